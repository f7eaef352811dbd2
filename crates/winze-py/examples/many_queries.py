"""Asks a prepared map many times: python many_queries.py MAP.wmap QUERY...

The map is opened once. Two queries are asked at a time, each on half of the processor's cores.
"""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor

import winze

AT_ONCE = 2


def main(map_path: str, queries: list[str]) -> None:
    prepared = winze.Map.open(map_path)
    threads = max(1, (os.cpu_count() or 1) // AT_ONCE)

    def ask(query: str) -> winze.Outcome:
        return prepared.locate(query, threads=threads)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        for query, outcome in zip(queries, pool.map(ask, queries)):
            print(f"{query}: {outcome.verdict} in {outcome.seconds:.1f} s")
            if outcome.located and outcome.pose is not None:
                print(outcome.pose.round(4))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2:])
