//! Whether every kind of vectors that this processor has, and every processor, leads to the same bits.
//!
//! A build for one processor alone (`-C target-cpu=native`) has no narrower vectors than that one's.

use std::fmt::{Debug, Write};
use std::sync::atomic::{AtomicUsize, Ordering};

use fearless_simd::Level;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::Simd;

use crate::config::{
    Config, DescriptorVariant, FpfhConfig, IcpConfig, IcpMetric, IssConfig, Kernel, Length,
    MatchingConfig, NdtConfig, NdtForm,
};
use crate::fpfh::Descriptor;
use crate::kdtree::KdTree;
use crate::locate::locate_by;
use crate::method::Method;
use crate::normals::Neighbourhood;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::request::Request;
use crate::test_world::{cloud, drift, surface};
use crate::{denoise, fpfh, icp, iss, matching, ndt, normals, voxel};

/// How much narrower than the processor's own. All tests of the process see it, and none may mind.
static NARROWER: AtomicUsize = AtomicUsize::new(0);

pub(super) fn chosen() -> Option<Level> {
    match NARROWER.load(Ordering::Relaxed) {
        0 => None,
        n => narrower().nth(n - 1),
    }
}

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
fn narrower() -> impl Iterator<Item = Level> {
    let own = Level::new();
    let all = [
        own.as_avx2().map(Simd::level),
        own.as_sse4_2().map(Simd::level),
        own.as_sse2().map(Simd::level),
    ];
    all.into_iter().flatten()
}

#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
fn narrower() -> impl Iterator<Item = Level> {
    std::iter::empty()
}

/// What `f` says with each kind of vectors, the processor's own first.
fn at_each<R>(f: impl Fn() -> R) -> Vec<R> {
    (0..=narrower().count())
        .map(|n| {
            NARROWER.store(n, Ordering::Relaxed);
            let said = f();
            NARROWER.store(0, Ordering::Relaxed);
            said
        })
        .collect()
}

/// Name and value, as text in which two numbers are alike only if their bits are, but for what a NaN holds.
type Told = Vec<(String, String)>;

fn tell(all: &mut Told, what: &str, value: impl Debug) {
    all.push((what.to_owned(), format!("{value:?}")));
}

const VOXEL: f64 = 0.15;

fn part() -> Vec<[f64; 3]> {
    let all = drift(40_000, 22.0, 0.4, 0.01, 101).into_iter();
    all.filter(|p| p[0] > 6.0 && p[0] < 16.0).collect()
}

/// What neighbours are needed for.
fn of_one_cloud(map: &Surface<'_>, query: &Surface<'_>) -> Told {
    let mut all = Told::new();
    tell(&mut all, "surface", map);
    let coarse = voxel::downsample(&cloud(&part()), 0.3);
    tell(&mut all, "voxels", coarse.points());
    let tree = KdTree::build(&map.points);
    tell(&mut all, "tree", &tree);
    let looked = query.points.iter().map(|p| {
        let (mut found, mut within) = (Vec::new(), 0);
        tree.knn(*p, 7, f32::INFINITY, &mut found);
        tree.within(*p, 0.5, |_, _| within += 1);
        (tree.nearest(*p), found, within)
    });
    tell(&mut all, "neighbours", looked.collect::<Vec<_>>());
    let kept = denoise::statistical(&map.points, &tree, 20, 1.0);
    tell(&mut all, "outliers", kept);
    for (radius, least, most) in [(0.0, 20, 20), (0.4, 3, 1000)] {
        let around = Neighbourhood {
            radius,
            least,
            most,
        };
        let found = normals::estimate(&map.points, &tree, around);
        tell(&mut all, "normals", found);
    }
    for density_weighting in [false, true] {
        let config = IssConfig {
            density_weighting,
            non_max_radius: Length::Metres(0.5),
            ..IssConfig::default()
        };
        let salient = iss::saliency(&map.points, &tree, &config, VOXEL);
        tell(&mut all, "saliency", salient);
        let keypoints = iss::keypoints(&map.points, &tree, &config, VOXEL);
        tell(&mut all, "keypoints", keypoints);
    }
    all
}

