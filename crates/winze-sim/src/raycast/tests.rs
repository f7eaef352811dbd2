use winze::rng::Rng;

use super::*;
use crate::mesh::{Material, Part};

fn part() -> Part {
    Part {
        name: "rock".into(),
        material: Material::ROCK,
        new: false,
    }
}

fn caster(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Caster {
    Caster::new(Mesh::of(part(), vertices, triangles).unwrap().0).unwrap()
}

/// Triangles of many sizes around `centre`.
fn soup(n: usize, centre: [f64; 3], seed: u64) -> Caster {
    let mut rng = Rng::new(seed, 0);
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..u32::try_from(n).unwrap() {
        let at: [f64; 3] = std::array::from_fn(|a| centre[a] + rng.range(-20.0, 20.0));
        let size = libm::exp(rng.range(-4.0, 2.0));
        for _ in 0..3 {
            vertices.push(at.map(|v| (v + rng.range(-size, size)) as f32));
        }
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    caster(&vertices, &triangles)
}

/// A closed box of twelve triangles, wound every which way.
fn room() -> Caster {
    let vertices: Vec<[f32; 3]> = (0..8u8)
        .map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| if b == 1 { 1.5 } else { -1.5 }))
        .collect();
    let sides = [
        [0u32, 1, 3, 2],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 3, 7, 5],
    ];
    let triangles: Vec<[u32; 3]> = sides
        .iter()
        .flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]])
        .collect();
    caster(&vertices, &triangles)
}

/// The range by the plane's equation and the areas beside the edges, over all triangles.
fn brute_force(caster: &Caster, o: [f64; 3], d: [f64; 3], max_range: f64) -> Option<(f64, u32)> {
    let mut best: Option<(f64, u32)> = None;
    for i in 0..caster.mesh().triangles().len() {
        let [a, b, c] = caster.mesh().corners(i).unwrap().map(|v| v.map(f64::from));
        let n = cross(sub(b, a), sub(c, a));
        let t = dot(n, sub(a, o)) / dot(n, d);
        let p = add(o, scale(d, t));
        let sides = [[a, b], [b, c], [c, a]].map(|[p0, p1]| dot(n, cross(sub(p1, p0), sub(p, p0))));
        let inside = sides.iter().all(|s| *s >= 0.0);
        if inside && t > 0.0 && t <= max_range && best.is_none_or(|(r, _)| t < r) {
            best = Some((t, i as u32));
        }
    }
    best
}

#[test]
fn rays_through_soups_meet_what_brute_force_finds_near_the_origin_and_far_from_it() {
    for (far, seed) in [([0.0; 3], 1), ([5000.0, -30_000.0, 400.0], 2)] {
        let soup = soup(600, far, seed);
        let mut rng = Rng::new(seed, 1);
        let mut hits = 0;
        for i in 0..3000 {
            // From inside, and from far outside towards it.
            let inside: [f64; 3] = std::array::from_fn(|a| far[a] + rng.range(-20.0, 20.0));
            let d = rng.direction();
            let o = if i % 3 == 0 {
                sub(inside, scale(d, 1e5))
            } else {
                inside
            };
            let max = if i % 2 == 0 { f64::INFINITY } else { 12.0 };
            let found = soup.cast(o, d, max);
            let expected = brute_force(&soup, o, d, max);
            assert_eq!(
                found.map(|h| h.triangle),
                expected.map(|(_, t)| t),
                "ray {i}"
            );
            if let (Some(h), Some((range, _))) = (found, expected) {
                hits += 1;
                assert!((h.range - range).abs() < 1e-8, "{} {range}", h.range);
                assert!((norm(h.normal) - 1.0).abs() < 1e-12 && dot(h.normal, d) <= 0.0);
                let [a, b, c] = soup
                    .mesh()
                    .corners(h.triangle as usize)
                    .unwrap()
                    .map(|v| v.map(f64::from));
                assert!(dot(h.normal, sub(b, a)).abs() < 1e-9 * norm(sub(b, a)).max(1.0));
                assert!(dot(h.normal, sub(c, a)).abs() < 1e-9 * norm(sub(c, a)).max(1.0));
            }
        }
        assert!(hits > 500, "{hits}");
    }
}

