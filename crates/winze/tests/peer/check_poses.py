"""Independent point-to-plane systems in numpy: reproduces
information_small_gicp_plane.csv and writes information_plane.csv, the ordinary
point-to-plane matrix. Exits non-zero if the reproduction fails."""

import sys

import numpy as np
from scipy.spatial import cKDTree


def read(name):
    return np.loadtxt(name, delimiter=",", comments="#")


def poses():
    out = {}
    with open("poses.csv") as lines:
        for line in lines:
            if not line.startswith("#"):
                name, *numbers = line.strip().split(",")
                out[name] = np.array(numbers[:16], dtype=float).reshape(4, 4)
    return out


def pca_normals(p, k):
    out = []
    for near in cKDTree(p).query(p, k=k)[1]:
        out.append(np.linalg.eigh(np.cov(p[near].T, bias=True))[1][:, 0])
    return np.array(out)


def skew(v):
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - out.transpose(0, 2, 1)


def systems(target, normals, source, t):
    """For every matched point: residual q - T p and its Jacobian for T exp(delta),
    delta = (rotation, translation); then the two ways to use the normal."""
    rot = t[:3, :3]
    moved = source @ rot.T + t[:3, 3]
    gap, near = cKDTree(target).query(moved)
    use = gap <= 1.0
    r = (target[near] - moved)[use]
    n = normals[near][use]
    jac = np.concatenate([rot @ skew(source[use]), np.broadcast_to(-rot, (use.sum(), 3, 3))], axis=2)
    scaled, each = n[:, :, None] * jac, n * r
    row, dot = np.einsum("ni,nij->nj", n, jac), (n * r).sum(1)
    componentwise = (
        np.einsum("nki,nkj->ij", scaled, scaled),
        np.einsum("nki,nk->i", scaled, each),
        0.5 * (each**2).sum(),
    )
    ordinary = row.T @ row, row.T @ dot, 0.5 * (dot**2).sum()
    return componentwise, ordinary, use.sum()


def main():
    target, source, given = read("cloud.csv"), read("moved.csv"), read("normals.csv")
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    pose = poses()

    peer = read("information_small_gicp_plane.csv")
    component, ordinary, used = systems(target, pca_normals(target, 20), source, pose["small_gicp_plane"])
    errors = {
        name: np.abs(h - peer[:6]).max() / np.abs(peer[:6]).max()
        for name, (h, _, _) in (("component by component", component), ("ordinary", ordinary))
    }
    print(f"small_gicp_plane: {used} matches, error {component[2]:.7g} component by component, {ordinary[2]:.7g} ordinary")
    for name, error in errors.items():
        print(f"  H against the {name} sum: largest relative difference {error:.1e}")

    _, (h, b, e), used = systems(target, given, source, pose["open3d_icp_plane"])
    print(f"open3d_icp_plane: {used} matches, error {e:.7g}, |b| {np.linalg.norm(b):.1e}, Newton step {np.linalg.norm(np.linalg.solve(h, b)):.1e}")
    np.savetxt(
        "information_plane.csv",
        np.vstack([h, b]),
        fmt="%.7g",
        delimiter=",",
        comments="# ",
        header=f"rows 1-6: H = sum J^T J, row 7: b = sum J^T r of point-to-plane at the pose open3d_icp_plane of poses.csv, "
        f"error 0.5 sum r^2 = {e:.7g}, {used} matches, normals.csv; rotation first, T exp(delta), by check_poses.py "
        f"with numpy {np.__version__}",
    )
    sys.exit(int(errors["component by component"] > 1e-5))


if __name__ == "__main__":
    main()
