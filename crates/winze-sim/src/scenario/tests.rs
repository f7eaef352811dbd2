use super::*;

const SMALL: &str = r#"
    name = "small"
    [[mine]]
    name = "one"
    world = { kind = "drifts", length = 60.0, cell = 0.3 }
    [mine.map]
    sensor = { preset = "vlp16" }
    [[mine.query]]
    name = "clean"
    sensors = [{ preset = "vlp16" }, { preset = "d457" }]
    count = 3
    [[mine.query]]
    name = "dusty"
    sensors = [{ preset = "vlp16" }]
    dust = { extinction = 0.1 }
"#;

#[test]
fn a_scenario_is_read_with_its_defaults() {
    let s = Scenario::parse(SMALL, "small.toml").unwrap();
    assert_eq!((s.mines.len(), s.cases()), (1, 4));
    let q = &s.mines[0].queries[1];
    assert_eq!((q.count, q.voxel, q.length), (1, 0.05, [5.0, 60.0]));
    let mut few = s.clone();
    few.limit(1);
    assert_eq!(few.cases(), 2);
    let written = toml::to_string(&s).unwrap();
    assert_eq!(Scenario::parse(&written, "again").unwrap(), s);
}

#[test]
fn errors_name_place_line_and_key() {
    for (from, to, words) in [
        (
            "count = 3",
            "cuont = 3",
            &["small.toml", "cuont", "line 11"][..],
        ),
        ("extinction", "extintion", &["extintion"]),
        ("0.1 }", "-0.1 }", &["one", "dusty", "extinction"]),
        ("cell = 0.3", "cel = 0.3", &["cel"]),
        ("\"vlp16\" }, {", "\"vlp17\" }, {", &["vlp17"]),
        ("count = 3", "count = -3", &["count"]),
        ("count = 3", "voxel = 0.0", &["voxel"]),
        ("count = 3", "place = \"border\"", &["leave_out"]),
        ("count = 3", "asks_in = \"two\"", &["two"]),
        ("name = \"dusty\"", "name = \"clean\"", &["clean"]),
        ("count = 3", "length = [50, 5]", &["length"]),
        ("count = 3", "mapped_share = [0.5, 0.1]", &["mapped_share"]),
        ("count = 3", "mapped_share = [0.1, 0.2]", &["border"]),
        ("count = 3", "via = [[0.0, 0.0, 1.0]]", &["via"]),
        (
            "count = 3",
            "through = [[0.0, 0.0, 1.0], [9e4, 0.0, 1.0]]",
            &["60 km"],
        ),
        (
            "count = 3",
            "later_mesh = \"b.ply\"",
            &["later_mesh", "made"],
        ),
        ("count = 3", "sensors = []", &["sensors"]),
        ("world = {", "mesh = \"a.ply\"\nworld = {", &["mesh"]),
        ("[mine.map]", "[mine.mep]", &["mep"]),
        ("[[mine]]", "[[mine", &["small.toml"]),
    ] {
        let text = SMALL.replace(from, to);
        assert_ne!(text, SMALL, "{from}");
        let e = Scenario::parse(&text, "small.toml")
            .unwrap_err()
            .to_string();
        for word in words {
            assert!(e.contains(word), "{to}: {e}");
        }
        assert!(!e.contains('\n'), "{e}");
    }
}

#[test]
fn an_unknown_name_tells_what_there_is() {
    let e = Scenario::open("pepar").unwrap_err().to_string();
    assert!(e.contains("paper") && e.contains("pepar"), "{e}");
}

/// A wall and a short drift, with few rays: soon done.
const TINY: &str = r#"
    name = "tiny"
    [[mine]]
    name = "wall"
    world = { kind = "wall", width = 8.0, height = 3.0, cell = 0.2, roughness = 0.3 }
    [mine.map]
    sensor = { preset = "d457", width = 60, height = 40 }
    motion = { scan_every = 1.0, mount = [90.0, 0.0, 0.0] }
    through = [[[1.0, -3.0, 1.5], [7.0, -3.0, 1.5]]]
    origin = [432100.0, 5400000.0, 812.5]
    [[mine.query]]
    name = "exact"
    sensors = [{ preset = "l515", width = 60, height = 40 }]
    motion = { scan_every = 1.0, mount = [90.0, 0.0, 0.0] }
    through = [[2.0, -2.5, 1.5], [6.0, -2.5, 1.5]]
    count = 2
    away = 30.0
    [[mine.query]]
    name = "bent"
    sensors = [{ preset = "l515", width = 60, height = 40 }]
    motion = { scan_every = 0.5, mount = [90.0, 0.0, 0.0] }
    through = [[2.0, -2.5, 1.5], [6.0, -2.5, 1.5]]
    drift = { translation_percent = 3.0, heading_per_metre = 0.3, walk = 0.02, heading_walk = 0.5 }
    [[mine]]
    name = "mine"
    world = { kind = "drifts", length = 70.0, cell = 0.4, fittings = {} }
    [mine.map]
    sensor = { preset = "vlp16", shots_per_turn = 60 }
    leave_out = 0.4
    [[mine.query]]
    name = "border"
    sensors = [{ preset = "vlp16", shots_per_turn = 60 }]
    place = "border"
    length = [12.0, 12.0]
    [[mine.query]]
    name = "abroad"
    asks_in = "wall"
    sensors = [{ preset = "vlp16", shots_per_turn = 60 }]
    length = [5.0, 5.0]
