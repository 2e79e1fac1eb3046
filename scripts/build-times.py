#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/build-times.py [BUILD] [--top N] [--limit PERCENT]

The processor time of each compiled file of a build with tests (cmake/compile-time.sh measures it), by folder, and the N slowest
files (10). In a unity build a file includes several sources.
Exit status 1 if a file took more than PERCENT of the total, which does not depend on the machine's speed.
Files from ccache count with the time of the cache. For the cost of a full build, build with CCACHE_DISABLE=1 into an empty folder.
For the limit, files below half a second are assumed to come from ccache and count as the mean of the others.
"""
import argparse
import collections
import json
import os
import re
import sys

CACHED_S = 0.5  # a faster file was not compiled: it came from ccache
TIME = re.compile(r"^(\d+)m([\d.]+)s (\d+)m([\d.]+)s$")


def seconds_of(path):
    """User and system seconds; None if the file has none (an interrupted build)."""
    with open(path, encoding="ascii", errors="replace") as file:
        match = TIME.match(file.read().strip().split("\n")[-1])
    if not match:
        return None
    minutes, seconds, system_minutes, system_seconds = map(float, match.groups())
    return 60 * (minutes + system_minutes) + seconds + system_seconds


def present_objects(build):
    """The objects that the build makes now; it may have others of an earlier configuration."""
    with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
        return {re.search(r" -o (\S+)", entry["command"]).group(1) for entry in json.load(file)}


def measured(build):
    """{object without the folders and suffixes of CMake: seconds}"""
    times = {}
    present = present_objects(build)
    for folder, _, names in os.walk(build):
        for name in names:
            if name.endswith((".o.time", ".gch.time")):
                path = os.path.join(folder, name)
                seconds = seconds_of(path)
                shown = os.path.relpath(path, build)[:-len(".time")]
                if seconds is not None and (shown in present or shown.endswith(".gch")):
                    times[re.sub(r"CMakeFiles/([^/]+)\.dir/", r"\1: ", shown)] = seconds
    return times


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", nargs="?", default="build/release", help="folder of the build [build/release]")
    parser.add_argument("--top", type=int, default=10, help="how many files are listed [10]")
    parser.add_argument("--limit", type=float, help="most of one file, in per cent of the whole build")
    options = parser.parse_args()
    times = measured(options.build)
    if not times:
        sys.exit(f"{options.build} has no times of compiled files: it was not built with tests, or with another launcher")
    folders = collections.Counter()
    tests = 0.0
    for name, seconds in times.items():
        is_test = re.search(r"_test\.cpp|_test: |unit_main|pch_test|^fuzz/|^examples/", name) is not None
        tests += seconds if is_test else 0
        folders[("tests of " if is_test else "") + "/".join(name.split(":")[0].split("/")[:3])] += seconds
    for folder, seconds in folders.most_common(options.top):
        print(f"{seconds:8.1f} s  {folder}")
    print()
    longest = sorted(times.items(), key=lambda entry: -entry[1])
    for name, seconds in longest[:options.top]:
        print(f"{seconds:8.1f} s  {name}")
    total = sum(times.values())
    print(f"\n{len(times)} files, {total:.0f} CPU s, of these {tests:.0f} for tests")
    if options.limit is not None:
        compiled = [seconds for seconds in times.values() if seconds >= CACHED_S]
        whole = len(times) * sum(compiled) / max(1, len(compiled))
        above = [name for name, seconds in longest if seconds > options.limit / 100 * whole]
        if above:
            sys.exit(f"more than {options.limit:g} % of the build: {', '.join(above)}")


main()
