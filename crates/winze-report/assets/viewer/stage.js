// The canvas: renderer, camera, what is in sight, and when to draw.

const VIEW_ANGLE = 45;

function makeStage(canvas) {
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    renderer.autoClear = false;
    const camera = new THREE.PerspectiveCamera(VIEW_ANGLE, 1, 0.1, 1000);
    camera.up.set(0, 0, 1);
    const controls = new THREE.OrbitControls(camera, canvas);
    controls.zoomToCursor = true;
    controls.zoomSpeed = 1.4;
    const shared = {
        perMetre: { value: 1 },
        pixelRatio: { value: 1 },
        cut: { value: 1e9 },
        fogNear: { value: 1 },
        fogFar: { value: 2 },
        background: { value: new THREE.Vector3() },
        ramp: { value: [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()] },
        offMap: { value: new THREE.Vector3() },
        fineAt: { value: 0.33 },
        darkest: { value: 0.35 },
    };
    const stage = {
        renderer,
        camera,
        controls,
        shared,
        clouds: new THREE.Scene(),
        marks: new THREE.Scene(),
        extent: 100,
        onDraw: [],
        drawn: 0,
        waiting: false,
        animation: null,
    };
    const target = new THREE.WebGLRenderTarget(1, 1, {
        minFilter: THREE.NearestFilter,
        magFilter: THREE.NearestFilter,
        depthTexture: new THREE.DepthTexture(1, 1, THREE.UnsignedIntType),
    });
    const light = lightMaterial(shared);
    light.uniforms.picture.value = target.texture;
    light.uniforms.depth.value = target.depthTexture;
    const screen = new THREE.Scene();
    const quad = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), light);
    quad.frustumCulled = false;
    screen.add(quad);
    const flat = new THREE.OrthographicCamera(-1, 1, 1, -1, 0, 1);

    function draw() {
        stage.waiting = false;
        const distance = camera.position.distanceTo(controls.target);
        camera.near = Math.max(distance / 100, 0.02);
        camera.far = distance + 4 * stage.extent;
        camera.updateProjectionMatrix();
        camera.updateMatrixWorld();
        const high = target.height;
        shared.perMetre.value = high / (2 * Math.tan((VIEW_ANGLE * Math.PI) / 360));
        shared.fogNear.value = 1.3 * distance;
        shared.fogFar.value = 6 * distance;
        light.uniforms.near.value = camera.near;
        light.uniforms.far.value = camera.far;
        renderer.setRenderTarget(target);
        renderer.clear();
        renderer.render(stage.clouds, camera);
        renderer.setRenderTarget(null);
        renderer.clear();
        renderer.render(screen, flat);
        renderer.clearDepth();
        renderer.render(stage.marks, camera);
        stage.drawn += 1;
        stage.onDraw.forEach((f) => f());
    }

    stage.ask = function () {
        if (stage.waiting) return;
        stage.waiting = true;
        requestAnimationFrame(draw);
    };

    stage.fit = function () {
        const box = canvas.parentElement.getBoundingClientRect();
        if (box.width < 1 || box.height < 1) return;
        const ratio = Math.min(window.devicePixelRatio || 1, 2);
        renderer.setPixelRatio(ratio);
        renderer.setSize(box.width, box.height, false);
        camera.aspect = box.width / box.height;
        target.setSize(Math.round(box.width * ratio), Math.round(box.height * ratio));
        light.uniforms.pixel.value.set((1.3 * ratio) / target.width, (1.3 * ratio) / target.height);
        shared.pixelRatio.value = ratio;
        stage.ask();
    };

    // Runs `step` from 0 to 1, at once where motion is not wanted.
    stage.animate = function (step, done) {
        cancelAnimationFrame(stage.animation);
        const still = matchMedia('(prefers-reduced-motion: reduce)').matches;
        if (still) {
            step(1);
            if (done) done();
            stage.ask();
            return;
        }
        const begun = performance.now();
        const next = (now) => {
            const t = Math.min(1, Math.max(0, (now - begun) / 550));
            step(t * t * (3 - 2 * t));
            stage.ask();
            if (t < 1) stage.animation = requestAnimationFrame(next);
            else if (done) done();
        };
        stage.animation = requestAnimationFrame(next);
    };

    // Where the camera stands, and what it looks at, to see points from a direction, with so much room around them.
    stage.standpoint = function (points, direction, room) {
        const back = direction.clone().normalize();
        const right = new THREE.Vector3(0, 0, 1).cross(back);
        if (right.length() < 1e-3) right.set(1, 0, 0);
        right.normalize();
        const up = back.clone().cross(right);
        const tanUp = Math.tan((VIEW_ANGLE * Math.PI) / 360) / room;
        const tanRight = tanUp * camera.aspect;
        const axes = [right, up, back];
        const low = [Infinity, Infinity, Infinity];
        const high = [-Infinity, -Infinity, -Infinity];
        const spread = points.map((p) => axes.map((a) => a.dot(p)));
        spread.forEach((s) => s.forEach((v, i) => {
            low[i] = Math.min(low[i], v);
            high[i] = Math.max(high[i], v);
        }));
        const middle = low.map((v, i) => (v + high[i]) / 2);
        const far = spread.map((s) => {
            const [r, u, b] = s.map((v, i) => v - middle[i]);
            return Math.max(Math.abs(r) / tanRight, Math.abs(u) / tanUp) + b;
        });
        const distance = Math.max(far.reduce((a, b) => Math.max(a, b), 0), 1);
        const target = new THREE.Vector3();
        axes.forEach((a, i) => target.addScaledVector(a, middle[i]));
        return { target, eye: back.multiplyScalar(distance).add(target) };
    };

    controls.addEventListener('change', stage.ask);
    // What a graphics card has forgotten is drawn anew.
    canvas.addEventListener('webglcontextrestored', stage.ask);
    const resized = new ResizeObserver(stage.fit);
    resized.observe(canvas.parentElement);
    stage.end = function () {
        resized.disconnect();
        controls.dispose();
        renderer.dispose();
        renderer.forceContextLoss();
    };
    return stage;
}

// Turns the camera about its target by angles in radians.
function turnCamera(stage, around, over) {
    const { camera, controls } = stage;
    const arm = camera.position.clone().sub(controls.target);
    const flat = Math.hypot(arm.x, arm.y);
    const heading = Math.atan2(arm.y, arm.x) + around;
    const lift = Math.max(-1.55, Math.min(1.55, Math.atan2(arm.z, flat) + over));
    const length = arm.length();
    arm.set(length * Math.cos(lift) * Math.cos(heading), length * Math.cos(lift) * Math.sin(heading), length * Math.sin(lift));
    camera.position.copy(controls.target).add(arm);
    controls.update();
    stage.ask();
}

function zoomCamera(stage, factor) {
    const { camera, controls } = stage;
    const arm = camera.position.clone().sub(controls.target).multiplyScalar(factor);
    camera.position.copy(controls.target).add(arm);
    controls.update();
    stage.ask();
}

// Moves the camera sideways and up, in shares of its distance.
function shiftCamera(stage, right, up) {
    const { camera, controls } = stage;
    const length = camera.position.distanceTo(controls.target);
    const way = new THREE.Vector3(right * length, up * length, 0).applyQuaternion(camera.quaternion);
    camera.position.add(way);
    controls.target.add(way);
    controls.update();
    stage.ask();
}
