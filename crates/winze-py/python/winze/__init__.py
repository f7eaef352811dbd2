"""Find a robot in its own map, underground.

A *map* is a prior point cloud of a mine, tunnel or cave, a *query* a new cloud in a frame of its own. winze answers,
with no initial guess, where the query lies in the map, or that it does not know::

    import winze

    outcome = winze.locate("map.pcd", "query.pcd")      # files, NumPy arrays, Open3D or small_gicp clouds
    if outcome.verdict is winze.Verdict.LOCATED:
        print(outcome.pose)                             # 4x4, takes query points to the map
    else:
        print(outcome.reason)

A map that is asked more than once is prepared once: :class:`Map`. Every stage is a function of its own, from
:func:`voxel_downsample` to :func:`icp`, with its settings in a frozen class (:class:`IssConfig`, ...) whose names and defaults
are those of the command line and of Rust, and so are the answers, to the bit.

Metres, radians and seconds; right-handed frames. ``map_from_query`` takes points of the query's frame to the map's. Points are rows: arrays
of shape (N, 3), of any floating or integer type and any memory layout.

Every function that works long releases the GIL, takes ``threads`` (0: all; the answer does not depend on it) and ends on
Ctrl-C.
"""

from ._cases import Case, Evaluation, evaluate, read_cases, scenarios, simulate
from ._cloud import Cloud, PointsLike, demo, read, write
from ._config import (
    Config,
    FpfhConfig,
    GraphConfig,
    IcpConfig,
    IssConfig,
    Length,
    MatchingConfig,
    NdtConfig,
    OdometryConfig,
    PrepareConfig,
    RansacConfig,
    ScaleConfig,
    VerifyConfig,
)
from ._locate import METHODS, Map, locate
from ._outcome import Hypothesis, Outcome, Patches, PoseError, Stage, Unobservable, Verdict
from ._progress import Progress
from ._settings import config_text, read_config
from ._stages import (
    Estimate,
    Keypoints,
    Matches,
    Refined,
    SampledPose,
    Surface,
    choose_voxel,
    estimate_normals,
    fpfh,
    icp,
    inliers,
    iss_keypoints,
    match_features,
    ndt,
    prepare,
    ransac,
    remove_outliers,
    spacing,
    voxel_downsample,
)
from ._winze import __version__

__all__ = [
    "METHODS",
    "Case",
    "Cloud",
    "Config",
    "Estimate",
    "Evaluation",
    "FpfhConfig",
    "GraphConfig",
    "Hypothesis",
    "IcpConfig",
    "IssConfig",
    "Keypoints",
    "Length",
    "Map",
    "MatchingConfig",
    "Matches",
    "NdtConfig",
    "OdometryConfig",
    "Outcome",
    "Patches",
    "PointsLike",
    "PoseError",
    "PrepareConfig",
    "Progress",
    "RansacConfig",
    "Refined",
    "SampledPose",
    "ScaleConfig",
    "Stage",
    "Surface",
    "Unobservable",
    "Verdict",
    "VerifyConfig",
    "__version__",
    "choose_voxel",
    "config_text",
    "demo",
    "estimate_normals",
    "evaluate",
    "fpfh",
    "icp",
    "inliers",
    "iss_keypoints",
    "locate",
    "match_features",
    "ndt",
    "prepare",
    "ransac",
    "read",
    "read_cases",
    "read_config",
    "remove_outliers",
    "scenarios",
    "simulate",
    "spacing",
    "voxel_downsample",
    "write",
]
