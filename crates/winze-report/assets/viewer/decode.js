// What the page carries: the scene as JSON, its long arrays as base64.

function readScene(id) {
    const element = document.getElementById(id);
    return element ? JSON.parse(element.textContent) : null;
}

function bytesOf(base64) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
    const text = atob(base64);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return bytes;
}

// A packed cloud as tiles: each a geometry in [0, 1]³ that a matrix of its own stretches to `edge` metres.
function tilesOf(packed) {
    const bytes = bytesOf(packed.points);
    const steps = new Uint16Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 2);
    let first = 0;
    return packed.tiles.map((tile) => {
        const geometry = new THREE.BufferGeometry();
        const own = steps.subarray(3 * first, 3 * (first + tile.count));
        geometry.setAttribute('position', new THREE.BufferAttribute(own, 3, true));
        const here = { geometry, low: tile.low, first, count: tile.count, steps: own };
        first += tile.count;
        return here;
    });
}

// Every so many-th point of a packed cloud, metres from where it counts from.
function sampleOf(tiles, edge, most) {
    const all = tiles.reduce((n, t) => n + t.count, 0);
    const stride = Math.max(1, Math.ceil(all / most));
    const points = [];
    for (const t of tiles) {
        for (let i = 0; i < t.count; i += stride) {
            points.push([0, 1, 2].map((a) => t.low[a] + (t.steps[3 * i + a] / 65535) * edge));
        }
    }
    return points;
}

// Middle and radius of a ball that holds all but the outermost points.
function ballOf(points) {
    if (points.length === 0) return { at: new THREE.Vector3(), radius: 1 };
    const middle = [0, 1, 2].map((a) => {
        const v = points.map((p) => p[a]).sort((x, y) => x - y);
        const skip = Math.floor(v.length / 200);
        return (v[skip] + v[v.length - 1 - skip]) / 2;
    });
    const far = points
        .map((p) => Math.hypot(p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]))
        .sort((x, y) => x - y);
    const radius = far[Math.floor(0.99 * (far.length - 1))];
    return { at: new THREE.Vector3(...middle), radius: Math.max(radius, 0.5) };
}
