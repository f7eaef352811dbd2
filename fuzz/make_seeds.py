"""Writes the seeds that the fuzzer starts from into seeds/<target>/. Run in this folder."""

import io
import json
import pathlib
import shutil
import struct
import zipfile
import zlib

SEEDS = pathlib.Path("seeds")
FIXTURES = pathlib.Path("../crates/winze-io/tests/fixtures")


def put(target, name, content):
    folder = SEEDS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def copy(target, *names):
    for name in names:
        (SEEDS / target).mkdir(parents=True, exist_ok=True)
        shutil.copy(FIXTURES / name, SEEDS / target / name)


def pcd(fields, size, kind, count, width, height, points, data, more=""):
    return (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {fields}\nSIZE {size}\n"
        f"TYPE {kind}\nCOUNT {count}\nWIDTH {width}\nHEIGHT {height}\n{more}POINTS {points}\nDATA {data}\n"
    ).encode()


def compressed(columns, packed=None):
    """The size words and an LZF stream, of literals only unless one is given."""
    if packed is None:
        runs = [columns[i : i + 32] for i in range(0, len(columns), 32)]
        packed = b"".join(bytes([len(r) - 1]) + r for r in runs)
    return struct.pack("<II", len(packed), len(columns)) + packed


def floats(*values):
    return struct.pack(f"<{len(values)}f", *values)


plain = ("x y z", "4 4 4", "F F F", "1 1 1")
put("kitti", "scan.bin", floats(1, 2, 3, 0.5, -4, 5, 6, 0.25))
put("kitti", "far.bin", floats(431234.5, 4499980.5, 312, 1) * 3)
put("kitti", "no_returns.bin", floats(0, 0, 0, 0) * 12 + floats(float("nan"), 1, 2, 3, 7, 8, 9, 1))
put("pcd", "ascii.pcd", pcd(*plain, 3, 1, 3, "ascii") + b"1 2 3\nnan nan nan\n-4.5 1e2 0.25\n")
put("pcd", "utm.pcd", pcd(*plain, 2, 1, 2, "ascii") + b"431234.567 4499980.459 312.1\n431235 4499981 313\n")
put("pcd", "binary.pcd", pcd(*plain, 2, 1, 2, "binary") + floats(1, 2, 3, 4, 5, 6))
put("pcd", "viewpoint.pcd", pcd(*plain, 2, 2, 4, "binary", "VIEWPOINT 1 2 3 0 1 0 0\n") + floats(*range(12)))
put("pcd", "points_differ.pcd", pcd(*plain, 5, 1, 2, "binary") + floats(1, 2, 3, 4, 5, 6))
put("pcd", "empty.pcd", pcd(*plain, 0, 1, 0, "binary_compressed") + struct.pack("<II", 0, 0))
put("pcd", "old.pcd", "COLUMNS x y z\r\nDATA ascii\r\n0.1 0.2 0.3\r\n")
padded = ("_ z ring y intensity x", "1 8 2 4 1 4", "U F U I U F", "3 1 1 1 1 1")
row = struct.pack("<3xdHiBf", 2.5, 7, -3, 200, 0.5)
put("pcd", "padded.pcd", pcd(*padded, 2, 1, 2, "binary") + row * 2)
put("pcd", "literal.pcd", pcd(*plain, 4, 1, 4, "binary_compressed") + compressed(floats(*range(12))))
put(
    "pcd",
    "match.pcd",
    # 1.0 once, then a match of 44 bytes, four back.
    pcd(*plain, 4, 1, 4, "binary_compressed") + compressed(floats(*[1] * 12), b"\x03\x00\x00\x80\x3f\xe0\x23\x03"),
)
copy("pcd", "pcl_compressed.pcd", "pcl_image.pcd", "open3d_compressed.pcd")


def ply(form, elements):
    return f"ply\nformat {form} 1.0\ncomment seed\n{elements}end_header\n".encode()


