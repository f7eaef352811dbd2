"""Settings, one frozen class a stage. Made by ``tools/make_config.py``; do not edit.

A length is metres (``0.5``) or a multiple of the voxel size (``"3 voxels"``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Union

#: Metres, or a multiple of the voxel size: ``0.5``, ``"0.5 m"``, ``"3 voxels"``.
Length = Union[float, str]


@dataclass(frozen=True, kw_only=True)
class ScaleConfig:
    """The length scale that everything follows from."""

    voxel: float = 0.0
    """Voxel size in metres; 0 takes it from the data (point spacing, passage width, extent). Must lie
    between 0 and 1000000."""

    tries: int = 3
    """How many scales ``auto`` tries before it gives up. Must lie between 1 and 8."""


@dataclass(frozen=True, kw_only=True)
class PrepareConfig:
    """From a raw cloud to an even one with normals."""

    min_range: float = 0.0
    """Query points nearer to the sensor than this are dropped (the robot itself), metres; 0: none.
    Must be 0 or above."""

    max_range: float = 0.0
    """Query points further from the sensor than this are dropped, metres; 0: none. Must be 0 or above."""

    denoise_first: bool = False
    """Remove outliers before thinning, as the paper does; else after, where densities are even."""

    statistical_neighbours: int = 12
    """Neighbours of the statistical outlier test; 0 switches it off. Must lie between 0 and 1000."""

    statistical_deviations: float = 3.0
    """A point stays while its mean neighbour distance is below mean + this many deviations. Must be 0
    or above."""

    outlier_radius: Length = "3 voxels"
    """Radius of the radius outlier test. Must lie between 0 and 1000."""

    radius_neighbours: int = 0
    """Neighbours a point must have within that radius; 0 switches the test off. Must lie between 0 and
    1000."""

    normal_radius: Length = "3.5 voxels"
    """Radius of the neighbourhood a normal is fitted to. Must lie between 0 and 1000."""

    normal_least: int = 16
    """Nearest neighbours that it takes even beyond the radius, where rings or rows lie far apart. Must
    lie between 0 and 1000."""

    normal_most: int = 0
    """Nearest neighbours that it takes at most; 0: all within the radius. Must lie between 0 and 1000."""

    orientation: Literal["auto", "open-side"] = "open-side"
    """Where the sign of a normal comes from. One of auto, open-side."""

    open_side_radius: Length = "16 voxels"
    """Radius within which the open side of a surface is judged: about a passage's width. Must be above
    0, at most 1000."""


@dataclass(frozen=True, kw_only=True)
class IssConfig:
    """ISS keypoints."""

    salient_radius: Length = "6 voxels"
    """Radius of the neighbourhood whose scatter is taken. Must be above 0, at most 1000."""

    gamma_21: float = 0.975
    """Bound on λ2/λ1, the paper's γ21. Must lie between 0 and 1."""

    gamma_32: float = 0.975
    """Bound on λ3/λ2, the paper's γ32. Must lie between 0 and 1."""

    min_relief: float = 0.0005
    """λ3 over the squared radius must exceed this: how much relief a keypoint needs. Must be 0 or
    above."""

    min_neighbours: int = 5
    """Neighbours a point must have within the salient radius."""

    centre: Literal["point", "centroid"] = "point"
    """What the scatter is taken about. One of point, centroid."""

    density_weighting: bool = False
    """Weigh each neighbour by the inverse of its own number of neighbours."""

    cell: Length = "3 voxels"
    """One keypoint a cell of this size is kept; 0: no cells. Must lie between 0 and 1000."""

    non_max_radius: Length = "0 voxels"
    """A keypoint must be the most salient within this radius; 0: no such test. Must lie between 0 and
    1000."""

    min_keypoints: int = 2000
    """Where fewer keypoints qualify, the most salient others fill up to this many."""

    max_keypoints: int = 20000
    """At most this many keypoints of a query, the most salient; 0: no limit."""

    max_map_keypoints: int = 0
    """At most this many of a map, at each of its scales; 0: no limit."""


@dataclass(frozen=True, kw_only=True)
class FpfhConfig:
    """FPFH descriptors."""

    radius: Length = "6 voxels"
    """Radius of the neighbourhood that is described. Must be above 0, at most 1000."""

    variant: Literal["paper", "pcl", "open3d"] = "paper"
    """How neighbours' histograms are summed. One of paper, pcl, open3d."""

    unsigned: bool = False
    """Describe without regard to the signs of normals."""