fn described(surface: &Surface<'_>, variant: DescriptorVariant, unsigned: bool) -> Vec<Descriptor> {
    let every: Vec<u32> = (0u32..)
        .zip(surface.points.iter())
        .map(|(i, _)| i)
        .collect();
    fpfh::descriptors(
        &surface.points,
        &surface.normals,
        &surface.tree,
        &every,
        &FpfhConfig {
            variant,
            unsigned,
            ..FpfhConfig::default()
        },
        VOXEL,
    )
}

/// Descriptors, matches and refinement.
fn of_two_clouds(map: &Surface<'_>, query: &Surface<'_>) -> Told {
    let mut all = Told::new();
    for (variant, unsigned) in [
        (DescriptorVariant::Pcl, true),
        (DescriptorVariant::Open3d, false),
    ] {
        let found = described(query, variant, unsigned);
        tell(&mut all, "descriptors of peers", found);
    }
    let (ours, theirs) = (
        described(map, DescriptorVariant::Paper, false),
        described(query, DescriptorVariant::Paper, false),
    );
    tell(&mut all, "descriptors", (&ours, &theirs));
    // With an index and without.
    for of in [ours.len(), 1500] {
        for (neighbours, mutual) in [(2, false), (2, true), (1, true)] {
            let config = MatchingConfig {
                neighbours,
                mutual,
                ratio: 1.0,
            };
            let matches = matching::match_descriptors(&theirs, &ours[..of], &config);
            tell(&mut all, "matches", matches);
        }
    }
    for form in [NdtForm::Mixture, NdtForm::Plain] {
        let config = NdtConfig {
            form,
            ..NdtConfig::default()
        };
        let cells = ndt::levels(map, &config);
        let aligned = ndt::align(&cells, map, query, &start(), &config);
        tell(&mut all, "NDT", aligned);
    }
    for metric in [
        IcpMetric::PointToPoint,
        IcpMetric::PointToPlane,
        IcpMetric::Generalized,
    ] {
        for kernel in [Kernel::None, Kernel::Huber, Kernel::GemanMcClure] {
            let config = IcpConfig {
                metric,
                kernel,
                ..IcpConfig::default()
            };
            tell(&mut all, "ICP", icp::align(map, query, &start(), &config));
        }
    }
    all
}

fn start() -> Pose {
    Pose::from_rotation_vector([0.01, -0.02, 0.02], [0.15, -0.1, 0.05])
}

/// Answers of every method.
fn of_whole_runs() -> Told {
    let mut all = Told::new();
    let map = cloud(&drift(40_000, 22.0, 0.4, 0.01, 1));
    for method in Method::ALL {
        let request = Request {
            method,
            initial: Some(start()),
            ..Request::default()
        };
        let found = locate_by(&map, &cloud(&part()), &Config::default(), &request).unwrap();
        let evidence = (&found.hypotheses, found.confidence, found.covariance);
        let answer = (found.verdict, found.map_from_query, evidence);
        tell(&mut all, method.name(), answer);
    }
    all
}

#[test]
fn every_kind_of_vectors_leads_to_the_same_bits() {
    let levels = at_each(|| {
        let map = surface(&drift(40_000, 22.0, 0.4, 0.01, 1), VOXEL);
        let query = surface(&part(), VOXEL);
        let mut all = of_one_cloud(&map, &query);
        all.extend(of_two_clouds(&map, &query));
        all.extend(of_whole_runs());
        all
    });
    assert!(levels[0].len() > 35);
    for (level, other) in levels.iter().enumerate().skip(1) {
        for ((what, own), (_, narrower)) in levels[0].iter().zip(other) {
            assert!(own == narrower, "{what} differs, {level} narrower");
        }
    }
    let mut digests = String::new();
    for (what, value) in &levels[0] {
        let _ = writeln!(digests, "{:016x} {what}", fnv(value));
    }
    assert!(
        digests == include_str!("digests.txt"),
        "not what every processor finds; if it is meant to be found now, digests.txt is to hold\n{digests}"
    );
}

/// A digest of text (Fowler, Noll & Vo).
fn fnv(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