xyz = "property float x\nproperty float y\nproperty float z\n"
put("ply", "ascii.ply", ply("ascii", f"element vertex 2\n{xyz}") + b"1 2 3\nnan 5 6\n")
put("ply", "little.ply", ply("binary_little_endian", f"element vertex 2\n{xyz}property uchar scalar_Intensity\n") + (floats(1, 2, 3) + b"\x07") * 2)
put("ply", "big.ply", ply("binary_big_endian", f"element vertex 2\n{xyz}") + struct.pack(">6f", *range(6)))
put(
    "ply",
    "lists.ply",
    ply("binary_big_endian", f"element face 1\nproperty list uchar int vertex_indices\nelement vertex 1\nproperty list short double t\n{xyz}")
    + struct.pack(">B3i", 3, 0, 1, 2) + struct.pack(">h2d3f", 2, 0.5, 1.5, 1, 2, 3),
)
put("ply", "utm.ply", ply("ascii", "element vertex 1\n" + xyz.replace("float", "double")) + b"431234.567 4499980.459 312.1\r\n")
put("ply", "empty.ply", ply("ascii", f"element vertex 0\n{xyz}"))
copy("ply", "plyfile_big.ply", "plyfile_lists_ascii.ply", "plyfile_lists_little.ply", "open3d_tensor.ply")

put("text", "blanks.xyz", "# x y z intensity\n1 2 3 4\n5.5 -6 7e1 8\n")
put("text", "commas.csv", "x,y,z\n431230,4499981,nan\n431231.5,4499979.25,311\n431234.567,4499980.459,312.1\n")
put("text", "semicolons.csv", '"X [m]";"Y [m]";"Z [m]"\r\n1,5;2,5;3,5\r\nnan;;inf\r\n')
put("text", "count.pts", "2\n1 2 3\n4 5 6\n")
put("text", "slashes.txt", "//X Y Z Scalar_Intensity\n0.1\t0.2\t0.3\t9\n")
put("text", "names.txt", "\ufefftime Z Y X\n1 2 3 4\n\n# between\n5 6 7 8\n")

identity = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
put("transform", "identity.txt", identity)
put("transform", "turned.txt", "# T_map_query\n0,-1,0,431234.567\n1,0,0,4499980.459\n0,0,1,-17.6 # up\n0,0,0,1\n")
put("transform", "brackets.txt", "[[1, 0, 0, 0.5],\n [0, 6.1e-17, -1, 0],\n [0, 1, 6.1e-17, 0],\n [0, 0, 0, 1]]")
put("transform", "rounded.txt", "0.7567 -0.6535 0.0176 1.97\n0.6534 0.7569 0.0144 0.0573\n-0.0227 0.0006 0.9997 0.0319\n0 0 0 1")

square = [(0, 0, 0), (1, 0, 0.5), (1, 1, 0.25), (0, 1, -0.125)]
corners = [c for i in (0, 1, 2, 0, 2, 3) for c in square[i]]
polygon = "element face 1\nproperty list uchar int vertex_indices\n"
lines = "".join(f"{x} {y} {z}\n" for x, y, z in square)
put("mesh_ply", "ascii.ply", ply("ascii", f"element vertex 4\n{xyz}{polygon}") + f"{lines}4 0 1 2 3\n".encode())
put(
    "mesh_ply",
    "parts.ply",
    ply(
        "binary_little_endian",
        "comment winze part 0 0.3 0 old rock\ncomment winze part 1 0.4 0.5 new a pipe\n"
        f"element vertex 4\n{xyz}element face 2\nproperty list uchar uint vertex_indices\nproperty ushort part\n",
    )
    + floats(*[c for v in square for c in v])
    + struct.pack("<B3IH", 3, 0, 1, 2, 0)
    + struct.pack("<B3IH", 3, 0, 2, 3, 1),
)
put(
    "mesh_ply",
    "big.ply",
    ply("binary_big_endian", f"element vertex 4\n{xyz}element face 1\nproperty uchar v1\nproperty uchar v2\nproperty uchar v3\n")
    + struct.pack(">12f", *[c for v in square for c in v])
    + bytes([0, 1, 2]),
)
facets = "".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join("vertex {} {} {}\n".format(*corners[9 * t + 3 * k : 9 * t + 3 * k + 3]) for k in range(3))
    + "endloop\nendfacet\n"
    for t in range(2)
)
put("mesh_stl", "ascii.stl", f"solid square\n{facets}endsolid square\n")
put(
    "mesh_stl",
    "binary.stl",
    b" " * 80 + struct.pack("<I", 2) + b"".join(floats(0, 0, 1, *corners[9 * t : 9 * t + 9]) + b"\0\0" for t in range(2)),
)
points = "".join(f"v {x} {y} {z}\n" for x, y, z in square)
put("mesh_obj", "square.obj", f"o square\n{points}vn 0 0 1\nf 1//1 2//1 3//1 4//1\n")
put("mesh_obj", "negative.obj", f"# far\nv 431234.567 4499980.459 312.1\n{points}f -4 -3 \\\n-2\n")


