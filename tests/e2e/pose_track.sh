#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Head poses: images and videos with the shipped models, drawn objects, training, evaluation, hostile files.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/messi5.jpg" ] || skip "needs the package opencv-doc"
messi=$images/messi5.jpg

# One head, JSON as documented, drawn.
run pose track "$messi" --json -o posed.png
expect_status 0
expect_out '^\{"image":"/usr/share/doc/opencv-doc/examples/data/messi5.jpg"' '"ms":'
python3 - stdout.txt <<'END' || fail "the pose of messi5 is not as documented"
import json, math, sys
faces = json.loads(open(sys.argv[1]).readline())["faces"]
assert len(faces) == 1
face = faces[0]
assert {"box", "points", "score", "rotation", "translation", "yaw", "pitch", "roll"} <= set(face)
r = [face["rotation"][3 * i:3 * i + 3] for i in range(3)]
for i in range(3):
    for j in range(3):
        assert abs(sum(r[i][k] * r[j][k] for k in range(3)) - (i == j)) < 1e-5
# R = Rz(roll) Rx(-pitch) Ry(yaw)
assert abs(math.degrees(math.atan2(-r[2][0], r[2][2])) - face["yaw"]) < 0.02
assert abs(math.degrees(math.asin(r[2][1])) + face["pitch"]) < 0.02
# He looks down and to image right.
assert -50 < face["yaw"] < -15 and -35 < face["pitch"] < -5 and abs(face["roll"]) < 15
assert face["translation"][2] > 500
for angle in ("yaw", "pitch", "roll"):
    assert 0.2 < face[angle + "_sigma_deg"] < 20, angle
END
[ -s posed.png ] || fail "no image with the axes"

# A focal length twice as long: twice as far.
run pose track "$messi" --json --focal 500
near=$(grep -o '"translation":\[[^]]*' stdout.txt | cut -d, -f3)
run pose track "$messi" --json --camera 1000,1000,273.5,170.5
far=$(grep -o '"translation":\[[^]]*' stdout.txt | cut -d, -f3)
awk "BEGIN { exit !($far / $near > 1.9 && $far / $near < 2.1) }" || fail "$near and $far mm away"

# Everything that can be drawn; an own object.
cat >thing.obj <<'END'
mtllib thing.mtl
v -20 0 -80
v 20 0 -80
v 0 30 -80
usemtl red
f 1 2 3
END
printf 'newmtl red\nKd 1 0 0\n' >thing.mtl
for what in none box head glasses hat thing.obj; do
  run pose track "$messi" --draw $what -o $what.png
  expect_status 0
  cmp -s $what.png posed.png && fail "--draw $what drew the axes"
done
expect_out 'yaw [+-][0-9.]+ ± [0-9.]+ pitch' 'mm away'

# A video: one head keeps its id; the table has a row a frame.
mkdir video
for i in 01 02 03 04 05 06; do cp "$messi" "video/$i.jpg"; done
for smooth in none mean one-euro; do
  run pose track video --sequence --smooth $smooth --csv poses.csv --json
  expect_status 0
  [ "$(grep -c '"id":1,' stdout.txt)" -eq 6 ] || fail "--smooth $smooth: not the same id in all frames"
  [ "$(wc -l <poses.csv)" -eq 7 ] || fail "poses.csv has $(wc -l <poses.csv) lines"
done
head -1 poses.csv | grep -q '^frame,time,face,score,yaw,pitch,roll,x,y,z,rms_px,yaw_sigma_deg,pitch_sigma_deg,roll_sigma_deg$' || fail "heading of poses.csv"

# The direction, corrected by what was learnt from drawn heads, which have their truth.
run pose synth -o heads --count 24 --size 320x240 --seed 3 --quiet
expect_status 0
run pose train-view --truth heads/truth.jsonl -o view.json --leave-out --json
expect_status 0
expect_out '"what":"landmarks alone"' '"yaw_within_sigma":[0-9.]+' '"what":"refined, each person left out in turn"' '"output":"view.json"'
angles() { grep -o '"yaw":[-0-9.]*,"pitch":[-0-9.]*' stdout.txt; }
run pose track "$messi" --json --refine none
expect_status 0
plain=$(angles)
run pose track "$messi" --json --view view.json
expect_status 0
[ -n "$plain" ] && [ "$(angles)" != "$plain" ] || fail "--view changes nothing"
run pose track "$messi" --view view.json --refine none
expect_status 2
expect_error '--view'
run pose track "$messi" --view heads/set.json
expect_status 5
expect_error 'heads/set.json'
run pose train-view -o view.json
expect_status 2
expect_error '--pointing'
run pose train-view --truth heads/truth.jsonl
expect_status 2
expect_error '--leave-out'
head -4 heads/truth.jsonl >heads/few.jsonl
run pose train-view --truth heads/few.jsonl -o none.json
expect_status 3
expect_error 'few.jsonl' 'at least 8'
[ ! -e none.json ] || fail "a model was written of four images"

# Annotated faces teach, too: the truth is the pose of their points.
run pose train-view --annotated heads/set.json -o annotated.json --leave-out --json
expect_status 0
expect_out '"set":"truth","what":"refined' '"output":"annotated.json"'
run pose track "$messi" --view annotated.json
expect_status 0
printf 'version: 1\nn_points: 3\n{\n1 1\n9 1\n5 9\n}\n' >video/01.pts
run pose train-view --annotated video/01.pts -o none.json
expect_status 3
expect_error '01.pts' 'has 3 points'

# Nothing found.
run pose track "$images/graf1.png"
expect_status 1

# The inner points only, through a mapping.
for i in $(seq 17 67); do echo "$i $i"; done >inner.txt
run pose track "$messi" --mapping inner.txt --json
expect_status 0
run pose track "$messi" --mapping inner.txt --view view.json
expect_status 5
expect_error 'view.json' 'learn it again'

