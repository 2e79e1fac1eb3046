#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm: a synthetic scene is reconstructed, placed, exported, resumed; tracked points; invalid input. (Videos:
# sfm_video.sh; interruptions and errors: sfm_interrupted.sh.)
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 6 --size 320x240 --seed 3
expect_status 0
[ "$(ls scene/images | wc -l)" -eq 6 ] || fail "6 images expected"
scene=(sfm reconstruct scene/images --camera-file scene/camera.yaml --max-features 1000)
run "${scene[@]}" -o model --json
expect_status 0
expect_out '"images":6' '"reprojection_px":0\.'
for file in cameras.txt images.txt points3D.txt points.ply cameras.ply report.json view.png view.html; do
  [ -s "model/$file" ] || fail "model/$file is missing"
done
run sfm eval model --truth scene/truth.jsonl --json
expect_status 0
python3 - "$out" <<'PY' || fail "the cameras are off: $out"
import json, sys
s = json.loads(sys.argv[1])
sys.exit(not (s["registered"] == 6 and s["center_mean_percent"] < 0.5 and s["rotation_mean_deg"] < 0.1))
PY

# --- a second run goes on from the first, and ends the same, whatever killed the first ---
cp model/images.txt first.txt
run "${scene[@]}" -o model --json
expect_status 0
python3 - "$out" <<'PY' || fail "the cache was not used"
import json, sys
sys.exit(json.loads(sys.argv[1])["from_cache"] != 6 + 15)
PY
cmp -s model/images.txt first.txt || fail "the second run gives another model"
run sfm synth -o little --images 3 --size 240x180 --seed 3
set_small_scene_words() { # set_small_scene_words FOLDER ARGUMENTS..
  local folder=$1
  shift
  words=(sfm reconstruct little/images --camera-file little/camera.yaml --max-features 400 -o "$folder" --quiet "$@")
}
set_small_scene_words whole
start=$(date +%s.%N)
run "${words[@]}"
expect_status 0
seconds=$(python3 -c "import sys, time; print(time.time() - float(sys.argv[1]))" "$start")
for share in 0.1 0.3 0.5 0.7 0.9; do
  set_small_scene_words "killed-$share"
  timeout -s KILL "$(python3 -c "print($share * $seconds)")" "$TARSIER" "${words[@]}" >/dev/null 2>&1 || true
  run "${words[@]}" --threads 1
  expect_status 0
  for file in cameras images points3D; do
    cmp -s "killed-$share/$file.txt" "whole/$file.txt" || fail "killed after $share of its time, it ends with another $file.txt"
  done
done

# --- little memory; what adjustment did ---
set_small_scene_words limited --debug-dir looked
memory_limit=4194304  # kB
[ -z "${TARSIER_SANITIZED:-}" ] || memory_limit=unlimited  # sanitizers map terabytes that they never touch
(ulimit -v $memory_limit && "$TARSIER" "${words[@]}") >/dev/null 2>stderr.txt || fail "4 GB are not enough: $(cat stderr.txt)"
cmp -s limited/images.txt whole/images.txt || fail "--debug-dir or a limit of memory changes the model"
for file in grown-001-before grown-001-after model-0; do
  [ -s "looked/$file.ply" ] && [ -s "looked/$file.png" ] || fail "--debug-dir: no $file"
done

# --- simulated views ---
set_small_scene_words wide --wide --json
run "${words[@]}"
expect_status 0
python3 - "$out" <<'PY' || fail "--wide gives no more points"
import json, sys
plain = sum(not line.startswith('#') for line in open('whole/points3D.txt'))
sys.exit(json.loads(sys.argv[1])["models"][0]["points"] <= plain)
PY
set_small_scene_words none --wide --features orb
run "${words[@]}"
expect_status 2
expect_error '--wide .*--features sift'

# --- placed, exported ---
python3 - <<'PY'
import json
with open('positions.csv', 'w') as f:
    f.write('name,x,y,z\n')
    for line in open('scene/truth.jsonl'):
        d = json.loads(line)
        f.write('%s,%.9f,%.9f,%.9f\n' % (d['name'], *d['C']))
PY
run "${scene[@]}" -o model --align positions.csv --export undistorted --turntable --match-images
expect_status 0
[ "$(head -c 6 model/turntable.gif)" = GIF89a ] || fail "no turntable.gif"
[ "$(ls model/undistorted/images | wc -l)" -eq 6 ] || fail "undistorted images are missing"
[ -s model/undistorted/sparse/points3D.txt ] || fail "no undistorted model"
[ "$(ls model/matches | wc -l)" -ge 5 ] || fail "no images of matches"
python3 - <<'PY' || fail "--align did not bring the cameras to their places"
import json, re
truth = {json.loads(l)['name']: json.loads(l)['C'] for l in open('scene/truth.jsonl')}
lines = [l for l in open('model/images.txt') if not l.startswith('#')]
worst = 0
for head in lines[0::2]:
    f = head.split()
    w, x, y, z = map(float, f[1:5])
    t = list(map(float, f[5:8]))
    R = [[1-2*(y*y+z*z), 2*(x*y-z*w), 2*(x*z+y*w)], [2*(x*y+z*w), 1-2*(x*x+z*z), 2*(y*z-x*w)], [2*(x*z-y*w), 2*(y*z+x*w), 1-2*(x*x+y*y)]]
    c = [-sum(R[r][k] * t[r] for r in range(3)) for k in range(3)]
    worst = max(worst, max(abs(a - b) for a, b in zip(c, truth[f[9]])))