#[test]
fn no_ray_leaves_a_closed_room_not_even_through_edges_and_corners() {
    let room = room();
    let mut rng = Rng::new(3, 0);
    for i in 0..20_000 {
        let o: [f64; 3] = std::array::from_fn(|_| rng.range(-1.4, 1.4));
        // Every third ray aims at an edge, every thirtieth at a corner.
        let mut aim: [f64; 3] = std::array::from_fn(|_| rng.range(-1.5, 1.5));
        let sign = |v: f64| if v < 0.0 { -1.5 } else { 1.5 };
        if i % 3 == 0 {
            (aim[0], aim[1]) = (sign(aim[0]), sign(aim[1]));
        }
        if i % 30 == 0 {
            aim[2] = sign(aim[2]);
        }
        let d = sub(aim, o);
        let d = scale(d, 1.0 / norm(d));
        let hit = room.cast(o, d, 100.0).expect("a closed room");
        let p = add(o, scale(d, hit.range));
        let wall = p.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!((wall - 1.5).abs() < 1e-12, "{p:?}");
    }
    // Along the diagonal of a wall, and along the axes.
    let hit = room.cast([0.0; 3], [1.0, 0.0, 0.0], 10.0).unwrap();
    assert_eq!((hit.range, hit.normal), (1.5, [-1.0, 0.0, 0.0]));
    // Two triangles tie: the first it is.
    let both = room.cast([0.0; 3], [0.0, 0.0, -1.0], 10.0).unwrap();
    assert_eq!((both.range, both.triangle), (1.5, 0));
}

#[test]
fn grazing_rays_keep_their_range_and_rays_in_the_plane_meet_nothing() {
    let wall = caster(
        &[
            [0.0, -500.0, 0.0],
            [1000.0, -500.0, 0.0],
            [1000.0, 500.0, 0.0],
            [0.0, 500.0, 0.0],
        ],
        &[[0, 1, 2], [0, 2, 3]],
    );
    for (height, reach) in [(1.0, 900.0), (0.01, 900.0), (1e-4, 990.0)] {
        let flat = f64::sqrt(reach * reach - height * height);
        let d = [flat / reach, 0.0, -height / reach];
        let hit = wall.cast([0.0, 1.0, height], d, 2000.0).unwrap();
        assert!(
            (hit.range - reach).abs() < 1e-6 * reach,
            "{height}: {}",
            hit.range
        );
    }
    assert_eq!(wall.cast([-5.0, 1.0, 0.0], [1.0, 0.0, 0.0], 2000.0), None);
    assert_eq!(wall.cast([10.0, 1.0, 1.0], [1.0, 0.0, 0.0], 2000.0), None);
}

#[test]
fn what_is_no_ray_meets_nothing() {
    let room = room();
    let x = [1.0, 0.0, 0.0];
    for (o, d, max) in [
        ([f64::NAN, 0.0, 0.0], x, 10.0),
        ([f64::INFINITY, 0.0, 0.0], x, 10.0),
        ([0.0; 3], [0.0; 3], 10.0),
        ([0.0; 3], [f64::NAN, 0.0, 1.0], 10.0),
        ([0.0; 3], [f64::INFINITY, 0.0, 1.0], 10.0),
        ([0.0; 3], x, 0.0),
        ([0.0; 3], x, -1.0),
        ([0.0; 3], x, f64::NAN),
        ([0.0; 3], x, 1.49),
        ([1e300, 1e300, 0.0], x, f64::INFINITY),
        ([2.0, 0.0, 0.0], x, f64::INFINITY),
    ] {
        assert_eq!(room.cast(o, d, max), None, "{o:?} {d:?} {max}");
    }
    assert!(room.cast([0.0; 3], x, 1.5).is_some(), "the range counts in");
    assert_eq!(
        room.cast([1.5, 0.0, 0.0], x, 10.0),
        None,
        "the wall it starts on"
    );
    assert!(room.cast([-1e6, 0.1, 0.0], x, f64::INFINITY).is_some());
    assert!(matches!(
        Caster::new(Mesh::default()),
        Err(Error::EmptyMesh { .. })
    ));
}