"#;

/// Everything that a play makes.
fn play(seed: u64, threads: usize) -> (Vec<winze::Cloud>, Vec<MadeQuery>) {
    let scenario = Scenario::parse(TINY, "tiny").unwrap();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    let (mut maps, mut queries) = (Vec::new(), Vec::new());
    pool.install(|| {
        simulate(&scenario, seed, &|_| (), |made| {
            match made {
                Made::Map(map) => maps.push(map.cloud.clone()),
                Made::Query(query) => queries.push(*query),
                Made::Mesh { .. } => {}
            }
            Ok::<(), crate::Error>(())
        })
        .unwrap();
    });
    (maps, queries)
}

fn pose(matrix: [[f64; 4]; 4]) -> winze::Pose {
    winze::Pose::from_matrix(matrix).unwrap()
}

#[test]
fn truth_is_exact_without_drift_and_a_fit_with_it() {
    let (maps, queries) = play(3, 2);
    assert_eq!((maps.len(), queries.len()), (2, 5));
    for (i, q) in queries.iter().enumerate().take(3) {
        let truth = pose(q.case.truth.unwrap());
        // Where the sensor truly was is where the truth puts what odometry believed.
        let off = q
            .map_from_sensor
            .iter()
            .zip(&q.query_from_sensor)
            .map(|(map, query)| {
                truth
                    .compose(query)
                    .distance(map, [2.0, 0.0, 0.0])
                    .translation
            })
            .fold(0.0, f64::max);
        if i < 2 {
            assert!(off < 1e-6, "{}: {off}", q.case.name);
            assert_eq!(q.case.bend_rms_m, 0.0);
        } else {
            assert!(off > 0.005 && off < 0.5, "{off}");
            assert!(
                q.case.bend_rms_m > 0.002 && q.case.bend_rms_m < off,
                "{}",
                q.case.bend_rms_m
            );
        }
    }
    // Half of them level, each in a frame of its own; coordinates of the map are those of its origin.
    assert!(queries[0].case.gravity_aligned && !queries[1].case.gravity_aligned);
    let up = pose(queries[0].case.truth.unwrap()).rotate([0.0, 0.0, 1.0]);
    assert!((up[2] - 1.0).abs() < 1e-12);
    assert!((maps[0].centroid().unwrap()[1] - 5_400_000.0).abs() < 5.0);
}

#[test]
fn the_clouds_lie_where_the_truth_says() {
    let (maps, queries) = play(3, 2);
    let tree = winze::kdtree::KdTree::build(maps[0].points());
    for q in &queries[..2] {
        let truth = pose(q.case.truth.unwrap());
        let m = winze::metrics::inliers(&tree, maps[0].origin(), &q.cloud, &truth, 0.25);
        assert!(m.fraction > 0.9, "{}: {m:?}", q.case.name);
        assert!(q.case.overlap.unwrap() > 0.9, "{:?}", q.case.overlap);
    }
    let border = &queries[3].case;
    let overlap = border.overlap.unwrap();
    assert!(
        border.truth.is_some() && overlap > 0.02 && overlap < 0.95,
        "{overlap}"
    );
    let abroad = &queries[4].case;
    assert_eq!((abroad.truth, abroad.overlap), (None, None));
    assert_eq!(abroad.map, "maps/wall.pcd");
}

#[test]
fn the_same_bits_at_any_thread_count_and_others_for_another_seed() {
    let (a, b, c) = (play(3, 1), play(3, 3), play(4, 2));
    assert_eq!(a.0, b.0);
    for (x, y) in a.1.iter().zip(&b.1) {
        assert_eq!((&x.cloud, &x.case), (&y.cloud, &y.case));
    }
    assert_ne!(a.0, c.0);
    assert_ne!(a.1[0].cloud, c.1[0].cloud);
}

