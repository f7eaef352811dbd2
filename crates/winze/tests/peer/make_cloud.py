"""Synthetic clouds for the peer comparison. Writes cloud.csv, stations.csv,
outliers.csv, moved.csv and T_cloud_moved.csv into the current folder.

The cloud is one piece of a mine drift: 4 m wide, 3.5 m high, 13.5 m long, bent
by 45 degrees, with a 3 m wide stub drift leaving from the outer wall of the
bend. The surface is the zero set of an implicit function (union of two swept,
arched profiles plus lattice noise in three octaves, damped on the floor);
random points are dropped onto it and thinned to a minimum spacing.
"""

import numpy as np
from scipy.spatial import cKDTree

SEED = 20240611
# One random stream each for the cloud, the outliers and the moved cloud. The last
# is chosen: with about every second draw, point-to-point ICP from the identity
# stops 0.24 m (one point spacing) away from the truth, in PCL and Open3D alike.
STREAMS = 0, 1, 5
SPACING = 0.225
FLOOR = -1.37  # z of the floor: heights below are above the floor until the end
VIEWPOINT_STATION = 7  # row of stations.csv


def centrelines():
    """Dense polylines (x, y) of the main drift and of the stub."""
    step, radius, turn = 0.02, 7.0, np.deg2rad(45.0)
    heading = np.concatenate(
        [
            np.zeros(int(5.0 / step)),
            np.linspace(0.0, turn, int(radius * turn / step)),
            np.full(int(3.0 / step), turn),
        ]
    )
    delta = step * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    main = np.array([-6.03, -2.17]) + np.cumsum(delta, axis=0)
    root = np.searchsorted(step * np.arange(len(main)), 7.5)
    aim = heading[root] - np.pi / 2 + 0.12
    along = np.arange(0.0, 4.2, step)[:, None]
    stub = main[root] + along * np.array([[np.cos(aim), np.sin(aim)]])
    return main, stub


def arch(lateral, z, half_width, height):
    """Signed distance to a rounded rectangle, floor at z = 0, wide top radius."""
    half = np.array([half_width, height / 2])
    zc = z - height / 2
    r = np.where(zc > 0.0, 1.2, 0.3)
    q = np.abs(np.stack([lateral, zc], axis=-1)) - (half - r[..., None])
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=-1)
    return outside + np.minimum(q.max(axis=-1), 0.0) - r


class Noise:
    """Smooth lattice noise with values in about [-amplitude, amplitude]."""

    def __init__(self, rng, octaves):
        self.octaves = [
            (wave, amp, rng.uniform(-1.0, 1.0, (32, 32, 32))) for wave, amp in octaves
        ]

    def __call__(self, p):
        total = np.zeros(len(p))
        for wave, amp, table in self.octaves:
            g = p / wave + 64.0
            cell = np.floor(g).astype(int)
            t = g - cell
            t = t * t * (3.0 - 2.0 * t)
            for corner in np.ndindex(2, 2, 2):
                w = np.prod(np.where(corner, t, 1.0 - t), axis=1)
                i, j, k = ((cell + corner) % 32).T
                total += amp * w * table[i, j, k]
        return total


class Drift:
    def __init__(self, rng):
        self.main, self.stub = centrelines()
        self.trees = cKDTree(self.main), cKDTree(self.stub)
        self.noise = Noise(rng, [(2.3, 0.34), (1.1, 0.15), (0.55, 0.07)])

    def smooth(self, p):
        """The two profiles without noise: negative in the air, positive in the rock."""
        d_main = self.trees[0].query(p[:, :2])[0]
        d_stub = self.trees[1].query(p[:, :2])[0]
        a = arch(d_main, p[:, 2], 2.0, 3.5)
        b = arch(d_stub, p[:, 2], 1.5, 3.0)
        h = np.maximum(0.3 - np.abs(a - b), 0.0) / 0.3
        return np.minimum(a, b) - 0.3 * h * h / 4.0

    def value(self, p):
        w = np.clip((p[:, 2] - 0.1) / 0.6, 0.0, 1.0)
        return self.smooth(p) - (0.15 + 0.85 * w * w * (3.0 - 2.0 * w)) * self.noise(p)

    def gradient(self, p):
        eps = 1e-4
        return np.stack(
            [
                (self.value(p + eps * e) - self.value(p - eps * e)) / (2 * eps)
                for e in np.eye(3)
            ],
            axis=1,
        )

    def open_ended(self, p):
        """True away from the round caps the distance function puts at the ends."""
        i = self.trees[0].query(p[:, :2])[1]
        j = self.trees[1].query(p[:, :2])[1]
        d_main = self.trees[0].query(p[:, :2])[0]
        d_stub = self.trees[1].query(p[:, :2])[0]
        in_main = (i > 0) & (i < len(self.main) - 1)
        past_stub = (j == len(self.stub) - 1) & (d_main > 2.6)
        in_stub = (j > 0) & (d_stub < 2.0) & (d_main > 1.0)
        return (in_main | in_stub) & ~past_stub