#[test]
fn holes_are_seen_through() {
    // The room without its second side.
    let full = room();
    let mut open = full.mesh().triangles().to_vec();
    open.drain(2..4);
    let open = caster(full.mesh().vertices(), &open);
    assert!(full.cast([0.0; 3], [0.0, 0.0, 1.0], 100.0).is_some());
    assert_eq!(open.cast([0.0; 3], [0.0, 0.0, 1.0], 100.0), None);
    // The outside is seen as well as the inside.
    let seen = open.cast([5.0, 0.2, 0.1], [-1.0, 0.0, 0.0], 100.0).unwrap();
    assert_eq!((seen.range, seen.normal), (3.5, [1.0, 0.0, 0.0]));
}

#[test]
fn the_nearest_point_is_that_of_brute_force() {
    for (far, seed) in [([0.0; 3], 4), ([5000.0, -30_000.0, 400.0], 5)] {
        let soup = soup(300, far, seed);
        let mut rng = Rng::new(seed, 1);
        for i in 0..1500 {
            let p: [f64; 3] = std::array::from_fn(|a| far[a] + rng.range(-40.0, 40.0));
            let within = if i % 2 == 0 { f64::INFINITY } else { 3.0 };
            let found = soup.nearest(p, within);
            // By many points on each triangle, which are never nearer.
            let mut least = f64::INFINITY;
            for t in 0..soup.mesh().triangles().len() {
                let corners = soup.mesh().corners(t).unwrap().map(|v| v.map(f64::from));
                let q = closest_point(p, corners);
                least = least.min(norm(sub(p, q)));
                let (mut s, mut r) = (rng.uniform(), rng.uniform());
                if s + r > 1.0 {
                    (s, r) = (1.0 - s, 1.0 - r);
                }
                let [a, b, c] = corners;
                let on = add(a, add(scale(sub(b, a), s), scale(sub(c, a), r)));
                assert!(norm(sub(p, on)) >= norm(sub(p, q)) - 1e-9);
            }
            match found {
                Some(n) => {
                    assert_eq!(n.distance, least);
                    assert!((norm(sub(p, n.point)) - least).abs() < 1e-12);
                    assert!(dot(n.normal, sub(p, n.point)) >= 0.0);
                }
                None => assert!(least > within),
            }
        }
    }
    let room = room();
    let n = room.nearest([0.0, 0.0, 1.0], 10.0).unwrap();
    assert_eq!(
        (n.distance, n.point, n.normal),
        (0.5, [0.0, 0.0, 1.5], [0.0, 0.0, -1.0])
    );
    assert_eq!(room.nearest([0.0, 0.0, 1.0], 0.4), None);
    assert_eq!(room.nearest([f64::NAN, 0.0, 1.0], 10.0), None);
    assert_eq!(room.nearest([0.0; 3], f64::NAN), None);
    assert!(room.nearest([1e6, 0.0, 0.0], f64::INFINITY).is_some());
    assert!(room.nearest([1.5, 0.2, 0.0], 1e-9).unwrap().distance < 1e-12);
}

#[test]
fn trees_over_one_two_and_many_equal_triangles() {
    let vertices = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    for n in [1, 2, 3, 5000] {
        let same = caster(&vertices, &vec![[0, 1, 2]; n]);
        let hit = same.cast([0.2, 0.2, 0.0], [0.0, 0.0, 1.0], 5.0).unwrap();
        assert_eq!((hit.range, hit.triangle), (1.0, 0));
        assert_eq!(same.cast([2.2, 0.2, 0.0], [0.0, 0.0, 1.0], 5.0), None);
        let nearest = same.nearest([0.2, 0.2, 3.0], 5.0).unwrap();
        assert_eq!((nearest.distance, nearest.triangle), (2.0, 0));
    }
}