exit(worst > 0.1)
PY
run "${scene[@]}" -o model --distance 2 --distance-between 0000.jpg 0001.jpg
expect_status 0

# --- what is shown while it grows changes nothing, and is gone at the end ---
run "${scene[@]}" -o grown --no-cache --growing
expect_status 0
[ ! -e grown/growing ] || fail "--growing leaves its folder"
cmp -s grown/images.txt first.txt || fail "--growing changes the model"

# --- what cannot be reconstructed is told, never made up ---
run sfm synth -o turned --images 3 --size 320x240 --pure-rotation
run sfm reconstruct turned/images --camera-file turned/camera.yaml --max-features 800 -o none
expect_status 1
expect_out 'no model: .*sideways'
run sfm synth -o wall --images 2 --size 240x180 --content nothing
run sfm reconstruct wall/images --camera-file wall/camera.yaml -o none
expect_status 1
expect_out 'no model: '
mkdir empty one
run sfm reconstruct empty -o none
expect_status 3
cp scene/images/0000.jpg one/
run sfm reconstruct one -o none
expect_status 3
expect_error 'two or more'
mkdir mixed
cp little/images/*.jpg mixed/
head -c 2000 little/images/0002.jpg >mixed/0003.jpg
cp scene/images/0000.jpg mixed/large.jpg
run sfm reconstruct mixed --camera-file little/camera.yaml --max-features 400 -o of-mixed
expect_status 0
expect_out 'not registered: 0003.jpg: '
run sfm reconstruct scene/images --camera 1,2 -o none
expect_status 2
run sfm reconstruct scene/images --camera-file missing.yaml -o none
expect_status 3
run sfm reconstruct scene/images --pairs nonsense -o none
expect_status 2
run sfm reconstruct scene/images --memory 2kB -o none
expect_status 2
expect_error '250MB..1024GB'
run sfm reconstruct scene/images --memory 2GB --no-cache -o none
expect_status 2
expect_error 'no-cache'
run sfm reconstruct scene/images -o /proc/nowhere/model
expect_status 6
expect_error '/proc/nowhere'
run sfm reconstruct little/images --camera-file little/camera.yaml -o whole --online --online-view /proc/nowhere/video.mp4
expect_status 6
expect_error '/proc/nowhere'
run sfm reconstruct scene/images -o none --window
expect_status 2
expect_error 'online'
run sfm reconstruct scene/images -o none --online --online-view view.png
expect_status 2
run sfm reconstruct 97 -o none
expect_status 3
expect_error 'with --online'
run sfm reconstruct 97 -o none --online
expect_status 3
run sfm eval model --truth scene/camera.yaml
expect_status 3

# Drawn streets, a flight and objects; what does not go together is refused.
for scene in walk city grid; do
  run sfm synth --trajectory "$scene" --images 3 --size 160x120 -o "drawn-$scene" --quiet
  expect_status 0
  [ "$(wc -l <"drawn-$scene/truth.jsonl")" -eq 3 ] || fail "truth of $scene"
done
for content in temple toy; do
  run sfm synth --trajectory ring --content "$content" --images 2 --size 160x120 -o "drawn-$content" --quiet
  expect_status 0
done
run sfm synth --trajectory walk --content relief -o refused
expect_status 2
expect_error 'needs --content houses'
run sfm synth --trajectory ring --content houses -o refused
expect_status 2
expect_error 'walk or city'
run sfm synth --trajectory grid --content room -o refused
expect_status 2
expect_error 'relief, boxes or plane'
run sfm synth --trajectory city --depth -o refused
expect_status 2
expect_error 'not possible with --trajectory city'
[ ! -e refused ] || fail 'a folder was made before the flags were checked'

# Features and matches without images: what is kept of one pair is not taken for another's.
run sfm synth --observations --trajectory walk --images 16 -o observed --quiet
expect_status 0
for kept in --quiet --no-cache; do
  run sfm reconstruct --database observed/database.db --camera-file observed/camera.yaml -o "of-database$kept" --quiet "$kept"
  expect_status 0
done
cmp of-database--quiet/images.txt of-database--no-cache/images.txt || fail "the cache changes a model"
finish
