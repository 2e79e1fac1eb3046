#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""How many readings match their plate on a watch list: bench/watch_list.py [--count 600] [--seed 78]

Renders small plates of five kinds (`plate synth`), reads them (`plate read --json`), and puts the true texts of all found plates on a
list. `plate watch test` then looks up each reading, for several numbers of tolerated errors. Prints how many readings match their own
plate's entry, how many of those were read with a confidence of 0.5 or more, and how many have another plate's entry as the nearest.
95 % intervals (Wilson).
"""
import argparse
import csv
import json
import os
import tempfile

from plate_width import overlap, run, wilson

KINDS = ["spain", "europe", "us", "brazil", "spain-old"]


def readings(count, seed, folder):
    """(truth, text read, confidence) of each plate that was found."""
    run("plate", "synth", "-o", folder, "--count", str(count), "--size", "640x360", "--kind", *KINDS, "--seed", str(seed), "--noise", "6")
    truth = {}
    with open(os.path.join(folder, "truth.csv"), encoding="utf-8") as file:
        for row in csv.DictReader(file):
            truth.setdefault(row["image"], []).append(([float(row[key]) for key in "xywh"], row["text"]))
    found = []
    for line in run("plate", "read", "--json", os.path.join(folder, "images")).splitlines():
        item = json.loads(line)
        for box, text in truth.get(os.path.basename(item["image"]), []):
            near = [plate for plate in item["plates"] if overlap(plate["box"], box) >= 0.5]
            if near:
                best = max(near, key=lambda plate: overlap(plate["box"], box))
                found.append((text, best["text"], best["confidence"]))
    return found


def share(hits, trials):
    low, high = wilson(hits, trials)
    return f"{hits} of {trials}: {100 * hits / trials:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--seed", type=int, default=78)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = readings(arguments.count, arguments.seed, folder)
        sure = [one for one in found if one[2] >= 0.5]
        print("| `errors` | match their own plate | of those with a confidence of 0.5 and more | nearest entry is another plate |\n|---|---|---|---|")
        for errors in (0, 0.25, 0.5, 1):
            path = os.path.join(folder, "list.csv")
            with open(path, "w", encoding="utf-8") as file:
                file.write("plate,errors\n" + "".join(f"{text},{errors}\n" for text in sorted({one[0] for one in found})))
            asked = sorted({one[1] for one in found})
            entries = {}
            for line in run("plate", "watch", "test", path, *asked, "--json").splitlines():
                item = json.loads(line)
                entries[item["text"]] = [match["entry"] for match in item["watch"]]
            own = [one for one in found if one[0] in entries.get(one[1], [])]
            wrong = [one for one in found if entries.get(one[1]) and entries[one[1]][0] != one[0]]
            print(f"| {errors} | {share(len(own), len(found))} | {share(sum(one[2] >= 0.5 for one in own), len(sure))} | {share(len(wrong), len(found))} |")


if __name__ == "__main__":
    main()
