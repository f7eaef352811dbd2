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
        np.stack([turned(5.0, (1.0, 0, 0))] * 3).tofile(self.folder / "start.f64")

    def held(self, stage, theirs, ours, library="PCL"):
        job = {"stage": stage, "inputs": str(self.folder), "library": library}
        for name, array in (("theirs", theirs), ("ours", ours)):
            job[name] = str(self.folder / name)
            np.asarray(array).tofile(job[name])
        told = compare.judged(job)
        self.assertEqual(told["library"], library)
        return told["text"], told["comparable"]

    def test_voxels_are_counted(self):
        points = np.zeros((200, 3), np.float32)
        self.assertEqual(self.held("voxel", points[:199], points), ("199 points (-0.50%)", True))
        # The map: a point in each of 100 cells of a grid through zero; two to a cell of one through its least corner.
        at = 0.2 * np.arange(100) + np.where(np.arange(100) % 2, 0.001, 0.199)
        np.stack([at, 0 * at, 0 * at], axis=1).astype(np.float32).tofile(self.folder / "map.f32")
        self.assertEqual(self.held("voxel", points[:50], points[:100]), ("50 points (-50.00%, as its grid lies elsewhere)", True))
        self.assertEqual(self.held("voxel", points[:70], points[:100]), ("70 points (-30.00%)", False))

    def test_removed_points_are_a_set(self):
        np.zeros((1000, 3), np.float32).tofile(self.folder / "map_thin.f32")
        kept = np.arange(960, dtype=np.uint32)
        self.assertEqual(self.held("outliers", kept[:-1], kept), ("41 removed, 97.56% shared", True))
        # Nearly all are kept by both, but others.
        self.assertEqual(self.held("outliers", kept + 3, kept), ("40 removed, 86.05% shared", False))

    def test_keypoints_are_held_against_the_definition_that_a_library_has(self):
        points, mean = np.arange(100, dtype=np.uint32), np.arange(20, 120, dtype=np.uint32)
        mean.tofile(self.folder / "ours.mean")
        text, comparable = self.held("iss", mean[1:], points, "Open3D")
        self.assertEqual((text, comparable), ("99, 99.0% shared with winze's 100 by the scatter about the mean", True))
        self.assertFalse(self.held("iss", mean[3:], points, "Open3D")[1])
        self.assertEqual(self.held("iss", mean, points), ("100 (+0.0%), 66.7% shared: its saliency grows with the number of neighbours", True))
        self.assertFalse(self.held("iss", mean[:70], points)[1])

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

    def test_a_refined_pose_is_winzes_or_nearer_the_truth_from_every_start(self):
        at = lambda *shifts: np.stack([turned(0, (shift, 0, 0)) for shift in shifts])  # noqa: E731
        ours = at(0.01, 0.01, 0.02)
        text = "worst of 3: 4.0 mm 0.000° from winze's, 14.0 mm 0.000° from the truth"
        self.assertEqual(self.held("gicp", at(0.014, 0.01, 0.02), ours), (text, True))
        self.assertTrue(self.held("gicp", at(0.0, 0.01, -0.015), ours)[1])
        # One start is enough, though another is farther off.
        text = "worst of 3: 6.0 mm 0.000° from winze's, 26.0 mm 0.000° from the truth"
        self.assertEqual(self.held("gicp", at(0.0, 0.01, 0.026), ours), (text, False))
        # Nearer in metres alone does not do.
        self.assertFalse(self.held("gicp", np.stack([turned(0.06), *ours[1:]]), ours)[1])
        self.assertEqual(self.held("gicp", ours[:1], ours), ("1 instead of 3", False))

    def test_winze_has_to_refine(self):
        near, stayed = turned(0, (0.01, 0, 0)), turned(5.0, (0.9, 0, 0))
        text = "median 10.0 mm 0.000° from the truth, worst of 3 1928.0 mm 5.000°"
        self.assertEqual(self.held("gicp", [near, near, stayed], [near, near, stayed], "winze"), (text, True))
        self.assertFalse(self.held("gicp", [near, stayed, stayed], [near, stayed, stayed], "winze")[1])

    def test_answers_are_counted(self):
        both, one = np.stack([np.eye(4)] * 2), np.stack([np.eye(4), turned(90)])
        none = np.stack([turned(90)] * 2)
        self.assertEqual(self.held("relocalize", both, both), ("2 of 2 right, median 0 mm", True))
        self.assertTrue(self.held("relocalize", one, both)[1])
        self.assertEqual(self.held("relocalize", none, both), ("0 of 2 right", False))

    def test_what_is_missing_is_not_comparable(self):
        job = {"stage": "voxel", "library": "PCL", "inputs": str(self.folder), "theirs": "/nowhere", "ours": "/nowhere"}
        told = compare.judged(job)
        self.assertFalse(told["comparable"])
        self.assertIn("cannot be compared", told["text"])


if __name__ == "__main__":
    unittest.main()
