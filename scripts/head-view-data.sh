#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# head-view-data.sh DATA OUT: makes the training data of the head view model, apart from Pointing'04, from faces68 in
# DATA (scripts/get-data.sh list), in the folder OUT:
#   drawn/       500 synthetic heads with their rotations
#   drawn1/      400 more, with the variation of real heads
#   faces.txt    every second image of faces68: with their landmarks they give the distribution of ordinary poses
# Then, in OUT: tarsier pose train-view --pointing DATA/pointing04 --truth drawn/truth.jsonl \
#   --truth drawn1/truth.jsonl --annotated faces.txt -o head-view.json     (--leave-out evaluates held-out people)
# TARSIER is the path of the program (build/release/bin/tarsier).
set -euo pipefail
data=$(realpath "${1:?the folder of the data}")
out=${2:?a folder for the lists}
tarsier=$(realpath "${TARSIER:-$(dirname "${BASH_SOURCE[0]}")/../build/release/bin/tarsier}")
mkdir -p "$out"
cd "$out"

"$tarsier" pose synth --count 500 --seed 21 -o drawn
"$tarsier" pose synth --count 400 --seed 22 --spread 1 -o drawn1
find "$data/faces68" -name '*.jpg' | LC_ALL=C sort | awk 'NR % 2 == 1' >faces.txt
wc -l faces.txt
