"""Locates the demo near its truth and prints the answers to the bit, times left out: what two processors print must be the same.

    python tools/smoke.py            # on standard error, what it runs on
"""

import hashlib
import json
import platform
import sys

import numpy as np

import winze


def timeless(value: object) -> object:
    """The value without what differs from run to run."""
    if isinstance(value, dict):
        return {key: timeless(each) for key, each in value.items() if key != "seconds"}
    if isinstance(value, list):
        return [timeless(each) for each in value]
    return value


def main() -> None:
    told = f"winze {winze.__version__}, {platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}"
    print(told, file=sys.stderr)
    prior, query, truth = winze.demo()
    for cloud in (prior, query):
        print(hashlib.sha256(cloud.points.tobytes()).hexdigest())
    # Between them they pass every stage; in an emulator each takes its time.
    for method in ("auto", "fpfh+ndt+icp"):
        outcome = winze.locate(prior, query, method=method)
        if method == "auto":
            assert outcome.verdict is winze.Verdict.LOCATED, outcome
            assert outcome.pose is not None
            # No element of the rotation, and no metre of the translation, is further off.
            assert np.abs(outcome.pose - truth).max() < 0.1, outcome.pose - truth
        if outcome.pose is not None:
            print(method, *(float(each).hex() for each in outcome.pose[:3].ravel()))
        # The digits of JSON are as many as tell one float from the next.
        print(method, json.dumps(timeless(outcome.to_dict()), sort_keys=True))


if __name__ == "__main__":
    main()
