//! Every sensor is checked along the ray, against the truth that its returns carry.

use super::*;
use crate::mesh::{Mesh, Part};
use winze::rng::Rng;
use winze::vec3::dot;

/// A rough box room, `size` metres, its corner at the origin: each wall a grid whose inner nodes are off by
/// up to `relief`. Part 0 holds the walls and the roof, part 1 the floor with `wet`.
fn room(size: [f64; 3], relief: f64, wet: f64) -> Caster {
    let mut rng = Rng::new(11, 0);
    let part = |name: &str, wet: f64| Part {
        name: name.into(),
        material: Material {
            reflectivity: 0.4,
            wet,
        },
        new: false,
    };
    let mut mesh = Mesh::default();
    let (mut walls, mut triangles) = (Vec::new(), Vec::new());
    const N: u32 = 4;
    for face in 0..6 {
        let (axis, high) = (face / 2, face % 2 == 1);
        let mut vertices: Vec<[f32; 3]> = Vec::new();
        for i in 0..=N {
            for j in 0..=N {
                let mut p = [0.0; 3];
                let inner = i > 0 && i < N && j > 0 && j < N;
                let off = if inner {
                    rng.range(-relief, relief)
                } else {
                    0.0
                };
                p[axis] = off + if high { size[axis] } else { 0.0 };
                p[(axis + 1) % 3] = size[(axis + 1) % 3] * f64::from(i) / f64::from(N);
                p[(axis + 2) % 3] = size[(axis + 2) % 3] * f64::from(j) / f64::from(N);
                vertices.push(p.map(|c| c as f32));
            }
        }
        let mut faces = Vec::new();
        for i in 0..N {
            for j in 0..N {
                let at = |di: u32, dj: u32| (i + di) * (N + 1) + j + dj;
                faces.push([at(0, 0), at(1, 0), at(1, 1)]);
                faces.push([at(0, 0), at(1, 1), at(0, 1)]);
            }
        }
        if axis == 2 && !high {
            mesh.add(part("floor", wet), &vertices, &faces).unwrap();
        } else {
            let first = walls.len() as u32;
            walls.extend(vertices);
            triangles.extend(faces.into_iter().map(|t| t.map(|v| v + first)));
        }
    }
    mesh.add(part("rock", 0.0), &walls, &triangles).unwrap();
    Caster::new(mesh).unwrap()
}

/// The sensor's preset with some 10 000 rays.
fn thin(name: &str) -> Sensor {
    let sensor = Sensor::preset(name).unwrap();
    let every = sensor.rays().div_ceil(10_000) as u32;
    sensor.thinned(every)
}

fn middle() -> Pose {
    Pose::from_yaw_pitch_roll(0.3, 0.05, -0.02, [2.5, 2.0, 1.3])
}

/// Reflectivity times cosine of incidence of a return.
fn given_back(r: &Return, pose: &Pose) -> f64 {
    0.4 * sight::incidence(pose.rotate(r.direction), r.normal)
}

fn share(of: &[Return], origin: ReturnOrigin) -> f64 {
    of.iter().filter(|r| r.origin == origin).count() as f64 / of.len().max(1) as f64
}

#[test]
fn residuals_along_the_ray_have_no_mean_and_the_stated_deviation() {
    let caster = room([8.0, 5.0, 3.5], 0.15, 0.0);
    let pose = middle();
    for name in Sensor::PRESETS {
        let sensor = thin(name);
        // Scaled by the stated deviation, and in metres by range.
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        let mut bins = [[0.0_f64; 3]; 8];
        let scans = 8;
        for scan in 0..scans {
            for r in sensor.scan(&caster, &pose, &Dust::NONE, 9, scan) {
                let truth = r.true_range.unwrap();
                if r.origin != ReturnOrigin::Surface {
                    continue;
                }
                let sd = sensor.noise_along(r.direction, truth, given_back(&r, &pose));
                let e = (r.range - truth) / sd;
                n += 1.0;
                sum += e;
                squares += e * e;
                let bin = &mut bins[(truth as usize).min(7)];
                bin[0] += 1.0;
                bin[1] += (r.range - truth).powi(2);
                bin[2] += sd * sd;
            }
        }
        assert!(n > 20_000.0, "{name}: {n}");
        // Errors that neighbours share count for fewer.
        let independent = if *name == "d457" { n / 60.0 } else { n };
        let (mean, sd) = (sum / n, (squares / n).sqrt());
        assert!(
            mean.abs() < 3.0 / independent.sqrt() + 0.01,
            "{name}: {mean}"
        );
        assert!((sd - 1.0).abs() < 0.05, "{name}: {sd}");
        println!("{name}: mean {mean:.4}, deviation {sd:.4}, as shares of the stated one");
        for (metres, [n, error, stated]) in bins.into_iter().enumerate() {
            let (error, stated) = ((error / n).sqrt(), (stated / n).sqrt());
            println!("{name} {metres} m: {error:.4} of {stated:.4} in {n}");
            if n > 2000.0 {
                assert!((error / stated - 1.0).abs() < 0.05, "{name} at {metres} m");
            }
        }
    }
}

