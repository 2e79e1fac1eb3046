#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# head-view-data.sh DATA OUT: what the head view model learns from beside Pointing'04, out of faces68 in DATA
# (scripts/get-data.sh list), into the folder OUT:
#   drawn/, video/   synthetic heads with their rotations
#   images.jsonl     every fourth image of faces68 in which one head has a pose, with its rotation by the landmarks alone, so
#                    that ordinary images are left as they are
# Then, in OUT: tarsier pose train-view --pointing DATA/pointing04 --truth drawn/truth.jsonl --truth video/truth.jsonl \
#   --truth images.jsonl --gamma 2 -o head-view.json     (--leave-out prints how it does on people it has not seen)
# TARSIER names the program (build/release/bin/tarsier).
set -euo pipefail
data=$(realpath "${1:?the folder of the data}")
out=${2:?a folder for the lists}
tarsier=$(realpath "${TARSIER:-$(dirname "${BASH_SOURCE[0]}")/../build/release/bin/tarsier}")
mkdir -p "$out"
cd "$out"

"$tarsier" pose synth --count 150 --seed 21 -o drawn
"$tarsier" pose synth --video --count 150 --seed 22 --spread 0.4 -o video
find "$data/faces68" -name '*.jpg' | LC_ALL=C sort | awk 'NR % 4 == 1' >every-fourth.txt
"$tarsier" pose track @every-fourth.txt --refine none --json >poses.jsonl
python3 - <<'END'
import json

with open("poses.jsonl") as poses, open("images.jsonl", "w") as images:
    for line in poses:
        image = json.loads(line)
        posed = [face for face in image["faces"] if "rotation" in face]
        if len(posed) == 1:
            print(json.dumps({"image": image["image"], "rotation": posed[0]["rotation"]}), file=images)
END
rm every-fourth.txt poses.jsonl
wc -l images.jsonl