@dataclass(frozen=True, kw_only=True)
class MatchingConfig:
    """Descriptor matching of the paper's methods (``auto`` takes all nearest, see ``[graph]``)."""

    neighbours: int = 1
    """Nearest map descriptors taken for each query descriptor. Must lie between 1 and 64."""

    mutual: bool = True
    """Keep a match only if it is one seen from the map as well."""

    ratio: float = 1.0
    """Drop a match that is not closer than this times the next best; 1: keep all. Must lie between 0
    and 1."""


@dataclass(frozen=True, kw_only=True)
class RansacConfig:
    """RANSAC over correspondences, in the paper's methods (``auto``: ``[graph]``)."""

    inlier_distance: Length = "2 voxels"
    """A correspondence is an inlier of a pose within this distance. Must be above 0, at most 1000."""

    edge_similarity: float = 0.9
    """Ratio of an edge's lengths in the two clouds below which a sample is thrown away. Must lie
    between 0 and 1."""

    min_edge: Length = "4 voxels"
    """Edges of a sample must be longer than this. Must lie between 0 and 1000."""

    max_samples: int = 2000000
    """Samples drawn at most. Must lie between 1 and 1000000000000."""

    min_samples: int = 500000
    """Samples drawn at least: rivals have less support than the best pose and show later. Must lie
    between 1 and 1000000000000."""

    confidence: float = 0.999
    """Sampling ends when a better pose would have been drawn with this probability. Must lie between 0
    and 0.999999999."""

    min_inliers: int = 4
    """Inliers a pose must have. Must lie between 3 and 1000000000."""

    hypotheses: int = 32
    """Distinct poses kept. Must lie between 1 and 1000."""

    distinct_distance: Length = "5 voxels"
    """Poses nearer than this (and 15 degrees) are one. Must lie between 0 and 1000."""


@dataclass(frozen=True, kw_only=True)
class GraphConfig:
    """Poses from correspondences that agree pair by pair (``auto``)."""

    neighbours: int = 2
    """Nearest map descriptors taken for each query descriptor. Must lie between 1 and 64."""

    max_pairs: int = 4000
    """Correspondences used at most, those whose descriptors are nearest. Must lie between 3 and 20000."""

    inlier_distance: Length = "1.5 voxels"
    """Distances of two correspondences may differ by this much. Must be above 0, at most 1000."""

    stretch: float = 0.01
    """And by this share of themselves, since odometry stretches a query. Must lie between 0 and 0.5."""

    min_edge: Length = "4 voxels"
    """Correspondences nearer to each other than this say nothing about a pose. Must lie between 0 and
    1000."""

    angle_tolerance: float = 0.25
    """Cosines of the angles between normals and the line that joins them may differ by this much. Must
    lie between 0 and 2."""

    min_inliers: int = 4
    """Keypoints that must agree with a pose. Must lie between 3 and 1000000000."""

    hypotheses: int = 64
    """Distinct poses kept. Must lie between 1 and 1000."""

    distinct_distance: Length = "5 voxels"
    """Poses nearer than this (and 15 degrees) are one. Must lie between 0 and 1000."""


@dataclass(frozen=True, kw_only=True)
class NdtConfig:
    """NDT refinement."""

    coarsest: Length = "8 voxels"
    """Cell size to begin with. Must lie between 0.01 and 1000."""

    finest: Length = "4 voxels"
    """Cell size to end with; sizes halve in between. Must lie between 0.01 and 1000."""

    neighbours: int = 7
    """Cells that a point looks at: its own (1), with face (7) or corner (27) neighbours. One of 1, 7,
    27."""

    min_points: int = 6
    """Points a cell must hold to have a Gaussian. Must lie between 3 and 1000000000."""

    eigenvalue_floor: float = 0.01
    """Eigenvalues of a Gaussian are raised to this share of its largest. Must lie between 0.000000001
    and 1."""

    form: Literal["mixture", "plain"] = "mixture"
    """The objective. One of mixture, plain."""

    outlier_ratio: float = 0.55
    """Expected share of points that belong to no Gaussian (mixture form). Must lie between 0.01 and
    0.99."""

    max_points: int = 4000
    """Query points used at most, evenly drawn; 0: all."""

    min_pairs: int = 20
    """Query points that must meet a Gaussian."""

    max_iterations: int = 30
    """Iterations at each cell size. Must lie between 1 and 1000000."""

    keep_better: bool = True
    """In the paper's methods, NDT is followed from a pose that features found only where it gains more
    than noise gives (``ndt+icp`` begins with a guess; ``auto`` weighs many places instead)."""

    translation_epsilon: float = 0.001
    """Ends when a step is shorter than this, metres. Must be 0 or above."""

    rotation_epsilon: float = 0.0001
    """And turns less than this, radians. Must be 0 or above."""