#[test]
fn lines_through_rock_and_walls_out_of_reach_are_errors() {
    for (line, words) in [
        ("[1.0, -90.0, 1.5]", "saw nothing"),
        ("[1.0, -3.0, 1.5], [3.0, 2.0, 1.5]", "meets rock"),
        ("[1.0, 1.5, 1.5], [3.0, 1.5, 1.5]", "begins in the rock"),
    ] {
        let lost = TINY.replace("[1.0, -3.0, 1.5], [7.0, -3.0, 1.5]", line);
        let scenario = Scenario::parse(&lost, "lost").unwrap();
        let e = simulate(&scenario, 1, &|_| (), |_| Ok::<(), crate::Error>(())).unwrap_err();
        assert!(e.to_string().contains(words), "{e}");
    }
}

/// A mine from a mesh that was scanned again later: what is asked is where the query lies, not whether.
#[test]
fn a_later_mesh_of_the_same_mine_keeps_the_truth() {
    let folder = std::env::temp_dir().join(format!("winze_later_mesh_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    // On a survey grid, and the later scan reaches further: their medians are not the same.
    for (name, width) in [("before.obj", 8.0), ("after.obj", 12.0)] {
        let spec = WorldSpec::Wall(crate::world::Wall {
            width,
            height: 3.0,
            cell: 0.2,
            roughness: 0.3,
            ..Default::default()
        });
        let mesh = crate::world::build(&spec, 5, None, &|_| ()).unwrap().mesh;
        let mut text = String::new();
        for v in mesh.vertices() {
            let [x, y, z] = v.map(f64::from);
            text += &format!("v {} {} {}\n", x + 431_000.0, y + 5_400_000.0, z);
        }
        for t in mesh.triangles() {
            let [a, b, c] = t.map(|i| i + 1);
            text += &format!("f {a} {b} {c}\n");
        }
        std::fs::write(folder.join(name), text).unwrap();
    }
    let (before, _) = crate::mesh_file::read_mesh(&folder.join("before.obj")).unwrap();
    let (low, high) = before.bounds().unwrap();
    let middle = 0.5 * (f64::from(low[0]) + f64::from(high[0]));
    let (y, from, to) = (f64::from(low[1]) - 2.5, middle - 2.0, middle + 2.0);
    let text = format!(
        r#"
    name = "later"
    about = "test"
    [[mine]]
    name = "wall"
    mesh = "before.obj"
    [mine.map]
    sensor = {{ preset = "d457", width = 60, height = 40 }}
    motion = {{ scan_every = 1.0, mount = [90.0, 0.0, 0.0] }}
    through = [[[{from}, {y}, 1.5], [{to}, {y}, 1.5]]]
    [[mine.query]]
    name = "again"
    later_mesh = "after.obj"
    sensors = [{{ preset = "l515", width = 60, height = 40 }}]
    motion = {{ scan_every = 1.0, mount = [90.0, 0.0, 0.0] }}
    through = [[{from}, {y}, 1.5], [{to}, {y}, 1.5]]
    "#
    );
    let file = folder.join("later.toml");
    std::fs::write(&file, text).unwrap();
    let scenario = Scenario::open(file.to_str().unwrap()).unwrap();
    let (mut meshes, mut queries) = (Vec::new(), Vec::new());
    let played = simulate(&scenario, 1, &|_| (), |made| {
        match made {
            Made::Mesh {
                mesh, later, read, ..
            } => {
                let origin = read.map(|r| r.origin);
                meshes.push((later.map(ToOwned::to_owned), mesh.clone(), origin));
            }
            Made::Query(query) => queries.push(*query),
            Made::Map(_) => {}
        }
        Ok::<(), crate::Error>(())
    });
    std::fs::remove_dir_all(&folder).unwrap();
    played.unwrap();
    assert_eq!(meshes.len(), 2);
    assert_eq!(
        (meshes[0].0.as_deref(), meshes[1].0.as_deref()),
        (None, Some("again"))
    );
    assert_ne!(meshes[0].1, meshes[1].1);
    assert_eq!(meshes[0].2, meshes[1].2, "one frame");
    assert!(meshes[0].2.unwrap()[0] > 400_000.0);
    let case = &queries[0].case;
    assert!(
        case.truth.is_some() && case.overlap.unwrap() > 0.9,
        "{case:?}"
    );
}
