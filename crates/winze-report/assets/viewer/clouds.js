// The clouds in the scene: the map, the query where it is shown, and faintly where else it could be.

function makeClouds(stage, scene) {
    const mapTiles = tilesOf(scene.map);
    const queryTiles = tilesOf(scene.query);
    const materials = {
        map: pointMaterial(stage.shared, { size: 1.7 * scene.map.spacing, bias: 0, colour: new THREE.Vector3() }),
        query: pointMaterial(stage.shared, { size: 1.9 * scene.query.spacing, bias: 0.3, colour: new THREE.Vector3() }),
        ghost: pointMaterial(stage.shared, { size: 1.7 * scene.query.spacing, bias: 0.15, colour: new THREE.Vector3() }),
    };
    const cloud = (tiles, edge, material) => {
        const group = new THREE.Group();
        for (const t of tiles) {
            const points = new THREE.Points(t.geometry, material);
            points.position.set(...t.low);
            points.scale.setScalar(edge);
            // In tiles of [0, 1]³ bounds are known beforehand.
            t.geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(0.5, 0.5, 0.5), 0.8661);
            group.add(points);
        }
        return group;
    };
    const map = cloud(mapTiles, scene.map.edge, materials.map);
    const query = cloud(queryTiles, scene.query.edge, materials.query);
    query.matrixAutoUpdate = false;
    const ghosts = scene.places.map((place) => {
        if (!place.rival && place.index !== 0) return null;
        const ghost = cloud(queryTiles, scene.query.edge, materials.ghost);
        ghost.matrixAutoUpdate = false;
        ghost.matrix.copy(matrixOf(placementOf(place)));
        ghost.visible = false;
        stage.clouds.add(ghost);
        return ghost;
    });
    stage.clouds.add(map, query);
    const residuals = scene.colours ? scene.colours.places.map(() => null) : [];
    return {
        materials,
        map,
        query,
        ghosts,
        mapSample: sampleOf(mapTiles, scene.map.edge, 4000).map((p) => new THREE.Vector3(...p)),
        // About the query's centroid, in its own axes.
        sample: inBall(sampleOf(queryTiles, scene.query.edge, 2000)).map((p) => new THREE.Vector3(...p)),
        // Colours the query by how far it lies off the map at a place.
        colourBy(place) {
            if (!residuals.length) return;
            residuals[place] = residuals[place] || bytesOf(scene.colours.places[place]);
            for (const t of queryTiles) {
                const own = residuals[place].subarray(t.first, t.first + t.count);
                t.geometry.setAttribute('residual', new THREE.BufferAttribute(own, 1, true));
            }
        },
    };
}

// A pose of the query as what can be blended: where its centroid lies and how it is turned.
function placementOf(place) {
    const r = place.turn;
    const m = new THREE.Matrix4().set(
        r[0][0], r[0][1], r[0][2], 0,
        r[1][0], r[1][1], r[1][2], 0,
        r[2][0], r[2][1], r[2][2], 0,
        0, 0, 0, 1,
    );
    return { at: new THREE.Vector3(...place.at), turn: new THREE.Quaternion().setFromRotationMatrix(m) };
}

function matrixOf(placement) {
    return new THREE.Matrix4().compose(placement.at, placement.turn, new THREE.Vector3(1, 1, 1));
}

function blend(from, to, t) {
    return { at: from.at.clone().lerp(to.at, t), turn: from.turn.clone().slerp(to.turn, t) };
}