@dataclass(frozen=True, kw_only=True)
class IcpConfig:
    """ICP refinement."""

    metric: Literal["point-to-point", "point-to-plane", "generalized"] = "point-to-point"
    """What is minimised (``auto`` always ends with point-to-plane). One of point-to-point, point-to-
    plane, generalized."""

    max_distance: Length = "4 voxels"
    """Pairs further apart than this do not count at first. Must be above 0, at most 1000."""

    shrink: float = 0.8
    """Once the pose has settled within it, the bound shrinks by this factor an iteration. Must lie
    between 0.01 and 0.99."""

    final_distance: Length = "1.5 voxels"
    """Down to this. Must be above 0, at most 1000."""

    kernel: Literal["none", "huber", "geman-mcclure"] = "none"
    """How residuals are weighted. One of none, huber, geman-mcclure."""

    kernel_scale: float = 0.3
    """The kernel's scale as a share of the current bound. Must be above 0."""

    trim: float = 1.0
    """Share of the pairs kept, the closest; 1: all. Must lie between 0.01 and 1."""

    max_points: int = 10000
    """Query points used at most, evenly drawn; 0: all."""

    min_pairs: int = 20
    """Pairs that must be found."""

    max_iterations: int = 50
    """Iterations at most. Must lie between 1 and 1000000."""

    translation_epsilon: float = 0.0005
    """Ends when a step is shorter than this, metres. Must be 0 or above."""

    rotation_epsilon: float = 5e-05
    """And turns less than this, radians. Must be 0 or above."""

    keep_better: bool = True
    """Keep the pose it began with unless the query then lies more finely on the map, by more than
    noise gives; ``false`` runs the paper's bare chain."""


