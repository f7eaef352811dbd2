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

// All but the outermost hundredth of points about zero: strays must not decide what is looked at.
function inBall(points) {
    const far = points.map((p) => Math.hypot(...p)).sort((a, b) => a - b);
    const radius = far[Math.floor(0.99 * (far.length - 1))];
    return points.filter((p) => Math.hypot(...p) <= radius);
}
