# SPDX-License-Identifier: MIT
"""Data from /proc about a running program, for tests that stop one at a moment of its processor time."""
import os

TICK = os.sysconf("SC_CLK_TCK")


def stat_of(pid):
    """The fields of /proc/PID/stat from the state on; None for a process that has ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else fields


def cpu_seconds(pid):
    """Processor time of a process, all its threads and the children that it has waited for. None if it has ended."""
    fields = stat_of(pid)
    return None if fields is None else sum(int(ticks) for ticks in fields[11:15]) / TICK
