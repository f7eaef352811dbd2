#!/usr/bin/env python3
"""Does a built map answer as its cloud does, to the bit?

    winze sim paper --out paper
    python3 bench/map_equals_cloud.py target/release/winze paper

Builds each map of the folder's cases once, locates every query by every method in the cloud and in the built map, and
compares verdict, reason, pose, hypotheses, information and open directions. Exit status 1 where any differs.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

METHODS = ["auto", "fpfh", "fpfh+ndt", "fpfh+icp", "ndt+icp", "fpfh+ndt+icp"]
COMPARED = ["verdict", "reason", "map_from_query", "hypotheses", "information", "unobservable", "covariance_at"]


def main() -> int:
    winze, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    cases = json.loads((folder / "cases.json").read_text())["cases"]
    differ = runs = 0
    with tempfile.TemporaryDirectory() as scratch:
        built = {}
        for case in cases:
            cloud = folder / case["map"]
            if cloud not in built:
                built[cloud] = pathlib.Path(scratch) / f"{len(built)}.wmap"
                subprocess.run([winze, "map", "build", cloud, "-o", built[cloud], "--quiet"], check=True)
            for method in METHODS:
                answers = []
                for prior in (cloud, built[cloud]):
                    command = [winze, "locate", prior, folder / case["query"], "--method", method, "--json", "-", "--quiet"]
                    if case.get("gravity_aligned"):
                        command.append("--gravity-aligned")
                    done = subprocess.run(command, capture_output=True, text=True)
                    if done.returncode not in (0, 1):
                        print(case["name"], method, done.stderr.strip())
                        return 2
                    answer = json.loads(done.stdout)
                    answers.append({key: answer[key] for key in COMPARED})
                runs += 1
                same = answers[0] == answers[1]
                differ += not same
                print(f"{case['name']} {method}: {answers[0]['verdict']}, {'same' if same else 'DIFFERENT'}")
    print(f"{runs} questions, {differ} answered differently")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
