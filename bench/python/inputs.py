"""The inputs of a stage, as bench/README.md lays them down, read when they are asked for."""

import json
import pathlib

import numpy as np


class Inputs:
    """One folder of inputs, such as `sim`."""

    def __init__(self, folder, voxel=None):
        """At a `voxel` size of the caller's, metres, or that of the settings."""
        self.folder = pathlib.Path(folder)
        self.name = self.folder.name
        self.voxel = voxel or float(json.loads((self.folder / "settings.json").read_text())["voxel"])

    def path(self, name):
        return str(self.folder / name)

    def points(self, name):
        """N x 3, f32; also normals."""
        return np.fromfile(self.path(name), np.float32).reshape(-1, 3)

    def features(self, name):
        return np.fromfile(self.path(name), np.float32).reshape(-1, 33)

    def indices(self, name):
        return np.fromfile(self.path(name), np.uint32)

    def pairs(self, name):
        return np.fromfile(self.path(name), np.uint32).reshape(-1, 2)

    def pose(self, name):
        return np.fromfile(self.path(name), np.float64).reshape(4, 4)

    def starts(self):
        """K x 4 x 4: what refinement begins with, one after the other."""
        return np.fromfile(self.path("start.f64"), np.float64).reshape(-1, 4, 4)

    def queries(self):
        """The raw points of every query, in their order."""
        number = 0
        found = []
        while (self.folder / f"query_{number}.f32").exists():
            found.append(self.points(f"query_{number}.f32"))
            number += 1
        return found

    def matched(self):
        """The keypoints of `correspondences`, row by row: of the query and of the map."""
        pairs = self.pairs("correspondences.u32")
        query = self.points("query_thin.f32")[self.indices("query_keypoints.u32")]
        map_ = self.points("map_thin.f32")[self.indices("map_keypoints.u32")]
        return query[pairs[:, 0]], map_[pairs[:, 1]]

