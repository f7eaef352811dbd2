"""Independent FPFH in numpy, compared with spfh_pcl.csv, fpfh_pcl.csv,
fpfh_open3d.csv and the two fpfh_duplicate_*.csv. Exits non-zero if a row is off
by 0.1 % or more in L1 (relative to the L1 norm of the row)."""

import sys

import numpy as np
from scipy.spatial import cKDTree

RADIUS = 1.25


def read(name, columns=None):
    return np.loadtxt(name, delimiter=",", comments="#", usecols=columns, ndmin=2)


def neighbour_pairs(p, dtype):
    """All ordered pairs (i, j), i != j by index, with d^2 < r^2 (strict)."""
    near = cKDTree(p).query_pairs(RADIUS * 1.001, output_type="ndarray")
    pairs = np.concatenate([near, near[:, ::-1]])
    diff = p[pairs[:, 1]].astype(dtype) - p[pairs[:, 0]].astype(dtype)
    d2 = (diff * diff).sum(1)
    keep = d2 < dtype(RADIUS) ** 2
    return pairs[keep], d2[keep].astype(float)


def darboux(p, n, pairs, swap):
    """The three pair features (f1, f2, f3); zero where they are undefined."""
    i, j = pairs.T
    d = p[j] - p[i]
    length = np.linalg.norm(d, axis=1)
    alive = length > 0
    d = d / np.where(alive, length, 1.0)[:, None]
    a1, a2 = (n[i] * d).sum(1), (n[j] * d).sum(1)
    flip = np.zeros(len(i), bool)
    if swap == "larger":
        flip = np.abs(a1) < np.abs(a2)
    elif swap == "smaller":
        flip = np.abs(a1) > np.abs(a2)
    u = np.where(flip[:, None], n[j], n[i])
    other = np.where(flip[:, None], n[i], n[j])
    d = np.where(flip[:, None], -d, d)
    f3 = np.where(flip, -a2, a1)
    v = np.cross(d, u)
    size = np.linalg.norm(v, axis=1)
    alive &= size > 0
    v = v / np.where(size > 0, size, 1.0)[:, None]
    w = np.cross(u, v)
    f = np.stack([np.arctan2((w * other).sum(1), (u * other).sum(1)), (v * other).sum(1), f3], 1)
    f[~alive] = 0.0
    return f, flip


def histogram(count, pairs, f, share):
    """SPFH rows: 11 floor bins each of f1 in [-pi, pi], f2 and f3 in [-1, 1]."""
    scaled = [(f[:, 0] + np.pi) / (2 * np.pi), (f[:, 1] + 1) / 2, (f[:, 2] + 1) / 2]
    spfh = np.zeros((count, 33))
    for k, s in enumerate(scaled):
        b = np.clip(np.floor(11 * s).astype(int), 0, 10) + 11 * k
        np.add.at(spfh, (pairs[:, 0], b), share[pairs[:, 0]])
    return spfh


def fpfh(p, n, dtype=np.float64, swap="larger", power=1.0, own=0.0):
    pairs, d2 = neighbour_pairs(p, dtype)
    f, flip = darboux(p, n, pairs, swap)
    others = np.bincount(pairs[:, 0], minlength=len(p))
    spfh = histogram(len(p), pairs, f, 100.0 / np.maximum(others, 1))
    weight = np.where(d2 > 0, 1.0 / np.where(d2 > 0, d2, 1.0) ** power, 0.0)
    total = np.zeros_like(spfh)
    np.add.at(total, pairs[:, 0], weight[:, None] * spfh[pairs[:, 1]])
    for k in range(3):
        block = total[:, 11 * k : 11 * k + 11]
        s = block.sum(1, keepdims=True)
        block *= np.where(s > 0, 100.0 / np.where(s > 0, s, 1.0), 0.0)
    return spfh, total + own * spfh, flip, others


def worst(mine, peer):
    return (np.abs(mine - peer).sum(1) / np.abs(peer).sum(1)).max()


def main():
    p, n = read("cloud.csv"), read("normals.csv")
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    bins = range(1, 34)
    index = read("fpfh_pcl.csv")[:, 0].astype(int)
    assert (index == np.arange(0, len(p), 10)).all()
    peer = {name: read(name, bins) for name in ("spfh_pcl.csv", "fpfh_pcl.csv", "fpfh_open3d.csv")}
    limit, failed = 1e-3, False

    def report(what, error, must=True):
        nonlocal failed
        failed |= must and error >= limit
        print(f"{what:58s} worst row {100 * error:9.5f} %")

    spfh, total, flip, others = fpfh(p, n, np.float32)
    print(f"{len(p)} points, {others.mean():.1f} neighbours on average ({others.min()} to {others.max()}), {flip.mean():.1%} of pairs swapped")
    report("PCL SPFH", worst(spfh[index], peer["spfh_pcl.csv"]))
    report("PCL FPFH", worst(total[index], peer["fpfh_pcl.csv"]))
    both = fpfh(p, n, own=1.0)[1]
    report("Open3D FPFH = PCL's + own SPFH", worst(both[index], peer["fpfh_open3d.csv"]))
    report("Open3D FPFH from PCL's two files", worst(peer["fpfh_pcl.csv"] + peer["spfh_pcl.csv"], peer["fpfh_open3d.csv"]))

    print("what other conventions would give (PCL's file, not expected to match):")
    report("  weight 1/d", worst(fpfh(p, n, power=0.5)[1][index], peer["fpfh_pcl.csv"]), False)
    report("  no swap", worst(fpfh(p, n, swap="none")[1][index], peer["fpfh_pcl.csv"]), False)
    report("  the opposite swap", worst(fpfh(p, n, swap="smaller")[1][index], peer["fpfh_pcl.csv"]), False)
    report("  own SPFH added", worst(fpfh(p, n, own=1.0)[1][index], peer["fpfh_pcl.csv"]), False)

    p2, n2 = np.vstack([p, p[:1]]), np.vstack([n, n[:1]])
    spfh, total, _, others = fpfh(p2, n2)
    print(f"row 0 twice: point 0 has {others[0]} neighbours other than itself")
    dup = read("fpfh_duplicate_pcl.csv", bins)
    report("PCL FPFH, duplicate", worst(total[:1], dup[:1]))
    report("PCL SPFH, duplicate", worst(spfh[:1], dup[1:]))
    report("Open3D FPFH, duplicate", worst((total + spfh)[:1], read("fpfh_duplicate_open3d.csv")))
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