def wmap(*sections):
    """A container: tag, bytes of an element, content."""
    pad = lambda b: b + bytes(-len(b) % 64)
    seal = lambda b: b + struct.pack("<I", zlib.crc32(b))
    out = seal(struct.pack("<8sII44x", b"WINZEMAP", 1, 0x0A0B0C0D))
    table = b""
    for tag, number, element, content in sections:
        out = pad(out)
        table += struct.pack("<4sIQQIIQ", tag, number, len(out), len(content), zlib.crc32(content), element, 0)
        out += content
    out = pad(out)
    trailer = struct.pack("<QQQI24x8s", len(out), len(table), len(pad(out + table)) + 64, zlib.crc32(table), b"WMAP END")
    return pad(out + table) + seal(trailer)


level = {"voxel": 0.2, "points": 0, "keypoints": 0, "qualified": 0, "ndt_sizes": [0.8], "ndt_cells": [0]}
meta = {
    "winze": "0.1.0",
    "points": 100,
    "origin": [0, 0, 0],
    "bounds": [[0, 0, 0], [1, 1, 1]],
    "robust_bounds": [[0, 0, 0], [1, 1, 1]],
    "measure": {"spacing": 0.1, "width": 4.0, "width_range": [3.0, 5.0], "budget": 0.4},
    "noise_patch": 0.3,
    "base_voxel": 0.1,
    "base_points": 0,
    "levels": [level],
    "sources": [{"name": "a", "digest": "", "bytes": 1, "format": "", "points": 100, "dropped": [0, 0, 0]}],
    "config": {},
    "config_digest": "",
}
put("map", "no_sections.wmap", wmap())
put(
    "map",
    "no_points.wmap",
    wmap(
        *[(tag, 0, size, b"") for tag, size in [(b"PNTS", 12), (b"NRML", 12), (b"NODE", 16)]],
        *[(tag, 0, 4, b"") for tag in [b"AXSX", b"AXSY", b"AXSZ"]],
        (b"KEYP", 0, 12, b""),
        (b"DESC", 0, 132, b""),
        (b"IDXF", 0, 132, bytes(12 * 132)),
        (b"IDXN", 0, 192, b""),
        (b"IDXB", 0, 768, b""),
        (b"IDXO", 0, 64, b""),
        (b"GAUS", 0, 72, b""),
        (b"GCEL", 0, 12, b""),
        (b"GTAB", 0, 4, bytes(4)),
        (b"META", 0, 1, json.dumps(meta).encode()),
    ),
)
put("map", "nothing.patch", b"patch")
for section in range(0, 60, 4):
    patch = struct.pack("<BBHI", section, section % 3, 7 * section, 0x7FC00000)
    put("map", f"section_{section}.patch", b"patch" + patch)


def archive(**entries):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in entries.items():
            packed.writestr(zipfile.ZipInfo(name.replace("_", ".")), content)
    return out.getvalue()


manifest = {"format": 1, "winze": "0.1.0", "query": {"path": "q", "entry": "query"}, "entries": {}}
manifest["map"] = {"path": "m", "digest": "sha256:0", "points_in_file": 1}
manifest["request"] = {"method": "auto", "gravity_aligned": False, "near": [1, 2, 3, 4], "initial": None, "truth": None}
put("bundle", "empty.zip", archive())
put("bundle", "manifest.zip", archive(manifest_json=json.dumps(manifest)))
put("bundle", "newer.zip", archive(manifest_json=json.dumps(manifest | {"format": 2})))
put("bundle", "nothing.patch", b"patch")
for entry in range(12):
    put("bundle", f"entry_{entry}.patch", b"patch" + struct.pack("<BBHI", entry, entry % 2, 37 * entry, 0x3F800000))
    put("bundle", f"cut_{entry}.patch", b"patch" + struct.pack("<BBHI", entry, 2, 12, 0))
