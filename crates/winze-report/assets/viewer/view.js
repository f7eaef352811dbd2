// What is shown: which place, before or after, which colours, how much of the roof; and how that is changed.

const SCHEMES = {
    dark: {
        background: '#0b0d12', darkest: 0.3, map: '#8f6bb8', query: '#3ddc84', ghost: '#e0a02a',
        ramp: ['#17c27b', '#f2d43d', '#ff4b33'], offMap: '#4aa8ff',
        yes: '#27d07f', no: '#ff5a45', unasked: '#59606e', amber: '#ffb52e', sky: '#9fd0ff',
    },
    light: {
        background: '#f4f4f7', darkest: 0.66, map: '#a58cc4', query: '#0f9d4f', ghost: '#d58a00',
        ramp: ['#10b46c', '#f0b400', '#dc2f1c'], offMap: '#2f7fe0',
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
    const radius = clouds.sample.reduce((r, p) => Math.max(r, p.length()), 0.5);
    scene.open.forEach((open) => about.add(openMark(open, 1.15 * radius, amber)));
    const ellipsoid = scene.ellipsoid ? ellipsoidMark(scene.ellipsoid, sky) : null;
    if (ellipsoid) {
        state.factor = exaggeration(scene.ellipsoid, radius);
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
        const far = slides && scene.ellipsoid ? `, ± ${metresOf(reachOf(scene.ellipsoid, d))}` : '';
        overlay.tag('open', slides ? `free to slide this way${far}` : 'free to turn about this', () => d.clone().multiplyScalar((slides ? 0.75 : 0.6) * radius).add(about.position), atAnswer);
    });
    if (ellipsoid) {
        const tag = overlay.tag('doubt', '', () => about.position, atAnswer);
        listeners.push(() => (tag.textContent = `95 % ellipsoid${scene.guess ? ' of place 1, a guess' : ''}${state.factor > 1 ? `, drawn ×${state.factor}` : ''}`));
    }
    scene.places.forEach((place, i) => {
        const [, top] = heights(placementOf(place));
        const lift = new THREE.Vector3(0, 0, top - place.at[2]);
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
        const z = clouds.sample.map((p) => v.copy(p).applyMatrix4(m).z).sort((a, b) => a - b);
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
        stage.shared.darkest.value = scheme.darkest;
        const [r, g, b] = stage.shared.background.value;
        stage.renderer.setClearColor(`rgb(${Math.round(255 * r)}, ${Math.round(255 * g)}, ${Math.round(255 * b)})`, 1);
        amber.color.set(scheme.amber);
        sky.color.set(scheme.sky);
        clouds.map.visible = state.map;
        clouds.ghosts.forEach((ghost, i) => {
            if (ghost) ghost.visible = !state.before && i !== state.place && scene.ghosts;
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

    // The direction to look at points from: from above at a slant, across their long side.
    function slant(points) {
        const middle = new THREE.Vector3();
        points.forEach((p) => middle.addScaledVector(p, 1 / points.length));
        let [xx, xy, yy] = [0, 0, 0];
        points.forEach((p) => {
            const [x, y] = [p.x - middle.x, p.y - middle.y];
            xx += x * x;
            xy += x * y;
            yy += y * y;
        });
        let across = 0.5 * Math.atan2(2 * xy, xx - yy) + Math.PI / 2;
        if (Math.sin(across) > 0) across += Math.PI;
        return new THREE.Vector3(Math.cos(across + 0.35), Math.sin(across + 0.35), 1.15);
    }

    function sampleAt(placement) {
        const m = matrixOf(placement);
        return clouds.sample.map((p) => p.clone().applyMatrix4(m));
    }

    // Everything that belongs in the picture for what is shown, and how much room around it.
    function subject() {
        if (state.before) return { points: clouds.mapSample.concat(sampleAt(beforePlace)), room: 1.08 };
        const rivals = scene.ghosts ? scene.places.filter((p) => p.rival).map(placementOf) : [];
        const all = [chosen(), ...rivals].map(sampleAt);
        return { points: all.flat(), room: rivals.length ? 1.3 : 1.45 };
    }

    // Moves the camera, and the query if it has to, at once or gently.
    function look({ points, room }, direction, gently, placement) {
        const { camera, controls } = stage;
        const from = { eye: camera.position.clone(), target: controls.target.clone(), query: now };
        const to = stage.standpoint(points, direction, room);
        const step = (t) => {
            if (placement) put(blend(from.query, placement, t));
            camera.position.lerpVectors(from.eye, to.eye, t);
            controls.target.lerpVectors(from.target, to.target, t);
            controls.update();
        };
        if (gently) stage.animate(step);
        else {
            step(1);
            stage.ask();
        }
    }

    // Moves the query to where it is shown now, and the camera to see it from the side that it looks from.
    function go() {
        about.position.copy(chosen().at);
        const direction = stage.camera.position.clone().sub(stage.controls.target);
        look(subject(), direction, true, chosen());
    }

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
            go();
        },
        setBefore(before) {
            if (scene.places.length === 0) return;
            state.before = before;
            show();
            go();
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
            look(subject(), slant(sampleAt(chosen())), true);
        },
        wholeMap() {
            state.cut = 1;
            show();
            const points = clouds.mapSample.concat(sampleAt(chosen()));
            look({ points, room: 1.08 }, slant(points), true);
        },
        fromAbove() {
            look(subject(), new THREE.Vector3(0, -0.001, 1), true);
        },
        // Height of the cut over the query's middle, metres; null where there is none.
        cutHeight: () => (state.cut >= 1 ? null : heightOfCut() - chosen().at.z),
        begin(scheme) {
            state.scheme = scheme;
            const all = clouds.mapSample.concat(sampleAt(beforePlace));
            stage.extent = all.reduce((r, p) => Math.max(r, p.length()), 50);
            if (state.place >= 0) clouds.colourBy(state.place);
            put(chosen());
            about.position.copy(chosen().at);
            stage.fit();
            show();
            look(subject(), slant(state.before ? subject().points : sampleAt(chosen())), false);
        },
    };
    return view;
}
