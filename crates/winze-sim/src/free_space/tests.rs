use winze::vec3::norm;

use super::*;
use crate::mesh::{Material, Mesh, Part};

const ROBOT: Robot = Robot {
    radius: 0.4,
    height: 0.6,
};

/// Triangles of boxes, each given by two corners; `keep` chooses among the triangles.
fn boxes(boxes: &[[[f32; 3]; 2]], keep: impl Fn(usize, &mut [u32; 3]) -> bool) -> Caster {
    let sides = [
        [0u32, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for [low, high] in boxes {
        let first = vertices.len() as u32;
        for i in 0..8usize {
            let pick = |a: usize| if i >> a & 1 == 1 { high[a] } else { low[a] };
            vertices.push([pick(0), pick(1), pick(2)]);
        }
        for s in sides {
            for t in [[s[0], s[1], s[2]], [s[0], s[2], s[3]]] {
                triangles.push(t.map(|i| first + i));
            }
        }
    }
    let mut i = 0;
    triangles.retain_mut(|t| {
        i += 1;
        keep(i - 1, t)
    });
    let part = Part {
        name: "rock".into(),
        material: Material::ROCK,
        new: false,
    };
    Caster::new(Mesh::of(part, &vertices, &triangles).unwrap().0).unwrap()
}

/// Two rooms of 10 m x 8 m with a pillar each; wound so that the inside is the front.
fn hall() -> Caster {
    boxes(
        &[
            [[0.0, 0.0, 0.0], [20.0, 8.0, 3.0]],
            [[9.0, -1.0, -1.0], [10.0, 6.0, 4.0]],
            [[4.0, 3.0, -1.0], [5.0, 5.0, 4.0]],
        ],
        |_, _| true,
    )
}

fn length(way: &[[f64; 3]]) -> f64 {
    way.windows(2).map(|w| distance(w[0], w[1])).sum()
}

/// Points are evenly spaced, in the open, and nothing lies between them.
fn check(free: &FreeSpace<'_>, way: &[[f64; 3]]) {
    for w in way.windows(2) {
        assert!(distance(w[0], w[1]) < 0.4, "{w:?}");
        assert!(free.is_open(w[0], w[1]));
        assert!(free.caster.nearest(w[1], 0.5 * ROBOT.clearance()).is_none());
    }
}

#[test]
fn places_of_a_hall_are_on_its_floor_and_clear_of_its_walls() {
    let hall = hall();
    let free = FreeSpace::measure(&hall, &ROBOT).unwrap();
    assert_eq!(free.cell(), 0.5);
    // The floor without margins of 0.4 m: 148 m² less wall and pillar, four places a square metre.
    let area = 19.2 * 7.2 - 1.8 * 6.4 - 1.8 * 2.8;
    let n = free.places().len() as f64;
    assert!((n / (4.0 * area) - 1.0).abs() < 0.1, "{n} {area}");
    for p in free.places() {
        assert!((p[2] - 0.6).abs() < 1e-9, "{p:?}");
        assert!(hall.nearest(*p, 0.4).is_none());
        assert!(free.is_free(*p));
        assert_eq!(free.nearest_place(*p), *p);
    }
    let mut rng = Rng::new(5, 0);
    let (a, b) = (free.random_place(&mut rng), free.random_place(&mut rng));
    assert!(a != b && free.places().contains(&a));
    for outside in [
        [9.5, 3.0, 0.6],
        [0.1, 4.0, 0.6],
        [-3.0, 4.0, 0.6],
        [10.0, 7.0, 8.0],
        [f64::NAN; 3],
    ] {
        assert!(!free.is_free(outside), "{outside:?}");
    }
}

#[test]
fn ways_go_around_walls_through_the_middle() {
    let hall = hall();
    let free = FreeSpace::measure(&hall, &ROBOT).unwrap();
    let (from, to) = ([1.0, 1.0, 0.6], [18.0, 1.0, 0.6]);
    let way = free.path(from, to).unwrap();
    check(&free, &way);
    assert_eq!((way[0], way[way.len() - 1]), (from, to));
    let shortest = 2.0 * f64::hypot(8.0, 5.4) + 1.0;
    let way_length = length(&way);
    assert!(
        way_length > shortest && way_length < 1.35 * shortest,
        "{way_length} {shortest}"
    );
    // No corner is sharper than 45 degrees from one step to the next.
    for w in way.windows(3).skip(2) {
        let (u, v) = (sub(w[1], w[0]), sub(w[2], w[1]));
        assert!(winze::vec3::dot(u, v) > 0.7 * norm(u) * norm(v), "{w:?}");
    }
    for bad in [[9.5, 3.0, 0.6], [0.1, 1.0, 0.6], [1.0, 1.0, 9.0]] {
        let e = free.path(bad, to).unwrap_err().to_string();
        assert!(e.contains("the way starts at"), "{e}");
        let e = free.path(from, bad).unwrap_err().to_string();
        assert!(e.contains("the way ends at"), "{e}");
    }
    assert_eq!(free.path(from, from).unwrap().len(), 2);
}

#[test]
fn drives_have_about_the_length_asked_for_or_all_there_is() {
    let hall = hall();
    let free = FreeSpace::measure(&hall, &ROBOT).unwrap();
    let mut rng = Rng::new(1, 0);
    for asked in [2.0, 6.0, 12.0] {
        let way = free.wander([1.0, 1.0, 0.6], asked, &mut rng).unwrap();
        check(&free, &way);
        let got = length(&way);
        assert!(
            got > 0.85 * asked && got < 1.2 * asked + 0.5,
            "{asked} {got}"
        );
    }
    let all = length(&free.wander([1.0, 1.0, 0.6], 500.0, &mut rng).unwrap());
    assert!(all > 18.0 && all < 40.0, "{all}");
    assert!(free.wander([1.0, 1.0, 0.6], -1.0, &mut rng).is_err());
    assert!(free.wander([9.5, 1.0, 0.6], 5.0, &mut rng).is_err());
    let same = |seed| {
        let mut rng = Rng::new(seed, 0);
        free.wander([1.0, 1.0, 0.6], 9.0, &mut rng).unwrap()
    };
    assert_eq!(same(3), same(3));
    assert_ne!(same(3), same(4));
}

#[test]
fn a_tour_passes_near_every_place() {
    let hall = hall();
    let free = FreeSpace::measure(&hall, &ROBOT).unwrap();
    let legs = free.tour(3.0).unwrap();
    legs.iter().for_each(|leg| check(&free, leg));
    for p in free.places() {
        let near = legs.iter().flatten().any(|q| distance(*p, *q) < 4.0);
        assert!(near, "{p:?}");
    }
    assert!(legs.len() < 12, "{}", legs.len());
    assert!(free.tour(0.1).is_err());
}

#[test]
fn a_shell_a_roofless_plan_flips_and_holes_do_not_change_what_is_inside() {
    let count = |c: &Caster| FreeSpace::measure(c, &ROBOT).unwrap().places().len();
    let closed = boxes(&[[[0.0, 0.0, 0.0], [12.0, 8.0, 3.0]]], |_, _| true);
    let n = count(&closed);
    // A shell around it, whose top is larger; wound the other way, so that rock lies between.
    let two = [
        [[0.0, 0.0, 0.0], [12.0, 8.0, 3.0]],
        [[-2.0, -2.0, -4.0], [14.0, 10.0, 6.0]],
    ];
    let shell = boxes(&two, |i, t| {
        if i >= 12 {
            t.swap(0, 1);
        }
        true
    });
    let inside = FreeSpace::measure(&shell, &ROBOT).unwrap();
    for p in inside.places() {
        assert!((p[2] - 0.6).abs() < 1e-9, "{p:?}");
    }
    let roofless = boxes(&two[..1], |i, _| !(2..4).contains(&i));
    assert!(count(&roofless).abs_diff(n) < n / 20);
    let flipped = boxes(&two[..1], |i, t| {
        if i % 3 == 0 {
            t.swap(0, 1);
        }
        true
    });
    assert_eq!(count(&flipped), n);
    // Half of a wall and half of the roof missing.
    let holes = boxes(&two[..1], |i, _| i != 3 && i != 8);
    assert!(count(&holes).abs_diff(n) < n / 10, "{} {n}", count(&holes));
}

#[test]
fn where_no_robot_fits_it_says_so() {
    let refused = |c: &Caster, robot: &Robot| match FreeSpace::measure(c, robot) {
        Err(e) => e.to_string(),
        Ok(f) => panic!("{} places", f.places().len()),
    };
    let low = boxes(&[[[0.0, 0.0, 0.0], [12.0, 8.0, 0.5]]], |_, _| true);
    refused(&low, &ROBOT);
    let hall = hall();
    let big = Robot {
        radius: 5.0,
        height: 7.0,
    };
    refused(&hall, &big);
    for bad in [f64::NAN, 0.0, -1.0] {
        let robot = Robot {
            radius: bad,
            ..ROBOT
        };
        assert!(refused(&hall, &robot).contains("robot.radius"));
    }
    // Solid soup, and a lone plate in the open.
    let mut rng = Rng::new(2, 0);
    let soup: Vec<[[f32; 3]; 2]> = (0..3000)
        .map(|_| {
            let low: [f32; 3] = std::array::from_fn(|_| rng.range(0.0, 10.0) as f32);
            [low, low.map(|v| v + 1.0)]
        })
        .collect();
    refused(&boxes(&soup, |_, _| true), &ROBOT);
    let plate = boxes(&[[[0.0, 0.0, 0.0], [30.0, 30.0, 0.1]]], |_, _| true);
    assert!(refused(&plate, &ROBOT).contains("not enclosed"));
}

#[test]
fn places_do_not_depend_on_threads() {
    let hall = hall();
    let measure = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| FreeSpace::measure(&hall, &ROBOT).unwrap())
    };
    let (one, three) = (measure(1), measure(3));
    assert_eq!(one.places(), three.places());
    assert_eq!(one.links, three.links);
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the worlds of WINZE_DATA")]
fn real_worlds_have_room() {
    let root = std::env::var_os("WINZE_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        Into::into,
    );
    for (file, least) in [
        ("worlds/edgar_section_03.ply", 300),
        ("worlds/lava_tube.ply", 300),
        ("worlds/edgar_plan_roofless.ply", 3000),
        ("worlds/rough_tunnel_tiles.ply", 1000),
        ("worlds/tunnel_practice_1.ply", 5000),
        ("gazebo_tunnel/world.ply", 2000),
        ("worlds/cave_01.ply", 20_000),
    ] {
        let (mesh, _) = crate::mesh_file::read_mesh(&root.join(file)).unwrap();
        let start = std::time::Instant::now();
        let caster = Caster::new(mesh).unwrap();
        let built = start.elapsed();
        let free = FreeSpace::measure(&caster, &ROBOT).unwrap();
        let measured = start.elapsed();
        let n = free.places().len();
        let from = free.places()[n / 2];
        let way = free.wander(from, 80.0, &mut Rng::new(1, 0)).unwrap();
        println!(
            "{file}: {n} places, tree {built:.1?}, places {:.1?}, drive of {:.1} m {:.1?}",
            measured - built,
            length(&way),
            start.elapsed() - measured
        );
        check(&free, &way);
        assert!(n >= least, "{file}: {n}");
    }
}
