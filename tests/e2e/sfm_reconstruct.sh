#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm: a drawn scene comes back, is placed, exported, resumed; films; bad input.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 6 --size 480x360 --seed 3
expect_status 0
[ "$(ls scene/images | wc -l)" -eq 6 ] || fail "6 photographs expected"
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o model --json
expect_status 0
expect_out '"photographs":6' '"reprojection_px":0\.'
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
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o model --json
expect_status 0
python3 - "$out" <<'PY' || fail "the cache was not used"
import json, sys
sys.exit(json.loads(sys.argv[1])["from_cache"] != 6 + 15)
PY
cmp -s model/images.txt first.txt || fail "the second run gives another model"
for after in 0.1 0.3 0.6 1.0; do
  timeout -s KILL "$after" "$TARSIER" sfm reconstruct scene/images --camera-file scene/camera.yaml -o killed --quiet >/dev/null 2>&1 || true
done
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o killed --threads 1
expect_status 0
cmp -s killed/images.txt first.txt || fail "after being killed it gives another model"

# --- placed, exported ---
python3 - <<'PY'
import json
with open('positions.csv', 'w') as f:
    f.write('name,x,y,z\n')
    for line in open('scene/truth.jsonl'):
        d = json.loads(line)
        f.write('%s,%.9f,%.9f,%.9f\n' % (d['name'], *d['C']))
PY
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o model --align positions.csv --export undistorted --turntable --match-pictures
expect_status 0
[ "$(head -c 6 model/turntable.gif)" = GIF89a ] || fail "no turntable.gif"
[ "$(ls model/undistorted/images | wc -l)" -eq 6 ] || fail "undistorted photographs are missing"
[ -s model/undistorted/sparse/points3D.txt ] || fail "no undistorted model"
[ "$(ls model/matches | wc -l)" -ge 5 ] || fail "no pictures of matches"
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
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o model --distance 2 --distance-between 0000.jpg 0001.jpg
expect_status 0
run sfm reconstruct scene/images --camera-file scene/camera.yaml -o model --distance 2 --distance-between 0000.jpg nobody.jpg
expect_status 2

# --- two scenes, a film, followed points ---
run sfm synth -o other --images 4 --size 480x360 --seed 9
mkdir both
for f in scene/images/*; do cp "$f" "both/a-${f##*/}"; done
for f in other/images/*; do cp "$f" "both/b-${f##*/}"; done
run sfm reconstruct both --camera-file scene/camera.yaml -o two --json
expect_status 0
[ -s two/model-1/images.txt ] || fail "two scenes gave no second model"
if command -v ffmpeg >/dev/null; then
  run sfm synth -o film --images 24 --size 480x360 --trajectory line --seed 5
  ffmpeg -loglevel error -framerate 8 -i film/images/%04d.jpg -q:v 2 film.avi </dev/null || fail "ffmpeg"
  run sfm reconstruct film.avi --camera-file film/camera.yaml -o of-film --json
  expect_status 0
  [ "$(ls of-film/frames | wc -l)" -ge 5 ] || fail "hardly any key frames"
fi

# --- what cannot be reconstructed is told, never made up ---
run sfm synth -o turned --images 4 --size 480x360 --pure-rotation
run sfm reconstruct turned/images --camera-file turned/camera.yaml -o none
expect_status 1
expect_out 'no model: .*sideways'
run sfm synth -o wall --images 3 --size 320x240 --content nothing
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
cp scene/images/*.jpg mixed/
head -c 2000 scene/images/0002.jpg >mixed/0002.jpg
run sfm synth -o small --images 1 --size 240x180 --seed 3
cp small/images/0000.jpg mixed/small.jpg
run sfm reconstruct mixed --camera-file scene/camera.yaml -o of-mixed
expect_status 0
expect_out 'missing: 0002.jpg: '
run sfm reconstruct scene/images --camera 1,2 -o none
expect_status 2
run sfm reconstruct scene/images --camera-file missing.yaml -o none
expect_status 3
run sfm reconstruct scene/images --pairs nonsense -o none
expect_status 2
run sfm reconstruct scene/images -o /proc/nowhere/model
expect_status 6
run sfm eval model --truth scene/camera.yaml
expect_status 3
finish
