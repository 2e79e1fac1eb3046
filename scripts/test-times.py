#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/test-times.py [--build FOLDER] [--jobs N] [--write] [flags of ctest: -R .., -L .., -E ..]

The processor time of each test: user and system seconds of its processes, which other work on the machine hardly changes.
Runs N tests at a time (1) and lists the slowest at the end. --write puts the times into tests/costs.txt. CMake takes the start
order of the tests from there (longest first).
"""
import argparse
import collections
import concurrent.futures
import json
import os
import subprocess
import sys
import tempfile
import threading
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
COSTS = os.path.join(ROOT, "tests", "costs.txt")


def properties(test):
    return {entry["name"]: entry["value"] for entry in test.get("properties", [])}


def run(test):
    """(exit status, CPU seconds, seconds) of one test."""
    about = properties(test)
    environment = dict(os.environ)
    for entry in about.get("ENVIRONMENT", []):
        name, _, value = entry.partition("=")
        environment[name] = value
    begin = time.monotonic()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(test["command"], cwd=about.get("WORKING_DIRECTORY"), env=environment,
                                   stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, about.get("SKIP_RETURN_CODE", 0)):
            output.seek(0)
            sys.stdout.write(output.read().decode(errors="replace")[-3000:])
    return process.returncode, usage.ru_utime + usage.ru_stime, time.monotonic() - begin


def in_order(tests):
    """Tests that others need first, then the others with the longest first, then those that clean up."""
    parts = [[], [], []]
    for test in sorted(tests, key=lambda test: -float(properties(test).get("COST", 0))):
        about = properties(test)
        parts[0 if "FIXTURES_SETUP" in about else 2 if "FIXTURES_CLEANUP" in about else 1].append(test)
    return parts


locks = collections.defaultdict(threading.Lock)


def run_locked(test, slots):
    """run() in one of the slots, with exclusive use of the test's resources."""
    held = [locks[name] for name in sorted(properties(test).get("RESOURCE_LOCK", []))]
    for lock in held:
        lock.acquire()
    try:
        with slots:
            return test, *run(test)
    finally:
        for lock in held:
            lock.release()


def write_costs(measured):
    known = {}
    if os.path.exists(COSTS):
        with open(COSTS, encoding="utf-8") as file:
            for line in file:
                if line.strip() and not line.startswith("#"):
                    name, seconds = line.split()
                    known[name] = float(seconds)
    known.update({name: seconds for name, seconds in measured.items() if seconds >= 1})
    for name in [name for name in known if measured.get(name, 1) < 1]:
        del known[name]
    with open(COSTS, "w", encoding="utf-8") as file:
        file.write("# CPU seconds of the tests that take one or more: scripts/test-times.py --write\n")
        file.writelines(f"{name} {seconds:.0f}\n" for name, seconds in sorted(known.items(), key=lambda e: (-round(e[1]), e[0])))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[2])
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "release"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    options, flags = parser.parse_known_args()
    listing = subprocess.run(["ctest", "--test-dir", options.build, "--show-only=json-v1", *flags], capture_output=True,
                             text=True, check=True)
    measured = {}
    failed = []
    slots = threading.Semaphore(options.jobs)
    pool = concurrent.futures.ThreadPoolExecutor(1000)  # most only wait
    for part in in_order([test for test in json.loads(listing.stdout)["tests"] if "command" in test]):
        for done in concurrent.futures.as_completed([pool.submit(run_locked, test, slots) for test in part]):
            test, status, cpu, seconds = done.result()
            measured[test["name"]] = cpu
            skipped = properties(test).get("SKIP_RETURN_CODE")
            word = "" if status == 0 else " skipped" if status == skipped else f" FAILED ({status})"
            if "FAILED" in word:
                failed.append(test["name"])
            print(f"{cpu:8.1f} CPU s {seconds:8.1f} s  {test['name']}{word}", flush=True)
    print("--- the longest")
    for name, cpu in sorted(measured.items(), key=lambda entry: entry[1])[-25:]:
        print(f"{cpu:8.1f} CPU s  {name}")
    print(f"{sum(measured.values()):8.1f} CPU s in all, {len(measured)} tests, {len(failed)} failed: {' '.join(failed)}")
    if options.write:
        write_costs(measured)
    sys.exit(1 if failed else 0)


main()
