// What is shown: which place, before or after, which colours, how much of the roof; and how that is changed.

const SCHEMES = {
    dark: {
        background: '#0b0d12', map: '#8f6bb8', query: '#3ddc84', ghost: '#e0a02a',
        ramp: ['#17c27b', '#f2d43d', '#ff4b33'], offMap: '#4aa8ff',
        yes: '#27d07f', no: '#ff5a45', unasked: '#59606e', amber: '#ffb52e', sky: '#9fd0ff',
    },
    light: {
        background: '#f4f4f7', map: '#a58cc4', query: '#0f9d4f', ghost: '#d58a00',
        ramp: ['#0fa763', '#eab308', '#dc2f1c'], offMap: '#2f7fe0',
        yes: '#12a25c', no: '#d9301f', unasked: '#9aa0ad', amber: '#c97a00', sky: '#2563b8',
    },
};

function makeView(scene, canvas, layer) {
    const stage = makeStage(canvas);
    const clouds = makeClouds(stage, scene);
    const overlay = makeOverlay(stage, layer);
    const state = {
        place: scene.places.length ? 0 : -1,
        before: scene.places.length === 0,
        colouring: scene.colours ? 'residuals' : 'plain',
        cut: 1,
        factor: 1,
        map: true,
        scheme: null,
    };
    const listeners = [];
    const beforePlace = { at: new THREE.Vector3(...scene.before.at), turn: new THREE.Quaternion() };
    let now = beforePlace;
    const chosen = () => (state.before || state.place < 0 ? beforePlace : placementOf(scene.places[state.place]));

    const amber = basic('#ffb52e', 0.95);
    const sky = basic('#9fd0ff', 0.28);
    const about = new THREE.Group();
    stage.marks.add(about);
    const ball = ballOf(clouds.sample);
    scene.open.forEach((open) => about.add(openMark(open, 1.15 * ball.radius, amber)));
    const ellipsoid = scene.ellipsoid ? ellipsoidMark(scene.ellipsoid, sky) : null;
    if (ellipsoid) {
        state.factor = exaggeration(scene.ellipsoid, ball.radius);
        about.add(ellipsoid);
    }
    const patches = scene.patches ? patchMark(scene.patches, discMaterial(stage.shared, 0.5)) : null;
    if (patches) {
        patches.matrixAutoUpdate = false;
        stage.clouds.add(patches);
    }

    const atAnswer = () => !state.before && state.place === 0;
    scene.open.forEach((open) => {
        const d = new THREE.Vector3(...open.direction);
        const slides = open.kind === 'translation';
        overlay.tag('open', slides ? 'free to slide this way' : 'free to turn about this', () => d.clone().multiplyScalar((slides ? 0.75 : 0.6) * ball.radius).add(about.position), atAnswer);
    });
    scene.places.forEach((place, i) => {
        const lift = new THREE.Vector3(0, 0, 0.35 * ball.radius);
        const tag = overlay.tag(
            place.rival ? 'pin rival' : 'pin',
            `${place.index + 1}`,
            () => new THREE.Vector3(...place.at).add(lift),
            () => !state.before && scene.places.length > 1,
            () => view.choose(i),
        );
        listeners.push(() => tag.classList.toggle('chosen', i === state.place));
    });

    function put(placement) {
        now = placement;
        const m = matrixOf(placement);
        clouds.query.matrix.copy(m);
        clouds.query.matrixWorldNeedsUpdate = true;
        if (patches) {
            patches.matrix.copy(m);
            patches.matrixWorldNeedsUpdate = true;
        }
        stage.shared.cut.value = heightOfCut();
    }

    // Heights of the query at a placement.
    function heights(placement) {
        const m = matrixOf(placement);
        const v = new THREE.Vector3();
        const z = clouds.sample.map((p) => v.set(...p).applyMatrix4(m).z).sort((a, b) => a - b);
        return z.length ? [z[Math.floor(0.01 * z.length)], z[Math.floor(0.99 * (z.length - 1))]] : [0, 1];
    }

    function heightOfCut() {
        if (state.cut >= 1) return 1e9;
        const [low, high] = heights(now);
        return low + 0.05 + state.cut * (high - low);
    }

    function show() {
        const scheme = SCHEMES[state.scheme];
        const residuals = state.colouring === 'residuals' && !state.before && state.place >= 0;
        const asked = state.colouring === 'patches' && !state.before && patches;
        const m = clouds.materials;
        m.query.uniforms.mode.value = residuals ? 1 : 0;
        m.query.uniforms.colour.value = vectorOf(asked ? scheme.unasked : scheme.query);
        m.map.uniforms.colour.value = vectorOf(scheme.map);
        m.ghost.uniforms.colour.value = vectorOf(scheme.ghost);
        stage.shared.ramp.value = scheme.ramp.map(vectorOf);
        stage.shared.offMap.value = vectorOf(scheme.offMap);
        stage.shared.background.value = vectorOf(scheme.background);
        const [r, g, b] = stage.shared.background.value;
        stage.renderer.setClearColor(`rgb(${Math.round(255 * r)}, ${Math.round(255 * g)}, ${Math.round(255 * b)})`, 1);
        amber.color.set(scheme.amber);
        sky.color.set(scheme.sky);
        clouds.map.visible = state.map;
        clouds.ghosts.forEach((ghost, i) => {
            if (ghost) ghost.visible = !state.before && i !== state.place && scene.verdict === 'ambiguous';
        });
        about.visible = atAnswer();
        if (ellipsoid) ellipsoid.userData.size(state.factor);
        if (patches) {
            const answers = asked ? scene.patches.answers[state.place] : null;
            patches.userData.show(answers, { y: vectorOf(scheme.yes), n: vectorOf(scheme.no), '-': vectorOf(scheme.unasked) });
        }
        if (scene.colours) stage.shared.fineAt.value = scene.colours.fine / scene.colours.most;
        stage.shared.cut.value = heightOfCut();
        listeners.forEach((f) => f(state));
        stage.ask();
    }

    // The direction to look from: from above at a slant, across the query's long side.
    function slant() {
        const m = matrixOf(chosen());
        const v = new THREE.Vector3();
        let [xx, xy, yy] = [0, 0, 0];
        const middle = chosen().at;
        clouds.sample.forEach((p) => {
            v.set(...p).applyMatrix4(m).sub(middle);
            xx += v.x * v.x;
            xy += v.x * v.y;
            yy += v.y * v.y;
        });
        let across = 0.5 * Math.atan2(2 * xy, xx - yy) + Math.PI / 2;
        if (Math.sin(across) > 0) across += Math.PI;
        return new THREE.Vector3(Math.cos(across + 0.35), Math.sin(across + 0.35), 1.15);
    }

    function ballAt(placement) {
        return { at: ball.at.clone().applyMatrix4(matrixOf(placement)), radius: ball.radius };
    }

    // Everything that belongs in the picture for what is shown.
    function balls() {
        if (state.before) return [clouds.mapBall, ballAt(beforePlace)];
        const rivals = scene.verdict === 'ambiguous' ? scene.places.filter((p) => p.rival).map(placementOf) : [];
        return [chosen(), ...rivals].map(ballAt);
    }

    function around(all, wider) {
        const middle = new THREE.Vector3();
        all.forEach((b) => middle.addScaledVector(b.at, 1 / all.length));
        return { at: middle, radius: wider * Math.max(...all.map((b) => b.at.distanceTo(middle) + b.radius)) };
    }

    function look(target, direction, gently) {
        const { camera, controls } = stage;
        const from = { eye: camera.position.clone(), target: controls.target.clone() };
        const eye = stage.standpoint(target, direction);
        const step = (t) => {
            camera.position.lerpVectors(from.eye, eye, t);
            controls.target.lerpVectors(from.target, target.at, t);
            controls.update();
        };
        if (gently) stage.animate(step);
        else {
            step(1);
            stage.ask();
        }
    }

    // Moves the query to where it is shown now, and the camera, if asked, to see it.
    function go(then) {
        const [from, to] = [now, chosen()];
        const { camera, controls } = stage;
        const start = { eye: camera.position.clone(), target: controls.target.clone() };
        const direction = camera.position.clone().sub(controls.target);
        const target = around(balls(), then);
        const eye = stage.standpoint(target, direction);
        stage.animate((t) => {
            put(blend(from, to, t));
            camera.position.lerpVectors(start.eye, eye, t);
            controls.target.lerpVectors(start.target, target.at, t);
            controls.update();
        });
        about.position.copy(to.at);
    }

    const CLOSE = 1.12;
    const view = {
        stage,
        state,
        onChange: (f) => listeners.push(f),
        choose(i) {
            if (i < 0 || i >= scene.places.length) return;
            state.place = i;
            state.before = false;
            clouds.colourBy(i);
            show();
            go(CLOSE);
        },
        setBefore(before) {
            if (scene.places.length === 0) return;
            state.before = before;
            show();
            go(before ? 1.02 : CLOSE);
        },
        setColouring(colouring) {
            state.colouring = colouring;
            show();
        },
        setCut(cut) {
            state.cut = cut;
            show();
        },
        setFactor(factor) {
            state.factor = factor;
            show();
        },
        setMap(map) {
            state.map = map;
            show();
        },
        setScheme(scheme) {
            state.scheme = scheme;
            show();
        },
        nearQuery() {
            look(around(balls(), CLOSE), slant(), true);
        },
        wholeMap() {
            state.cut = 1;
            show();
            look(around([clouds.mapBall, ballAt(chosen())], 1.02), slant(), true);
        },
        fromAbove() {
            const { camera, controls } = stage;
            const radius = camera.position.distanceTo(controls.target) * Math.sin((VIEW_ANGLE * Math.PI) / 360) * Math.min(camera.aspect, 1);
            look({ at: controls.target.clone(), radius }, new THREE.Vector3(0, -0.001, 1), true);
        },
        // Height of the cut over the query's middle, metres; null where there is none.
        cutHeight: () => (state.cut >= 1 ? null : heightOfCut() - chosen().at.z),
        begin(scheme) {
            state.scheme = scheme;
            stage.extent = Math.max(clouds.mapBall.radius, 50) + new THREE.Vector3(...scene.before.at).length();
            if (state.place >= 0) clouds.colourBy(state.place);
            put(chosen());
            about.position.copy(chosen().at);
            stage.fit();
            show();
            look(around(balls(), CLOSE), slant(), false);
        },
    };
    return view;
}
