#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Recall of number plates by their width: bench/plate_width.py [--sizes 1280x720 ..] [--count 200] [--svg FILE] [--json]

Renders streets with near and far cars (`plate synth --far`) and reads them (`plate read --json --threads 1`). For each image size
and each range of plate widths (px) it prints how many plates were found (intersection over union of the boxes 0.5) and how many
were read right, with 95 % intervals (Wilson). It also prints the processor time per image in ms, with decoding and the
program's start. --svg draws the curves.
"""
import argparse
import csv
import json
import math
import os
import resource
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PROGRAM = os.environ.get("TARSIER", os.path.join(ROOT, "build", "release", "bin", "tarsier"))
EDGES = [16, 24, 32, 40, 50, 60, 80, 110, 160, 240]  # px; ranges from each to the next
FAR = {720: 9, 1080: 13, 2160: 25}  # the farthest plates have a width of about 16 px
COLOURS = ["#1f5fa8", "#c05a1c", "#3a7d34", "#7a3fa0"]


def run(*words):
    done = subprocess.run([PROGRAM, *words, "--quiet"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode not in (0, 1):
        sys.exit(f"plate_width: {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout


def overlap(a, b):
    wide = max(0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    high = max(0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    both = wide * high
    return both / (a[2] * a[3] + b[2] * b[3] - both) if both else 0


def wilson(hits, trials):
    z, p = 1.959964, hits / trials
    middle = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials))
    return max(0, middle - half), min(1, middle + half)


def measure(size, count, seed, folder):
    """Rows of (from px, to px, plates, found, right), and CPU ms per image."""
    width, height = map(int, size.split("x"))
    far = FAR.get(height, 0.012 * height)
    run("plate", "synth", "-o", folder, "--size", size, "--far", str(far), "--count", str(count), "--seed", str(seed), "--noise", "3")
    truth = {}
    with open(os.path.join(folder, "truth.csv"), encoding="utf-8") as file:
        for row in csv.DictReader(file):
            truth.setdefault(row["image"], []).append(([float(row[key]) for key in "xywh"], row["text"]))
    found = [[0, 0, 0] for _ in EDGES]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = run("plate", "read", "--json", "--threads", "1", os.path.join(folder, "images")).splitlines()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    for line in lines:
        image = json.loads(line)
        for box, text in truth.get(os.path.basename(image["image"]), []):
            if box[2] < EDGES[0]:
                continue
            cell = found[max(k for k, edge in enumerate(EDGES) if box[2] >= edge)]
            best = max(image["plates"], key=lambda plate: overlap(plate["box"], box), default=None)
            hit = best is not None and overlap(best["box"], box) >= 0.5
            cell[0] += 1
            cell[1] += hit
            cell[2] += hit and best["text"] == text
    rows = [(edge, EDGES[k + 1] if k + 1 < len(EDGES) else 0, *found[k]) for k, edge in enumerate(EDGES) if found[k][0]]
    return rows, 1000 * spent / max(1, len(lines))


def svg(curves):
    left, top, wide, high = 52, 16, 520, 250
    low, most = math.log(EDGES[0]), math.log(EDGES[-1] * 1.4)
    x = lambda px: left + wide * (math.log(px) - low) / (most - low)
    y = lambda share: top + high * (1 - share)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {left + wide + 20} {top + high + 50}" font-family="sans-serif" font-size="12">',
           '<title>Share of plates found, by their width in the image</title>',
           f'<rect width="{left + wide + 20}" height="{top + high + 50}" fill="#fff"/>']
    for share in (0, 0.25, 0.5, 0.75, 1):
        out.append(f'<path d="M{left} {y(share):.1f}h{wide}" stroke="#ddd"/><text x="{left - 6}" y="{y(share) + 4:.1f}" text-anchor="end">{round(100 * share)} %</text>')
    for px in EDGES:
        out.append(f'<path d="M{x(px):.1f} {top + high}v5" stroke="#333"/><text x="{x(px):.1f}" y="{top + high + 18}" text-anchor="middle">{px}</text>')
    out.append(f'<text x="{left + wide / 2}" y="{top + high + 38}" text-anchor="middle">width of the plate, px</text>')
    for number, (name, rows, ms) in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        middle = lambda row: math.sqrt(row[0] * (row[1] or row[0] * 1.4))
        points = [(x(middle(row)), y(row[3] / row[2]), *wilson(row[3], row[2])) for row in rows]
        for px, _, a, b in points:
            out.append(f'<path d="M{px + 2 * number:.1f} {y(a):.1f}V{y(b):.1f}" stroke="{colour}" stroke-opacity=".35"/>')
        out.append(f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b, *_ in points)}"/>')
        row = top + high - 60 + 18 * number
        out.append(f'<path d="M{left + wide - 150} {row}h24" stroke="{colour}" stroke-width="2"/><text x="{left + wide - 120}" y="{row + 4}">{name}</text>')
    return "\n".join([*out, "</svg>", ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["1280x720", "1920x1080", "3840x2160"])
    parser.add_argument("--count", type=int, default=200, help="images of each size")
    parser.add_argument("--seed", type=int, default=901)
    parser.add_argument("--svg", help="file for the curves")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    curves = []
    for size in given.sizes:
        with tempfile.TemporaryDirectory(prefix="tarsier-width-") as folder:
            rows, ms = measure(size, given.count, given.seed, folder)
        curves.append((size, rows, ms))
        if not given.json:
            print(f"{size}: {ms:.0f} CPU ms an image\n  width px  plates  found            right")
        for first, last, plates, found, right in rows:
            a, b = wilson(found, plates)
            if given.json:
                print(json.dumps({"size": size, "from": first, "to": last or None, "plates": plates, "found": found, "right": right,
                                  "found_interval": [round(a, 4), round(b, 4)], "cpu_ms": round(ms, 1)}))
            else:
                print(f"  {first:3}-{last or '':4} {plates:6}  {found:4} ({100 * found / plates:3.0f} %; {100 * a:.0f}-{100 * b:.0f})  {right:4}", flush=True)
    if given.svg:
        with open(given.svg, "w", encoding="utf-8") as file:
            file.write(svg(curves))


if __name__ == "__main__":
    main()
