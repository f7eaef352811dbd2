// What is drawn about the query: the patches of wall that were asked, open directions, the 95 % ellipsoid.

function basic(colour, opacity) {
    return new THREE.MeshBasicMaterial({
        color: colour,
        transparent: true,
        opacity,
        depthTest: false,
        depthWrite: false,
        side: THREE.DoubleSide,
    });
}

// An arrow both ways along a direction that the query can slide along, or a ring about one that it can turn about.
function openMark(open, reach, material) {
    const group = new THREE.Group();
    const thick = 0.012 * reach;
    const along = new THREE.Vector3(...open.direction).normalize();
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
    const add = (geometry, y) => {
        const mesh = new THREE.Mesh(geometry, material);
        mesh.position.y = y;
        group.add(mesh);
        return mesh;
    };
    if (open.kind === 'translation') {
        add(new THREE.CylinderGeometry(thick, thick, 2 * reach, 12), 0);
        add(new THREE.ConeGeometry(4.5 * thick, 12 * thick, 20), reach);
        add(new THREE.ConeGeometry(4.5 * thick, 12 * thick, 20), -reach).rotation.x = Math.PI;
    } else {
        add(new THREE.CylinderGeometry(0.6 * thick, 0.6 * thick, 1.2 * reach, 12), 0);
        const ring = 0.5 * reach;
        add(new THREE.TorusGeometry(ring, thick, 10, 60, 1.75 * Math.PI), 0).rotation.x = Math.PI / 2;
        const tip = add(new THREE.ConeGeometry(4 * thick, 10 * thick, 20), 0);
        tip.position.x = ring;
        tip.rotation.x = -Math.PI / 2;
    }
    group.quaternion.copy(turn);
    return group;
}

function ellipsoidMark(ellipsoid, material) {
    const group = new THREE.Group();
    const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 40, 24), material);
    const wire = new THREE.Mesh(
        new THREE.SphereGeometry(1, 16, 8),
        new THREE.MeshBasicMaterial({ color: material.color, wireframe: true, depthTest: false, transparent: true, opacity: 0.75 }),
    );
    group.add(ball, wire);
    const [x, y, z] = ellipsoid.axes.map((a) => new THREE.Vector3(...a));
    const turn = new THREE.Matrix4().makeBasis(x, y, x.clone().cross(y));
    group.quaternion.setFromRotationMatrix(turn);
    group.userData.size = (factor) => {
        const [a, b, c] = ellipsoid.half.map((h) => Math.max(h * factor, 1e-4));
        group.scale.set(a, b, c);
        return Math.max(a, b, c);
    };
    return group;
}

// How far an ellipsoid reaches along a direction, metres.
function reachOf(ellipsoid, direction) {
    const d = direction.clone().normalize();
    return Math.hypot(...ellipsoid.axes.map((a, i) => ellipsoid.half[i] * d.dot(new THREE.Vector3(...a))));
}

// A length as people say it.
function metresOf(metres) {
    if (metres < 1) return `${Math.max(1, Math.round(100 * metres))} cm`;
    return `${metres.toFixed(metres < 10 ? 1 : 0)} m`;
}

// A round number by which the ellipsoid must be drawn larger to be seen in a ball of some radius.
function exaggeration(ellipsoid, radius) {
    const half = Math.max(...ellipsoid.half, 1e-9);
    const wanted = (0.05 * radius) / half;
    return wanted <= 1.5 ? 1 : 10 ** Math.round(Math.log10(wanted));
}

const DISC_SIDES = 14;

// The patches as discs on the walls, in the query's axes.
function patchMark(patches, material) {
    const n = patches.at.length;
    const corners = new Float32Array(n * DISC_SIDES * 9);
    const geometry = new THREE.BufferGeometry();
    let at = 0;
    const put = (v) => {
        corners.set([v.x, v.y, v.z], at);
        at += 3;
    };
    for (const [x, y, z, nx, ny, nz] of patches.at) {
        const centre = new THREE.Vector3(x, y, z);
        const normal = new THREE.Vector3(nx, ny, nz);
        const side = Math.abs(nz) < 0.9 ? new THREE.Vector3(0, 0, 1) : new THREE.Vector3(1, 0, 0);
        const u = normal.clone().cross(side).normalize().multiplyScalar(0.44 * patches.size);
        const v = normal.clone().cross(u);
        const rim = (i) => {
            const a = (i / DISC_SIDES) * 2 * Math.PI;
            return centre.clone().addScaledVector(u, Math.cos(a)).addScaledVector(v, Math.sin(a));
        };
        for (let i = 0; i < DISC_SIDES; i++) {
            put(centre);
            put(rim(i));
            put(rim(i + 1));
        }
    }
    geometry.setAttribute('position', new THREE.BufferAttribute(corners, 3));
    const colours = new THREE.BufferAttribute(new Float32Array(corners.length), 3);
    geometry.setAttribute('discColour', colours);
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    // `answers`: a letter a patch.
    mesh.userData.show = (answers, palette) => {
        mesh.visible = Boolean(answers);
        if (!answers) return;
        for (let i = 0; i < n; i++) {
            const c = palette[answers[i]];
            for (let k = 0; k < DISC_SIDES * 3; k++) colours.setXYZ(i * DISC_SIDES * 3 + k, c.x, c.y, c.z);
        }
        colours.needsUpdate = true;
    };
    return mesh;
}
