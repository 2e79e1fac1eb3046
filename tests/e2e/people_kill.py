# SPDX-License-Identifier: MIT
"""Kills `people enroll` twenty times at random moments. The gallery opens each time, and no committed face is lost.

people_kill.py IMAGE [SEED]. Every second round waits for a new face in the gallery before the kill, however slow the machine
is. The others kill while the program starts, creates the gallery or detects faces.
"""
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

from processes import cpu_seconds

PROGRAM = os.environ["TARSIER"]
ROUNDS = 20 if os.environ.get("TARSIER_TEST_ALL") else 8
TIMEOUT = int(os.environ.get("TARSIER_TEST_TIMEOUT", "300"))  # s
failures = []


def fail(text):
    failures.append(text)
    print(f"FAILED: {text}", flush=True)


def count_faces():
    """Number of committed faces; 0 without a gallery or without a table in it."""
    try:
        base = sqlite3.connect("file:people.db?mode=ro", uri=True)
        count = base.execute("SELECT count(*) FROM face").fetchone()[0]
        base.close()
        return count
    except sqlite3.Error:
        return 0


def kill_once(number, before, delay):
    """Starts and kills one enrolment; returns the number of faces committed before the kill."""
    process = subprocess.Popen([PROGRAM, "people", "enroll", "Lena", "faces", "--any-quality", "--faces", "1000", "--threads", "1",
                                "--quiet"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + TIMEOUT
    if number % 2 == 0:
        while count_faces() <= before and process.poll() is None:
            if time.monotonic() > deadline:
                fail(f"round {number}: no face in {TIMEOUT} s")
                break
            time.sleep(0.005)
    begin = cpu_seconds(process.pid)  # processor time gives the same moments on a busy machine
    while (used := cpu_seconds(process.pid)) is not None and used - begin < delay and time.monotonic() < deadline:
        time.sleep(0.005)
    faces_at_kill = count_faces()
    if process.poll() is not None:
        fail(f"round {number}: ended with {process.returncode} before it was killed: give it more images")
    process.send_signal(signal.SIGKILL)
    process.wait()
    return faces_at_kill


def main():
    rng = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    os.mkdir("faces")
    for k in range(400):
        shutil.copy(sys.argv[1], f"faces/{k:03}.png") if k == 0 else os.link("faces/000.png", f"faces/{k:03}.png")
    before = 0
    for number in range(1, ROUNDS + 1):
        faces_at_kill = kill_once(number, before, rng.random() * 0.25)
        if not os.path.exists("people.db"):
            continue
        base = sqlite3.connect("people.db")
        check = base.execute("PRAGMA integrity_check").fetchone()[0]
        base.close()
        if check != "ok":
            fail(f"round {number}: integrity_check: {check}")
        done = subprocess.run([PROGRAM, "people", "list", "--json"], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1, 3):
            fail(f"round {number}: people list: {done.returncode}: {done.stderr}")
        elif done.returncode != 0 and faces_at_kill > 0:
            fail(f"round {number}: {faces_at_kill} faces were there, now none: {done.stderr}")
        after = sum(json.loads(line)["faces"] for line in done.stdout.splitlines())
        if after < max(faces_at_kill, before):
            fail(f"round {number}: {faces_at_kill} faces before the kill, {before} before the run, {after} after it")
        before = after
    if before < ROUNDS // 2:
        fail(f"only {before} faces were ever enrolled: the test tests nothing")
    print(f"{before} faces after {ROUNDS} kills")
    sys.exit(1 if failures else 0)


main()
