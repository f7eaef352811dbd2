"""Independent ISS keypoints in numpy, compared with iss_pcl.csv and
iss_open3d.csv; writes iss_eigen.csv. Exits non-zero if a set differs."""

import sys

import numpy as np
from scipy.spatial import cKDTree

SALIENT, NON_MAX, GAMMA, MIN_NEIGHBOURS = 1.0, 0.75, 0.975, 5


def read(name):
    return np.loadtxt(name, delimiter=",", comments="#")


def neighbours(p, radius):
    """Lists with the point itself, d^2 < r^2 (strict)."""
    out = []
    for i, near in enumerate(cKDTree(p).query_ball_point(p, radius * 1.001)):
        near = np.array(near)
        out.append(near[((p[near] - p[i]) ** 2).sum(1) < radius**2])
    return out


def scatter_eigenvalues(p, near, centre, divided):
    """Descending eigenvalues of sum (q - c)(q - c)^T, divided by the count or not."""
    e = np.zeros((len(p), 3))
    for i, k in enumerate(near):
        if len(k) < MIN_NEIGHBOURS:
            continue
        q = p[k] - (p[i] if centre == "point" else p[k].mean(0))
        e[i] = np.linalg.eigvalsh(q.T @ q)[::-1] / (len(k) if divided else 1)
    return e


def keypoints(e, near):
    """Largest third eigenvalue within the non-max radius; ties all stay."""
    with np.errstate(invalid="ignore", divide="ignore"):
        salient = (e[:, 1] / e[:, 0] < GAMMA) & (e[:, 2] / e[:, 1] < GAMMA)
    third = np.where(salient, e[:, 2], 0.0)
    return {
        i
        for i, k in enumerate(near)
        if third[i] > 0 and len(k) >= MIN_NEIGHBOURS and third[i] >= third[k].max()
    }


def main():
    p = read("cloud.csv")
    wide, close = neighbours(p, SALIENT), neighbours(p, NON_MAX)
    peer = {name: set(read(f"iss_{name}.csv").astype(int)) for name in ("pcl", "open3d")}
    eigen, found = {}, {}
    for centre in ("point", "mean"):
        for divided in (False, True):
            key = centre, divided
            eigen[key] = scatter_eigenvalues(p, wide, centre, divided)
            found[key] = keypoints(eigen[key], close)
            print(
                f"about the {centre:5s}, {'divided by n' if divided else 'plain sum   '}: {len(found[key])} keypoints;",
                ", ".join(f"{len(found[key] & s)} of {len(s)} of {name}'s" for name, s in peer.items()),
            )
    print(f"PCL and Open3D share {len(peer['pcl'] & peer['open3d'])} keypoints")
    counts = np.array([len(k) for k in wide])
    index = np.arange(0, len(p), 10)
    np.savetxt(
        "iss_eigen.csv",
        np.column_stack([index, counts[index], eigen["point", False][index], eigen["mean", True][index]]),
        fmt="%.7g",
        delimiter=",",
        comments="# ",
        header="index, count n of points within 1.0 (itself included), descending eigenvalues of the scatter about "
        "the point, a plain sum (3 columns, PCL's), then about the mean of the n points, divided by n (3 columns, Open3D's); "
        f"every 10th point of cloud.csv, by check_iss.py with numpy {np.__version__}",
    )
    sys.exit(int(found["point", False] != peer["pcl"] or found["mean", True] != peer["open3d"]))


if __name__ == "__main__":
    main()