#[test]
fn true_ranges_are_those_of_the_mesh_and_points_lie_on_their_rays() {
    let caster = room([8.0, 5.0, 3.5], 0.15, 0.3);
    let pose = middle();
    for name in Sensor::PRESETS {
        let sensor = thin(name).thinned(20);
        let air = Dust {
            extinction: 0.05,
            ..Dust::NONE
        };
        for r in sensor.scan(&caster, &pose, &air, 1, 1) {
            let out = pose.rotate(r.direction);
            let hit = caster.cast(pose.translation(), out, 1000.0).unwrap();
            assert!((hit.range - r.true_range.unwrap()).abs() < 1e-9);
            assert!((dot(r.point(), r.direction) - r.range).abs() < 1e-9);
            assert!(
                (0.0..=1.0).contains(&r.intensity),
                "{name}: {}",
                r.intensity
            );
            match r.origin {
                ReturnOrigin::Surface => assert_eq!((r.part, r.normal), (hit.part, hit.normal)),
                ReturnOrigin::Dust => assert_eq!(r.part, u16::MAX),
                _ => {}
            }
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_at_any_thread_count() {
    let caster = room([8.0, 5.0, 3.5], 0.15, 0.5);
    let air = Dust {
        extinction: 0.1,
        ..Dust::NONE
    };
    for name in Sensor::PRESETS {
        let sensor = thin(name).thinned(4);
        let scan = |threads, seed, scan| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| sensor.scan(&caster, &middle(), &air, seed, scan))
        };
        let one = scan(1, 3, 2);
        assert!(!one.is_empty());
        assert_eq!(one, scan(3, 3, 2), "{name}");
        assert_ne!(one, scan(3, 4, 2), "{name}");
        assert_ne!(one, scan(3, 3, 1), "{name}");
    }
}

#[test]
fn dust_takes_over_as_it_thickens() {
    let caster = room([30.0, 5.0, 4.0], 0.1, 0.0);
    let pose = Pose::from_translation([8.0, 2.5, 1.5]);
    for name in ["vlp16", "xt32", "os0_128", "l515"] {
        let sensor = thin(name);
        let (mut last, mut walls) = (-1e-9, f64::INFINITY);
        for extinction in [0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0] {
            let air = Dust {
                extinction,
                ..Dust::NONE
            };
            let returns = sensor.scan(&caster, &pose, &air, 1, 0);
            let dust = share(&returns, ReturnOrigin::Dust);
            let surface = returns.iter().filter(|r| r.origin == ReturnOrigin::Surface);
            let seen = surface.count() as f64 / sensor.rays() as f64;
            println!("{name} {extinction}: {dust:.3} dust, {seen:.3} wall");
            assert!(
                dust >= last && seen <= walls + 1e-3,
                "{name} at {extinction}"
            );
            (last, walls) = (dust, seen);
            if extinction == 0.0 {
                assert_eq!(dust, 0.0);
            }
        }
        assert!(last > 0.9 && walls < 0.02, "{name}: {last} {walls}");
    }
}

#[test]
fn the_last_return_sees_more_wall_than_the_strongest() {
    let caster = room([30.0, 5.0, 4.0], 0.1, 0.0);
    let pose = Pose::from_translation([8.0, 2.5, 1.5]);
    let Sensor::Spinning(strongest) = thin("vlp16") else {
        panic!("spinning")
    };
    let mut last = strongest.clone();
    last.pulse.returns = Returns::Last;
    let air = Dust {
        extinction: 0.15,
        ..Dust::NONE
    };
    let wall = |s: Spinning| {
        let returns = Sensor::Spinning(s).scan(&caster, &pose, &air, 1, 0);
        share(&returns, ReturnOrigin::Surface)
    };
    let (a, b) = (wall(strongest), wall(last));
    println!("strongest {a:.3}, last {b:.3}");
    assert!(b > a + 0.1);
}

#[test]
fn extinction_hides_a_wall_where_the_lidar_equation_says() {
    // A wall 60 m wide, seen nearly head-on by narrow beams from further and further off.
    let vertices = [
        [0.0, -30.0, -30.0],
        [0.0, 30.0, -30.0],
        [0.0, 30.0, 30.0],
        [0.0, -30.0, 30.0],
    ];
    let part = Part {
        name: "wall".into(),
        material: Material {
            reflectivity: 0.4,
            wet: 0.0,
        },
        new: false,
    };
    let (mesh, _) = Mesh::of(part, &vertices, &[[0, 1, 2], [0, 2, 3]]).unwrap();
    let caster = Caster::new(mesh).unwrap();
    let sensor = SolidState {
        width: 60,
        height: 60,
        field_of_view_deg: [4.0, 4.0],
        ..presets::l515()
    };
    let sensor = SolidState {
        pulse: Pulse {
            max_range: 100.0,
            range_at_10_percent: 40.0,
            dropout: 0.0,
            returns: Returns::Last,
            ..sensor.pulse
        },
        ..sensor
    };
    let air = Dust {
        extinction: 0.05,
        patchiness: 0.0,
        ..Dust::NONE
    };
    let mut shares = Vec::new();
    for range in [10.0, 20.0, 24.0, 25.0, 26.0, 27.0, 28.0, 30.0, 40.0] {
        let pose = Pose::from_translation([-range, 0.0, 0.0]);
        let all = Sensor::SolidState(sensor.clone());
        let walls = all.scan(&caster, &pose, &air, 1, 0);
        let seen = walls
            .iter()
            .filter(|r| r.origin == ReturnOrigin::Surface)
            .count();
        let seen = seen as f64 / all.rays() as f64;
        // Written out by hand: detection of s > 1 under log-normal fading.
        let s = 4.0 * (40.0 / range).powi(2) * (-2.0 * 0.05 * range).exp();
        let expected = 0.5 * (1.0 + libm::erf(s.ln() / 0.25 / std::f64::consts::SQRT_2));
        println!("{range} m: {seen:.3} of {expected:.3}");
        assert!(
            (seen - expected).abs() < 0.03,
            "{range} m: {seen} for {expected}"
        );
        shares.push(seen);
    }
    assert!(shares[0] > 0.99 && shares[8] < 0.01);
}

#[test]
fn a_stereo_camera_loses_sight_in_dust() {
    let caster = room([8.0, 5.0, 3.5], 0.15, 0.0);
    let sensor = thin("d457");
    let seen = |extinction| {
        let air = Dust {
            extinction,
            patchiness: 0.0,
            ..Dust::NONE
        };
        let returns = sensor.scan(&caster, &middle(), &air, 1, 0);
        let error: f64 = returns
            .iter()
            .filter(|r| r.origin == ReturnOrigin::Surface)
            .map(|r| ((r.range - r.true_range.unwrap()) / sensor.noise_at(r.range)).powi(2))
            .sum();
        let n = returns.len() as f64;
        (n / sensor.rays() as f64, (error / n.max(1.0)).sqrt())
    };
    let (clear, hazy, thick, blackout) = (seen(0.0), seen(0.1), seen(0.4), seen(3.0));
    println!("{clear:?} {hazy:?} {thick:?} {blackout:?}");
    assert!(
        clear.0 > 0.8 && clear.0 < 0.995,
        "holes, but few: {clear:?}"
    );
    assert!(hazy.0 < clear.0 && thick.0 < 0.8 * hazy.0 && blackout.0 < 0.01);
    assert!(hazy.1 > 1.2 * clear.1, "noise grows as contrast falls");
}

#[test]
fn a_wet_floor_mirrors_and_its_images_lie_below_it() {
    let pose = Pose::from_translation([2.0, 2.5, 1.2]);
    for name in ["vlp16", "os0_128", "d457"] {
        let sensor = thin(name);
        let mirrored = |wet| {
            let caster = room([7.0, 5.0, 4.0], 0.0, wet);
            let returns = sensor.scan(&caster, &pose, &Dust::NONE, 1, 0);
            let of: Vec<Return> = returns
                .into_iter()
                .filter(|r| r.origin == ReturnOrigin::Mirror)
                .collect();
            for r in &of {
                let image = pose.transform(r.point()).map(f64::abs);
                // Mirrored back it lies on the walls or the roof.
                let off = [
                    image[0],
                    7.0 - image[0],
                    image[1],
                    5.0 - image[1],
                    4.0 - image[2],
                ];
                let nearest = off.into_iter().fold(f64::INFINITY, |a, b| a.min(b.abs()));
                let noise = 6.0 * sensor.noise_along(r.direction, r.range, 0.02);
                assert!(nearest < noise, "{nearest}");
                assert!(r.range > r.true_range.unwrap() - noise);
                // Below the floor, but for the noise of what stands on it.
                assert!(pose.transform(r.point())[2] < noise);
            }
            of.len()
        };
        let (dry, damp, wet) = (mirrored(0.0), mirrored(0.3), mirrored(1.0));
        println!("{name}: {dry} {damp} {wet}");
        assert!(dry == 0 && damp > 0 && wet > damp);
    }
}

#[test]
fn edges_bleed_between_fore_and_background() {
    // A board 2 m before a wall.
    let mut mesh = Mesh::default();
    for (x, half) in [(3.0, 0.6_f32), (5.0, 10.0)] {
        let v = [
            [x, -half, -half],
            [x, half, -half],
            [x, half, half],
            [x, -half, half],
        ];
        let part = Part {
            name: "board".into(),
            material: Material::ROCK,
            new: false,
        };
        mesh.add(part, &v, &[[0, 1, 2], [0, 2, 3]]).unwrap();
    }
    let caster = Caster::new(mesh).unwrap();
    let sensor = thin("d457");
    let returns = sensor.scan(&caster, &Pose::identity(), &Dust::NONE, 1, 0);
    let bleed: Vec<&Return> = returns
        .iter()
        .filter(|r| r.origin == ReturnOrigin::Bleed)
        .collect();
    assert!(
        bleed.len() > 30 && bleed.len() * 10 < returns.len(),
        "{}",
        bleed.len()
    );
    let between = bleed
        .iter()
        .filter(|r| (3.1..4.9).contains(&r.point()[0]))
        .count();
    assert!(
        between * 10 > bleed.len() * 7,
        "{between} of {}",
        bleed.len()
    );
    // A beam's own edge, where the board stands closer to the wall than a pulse is long.
    let Sensor::Spinning(mut wide) = Sensor::preset("vlp16").unwrap() else {
        panic!("spinning")
    };
    wide.pulse.divergence_deg = 1.0;
    wide.pulse.pulse_length = 4.0;
    let returns = Sensor::Spinning(wide).scan(&caster, &Pose::identity(), &Dust::NONE, 1, 0);
    let bleed = returns.iter().filter(|r| r.origin == ReturnOrigin::Bleed);
    assert!(bleed.clone().count() > 30);
    assert!(bleed.clone().all(|r| (2.8..6.5).contains(&r.point()[0])));
}

#[test]
fn grazing_and_dark_surfaces_are_lost() {
    let caster = room([60.0, 5.0, 4.0], 0.0, 0.0);
    let pose = Pose::from_translation([2.0, 2.5, 1.5]);
    let sensor = thin("l515");
    let returns = sensor.scan(&caster, &pose, &Dust::NONE, 1, 0);
    assert!(!returns.is_empty() && returns.len() < sensor.rays() / 2);
    assert!(returns.iter().all(|r| r.range < 9.5));
}

#[test]
fn thinning_keeps_the_field_of_view_and_nothing_hangs_on_nothing() {
    for name in Sensor::PRESETS {
        let sensor = Sensor::preset(name).unwrap();
        let thin = sensor.thinned(10);
        let ratio = sensor.rays() as f64 / thin.rays() as f64;
        assert!((8.0..12.5).contains(&ratio), "{name}: {ratio}");
        assert_eq!(thin.max_range(), sensor.max_range());
        thin.validate().unwrap();
        assert!(sensor.thinned(u32::MAX).rays() >= 1);
    }
    let none = Sensor::Spinning(Spinning {
        beams: 0,
        shots_per_turn: 0,
        ..presets::vlp16()
    });
    let caster = room([8.0, 5.0, 3.5], 0.0, 0.0);
    assert!(none.scan(&caster, &middle(), &Dust::NONE, 1, 0).is_empty());
    let e = none.validate().unwrap_err();
    assert!(matches!(e, Error::Setting { .. }), "{e}");
    let blind = Sensor::Stereo(Stereo {
        width: 0,
        ..presets::d457()
    });
    assert!(blind.scan(&caster, &middle(), &Dust::NONE, 1, 0).is_empty());
    let outside = Pose::from_translation([500.0, 0.0, 0.0]);
    for name in Sensor::PRESETS {
        let returns = thin(name).scan(&caster, &outside, &Dust::NONE, 1, 0);
        assert!(returns.is_empty(), "{name}");
    }
}
