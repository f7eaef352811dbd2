"""Independent normals, outlier removal and voxel grids in numpy, compared with
the normals_*, removed_* and voxel_* files. Exits non-zero on a difference."""

import sys

import numpy as np
from scipy.spatial import cKDTree

VIEWPOINT_STATION = 7
failed = False


def read(name):
    return np.loadtxt(name, delimiter=",", comments="#", ndmin=2)


def report(what, ok, note=""):
    global failed
    failed |= not ok
    print(f"{'ok  ' if ok else 'FAIL'} {what} {note}")


def within(p, radius):
    """Lists with the point itself, d^2 < r^2 (strict)."""
    out = []
    for i, near in enumerate(cKDTree(p).query_ball_point(p, radius * 1.001)):
        near = np.array(near)
        out.append(near[((p[near] - p[i]) ** 2).sum(1) < radius**2])
    return out


def plane(q):
    """Normal and curvature of a neighbourhood: covariance about the mean."""
    w, v = np.linalg.eigh(np.cov(q.T, bias=True))
    return v[:, 0], w[0] / w.sum()


def normals(p, eye):
    for tag, near in (("k20", cKDTree(p).query(p, k=20)[1]), ("r08", within(p, 0.8))):
        for peer in ("pcl", "open3d"):
            rows = read(f"normals_{peer}_{tag}.csv")
            angle, bend = [], []
            for row in rows:
                i = int(row[0])
                n, curvature = plane(p[near[i]])
                n *= np.sign(n @ (eye - p[i]))
                angle.append(np.rad2deg(2 * np.arcsin(min(1.0, np.linalg.norm(n - row[1:4]) / 2))))
                if peer == "pcl":
                    bend.append(abs(curvature - row[4]))
            note = f"largest angle {max(angle):.5f} deg"
            if bend:
                note += f", largest curvature difference {max(bend):.1e}"
            report(f"normals_{peer}_{tag}.csv", max(angle) < 0.05 and max(bend, default=0) < 1e-5, note)


def outliers(p):
    def same(name, mine):
        peer = set(read(name)[:, 0].astype(int))
        report(name, peer == set(mine), f"{len(peer)} removed")

    d = cKDTree(p).query(p, k=17)[0]

    def statistical(mean_distance, ddof):
        return np.flatnonzero(mean_distance > mean_distance.mean() + mean_distance.std(ddof=ddof))

    without_self, with_self = d[:, 1:].mean(1), d[:, :16].mean(1)
    same("removed_statistical_pcl.csv", statistical(without_self, 1))
    same("removed_statistical_open3d.csv", statistical(with_self, 1))
    for tag, m in (("without self", without_self), ("with self", with_self)):
        for ddof in (0, 1):
            limit = m.mean() + m.std(ddof=ddof)
            nearest = np.sort(np.abs(m - limit))[0]
            print(f"     16 {tag}, ddof {ddof}: threshold {limit:.7f}, closest point {nearest:.1e} away")

    count = np.array([len(k) for k in within(p, 0.6)])
    few = np.flatnonzero(count <= 5)
    same("removed_radius_pcl.csv", few)
    same("removed_radius_open3d.csv", few)
    print(f"     points with exactly 5 or 6 within 0.6, itself included: {(count == 5).sum()} and {(count == 6).sum()}")


def centroids(p, cell):
    keys, inverse = np.unique(cell, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    total = np.zeros((len(keys), 3))
    np.add.at(total, inverse, p)
    return total / np.bincount(inverse)[:, None]


def voxels(p):
    size = 0.5
    world = np.floor(p.astype(np.float32) * np.float32(1 / size)).astype(int)
    shifted = np.floor((p - (p.min(0) - size / 2)) / size).astype(int)
    for name, cell in (("voxel_pcl.csv", world), ("voxel_open3d.csv", shifted)):
        peer, mine = read(name), centroids(p, cell)
        gap = cKDTree(mine).query(peer)[0].max() if len(peer) == len(mine) else np.inf
        report(name, gap < 2e-5, f"{len(peer)} cells, largest difference {gap:.1e} m")


def main():
    p = read("cloud.csv")
    normals(p, read("stations.csv")[VIEWPOINT_STATION])
    outliers(read("outliers.csv"))
    voxels(p)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