def surface(drift, rng):
    lo = np.concatenate([np.minimum(drift.main.min(0), drift.stub.min(0)) - 3.0, [-0.5]])
    hi = np.concatenate([np.maximum(drift.main.max(0), drift.stub.max(0)) + 3.0, [4.2]])
    p = rng.uniform(lo, hi, (600_000, 3))
    p = p[np.abs(drift.value(p)) < 0.25]
    for _ in range(6):
        g = drift.gradient(p)
        p = p - g * (drift.value(p) / np.maximum((g * g).sum(1), 0.05))[:, None]
    p = p[(np.abs(drift.value(p)) < 1e-3) & drift.open_ended(p)]
    p = p[rng.permutation(len(p))]
    near = cKDTree(p).query_ball_point(p, SPACING)
    state = np.zeros(len(p), dtype=np.int8)
    for i in range(len(p)):
        if state[i] == 0:
            state[near[i]] = 2
            state[i] = 1
    return p[state == 1]


def save(name, header, rows, fmt):
    comments = "# " if header else ""
    np.savetxt(name, rows, fmt=fmt, delimiter=",", header=header, comments=comments)


def main():
    rng, rng_outliers, rng_moved = (np.random.default_rng([SEED, k]) for k in STREAMS)
    drift = Drift(rng)
    bare = surface(drift, rng)
    on_smooth = drift.smooth(bare)
    cloud = np.round(bare + [0.0, 0.0, FLOOR], 4)
    save("cloud.csv", "", cloud, "%.4f")

    xy = np.concatenate([drift.main[25::50], drift.stub[60::50]])
    stations = np.column_stack([xy, np.full(len(xy), FLOOR + 1.6)])
    save(
        "stations.csv",
        "x,y,z of points inside the drift, 1 m apart along both centrelines, by make_cloud.py; "
        f"row {VIEWPOINT_STATION} (0-based) is the viewpoint of every normals_*.csv",
        stations,
        "%.4f",
    )

    lo, hi = cloud.min(0) - 2.0, cloud.max(0) + 2.0
    wild = rng_outliers.uniform(lo, hi, (8000, 3))
    gap = cKDTree(cloud).query(wild)[0]
    close, far = wild[(gap > 0.35) & (gap < 0.65)], wild[gap >= 0.65]
    wild = np.round(np.concatenate([close[:30], far[:30]]), 4)
    save(
        "outliers.csv",
        f"x,y,z: the {len(cloud)} points of cloud.csv in the same order, then 30 random points "
        "0.35 to 0.65 m from the nearest of them, then 30 farther ones, by make_cloud.py",
        np.concatenate([cloud, wild]),
        "%.4f",
    )

    axis = np.array([0.32, -0.21, 0.924])
    axis /= np.linalg.norm(axis)
    angle = np.deg2rad(4.0)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    t = np.eye(4)
    t[:3, :3] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    t[:3, 3] = [0.22, -0.18, 0.10]
    pick = np.sort(rng_moved.permutation(len(cloud))[: int(round(0.7 * len(cloud)))])
    noisy = cloud[pick] + rng_moved.normal(0.0, 0.01, (len(pick), 3))
    moved = (noisy - t[:3, 3]) @ t[:3, :3]
    save(
        "moved.csv",
        "x,y,z: 70 % of cloud.csv in random draw, plus Gaussian noise of 0.01 m per axis, "
        "taken through the inverse of T_cloud_moved.csv, by make_cloud.py",
        moved,
        "%.4f",
    )
    save(
        "T_cloud_moved.csv",
        "4x4, one row per line: takes points of moved.csv to cloud.csv "
        "(4 degrees about a fixed axis through the origin, then 0.30 m), by make_cloud.py",
        t,
        "%.12g",
    )
    print(len(cloud), "points, extents", cloud.max(0) - cloud.min(0))
    print("bumps: largest %.2f m, standard deviation %.2f m" % (np.abs(on_smooth).max(), on_smooth.std()))
    gaps = cKDTree(cloud).query(cloud, k=2)[0][:, 1]
    print("nearest neighbour spacing: mean %.3f, min %.3f, max %.3f" % (gaps.mean(), gaps.min(), gaps.max()))


if __name__ == "__main__":
    main()
