# SPDX-License-Identifier: MIT
"""Compares the figures of `tarsier bench NAME --json` of two builds, or prints those of one build: scripts/bench-compare.sh."""
import json
import os
import subprocess
import sys

ROUNDS = int(os.environ.get("ROUNDS", "3"))
REPEATS = os.environ.get("REPEATS", "5")
LIMIT = float(os.environ.get("LIMIT", "1.15"))
MARK = 1.10
LEAST_MS = 0.002  # shorter times are noise of the clock; they are shown but not compared


def program_of(text):
    path = os.path.join(text, "bin", "tarsier") if os.path.isdir(text) else text
    if not os.access(path, os.X_OK):
        sys.exit(f"bench-compare: no program {path}")
    return path


def is_program(text):
    return os.path.isdir(text) or os.access(text, os.X_OK)


def benches_of(program):
    done = subprocess.run([program, "help", "--json"], capture_output=True, text=True, check=True)
    verbs = [verb["path"] for verb in json.loads(done.stdout)["verbs"]]
    return [path[1] for path in verbs if path[0] == "bench"]


def times_of(line):
    """Field -> ms. The max of several (max_ms) is not used for comparisons."""
    found = {}
    for key, value in line.items():
        if not isinstance(value, (int, float)) or key == "max_ms":
            continue
        if key == "ms" or key.endswith("_ms"):
            found[key] = float(value)
        elif key == "us" or key.endswith("_us"):
            found[key] = value / 1000
    return found


def measure(program, bench):
    """(bench, case, field) -> ms of one run."""
    done = subprocess.run([program, "bench", bench, "--json", "--quiet", "--repeats", REPEATS], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"bench-compare: {program} bench {bench}: exit status {done.returncode}: {done.stderr.strip()}")
    figures = {}
    for text in done.stdout.splitlines():
        line = json.loads(text)
        if line.get("bench") != bench or "case" not in line:
            sys.exit(f"bench-compare: {program} bench {bench}: a line without \"bench\" or \"case\": {text[:200]}")
        for field, ms in times_of(line).items():
            key = (bench, line["case"], field)
            if key in figures:
                sys.exit(f"bench-compare: {program} bench {bench}: two lines of the case {line['case']!r}")
            figures[key] = ms
    return figures


def best_of(programs, bench):
    """For each program the min of each figure over all rounds. The programs take turns."""
    best = [{} for _ in programs]
    for _ in range(ROUNDS):
        for kept, program in zip(best, programs):
            for key, ms in measure(program, bench).items():
                kept[key] = min(ms, kept.get(key, ms))
    return best


def text_of(ms):
    return f"{ms:.1f} ms" if ms >= 100 else f"{ms:.3g} ms" if ms >= 1 else f"{1000 * ms:.3g} us"


def print_one(program, benches):
    print("| bench | case | figure | time |\n|---|---|---|---|")
    for bench in benches:
        for (_, case, field), ms in best_of([program], bench)[0].items():
            print(f"| {bench} | {case} | {field} | {text_of(ms)} |", flush=True)


def compare(programs, benches):
    slower = 0
    print("| bench | case | figure | A | B | B/A | |\n|---|---|---|---|---|---|---|")
    for bench in benches:
        first, second = best_of(programs, bench)
        for key in [*first, *(key for key in second if key not in first)]:
            _, case, field = key
            a, b = first.get(key), second.get(key)
            if a is None or b is None:
                print(f"| {bench} | {case} | {field} | {text_of(a) if a is not None else '-'} | "
                      f"{text_of(b) if b is not None else '-'} | | only in {'A' if b is None else 'B'} |", flush=True)
                continue
            ratio = b / a if a > 0 else 1.0
            word = ""
            if max(a, b) < LEAST_MS:
                word = "too short to judge"
            elif ratio > LIMIT:
                word = "SLOWER"
                slower += 1
            elif ratio > MARK:
                word = "slower"
            elif ratio < 1 / MARK:
                word = "faster"
            print(f"| {bench} | {case} | {field} | {text_of(a)} | {text_of(b)} | {ratio:.2f} | {word} |", flush=True)
    print(f"\nbench-compare: {slower} figures slower than {LIMIT:g} times", file=sys.stderr)
    return 1 if slower else 0


def main():
    words = sys.argv[1:]
    if not words or words[0].startswith("-"):
        sys.exit("usage: scripts/bench-compare.sh BUILD_A [BUILD_B] [BENCH ..]")
    programs = [program_of(words.pop(0))]
    if words and is_program(words[0]):
        programs.append(program_of(words.pop(0)))
    known = benches_of(programs[0])
    for word in words:
        if word not in known:
            sys.exit(f"bench-compare: neither a build nor a bench: {word}")
    benches = words or [name for name in known if name != "steady"]  # steady measures flicker, no time
    if len(programs) == 1:
        print_one(programs[0], benches)
        return 0
    return compare(programs, benches)


sys.exit(main())
