"""What is comparable, on small results that one can work out by hand. Wants numpy."""

import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import compare  # noqa: E402


def turned(degrees, shift=(0.0, 0.0, 0.0)):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = shift
    return pose


class Compare(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        (self.folder / "settings.json").write_text(json.dumps({"voxel": 0.2}))
        for n in range(2):
            np.array([[10, 0, 0], [30, 0, 0]], np.float32).tofile(self.folder / f"query_{n}.f32")
            np.eye(4).tofile(self.folder / f"truth_{n}.f64")
        np.eye(4).tofile(self.folder / "truth.f64")
        turned(5.0, (1.0, 0, 0)).tofile(self.folder / "start.f64")

    def held(self, stage, theirs, ours):
        job = {"stage": stage, "inputs": str(self.folder), "library": "PCL"}
        for name, array in (("theirs", theirs), ("ours", ours)):
            job[name] = str(self.folder / name)
            np.asarray(array).tofile(job[name])
        told = compare.judged(job)
        self.assertEqual(told["library"], "PCL")
        return told["text"], told["comparable"]

    def test_voxels_are_counted(self):
        points = np.zeros((200, 3), np.float32)
        self.assertEqual(self.held("voxel", points[:199], points), ("199 points (-0.50%)", True))
        # The map: a point in each of 100 cells of a grid through zero; two to a cell of one through its least corner.
        at = 0.2 * np.arange(100) + np.where(np.arange(100) % 2, 0.001, 0.199)
        np.stack([at, 0 * at, 0 * at], axis=1).astype(np.float32).tofile(self.folder / "map.f32")
        self.assertEqual(self.held("voxel", points[:50], points[:100]), ("50 points (-50.00%, as its grid lies elsewhere)", True))
        self.assertEqual(self.held("voxel", points[:70], points[:100]), ("70 points (-30.00%)", False))

    def test_kept_points_are_a_set(self):
        kept = np.arange(1000, dtype=np.uint32)
        self.assertTrue(self.held("outliers", kept[:995], kept)[1])
        self.assertFalse(self.held("outliers", kept + 100, kept)[1])

    def test_a_sum_of_distances_may_be_off_by_its_terms(self):
        ours = np.full(10, 4.0, np.float32)
        self.assertTrue(self.held("knn", ours + np.float32(0.001), ours)[1])
        self.assertFalse(self.held("nearest", ours + np.float32(0.001), ours)[1])
        self.assertFalse(self.held("nearest", ours[:9], ours)[1])

    def test_normals_have_no_sign(self):
        ours = np.tile(np.array([0, 0, 1], np.float32), (10, 1))
        self.assertEqual(self.held("normals-knn", -ours, ours), ("100.00% within 1°", True))
        theirs = ours.copy()
        theirs[:5] = [0, 1, 0]
        self.assertEqual(self.held("normals-knn", theirs, ours), ("50.00% within 1°", False))
        # A normal that is missing agrees with none.
        self.assertFalse(self.held("normals-knn", np.zeros_like(ours), ours)[1])

    def test_the_scale_of_a_histogram_does_not_count(self):
        ours = np.random.default_rng(1).uniform(1, 2, (5, 33)).astype(np.float32)
        self.assertTrue(self.held("fpfh-all", 100 * ours, ours)[1])
        self.assertFalse(self.held("fpfh-all", ours[:, ::-1] ** 4, ours)[1])

    def test_matches_are_pairs(self):
        ours = np.array([[0, 1], [1, 0], [2, 2]], np.uint32)
        self.assertEqual(self.held("match", ours[::-1].copy(), ours), ("3 pairs, 100.00% shared", True))
        self.assertFalse(self.held("match", ours[:, ::-1] + np.uint32(5), ours)[1])

    def test_pose_errors_are_at_the_centroid(self):
        # A degree about the origin moves a centroid that is 20 m away by 349 mm.
        metres, degrees = compare.apart(turned(1.0), np.eye(4), np.array([20.0, 0, 0]))
        self.assertAlmostEqual(metres, 0.34906, 4)
        self.assertAlmostEqual(degrees, 1.0, 9)

    def test_small_angles_survive(self):
        self.assertAlmostEqual(compare.apart(turned(1e-6), np.eye(4), np.zeros(3))[1], 1e-6, 10)

    def test_a_refined_pose_may_not_be_much_worse(self):
        near, far = turned(0, (0.01, 0, 0)), turned(0, (0.3, 0, 0))
        self.assertEqual(self.held("gicp", near, np.eye(4)), ("10.0 mm 0.000° from the truth, 10.0 mm 0.000° from winze's", True))
        self.assertFalse(self.held("gicp", far, near)[1])
        # Better than winze's is no fault.
        self.assertTrue(self.held("gicp", near, far)[1])
        # Whoever stays where the start was has refined nothing, winze too.
        stayed = turned(5.0, (0.9, 0, 0))
        self.assertFalse(self.held("gicp", stayed, stayed)[1])

    def test_answers_are_counted(self):
        both, one = np.stack([np.eye(4)] * 2), np.stack([np.eye(4), turned(90)])
        none = np.stack([turned(90)] * 2)
        self.assertEqual(self.held("relocalize", both, both), ("2 of 2 right, median 0 mm", True))
        self.assertTrue(self.held("relocalize", one, both)[1])
        self.assertEqual(self.held("relocalize", none, both), ("0 of 2 right", False))

    def test_what_is_missing_is_not_comparable(self):
        job = {"stage": "voxel", "inputs": str(self.folder), "theirs": "/nowhere", "ours": "/nowhere"}
        told = compare.judged(job)
        self.assertFalse(told["comparable"])
        self.assertIn("cannot be compared", told["text"])


if __name__ == "__main__":
    unittest.main()
