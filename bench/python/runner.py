#!/usr/bin/env python3
"""Does one stage with one of Open3D, small_gicp and KISS-Matcher and prints a line of JSON (bench/README.md has the protocol).

    runner.py --stages
    runner.py --library NAME --inputs FOLDER --stage STAGE --threads N --repeat R [--out FILE]

Only the library that is asked for is imported, so that the memory is its own.
"""

import argparse
import importlib
import importlib.metadata
import json
import os
import sys

from inputs import Inputs

REFINERS = ["icp-point", "icp-plane", "gicp"]
QUERIES = ["nearest", "knn"]
RELOCATE = ["relocalize-prepared", "relocalize"]
STAGES = {
    "Open3D": ["read-pcd-ascii", "read-pcd-binary", "read-pcd-compressed", "read-ply", "voxel", "outliers", "tree"]
    + QUERIES
    + ["radius", "normals-knn", "normals-radius", "iss", "fpfh-all", "fpfh-keypoints", "match", "match-mutual", "ransac"]
    + REFINERS
    + ["chain"]
    + RELOCATE,
    # At voxel sizes of its own, metres.
    "Open3D@0.3": RELOCATE,
    "Open3D@0.5": RELOCATE,
    # By fast global registration in place of RANSAC.
    "Open3D-FGR": RELOCATE,
    "Open3D-FGR@0.5": RELOCATE,
    "small_gicp": ["voxel", "tree"] + QUERIES + ["normals-knn"] + REFINERS,
    "KISS-Matcher": ["ransac", "relocalize"],
    "KISS-Matcher@0.3": ["relocalize"],
    "KISS-Matcher@0.5": ["relocalize"],
}

# Name before the voxel size: its module here, the name of its stages there, its package. The modules are imported only to run a stage.
LIBRARIES = {
    "Open3D": ("on_open3d", "STAGES", "open3d-cpu"),
    "Open3D-FGR": ("on_open3d", "FAST_STAGES", "open3d-cpu"),
    "small_gicp": ("on_small_gicp", "STAGES", "small_gicp"),
    "KISS-Matcher": ("on_kiss_matcher", "STAGES", "kiss_matcher"),
}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", action="store_true", help="list what there is, a line each")
    parser.add_argument("--library", dest="name", choices=STAGES, type=known_as)
    parser.add_argument("--inputs")
    parser.add_argument("--stage")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--out")
    given = parser.parse_args()
    if given.stages:
        return given
    if not (given.name and given.inputs and given.stage):
        parser.error("--library, --inputs and --stage, or --stages")
    if given.stage not in STAGES[given.name]:
        parser.error(f"{given.name} has no stage {given.stage}")
    if given.threads < 1 or given.repeat < 1:
        parser.error("--threads and --repeat are at least 1")
    return given


def known_as(name):
    """A library's name, however it is written."""
    return {known.lower(): known for known in STAGES}.get(name.lower(), name)


def installed(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def main():
    given = arguments()
    if given.stages:
        for library, stages in STAGES.items():
            package = LIBRARIES[library.partition("@")[0]][2]
            if not installed(package):
                print(f"{package} is not installed: {library} is left out", file=sys.stderr)
                continue
            for stage in stages:
                print(library, stage)
        return
    # Before the import: OpenMP looks once.
    os.environ["OMP_NUM_THREADS"] = str(given.threads)
    name, _, voxel = given.name.partition("@")
    module, stages, package = LIBRARIES[name]
    library = importlib.import_module(module)
    library.limit(given.threads)

    from measure import measured

    inputs = Inputs(given.inputs, float(voxel) if voxel else None)
    work = getattr(library, stages)[given.stage](inputs, given.threads)
    figures, value = measured(work, given.repeat)
    array = work.result(value)
    if given.out:
        with open(given.out, "wb") as file:
            if array is not None:
                file.write(array.tobytes())
    if work.count is not None:
        count = work.count(value)
    else:
        count = 0 if array is None else len(array)
    line = {
        "library": given.name,
        "version": installed(package),
        "stage": given.stage,
        "input": inputs.name,
        "threads": given.threads,
        **figures,
        "count": count,
        "note": work.note,
    }
    if split := work.split():
        line["split"] = split
    # The libraries may have printed to the same pipe.
    sys.stdout.flush()
    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
