#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Times searches in a generated log of number plates.

scripts/plate-log-bench.py [--rows 1000000] [--runs 5] [--program build/release/bin/tarsier] [--folder DIR]

Writes DIR/plates.db in the layout of the program's first version (kept; written again for another number of rows) and upgrades it
with `plate log --keep`. Then times `plate log --text PATTERN --csv -`: the CPU time of the whole program minus that of a
search in an empty log; the min of the runs, in ms. Prints one JSON line per pattern.
"""
import argparse
import json
import os
import random
import resource
import sqlite3
import subprocess
import sys
import time

parser = argparse.ArgumentParser()
parser.add_argument("--rows", type=int, default=1_000_000)
parser.add_argument("--runs", type=int, default=5)
parser.add_argument("--program", default="build/release/bin/tarsier")
parser.add_argument("--folder", default="/tmp/plate-log-bench")
flags = parser.parse_args()
os.makedirs(flags.folder, exist_ok=True)
path = os.path.join(flags.folder, "plates.db")
empty = os.path.join(flags.folder, "empty.db")

LETTERS = "BCDFGHJKLMNPRSTVWXYZ"
SCHEMA = """PRAGMA auto_vacuum = INCREMENTAL; PRAGMA journal_mode = WAL;
CREATE TABLE plate(id INTEGER PRIMARY KEY AUTOINCREMENT, first_time INTEGER NOT NULL, last_time INTEGER NOT NULL,
  source TEXT NOT NULL, text TEXT NOT NULL, confidence REAL NOT NULL, country TEXT NOT NULL, frames INTEGER NOT NULL,
  x INTEGER NOT NULL, y INTEGER NOT NULL, w INTEGER NOT NULL, h INTEGER NOT NULL, candidates TEXT NOT NULL,
  readings TEXT NOT NULL, crop BLOB) STRICT;
CREATE INDEX plate_by_time ON plate(last_time);
PRAGMA application_id = 0x54504C31; PRAGMA user_version = 1;"""


def make(file, rows):
    for ending in ("", "-wal", "-shm"):
        if os.path.exists(file + ending):
            os.remove(file + ending)
    database = sqlite3.connect(file)
    database.executescript(SCHEMA)
    rng = random.Random(1)
    now = int(time.time() * 1000)

    def entries():
        for k in range(rows):
            text = f"{rng.randrange(10000):04}{''.join(rng.choice(LETTERS) for _ in range(3))}"
            first = now - (rows - k) * 1000
            readings = json.dumps([{"frame": 1, "time": 0.1, "text": text, "confidence": 0.9, "box": [1, 2, 3, 4]}] * 3)
            yield first, first + 5000, "cam", text, json.dumps([{"text": text, "confidence": 0.9}]), readings

    database.executemany("INSERT INTO plate(first_time, last_time, source, text, confidence, country, frames, x, y, w, h, "
                         "candidates, readings) VALUES(?, ?, ?, ?, 0.9, 'es', 5, 1, 2, 3, 4, ?, ?)", entries())
    database.commit()
    database.close()


def run(file, *words):
    """CPU s, wall s, lines on stdout."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run([flags.program, "plate", "log", file, *words], capture_output=True, text=True)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, len(done.stdout.splitlines())


def rows_in(file):
    try:
        return sqlite3.connect(f"file:{file}?mode=ro", uri=True).execute("SELECT count(*) FROM plate").fetchone()[0]
    except sqlite3.Error:
        return -1


make(empty, 0)
run(empty, "--keep", "9000w")
if rows_in(path) != flags.rows:
    make(path, flags.rows)
if sqlite3.connect(f"file:{path}?mode=ro", uri=True).execute("PRAGMA user_version").fetchone()[0] == 1:
    size = os.path.getsize(path)
    cpu, wall, _ = run(path, "--keep", "1000w")
    print(json.dumps({"what": "brought up to date", "rows": flags.rows, "cpu_s": round(cpu, 1), "wall_s": round(wall, 1),
                      "MB_before": round(size / 1e6), "MB_after": round(os.path.getsize(path) / 1e6)}), flush=True)
database = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
some = database.execute("SELECT text FROM plate WHERE id = ?", (flags.rows // 2,)).fetchone()[0]
database.close()
base = min(run(empty, "--text", some, "--csv", "-")[0] for _ in range(flags.runs))
for what, words in [("exact", [some]), ("exact, near", [some, "--near"]), ("beginning", [some[:4] + "*"]),
                    ("beginning of 2, wildcards", [some[:2] + "*" + some[4] + "?" + some[6]]), ("infix of 3", ["*" + some[2:5] + "*"]),
                    ("infix of 2", ["*" + some[3:5] + "*"]), ("end", ["*" + some[3:]]), ("wildcards", ["?" + some[1:4] + "?" + some[5:]]),
                    ("no piece", ["*" + some[4] + "?" + some[6]])]:
    best = min((run(path, "--text", *words, "--csv", "-") for _ in range(flags.runs)))
    print(json.dumps({"what": what, "pattern": words[0], "found": best[2] - 1, "ms": round(1000 * (best[0] - base), 1)}), flush=True)