@dataclass(frozen=True, kw_only=True)
class VerifyConfig:
    """Verification and verdict."""

    inlier_distance: float = 0.5
    """The paper's inlier distance, metres, for its metrics alone: the verdict does not use it. Must be
    above 0."""

    overlap_distance: Length = "1.5 voxels"
    """A query point overlaps the map where map surface lies within this distance. Must be above 0, at
    most 1000."""

    fine_tolerance: Length = "0.25 voxels"
    """And fits finely within this distance of its tangent plane. Must be above 0, at most 1000."""

    min_overlap: float = 0.5
    """Where the rock does not tell: overlap below which no place counts as fitting. Must lie between 0
    and 1."""

    min_fine_share: float = 0.5
    """Share of the overlapping points that must fit finely. Must lie between 0 and 1."""

    rival_overlap: float = 0.5
    """A rival's overlap, as a share of the best's, from which it makes the answer ambiguous. Must lie
    between 0 and 1."""

    rival_residual: float = 1.6
    """Where its median point-to-plane residual is below this many times the best's. Must be 0 or
    above."""

    hopeless_residual: float = 4.0
    """Places that a first refinement leaves at more than this many times the finest one's residual are
    weighed as they are: the last refinement is not spent on them. Must lie between 1 and 1000000."""

    min_information: float = 0.01
    """Information (a pair's share) below which a direction is unobservable. Must lie between 0 and 1."""

    min_information_confirmed: float = 0.001
    """The same where the rock has confirmed the place, and so resists. Must lie between 0 and 1."""

    patch_size: Length = "10 voxels"
    """Size of the patches of wall that are asked whether they lie on the rock they were seen on. Must
    be above 0, at most 1000."""

    patch_width: float = 0.3
    """But at least this share of the passages' width (the step grows with it). Must lie between 0 and
    10."""

    patch_step: Length = "5 voxels"
    """How far each is moved to see whether it lies as finely there. Must be above 0, at most 1000."""

    patch_reach: Length = "4 voxels"
    """How far from it the map's surface may lie. Must be above 0, at most 1000."""

    piece_size: Length = "40 voxels"
    """Size of the pieces of a bent query, each of which finds its own place. Must be above 0, at most
    1000."""

    straight: Length = "0.5 voxels"
    """How far off one rigid pose the pieces must lie for it to count as bent. Must be above 0, at most
    1000."""

    min_followed: float = 0.6
    """Share of the query that must lie in pieces on the map for their rigid fit to be an answer. Must
    lie between 0 and 1."""

    max_beyond: float = 0.25
    """How far off the query's centroid, metres, a bend may leave the answer where the rest of the
    query bends on alike. Must be above 0."""

    patches: int = 300
    """And how many patches are asked at most. Must lie between 1 and 1000000."""

    min_patches: int = 15
    """Patches that must have been asked for a place to be believed. Must lie between 1 and 1000000."""

    min_significance: float = 3.0
    """And the standard deviations by which those that say yes must exceed chance. Must be 0 or above."""

    sure_significance: float = 4.0
    """Short of so many, no other place may fit better by its shape; a place that has so many is a
    rival of any other. Must be 0 or above."""

    rival_excess: float = 0.4
    """And so is one with this share of the best place's excess over chance: the answer is ambiguous.
    Must lie between 0 and 1."""

    least_overlap: float = 0.1
    """Overlap below which no place is believed, whatever the rock says. Must lie between 0 and 1."""

    merge_distance: Length = "1.5 voxels"
    """Refined poses nearer than this are one place, if. Must lie between 0 and 1000."""

    merge_angle: float = 5.0
    """They also differ by less than this angle, degrees. Must lie between 0 and 180."""

    max_points: int = 8000
    """Query points used at most, evenly drawn; 0: all."""

    min_points: int = 100
    """Prepared query points below which the answer is ``insufficient``."""

    refined: int = 8
    """Hypotheses that are refined to the end: those of which, at first sight, most of the query lies.
    Must lie between 1 and 1000."""

    first_look_distance: Length = "3 voxels"
    """Within this distance of the map. Must be above 0, at most 1000."""


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """How the SLAM that made the query errs, one standard deviation each. For the covariance alone.
    All but ``map``: where part of the query is not in the map, it hangs on the rest by these."""

    scale: float = 0.003
    """Scale of its steps, a share. Must lie between 0 and 1."""

    turn: float = 0.01
    """Constant turn of its heading, degrees a metre. Must lie between 0 and 90."""

    turn_walk: float = 0.02
    """Random walk of its heading, degrees after one metre. Must lie between 0 and 90."""

    walk: float = 0.003
    """Random walk of its position about each axis, metres after one metre. Must lie between 0 and 10."""

    map: float = 0.01
    """How far off the pose may be as a whole, metres, for what no residual shows: the map was made by
    some odometry too, and the fit clings to some walls more than to others. Level; upright by the
    share of ``tilt``, where the map's z is up. Must lie between 0 and 10."""

    tilt: float = 0.1
    """How much of the turns also tilts, away from the map's z: little where the SLAM knows gravity and
    z is up. Must lie between 0 and 1."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """All settings: one section a stage. ``dataclasses.replace`` makes others of them."""

    seed: int = 0
    """Seed of every random choice (``auto`` makes none)."""

    scale: ScaleConfig = field(default_factory=ScaleConfig)
    """The length scale that everything follows from."""

    prepare: PrepareConfig = field(default_factory=PrepareConfig)
    """From a raw cloud to an even one with normals."""

    iss: IssConfig = field(default_factory=IssConfig)
    """ISS keypoints."""

    fpfh: FpfhConfig = field(default_factory=FpfhConfig)
    """FPFH descriptors."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    """Descriptor matching of the paper's methods (``auto`` takes all nearest, see ``[graph]``)."""

    ransac: RansacConfig = field(default_factory=RansacConfig)
    """RANSAC over correspondences, in the paper's methods (``auto``: ``[graph]``)."""

    graph: GraphConfig = field(default_factory=GraphConfig)
    """Poses from correspondences that agree pair by pair (``auto``)."""

    ndt: NdtConfig = field(default_factory=NdtConfig)
    """NDT refinement."""

    icp: IcpConfig = field(default_factory=IcpConfig)
    """ICP refinement."""

    verify: VerifyConfig = field(default_factory=VerifyConfig)
    """Verification and verdict."""

    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """How the SLAM that made the query errs, one standard deviation each. For the covariance alone.
    All but ``map``: where part of the query is not in the map, it hangs on the rest by these."""
