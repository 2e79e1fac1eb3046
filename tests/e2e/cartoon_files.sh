#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Images, folders and videos through `cartoon run`: the right files, and JSON that lists them.
. "$(dirname "$0")/lib.sh"
samples=/usr/share/doc/opencv-doc/examples/data
[ -r $samples/home.jpg ] || skip "no sample images (package opencv-doc)"

# json EXPRESSION: Python over stdout.txt; `lines` are its objects. True, or the test fails.
have_python=1
command -v python3 >/dev/null || { have_python=0; echo "no python3: JSON is checked by its looks only"; }
json() {
  if [ $have_python = 0 ]; then grep -q '^{' stdout.txt; else
    python3 - "$1" <<'PY'
import json, sys
lines = [json.loads(line) for line in open("stdout.txt", encoding="utf-8")]
frames = [line for line in lines if "image" in line or "frame" in line]
sys.exit(0 if eval(sys.argv[1]) else 1)
PY
  fi || fail "$command_line: not so: $1 in $(head -c 300 stdout.txt)"
}
probe() { ffprobe -v error -select_streams v -count_frames -show_entries "stream=$2" -of csv=p=0 "$1"; }

# An image to an image, in every mode.
for mode in sketch paint cartoon evil evil-sketch alien smooth none; do
  run cartoon run $samples/home.jpg --mode $mode -o $mode.png --json
  expect_status 0
  json "lines == [dict(lines[0], image='$samples/home.jpg', mode='$mode', output='$mode.png')]"
  json "lines[0]['ms'] >= 0 and lines[0]['faces'] == []"
  [ "$(head -c 4 $mode.png | tail -c 3)" = PNG ] || fail "$mode.png is no PNG"
done
cmp -s sketch.png paint.png && fail "two modes draw the same image"
run cartoon run $samples/home.jpg -o quiet.jpg --quiet
expect_status 0
expect_no_out
expect_no_err
[ "$(head -c 2 quiet.jpg | od -An -tx1 | tr -d ' ')" = ffd8 ] || fail "quiet.jpg is no JPEG"

# An image from another program.
cat $samples/home.jpg | "$TARSIER" cartoon run /dev/stdin --mode sketch -o piped.png --quiet
cmp -s piped.png sketch.png || fail "an image on stdin gives another output"

# The reference draws what the fast way draws.
run cartoon run $samples/home.jpg --mode sketch --quality reference -o reference.png
expect_status 0
cmp -s sketch.png reference.png || fail "sketch differs from its reference"

# Several inputs, a folder with broken images, a list, a glob.
mkdir in
cp $samples/home.jpg in/a.jpg
cp $samples/box.png in/b.png
head -c 3000 $samples/home.jpg >in/c.jpg
echo "no image" >in/d.jpg
run cartoon run in -o out --json
expect_status 0
json "[line['image'] for line in lines] == ['in/a.jpg', 'in/b.png']"
json "[line['output'] for line in lines] == ['out/a.jpg', 'out/b.png']"
[ "$(ls out)" = $'a.jpg\nb.png' ] || fail "files of the folder: $(ls out)"
[ "$(grep -c 'warning: in/' stderr.txt)" -eq 2 ] || fail "two broken images, but: $err"
printf '# two\nin/a.jpg\n\nin/b.png\n' >list.txt
run cartoon run @list.txt -o listed/ --json
expect_status 0
json "len(lines) == 2"
run cartoon run 'in/*.png' in/a.jpg -o several --json --mode none
expect_status 0
json "[line['image'] for line in lines] == ['in/b.png', 'in/a.jpg']"
run cartoon run in/a.jpg -o stages.png --debug-dir stages
expect_status 0
[ "$(find stages -name '0*-*.png' | wc -l)" -ge 5 ] || fail "stages: $(find stages)"

# Videos.
run cartoon run $samples/vtest.avi -o video.mp4 --frames 20 --json --timings
expect_status 0
json "[line['frame'] for line in lines] == list(range(20)) and abs(lines[10]['time'] - 1.0) < 0.01"
grep -q '^total ' stderr.txt || fail "no table of times: $err"
if command -v ffprobe >/dev/null; then
  [ "$(probe video.mp4 width,height,r_frame_rate,nb_read_frames)" = 768,576,10/1,20 ] ||
    fail "video.mp4: $(probe video.mp4 width,height,r_frame_rate,nb_read_frames)"
else
  echo "no ffprobe: the video is not looked into"
fi
run cartoon run $samples/Megamind.avi -o frames --frames 5 --mode sketch --json
expect_status 0
[ "$(find frames -name '*.png' | wc -l)" -eq 5 ] || fail "frames: $(ls frames)"
json "all(line['output'].startswith('frames/') for line in lines)"
run cartoon run $samples/vtest.avi -o none --every 10 --frames 3 --json
expect_status 0
json "[line['frame'] for line in lines] == [0, 10, 20]"

# Switching by lines on stdin. Stopping while paused must not wait for ever.
printf 'sketch\nsketch-threshold 40\nno-such-thing\npause\n' >actions.txt
status=0
timeout 900 "$TARSIER" cartoon run $samples/vtest.avi -o none --frames 30 --json --actions - \
  <actions.txt >stdout.txt 2>stderr.txt || status=$?
out=$(cat stdout.txt) err=$(cat stderr.txt) command_line="--actions -"
expect_status 0
json "[line['event'] for line in lines if 'event' in line][0] == 'action sketch'"
json "lines[-1]['mode'] == 'sketch' or lines[-1]['state']['mode'] == 'sketch'"
grep -q 'no-such-thing' stderr.txt || fail "an unknown action is not named: $err"
finish
