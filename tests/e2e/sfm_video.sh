#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm: a video, tracked points, and a model that grows while the video runs.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"
command -v ffmpeg >/dev/null || skip "no ffmpeg to make a video with"

run sfm synth -o video --images 16 --size 320x240 --trajectory line --seed 5
ffmpeg -loglevel error -framerate 8 -i video/images/%04d.jpg -q:v 2 video.avi </dev/null || fail "ffmpeg"
walk=(sfm reconstruct video.avi --camera-file video/camera.yaml --max-features 500 --pairs sequential --overlap 4 --json)
run "${walk[@]}" -o of-video
expect_status 0
[ "$(ls of-video/frames | wc -l)" -ge 5 ] || fail "hardly any key frames"
case $err in *'are not used'*) fail "no limit of key frames was reached: $err" ;; esac

run "${walk[@]}" -o limited --max-frames 3
expect_status 0
[ "$(ls limited/frames | wc -l)" = 3 ] || fail "--max-frames 3: $(ls limited/frames)"
grep -q 'are not used: the limit of 3 key frames is reached' stderr.txt || fail "--max-frames 3 without a word: $err"

# --- followed points are found once ---
followed=(sfm reconstruct video/images --camera-file video/camera.yaml --matches flow -o followed --json)
run "${followed[@]}"
expect_status 0
cp followed/images.txt first.txt
rm -f followed/cache/*.mapper
run "${followed[@]}"
expect_status 0
python3 - "$out" <<'PY' || fail "what was followed was not kept"
import json, sys
report = json.loads(sys.argv[1])
sys.exit(report["from_cache"] != 16 + report["pairs"]["compared"])
PY
cmp -s followed/images.txt first.txt || fail "--matches flow: the second run gives another model"

# --- online: the model grows while the video runs, and ends as it does without ---
run "${walk[@]}" -o online --online --online-view online.avi
expect_status 0
grep '"frame"' stdout.txt >frames.jsonl
python3 - <<'PY' || fail "the model did not grow with the video: $(tail -n 2 frames.jsonl)"
import json, sys
frames = [json.loads(line) for line in open('frames.jsonl')]
grown = [f['registered'] for f in frames]
sys.exit(not (len(frames) == 16 and len(set(grown)) >= 3 and grown == sorted(grown) and frames[-1]['points'] > 100))
PY
for file in cameras images points3D; do
  cmp -s "online/$file.txt" "of-video/$file.txt" || fail "online gives another $file.txt"
done
[ -s online.avi ] && [ -s online/view.html ] || fail "online: no video of it, or no results"

# --- the user ends it; a signal ends it: the model is of what was seen ---
online() { # online FOLDER ARGUMENTS..
  local folder=$1
  shift
  exec "$TARSIER" sfm reconstruct video/images --camera-file video/camera.yaml --max-features 500 --pairs sequential \
    --overlap 4 -o "$folder" --online --json "$@" >stdout.txt 2>stderr.txt
}
wait_until_grown() { # waits for three images in the model
  for _ in $(seq 6000); do
    grep -qE '"registered":([3-9]|1.)' stdout.txt && return
    sleep 0.05
  done
  fail "online: nothing grows: $(tail -n 1 stdout.txt) $(cat stderr.txt)"
}
: >stdout.txt
status=0
(online ended --actions -) < <(wait_until_grown; printf 'adjust\nquit\n') || status=$?
[ "$status" -eq 0 ] || fail "online, quit: exit status $status: $(cat stderr.txt)"
expect_out '"event":"action adjust"' '"event":"action quit"'
[ -s ended/points3D.txt ] || fail "online, quit: there is no model"
: >stdout.txt
(online stopped) </dev/null &
program=$!
wait_until_grown
kill -INT $program
status=0
wait $program || status=$?
[ "$status" -eq 130 ] || fail "online, interrupted: exit status $status: $(cat stderr.txt)"
[ -s stopped/points3D.txt ] && [ -s stopped/report.json ] || fail "online, interrupted: there is no model"
finish
