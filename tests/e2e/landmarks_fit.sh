#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Landmarks of faces: fitting and tracking with the shipped model, training on a set, evaluation.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/messi5.jpg" ] || skip "needs the package opencv-doc"

# One face, 68 points, inside the image, JSON as documented.
run landmarks fit "$images/messi5.jpg" --json -o points.png
expect_status 0
expect_out '^\{"image":"/usr/share/doc/opencv-doc/examples/data/messi5.jpg"' '"faces":\[\{"box":\[' '"score":' '"ms":'
python3 - stdout.txt <<'END' || fail "the points of messi5 are not where his face is"
import json, sys
line = json.loads(open(sys.argv[1]).readline())
faces = line["faces"]
assert len(faces) == 1 and len(faces[0]["points"]) == 68
left, right = faces[0]["points"][36], faces[0]["points"][45]
assert 215 < left[0] < right[0] < 275 and abs(left[1] - right[1]) < 12, (left, right)
assert 90 < left[1] < 115 and 12 < right[0] - left[0] < 40, (left, right)
assert faces[0]["score"] > 0.5, faces[0]["score"]
# He is hidden by nothing; each point is known to a few pixels.
assert len(faces[0]["visible"]) == len(faces[0]["sigma_px"]) == 68
assert sum(one > 0.5 for one in faces[0]["visible"]) > 60, faces[0]["visible"]
assert all(0 < one < 10 for one in faces[0]["sigma_px"]), faces[0]["sigma_px"]
END
[ -s points.png ] || fail "no image with the points"

# Each method; an image without a face.
for method in mean trees sdm cnn patch; do
  run landmarks fit "$images/messi5.jpg" --method $method --json
  expect_status 0
done
run landmarks fit "$images/messi5.jpg" --method forest
expect_status 2
expect_error 'mean, trees, sdm, cnn or patch'
run landmarks fit "$images/graf1.png"
expect_status 1

# Following: one face keeps its id; the table has a row a frame.
mkdir video
for i in 01 02 03 04 05 06; do cp "$images/messi5.jpg" "video/$i.jpg"; done
run landmarks track video --sequence --csv points.csv --json
expect_status 0
[ "$(grep -c '"id":1,' stdout.txt)" -eq 6 ] || fail "not the same id in all frames"
[ "$(wc -l <points.csv)" -eq 7 ] || fail "points.csv has $(wc -l <points.csv) lines"
head -1 points.csv | grep -q '^frame,time,face,score,x0,y0,x1' || fail "heading of points.csv"

# A set of one's own: moved copies of one annotation.
python3 - <<'END'
import json
samples = []
for i in range(4):
    points = [[100 + 40 * (k % 3) + i, 120 + 50 * (k // 3) + (k % 2) * i] for k in range(9)]
    samples.append({"image": f"video/0{i + 1}.jpg", "points": points})
payload = {"mirror": [2, 1, 0, 5, 4, 3, 8, 7, 6], "connections": [[0, 2]], "samples": samples}
def write(name, **change):
    archive = {"type": "landmark-set", "version": 1, "provenance": {}, "payload": dict(payload, **change)}
    json.dump(archive, open(name, "w"))
write("set.yaml")
write("one.yaml", samples=samples[:1])
write("counts.yaml", samples=[samples[0], {"image": "video/02.jpg", "points": [[1, 2]]}])
write("gone.yaml", samples=[dict(s, image="gone.jpg") for s in samples])
write("none.yaml", samples=[])
text = open("set.yaml").read()
open("nan.yaml", "w").write(text.replace("[100, 120]", "[NaN, 120]", 1))
open("version.yaml", "w").write(text.replace('"version": 1', '"version": 99'))
END
run landmarks train shape set.yaml -o shape.json --json
expect_status 0
expect_out '"modes":' '"samples":4'
run landmarks show shape.json -o modes.png
expect_status 0
[ -s modes.png ] || fail "no image of the modes"
run landmarks train tracker set.yaml -o own.json --mirror --levels 1 --trees 4 --quiet
expect_status 0
# Faces are turned by a head model of the same points.
run landmarks train tracker set.yaml -o turned.json --turned 1
expect_status 2
expect_error '68 points, the set 9' '--head'
run landmarks train tracker set.yaml -o turned.json --turned 1 --head own.json
expect_status 5
expect_error 'own.json'
[ ! -e turned.json ] || fail "a model was written without a head"
run landmarks fit video/01.jpg --model shape.json
expect_status 5
expect_error 'shape.json'

# What cannot be used says so.
for set in one counts none nan version; do
  run landmarks train shape $set.yaml -o x.json
  expect_status 3
  expect_error "$set.yaml"
done
run landmarks train tracker gone.yaml -o x.json
expect_status 3
[ ! -e x.json ] || fail "a model was written without data"
run landmarks train shape set.yaml -o /proc/nowhere/x.json
expect_status 6
run landmarks eval set.yaml
expect_status 2
expect_error '--eyes'

# Judging given points.
python3 - <<'END'
import json
for line in json.load(open("set.yaml"))["payload"]["samples"]:
    moved = [[x + 8, y] for x, y in line["points"]]
    print(json.dumps({"image": line["image"], "points": moved}), file=open("r.jsonl", "a"))
END
run landmarks eval set.yaml --eyes 0,2 --results r.jsonl --json
expect_status 0
expect_out '"nme_mean":10' '"failures":1' '"bias_x":10'
# A sample whose two eyes coincide cannot be normalised: it is left out, and the others count.
run landmarks eval set.yaml --eyes 0,2 --results r.jsonl --json
samples=$(sed -n 's/.*"faces":\([0-9]*\).*/\1/p' stdout.txt)
python3 - <<'END'
import json
whole = json.load(open("set.yaml"))
points = whole["payload"]["samples"][0]["points"]
points[2] = points[0]
json.dump(whole, open("flat.yaml", "w"))
END
run landmarks eval flat.yaml --eyes 0,2 --results r.jsonl --json
expect_status 0
expect_out "\"faces\":$((samples - 1)),"
grep -q 'its two eyes lie in one place; left out' stderr.txt || fail "no warning: $(cat stderr.txt)"

# Rolled faces: looked for where no face is found upright, in any case, or not at all; an upright face is found the same.
run pose synth -o rolled --count 10 --roll 60 --yaw 10 --pitch 5 --size 320x240 --near 450 --far 500 --seed 3 --quiet
expect_status 0
for search in never auto always; do
  run landmarks fit rolled/images --rolled $search --json
  grep -c '"score"' stdout.txt >"$search.count" || true
  sed -n 's/"ms":[0-9.]*//; /0002.png/p' stdout.txt >"$search.upright"
done
[ "$(cat auto.count)" -ge $(($(cat never.count) + 2)) ] || fail "no more rolled faces: $(cat never.count auto.count)"
[ "$(cat always.count)" -ge "$(cat auto.count)" ] || fail "fewer faces with --rolled always"
cmp -s never.upright auto.upright || fail "the search of rolled faces changes an upright one"
run landmarks fit rolled/images/0000.png --rolled often
expect_status 2
run people enroll Ann rolled/images/0000.png --any-quality --template classic --rolled never
expect_status 1
run people enroll Ann rolled/images/0000.png --any-quality --template classic
expect_status 0
finish
