# SPDX-License-Identifier: MIT
"""Kills `plate read --log` at random moments: each certain vehicle is in the log. Thirty kills in `./test --all`, eight
otherwise.

The program's own lines tell which vehicles are certain: a line is written after its content was stored. So each confirmed vehicle
of a line must be in the log, however soon after the line the program is killed.
"""
import difflib
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time

PROGRAM = os.environ["TARSIER"]
ROUNDS = 30 if os.environ.get("TARSIER_TEST_ALL") else 8
failures = []


def fail(text):
    failures.append(text)
    print(f"FAILED: {text}", flush=True)


def entries():
    """{id: (text, state)} as `plate log` lists them."""
    if not os.path.exists("plates.db"):
        return {}
    done = subprocess.run([PROGRAM, "plate", "log", "plates.db", "--json"], capture_output=True, text=True)
    if done.returncode not in (0, 1) and "is empty" not in done.stderr:
        fail(f"plate log: {done.returncode} {done.stderr}")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return {line["id"]: (line["text"], line["state"]) for line in lines}


def command(seed, frames):
    source = f"synth:drive?size=640x360&seconds=5&fps=5&cars=4&parked=1&far=0&seed={seed}"
    return [PROGRAM, "plate", "read", source, "--json", "--log", "plates.db", "--threads", "1", "--quiet",
            "--return-within", "0.5", "--lost-after", "0.3", "--frames", str(frames)]


rng = random.Random(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
before = {}
certain_count = 0
for number in range(ROUNDS):
    process = subprocess.Popen(command(number % 3, 20), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = []
    lines_before_kill = rng.randrange(0, 16)
    while len(lines) < lines_before_kill:
        line = process.stdout.readline()
        if not line:
            break
        lines.append(line)
    time.sleep(rng.random() * 0.03)  # anywhere within a frame
    process.send_signal(signal.SIGKILL)
    rest, errors = process.communicate()
    lines += [line for line in rest.splitlines(keepends=True) if line.endswith("\n")]
    if process.returncode not in (0, -signal.SIGKILL):
        fail(f"round {number}: ended with {process.returncode}: {errors}")
    certain = {}
    for line in map(json.loads, lines):
        if line.get("event") == "plate":
            certain[line["id"]] = line["text"]
        for track in line.get("tracks", []):
            if track["confirmed"]:
                certain[track["id"]] = track["text"]
            elif track["id"] in certain:  # it may be removed again
                del certain[track["id"]]
    certain_count += len(certain)
    if os.path.exists("plates.db") and os.path.getsize("plates.db") > 0:
        database = sqlite3.connect("plates.db")
        check = database.execute("PRAGMA integrity_check").fetchone()[0]
        database.close()
        if check != "ok":
            fail(f"round {number}: integrity_check: {check}")
    after = entries()
    for entry, (text, _) in before.items():
        if entry not in after or after[entry][0] != text:
            fail(f"round {number}: entry {entry} of an earlier run is gone or changed")
    new_texts = [text for entry, (text, _) in after.items() if entry not in before]
    for text in certain.values():
        # The vote of a frame whose line was not written may have changed a character.
        match = difflib.get_close_matches(text, new_texts, 1, 0.6)
        if not match:
            fail(f"round {number}, killed after {len(lines)} lines: {text} was certain, the log has {new_texts}")
        else:
            new_texts.remove(match[0])
    before = after
if certain_count < ROUNDS:
    fail(f"only {certain_count} vehicles were ever certain: the test tests nothing")

# A run that ends normally closes its own entries. Open entries of the other runs stay marked as interrupted.
done = subprocess.run(command(0, 20), capture_output=True, text=True)
if done.returncode != 0:
    fail(f"the last run: {done.returncode}: {done.stderr}")
last = entries()
for entry, (text, state) in last.items():
    if entry in before and before[entry][0] != text:
        fail(f"entry {entry} was changed by a later run")
    if state == "open" or (state == "interrupted" and entry not in before):
        fail(f"entry {entry} is {state} after all has ended")
if not any(state == "interrupted" for _, state in last.values()):
    fail("no entry was ever interrupted")
print(f"{certain_count} certain vehicles in {ROUNDS} runs, {len(last)} entries")
sys.exit(1 if failures else 0)