# A head from one's own points, and how good it is.
python3 - <<'END'
import json, math, random
random.seed(4)
half = [(44, 0, 0), (20, 2, -4), (60, -15, 20), (35, -24, -8), (12, -18, -16), (14, 40, -22), (26, 64, -4), (62, 60, 40), (35, 98, 12)]
head = [(s * x, y, z) for x, y, z in half for s in (-1, 1)] + [(0, 34, -36), (0, 80, -15)]
mirror = [i ^ 1 for i in range(18)] + [18, 19]
def seen(yaw, pitch, size):
    points = []
    for x, y, z in head:
        x, z = math.cos(yaw) * x + math.sin(yaw) * z, -math.sin(yaw) * x + math.cos(yaw) * z
        y, z = math.cos(pitch) * y - math.sin(pitch) * z, math.sin(pitch) * y + math.cos(pitch) * z
        d = 1 + z / 1500
        points.append([300 + size * x / d, 300 + size * y / d])
    return points
def write(name, samples):
    json.dump({"type": "landmark-set", "version": 1, "provenance": {}, "payload": {"mirror": mirror, "connections": [],
              "samples": [{"image": "video/01.jpg", "points": p} for p in samples]}}, open(name, "w"))
write("set.yaml", [seen(random.uniform(-0.7, 0.7), random.uniform(-0.4, 0.4), random.uniform(1, 3)) for _ in range(60)])
write("few.yaml", [seen(0.1, 0, 1)] * 3)
write("still.yaml", [seen(0, 0, 1 + 0.01 * i) for i in range(30)])
open("head.txt", "w").write("20\n" + "".join("%g %g %g\n" % p for p in head))
open("head19.txt", "w").write("".join("%g %g %g\n" % p for p in head[:19]))
END
run pose train-head set.yaml -o own.json --eyes 0,1 --outer-eye-mm 88 --modes 2 --iterations 30 --compare head.txt --json
expect_status 0
expect_out '"faces":60' '"compared_mm":0\.'
run pose eval --head own.json --compare head.txt
expect_status 0
expect_out 'mean head against head.txt: 0\.'
run pose train-head set.yaml -o x.json
expect_status 2
expect_error '--eyes'
for set in few still; do
  run pose train-head $set.yaml -o x.json --eyes 0,1
  expect_status 3
  expect_error "$set.yaml"
done
[ ! -e x.json ] || fail "a head was written without a result"
run pose eval --head own.json --compare head19.txt
expect_status 3
expect_error 'head19.txt: has 19 points, the head 20'

# Judging given poses.
python3 - <<'END'
import json
line = {"image": "a.jpg", "yaw": 10, "pitch": 5, "roll": 0}
print(json.dumps(line), file=open("found.jsonl", "w"))
line.update(yaw_sigma_deg=2, pitch_sigma_deg=1, roll_sigma_deg=1)
print(json.dumps(line), file=open("sure.jsonl", "w"))
print(json.dumps({"image": "a.jpg", "euler": [-5, 13, 0]}), file=open("truth.jsonl", "w"))
END
run pose eval --truth truth.jsonl --results found.jsonl --json
expect_status 0
expect_out '"answered":1' '"pitch_mae":0\.0' '"yaw_mae":3\.0' '"rotation_mean":(2\.99|3\.0)'
grep -q sigma stdout.txt && fail "there is a coverage of poses without deviations"
# Off by 3 degrees with a deviation of 2: within two, not within one.
run pose eval --truth truth.jsonl --results sure.jsonl --json
expect_status 0
expect_out '"with_sigma":1,"yaw_within_sigma":0\.0,"yaw_within_2sigma":1\.0,"pitch_within_sigma":1\.0'
run pose eval --truth truth.jsonl --results sure.jsonl
expect_out 'yaw +within 1 sigma 0\.0 % \(0 of 1; 0-[0-9]+\), within 2 100\.0 % \(1 of 1'

# What cannot be used says so.
printf 'mtllib ../../etc/passwd\nv 0 0 0\nf 1 1 1\n' >outside.obj
printf 'v 0 0 0\nf 1 2 3\n' >range.obj
printf '%0100000d' 0 | tr 0 '[' >deep.json
expect_refusal() { # STATUS PATTERN ARGUMENTS..
  local status_wanted=$1 pattern=$2
  shift 2
  run pose track "$messi" "$@"
  expect_status "$status_wanted"
  expect_error "$pattern"
}
expect_refusal 3 'outside the folder' --draw outside.obj
expect_refusal 3 'range.obj: line 2: vertex 2 of 1' --draw range.obj
expect_refusal 3 'gone.obj' --draw gone.obj
expect_refusal 2 'Wavefront' --draw teapot
expect_refusal 5 'deep.json' --head deep.json
expect_refusal 5 'gone.json' --head gone.json
expect_refusal 3 'thing.mtl' --mapping thing.mtl
expect_refusal 3 'thing.obj' --camera thing.obj
expect_refusal 2 'focal' --focal -3
run pose eval --pointing video
expect_status 3
expect_error 'Pointing'
run pose eval
expect_status 2
expect_error '--pointing'

# The development set, where it is there.
if [ -d "${TARSIER_DATA:-}/pointing04/Person01" ]; then
  mkdir few
  for file in "$TARSIER_DATA"/pointing04/Person01/person01*+0{-30,+0,+30}.jpg; do
    [ -f "$file" ] && ln -sf "$file" "${file%.jpg}.txt" few/
  done
  run pose eval --pointing few --json --csv few.csv
  expect_status 0
  expect_out '"yaw_rises":true'
else
  echo "Pointing'04 left out: TARSIER_DATA is not set"
fi
finish
