"""One stage, warmed up and timed as bench/README.md says."""

import dataclasses
import gc
import resource
import time
import typing


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


def measured(work, repeat):
    """The figures of a line and what the last run gave back."""
    gc.collect()
    work.fresh()
    before = status_bytes("VmRSS")
    reset_peak()
    given = work.run()
    wall, cpu = [], []
    for _ in range(repeat):
        given = None
        work.fresh()
        began, used = time.perf_counter(), cpu_seconds()
        given = work.run()
        cpu.append(cpu_seconds() - used)
        wall.append(time.perf_counter() - began)
    peak = status_bytes("VmHWM")
    return {"wall": wall, "cpu": cpu, "rss_before": before, "rss_peak": peak}, given
