"""What the tables say of raw figures that one can work out by hand."""

import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import tables  # noqa: E402


def run(library, cpu, stage="voxel", threads=1, **more):
    line = {"library": library, "version": "1", "stage": stage, "input": "sim", "threads": threads, "note": "", "count": 7}
    line |= {"cpu": cpu, "wall": [2 * c for c in cpu], "rss_before": 10_000_000, "rss_peak": 30_000_000}
    return line | more


def held(library, comparable=True, stage="voxel", threads=1):
    return {"library": library, "stage": stage, "input": "sim", "threads": threads, "text": "as told", "comparable": comparable}


def raw(runs, comparisons=()):
    return {"date": "2026-11-30", "machine": {"commit": "abc"}, "repeat": 5, "runs": list(runs), "comparisons": list(comparisons)}


class Tables(unittest.TestCase):
    def standing(self, figures, stage="voxel"):
        return tables.standing(tables.gathered(figures), "sim", 1, stage)

    def test_rounds_are_one_sample(self):
        cells = tables.gathered(raw([run("PCL", [1.0]), run("PCL", [3.0, 9.0]), run("PCL", [5.0, 7.0], rss_peak=50_000_000)]))
        cell = cells["sim", 1, "voxel", "PCL"]
        self.assertEqual((cell["cpu"], cell["wall"], cell["runs"]), (5.0, 10.0, 5))
        self.assertEqual((cell["own"], cell["peak"]), (40_000_000, 50_000_000))

    def test_the_best_peer_is_the_quickest_whose_result_is_comparable(self):
        runs = [run("winze", [1.0]), run("PCL", [4.0]), run("Open3D", [3.0]), run("quick", [0.1])]
        told = [held("PCL"), held("Open3D"), held("quick", comparable=False)]
        found = self.standing(raw(runs, told))
        self.assertEqual((found["library"], found["cpu"], found["reached"]), ("Open3D", 3.0, "yes"))
        self.assertIn("100 ms (n=1) ✗", tables.full(raw(runs, told)))

    def test_a_result_that_nobody_compared_counts_for_nothing(self):
        self.assertIsNone(self.standing(raw([run("winze", [1.0]), run("PCL", [4.0])])))

    def test_a_peer_ahead_stays_in(self):
        figures = raw([run("winze", [2.0]), run("PCL", [1.0])], [held("PCL")])
        found = self.standing(figures)
        self.assertEqual((found["cpu"], found["reached"]), (0.5, "no"))
        self.assertIn("| voxel | 2.00 s | 1.00 s | PCL | 0.50 | 0.50 | 2 | no | 1.00 |", tables.full(figures))
        self.assertIn("| voxel | 2.00 s | 1.00 s | PCL | 0.50 |", tables.short(figures))

    def test_without_a_target_it_is_enough_to_be_ahead(self):
        figures = raw([run("winze", [1.0], "tree"), run("PCL", [1.5], "tree")], [held("PCL", stage="tree")])
        found = self.standing(figures, "tree")
        self.assertEqual((found["target"], found["reached"]), (None, "yes"))
        self.assertIn("| – | ahead |", tables.full(figures))

    def test_a_target_is_surely_reached_where_the_spreads_lie_apart(self):
        for peer, told in (([4.5, 5.0, 6.0], "about"), ([5.0, 6.0, 7.0], "yes"), ([2.0, 3.0, 9.0], "no")):
            figures = raw([run("winze", [1.5, 2.0, 2.5]), run("PCL", peer)], [held("PCL")])
            self.assertEqual(self.standing(figures)["reached"], told)
        self.assertIn("| voxel | 2.00 s (1.50–2.50) (n=3) | 3.00 s (2.00–9.00) (n=3) |", tables.full(figures))
        figures = raw([run("winze", [0.9, 1.0, 2.0], "tree"), run("PCL", [1.2, 1.5, 2.0], "tree")], [held("PCL", stage="tree")])
        self.assertIn("| – | about |", tables.full(figures))

    def test_a_search_in_a_tree_that_was_made_before_has_no_memory(self):
        figures = raw([run("winze", [1.0], "knn"), run("PCL", [1.5], "knn")], [held("PCL", stage="knn")])
        self.assertIn("| – | ahead | – |", tables.full(figures))

    def test_relocalization_is_held_against_the_best_and_against_the_one_that_is_named(self):
        runs = [run("winze", [1.0], stage) for stage in tables.ALSO] + [run("Open3D", [5.0], stage) for stage in tables.ALSO]
        runs += [run("KISS-Matcher", [30.0], "relocalize")]
        told = [held("Open3D", stage=stage) for stage in tables.ALSO] + [held("KISS-Matcher", stage="relocalize")]
        page = tables.full(raw(runs, told))
        rows = [line.split(" | ")[:5] for line in page.split("\n### CPU")[0].split("\n") if line.startswith("| relocalize")]
        self.assertEqual([(r[0][2:], r[3], r[4]) for r in rows], [
            ("relocalize-prepared", "KISS-Matcher †", "30.0"),
            ("relocalize-prepared", "Open3D", "5.0"),
            ("relocalize", "Open3D", "5.0"),
            ("relocalize", "KISS-Matcher", "30.0"),
        ])
        # Whoever places more right is not beaten.
        told[0]["right"] = 6
        found = tables.both(tables.gathered(raw(runs, told)), "sim", 1, "relocalize-prepared")
        self.assertEqual([s["reached"] for s in found], ["yes", "no"])

    def test_a_librarys_own_clocks_are_told(self):
        runs = [run("winze", [1.0], "relocalize"), run("KISS-Matcher", [3.0], "relocalize", split={"voxels": 0.5, "features": 2.0})]
        told = "* KISS-Matcher, relocalize of sim, 1 thread, wall time of the last run by its own clocks: voxels 500 ms, features 2.00 s."
        self.assertIn(told, tables.full(raw(runs)))

    def test_failures_show_and_do_not_count(self):
        gone = {"library": "PCL", "stage": "voxel", "input": "sim", "threads": 1, "failed": "signal 11: gone"}
        figures = raw([run("winze", [1.0]), gone, run("Open3D", [3.0])], [held("Open3D")])
        self.assertEqual(self.standing(figures)["library"], "Open3D")
        page = tables.full(figures)
        self.assertIn("failed", page)
        self.assertIn("* PCL, voxel: failed at sim, 1 threads: signal 11: gone.", page)

    def test_a_stage_that_breaks_off_later_has_failed(self):
        gone = {"library": "PCL", "stage": "voxel", "input": "sim", "threads": 1, "failed": "exit 1: no memory"}
        figures = raw([run("winze", [1.0]), run("PCL", [2.0]), gone], [held("PCL")])
        self.assertIsNone(self.standing(figures))

    def test_a_map_that_cannot_be_prepared_is_shown_where_it_can(self):
        runs = [run("winze", [1.0], "relocalize-prepared"), run("winze", [2.0], "relocalize")]
        runs += [run("KISS-Matcher", [30.0], "relocalize"), run("Open3D", [5.0], "relocalize-prepared")]
        told = [held("KISS-Matcher", stage="relocalize"), held("Open3D", stage="relocalize-prepared")]
        figures = raw(runs, told)
        found = self.standing(figures, "relocalize-prepared")
        # The target names KISS-Matcher, though Open3D is quicker.
        self.assertEqual((found["library"], found["cpu"], found["wall"]), ("KISS-Matcher", 30.0, 30.0))
        self.assertIn("KISS-Matcher †", tables.full(figures))

    def test_of_a_peers_voxel_sizes_the_one_that_finds_most_counts(self):
        runs = [run("winze", [1.0], "relocalize-prepared"), run("winze", [2.0], "relocalize"), run("Open3D", [0.1], "relocalize")]
        told = []
        for name, cpu, right in (("KISS-Matcher", 30.0, 4), ("KISS-Matcher@0.3", 20.0, 4), ("KISS-Matcher@0.5", 5.0, 3)):
            runs.append(run(name, [cpu], "relocalize"))
            told.append({**held(name, stage="relocalize"), "right": right})
        found = self.standing(raw(runs, told), "relocalize-prepared")
        self.assertEqual((found["library"], found["cpu"], found["wall"]), ("KISS-Matcher@0.3", 20.0, 20.0))

    def test_fewer_repetitions_are_told(self):
        figures = raw([run("winze", [1.0] * 5), run("PCL", [70.0])], [held("PCL")])
        page = tables.full(figures)
        self.assertIn("70.00 s (n=1)", page)
        self.assertNotIn("1.00 s (n=", page)

    def test_memory_is_held_against_the_leanest_and_is_at_least_a_megabyte(self):
        runs = [run("winze", [1.0], rss_peak=10_000_000), run("PCL", [2.0], rss_peak=70_000_000), run("Open3D", [3.0], rss_peak=14_000_000)]
        found = self.standing(raw(runs, [held("PCL"), held("Open3D")]))
        self.assertEqual((found["library"], found["memory"]), ("PCL", 4.0))

    def test_stages_come_in_the_order_of_the_protocol(self):
        cells = tables.gathered(raw([run("winze", [1.0], s) for s in ("chain", "other", "voxel")]))
        self.assertEqual(tables.stages(cells), ["voxel", "chain", "other"])

    def test_the_short_table_has_a_column_a_thread_count(self):
        runs = [run(name, [cpu], threads=t) for t in (1, 2) for name, cpu in (("winze", 0.5), ("PCL", 2.0 * t))]
        page = tables.short(raw(runs, [held("PCL", threads=1), held("PCL", threads=2)]))
        self.assertIn("| stage | winze | best peer | which | ratio, 1 thread | ratio, 2 threads |", page)
        self.assertIn("| voxel | 500 ms | 2.00 s | PCL | 4.0 | 8.0 |", page)


if __name__ == "__main__":
    unittest.main()
