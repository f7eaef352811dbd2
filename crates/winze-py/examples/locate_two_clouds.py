"""Finds a cloud in a map: python locate_two_clouds.py MAP QUERY

Prints the verdict and the pose, and leaves the report beside the query. Exits with 0 where it is located, else with 1.
"""

from __future__ import annotations

import sys
from pathlib import Path

import winze


def main(map_path: str, query_path: str) -> int:
    outcome = winze.locate(map_path, query_path, progress=True)
    print(f"{outcome.verdict}: {outcome.reason}")
    outcome.to_html(Path(query_path).with_suffix(".html"))
    if not outcome.located or outcome.pose is None:
        return 1
    print(outcome.pose.round(4))
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
