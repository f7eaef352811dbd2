//! What a ray meets: a surface, or, over a wet floor, the mirror image of one.

use winze::rng::Rng;
use winze::vec3::dot;

use super::ReturnOrigin;
use crate::raycast::{Caster, Hit};

/// The surface that gives a ray's light back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Met {
    /// Length of the light's way, metres.
    pub(super) range: f64,
    /// Cosine of the angle of incidence.
    pub(super) cosine: f64,
    /// Share of light given back, less what a mirror on the way took.
    pub(super) reflectivity: f64,
    pub(super) part: u16,
    /// Towards the light, world frame.
    pub(super) normal: [f64; 3],
    /// A surface, or its mirror image.
    pub(super) origin: ReturnOrigin,
}

/// What lies along a ray.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sight {
    /// Distance to the first surface, metres.
    pub(super) first: Option<f64>,
    /// What gives light back; `None` where a mirror sent the ray into the void.
    pub(super) met: Option<Met>,
}

/// Reflectance of water seen straight on, from its refractive index of 1.33.
const WATER_HEAD_ON: f64 = 0.02;

/// Share of light that a smooth film of water mirrors at this cosine of incidence (Schlick 1994).
pub(super) fn mirrored(cosine: f64) -> f64 {
    let c = 1.0 - cosine.clamp(0.0, 1.0);
    WATER_HEAD_ON + (1.0 - WATER_HEAD_ON) * c * c * c * c * c
}

/// Follows a ray from `origin` along the unit `direction`. A wet surface mirrors it with the probability
/// `wet` times [`mirrored`]; mirrored once, it is not mirrored again.
pub(super) fn look(
    caster: &Caster,
    origin: [f64; 3],
    direction: [f64; 3],
    max_range: f64,
    rng: &mut Rng,
) -> Sight {
    let Some(hit) = caster.cast(origin, direction, max_range) else {
        return Sight::default();
    };
    let (reflectivity, wet) = material(caster, hit.part);
    let cosine = incidence(direction, hit.normal);
    let share = mirrored(cosine);
    let first = Some(hit.range);
    if wet <= 0.0 || rng.uniform() >= wet * share {
        let met = Some(met(
            &hit,
            hit.range,
            cosine,
            reflectivity,
            ReturnOrigin::Surface,
        ));
        return Sight { first, met };
    }
    let along = dot(direction, hit.normal);
    let onward: [f64; 3] = std::array::from_fn(|a| direction[a] - 2.0 * along * hit.normal[a]);
    // A little off the surface, so that the ray does not meet it again at once.
    let from =
        std::array::from_fn(|a| origin[a] + hit.range * direction[a] + OFF_SURFACE * hit.normal[a]);
    let met = caster
        .cast(from, onward, max_range - hit.range)
        .map(|second| {
            let cosine = incidence(onward, second.normal);
            let reflectivity = material(caster, second.part).0 * share;
            let range = hit.range + second.range;
            met(&second, range, cosine, reflectivity, ReturnOrigin::Mirror)
        });
    Sight { first, met }
}

/// Metres by which a mirrored ray starts above the mirror.
const OFF_SURFACE: f64 = 1e-4;

/// How far the point at `range` along `direction` lies from the plane through `hit`, which lies along
/// `hit_direction`; metres.
pub(super) fn off_plane(
    hit_direction: [f64; 3],
    hit_range: f64,
    normal: [f64; 3],
    direction: [f64; 3],
    range: f64,
) -> f64 {
    (range * dot(direction, normal) - hit_range * dot(hit_direction, normal)).abs()
}

/// Reflectivity and wetness of a part.
pub(super) fn material(caster: &Caster, part: u16) -> (f64, f64) {
    caster
        .mesh()
        .parts()
        .get(usize::from(part))
        .map_or((0.0, 0.0), |p| (p.material.reflectivity, p.material.wet))
}

/// Cosine of the angle between a ray turned round and a normal.
pub(super) fn incidence(direction: [f64; 3], normal: [f64; 3]) -> f64 {
    dot(direction, normal).abs().min(1.0)
}

fn met(hit: &Hit, range: f64, cosine: f64, reflectivity: f64, origin: ReturnOrigin) -> Met {
    Met {
        range,
        cosine,
        reflectivity,
        part: hit.part,
        normal: hit.normal,
        origin,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_mirrors_at_grazing_incidence_and_hardly_head_on() {
        assert!((mirrored(1.0) - 0.02).abs() < 1e-12);
        assert!((mirrored(0.0) - 1.0).abs() < 1e-12);
        assert!(mirrored(0.2) > mirrored(0.3));
    }

    #[test]
    fn points_of_one_plane_are_on_it() {
        let (d, n) = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        let s = std::f64::consts::FRAC_1_SQRT_2;
        assert!(off_plane(d, 2.0, n, [s, s, 0.0], 2.0 / s) < 1e-12);
        assert!((off_plane(d, 2.0, n, [s, s, 0.0], 3.0 / s) - 1.0).abs() < 1e-12);
    }
}
