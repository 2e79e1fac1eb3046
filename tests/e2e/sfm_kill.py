# SPDX-License-Identifier: MIT
"""Kills `sfm reconstruct`, or `sfm merge` of clusters, at random moments of all its stages. The same command then produces the files of
an undisturbed run.

sfm_kill.py IMAGES KILLS [MAPPER ..]: incremental, global, or merge. The moments are spread over the processor time of the undisturbed run, so they are the
same on a busy machine. One kill falls into each of KILLS equal parts of it. Every run begins in a new folder.
"""
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

from processes import cpu_seconds

PROGRAM = os.environ["TARSIER"]
TIMEOUT = int(os.environ.get("TARSIER_TEST_TIMEOUT", "600"))  # s
# Keys of report.json that describe the run, not its result.
RUN_KEYS = ("stages", "from_cache", "resumed")
failures = []


def fail(text):
    failures.append(text)
    print(f"FAILED: {text}", flush=True)


def command(folder, mapper):
    if mapper == "merge":
        return [PROGRAM, "sfm", "merge", "clusters", "--checkpoint", "0", "--threads", "1", "--quiet", "-o", folder]
    return [PROGRAM, "sfm", "reconstruct", "scene/images", "--camera-file", "scene/camera.yaml", "--max-features", "500", "--mapper",
            mapper, "--checkpoint", "0", "--threads", "1", "--quiet", "-o", folder]


def start(folder, mapper):
    return subprocess.Popen(command(folder, mapper), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def run(folder, mapper):
    """Runs to the end; returns the processor time."""
    before = os.times()
    done = subprocess.run(command(folder, mapper), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    if done.returncode != 0:
        fail(f"{mapper}: exit status {done.returncode}: {done.stderr}")
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def files_of(folder):
    """The bytes of all files that a run wrote, without the cache."""
    result = {}
    for root, folders, names in os.walk(folder):
        if root == folder and "cache" in folders:
            folders.remove("cache")
        for name in names:
            path = os.path.join(root, name)
            with open(path, "rb") as file:
                content = file.read()
            if name == "report.json":
                report = json.loads(content)
                content = json.dumps({key: value for key, value in report.items() if key not in RUN_KEYS}).encode()
            result[os.path.relpath(path, folder)] = content
    return result


def kill_once(mapper, delay):
    """Returns the progress of the killed run: nothing, features and pairs, or a checkpoint of the mapping; or that it had ended."""
    process = start("killed", mapper)
    deadline = time.monotonic() + TIMEOUT
    while (used := cpu_seconds(process.pid)) is not None and used < delay and time.monotonic() < deadline:
        time.sleep(0.002)
    ended = process.poll() is not None
    process.send_signal(signal.SIGKILL)
    process.wait()
    if ended:
        return "ended"
    cached = os.listdir("killed/cache") if os.path.isdir("killed/cache") else []
    for ending in ("mapper", "pairs", "features"):
        if any(name.endswith("." + ending) for name in cached):
            return ending
    return "nothing"


def main():
    images, kills = int(sys.argv[1]), int(sys.argv[2])
    rng = random.Random(1)
    subprocess.run([PROGRAM, "sfm", "synth", "-o", "scene", "--images", str(images), "--size", "320x240", "--seed", "4"], check=True,
                   stdout=subprocess.DEVNULL)
    mappers = sys.argv[3:] or ["incremental", "global", "merge"]
    if "merge" in mappers:
        for words in (["plan", "scene/images", "--camera-file", "scene/camera.yaml", "--max-features", "500", "--cluster-size",
                       str(max(6, images // 3)), "-o", "clusters"],
                      ["features", "clusters"], ["match", "clusters"], ["map", "clusters", "--cluster", "all"]):
            subprocess.run([PROGRAM, "sfm", *words, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    for mapper in mappers:
        shutil.rmtree("whole", ignore_errors=True)
        total = run("whole", mapper)
        expected = files_of("whole")
        if "points3D.txt" not in expected:
            sys.exit(f"FAILED: {mapper}: no model")
        progress_counts = {}
        for k in range(kills):
            shutil.rmtree("killed", ignore_errors=True)
            delay = (k + rng.random()) / kills * total
            progress = kill_once(mapper, delay)
            progress_counts[progress] = progress_counts.get(progress, 0) + 1
            run("killed", mapper)
            resumed = files_of("killed")
            for name in sorted(set(expected) | set(resumed)):
                if expected.get(name) != resumed.get(name):
                    fail(f"{mapper}: killed after {delay:.2f} of {total:.2f} CPU s ({progress}), resumed: another {name}")
        print(f"{mapper}: {total:.1f} CPU s, {kills} kills; the killed runs had: {progress_counts}", flush=True)
        if progress_counts.get("ended", 0) * 3 > kills:
            fail(f"{mapper}: {progress_counts['ended']} runs had ended before the kill: the test tests little")
        if kills >= 6 and "mapper" not in progress_counts:
            fail(f"{mapper}: no run was killed while it mapped: the test tests little")
    sys.exit(1 if failures else 0)


main()
