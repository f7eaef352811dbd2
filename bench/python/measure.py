"""One stage, warmed up and timed as bench/README.md says."""

import dataclasses
import gc
import resource
import time
import typing

# A run that takes longer, in seconds, is not repeated: as the warm-up it is the only one.
SLOW = 100.0

@dataclasses.dataclass
class Work:
    """What a stage does. Only `run` is timed: its inputs are in memory and in the library's own types before."""

    run: typing.Callable[[], typing.Any]
    # What `run` gave back as the array for `--out`; None where there is nothing to write.
    result: typing.Callable[[typing.Any], typing.Any] = lambda _: None
    # The number of things that came out, where it is not the length of the result.
    count: typing.Optional[typing.Callable[[typing.Any], int]] = None
    # Before every run, outside the time: undoes what a run leaves behind.
    fresh: typing.Callable[[], None] = lambda: None
    note: str = ""
    # Wall seconds of the last run's parts, by their names, where the library tells them.
    split: typing.Callable[[], dict] = dict


def cpu_seconds():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def status_bytes(field):
    with open("/proc/self/status") as lines:
        for line in lines:
            if line.startswith(field + ":"):
                return int(line.split()[1]) * 1024
    raise RuntimeError(f"no {field} in /proc/self/status")


def reset_peak():
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def timed(work):
    """What a run gave back, its wall and its CPU seconds."""
    began, used = time.perf_counter(), cpu_seconds()
    given = work.run()
    cpu = cpu_seconds() - used
    return given, time.perf_counter() - began, cpu


def measured(work, repeat):
    """The figures of a line and what the last run gave back."""
    gc.collect()
    work.fresh()
    before = status_bytes("VmRSS")
    reset_peak()
    given, *first = timed(work)
    unwarmed = first[0] > SLOW
    runs = [first] if unwarmed else []
    for _ in range(0 if unwarmed else repeat):
        given = None
        work.fresh()
        given, *took = timed(work)
        runs.append(took)
    peak = status_bytes("VmHWM")
    wall, cpu = map(list, zip(*runs))
    figures = {"wall": wall, "cpu": cpu, "rss_before": before, "rss_peak": peak}
    if unwarmed:
        figures["unwarmed"] = True
    return figures, given
