#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Image targets: training, rating, detection in an image, tracking through a video; and all errors.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/box_in_scene.png" ] || skip "needs the package opencv-doc"

# --- training ---

run ar target-train "$images/box.png" -o box.target.json --width 20cm --draw quality.png --trials 8 --json
expect_status 0
expect_out '"name":"box"' '"width":0.2,' '"rating":0\.[6-9]|"rating":1' '"reasons":\[\]'
[ -s quality.png ] || fail "no image of the quality"
cp box.target.json first.json
run ar target-train "$images/box.png" -o box.target.json --width 20cm --trials 8 --quiet
expect_status 0
expect_no_out
cmp -s first.json box.target.json || fail "training twice gave two files"
grep -q '"type": "image-target"' box.target.json || fail 'no target file'

# A wall of squares: a file is written, and what is wrong is said.
run ar target-train "$images/chessboard.png" -o chess.target.json --trials 8
expect_out 'repetitive'
[ -s chess.target.json ] || fail "no file of a poor target"

run ar target-train missing.png -o x.target.json
expect_status 3
expect_error 'missing.png'
run ar target-train "$images/box.png" -o /nowhere/x.target.json --trials 2
expect_status 6
run ar target-train "$images/box.png" -o x.target.json --width wide
expect_status 2
expect_error '--width'
python3 -c "
import struct, zlib
def chunk(t, d): return struct.pack('>I', len(d)) + t + d + struct.pack('>I', zlib.crc32(t + d))
rows = b''.join(b'\0' + b'\x80' * 400 for _ in range(20))
open('strip.png', 'wb').write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', 400, 20, 8, 0, 0, 0, 0)) + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))"
run ar target-train strip.png -o x.target.json
expect_status 3
expect_error '400 x 20 px'

# --- finding ---

run ar target-track "$images/box_in_scene.png" --target box.target.json --camera 600,600,255.5,191.5 --json -o found.png
expect_status 0
expect_out '"markers":\[\{"id":0,"name":"box","corners":\[\[' '"homography":\[' '"rvec":\[' '"tvec":\[' '"ms":'
python3 - stdout.txt <<'END' || fail "the box is not where it lies"
import json, sys
marker, = json.loads(open(sys.argv[1]).readline())["markers"]
truth = [[117.9, 160.6], [284.5, 175.0], [267.5, 297.7], [89.2, 272.2]]  # by eye to a pixel
for seen, true in zip(marker["corners"], truth):
    assert abs(seen[0] - true[0]) < 3 and abs(seen[1] - true[1]) < 3, (seen, true)
h = marker["homography"]
w = h[8] + h[6] * -0.5 + h[7] * -0.5
assert abs((h[0] * -0.5 + h[1] * -0.5 + h[2]) / w - marker["corners"][0][0]) < 0.01
assert 0.3 < marker["tvec"][2] < 2
END
[ -s found.png ] || fail "no image with the box"
# Without a camera there are no poses; where it is not, it is not seen.
run ar target-track "$images/box_in_scene.png" --target box.target.json --json
expect_status 0
grep -q tvec stdout.txt && fail "a pose without a camera"
run ar target-track "$images/graf1.png" "$images/fruits.jpg" --target box.target.json --json
expect_status 1
[ "$(grep -c '"markers":\[\]' stdout.txt)" -eq 2 ] || fail "the box is seen where it is not"

# --- following ---

mkdir video
for i in 1 2 3 4 5 6; do cp "$images/box_in_scene.png" "video/$i.png"; done
run ar target-track video --sequence --target box.target.json --csv box.csv --json --on-event 'cat >>told.jsonl'
expect_status 0
[ "$(cut -c1-47 told.jsonl)" = "$(printf '{"event":"target","state":"appeared","source":"\n{"event":"target","state":"lost","id":0,"name":')" ] ||
  fail "--on-event: $(cat told.jsonl)"
[ "$(wc -l <box.csv)" -eq 7 ] || fail "box.csv has $(wc -l <box.csv) lines"
head -1 box.csv | grep -q '^frame,time,id,confidence,x0,y0' || fail "heading of box.csv"
[ "$(grep -c '"name":"box"' stdout.txt)" -eq 6 ] || fail "the box is lost"
# Two targets keep their numbers.
run ar target-track "$images/box_in_scene.png" --target chess.target.json --target box.target.json --json
expect_status 0
grep -q '"id":1,"name":"box"' stdout.txt || fail "the second target is not number 1"

# --- refused ---

run ar target-track "$images/box_in_scene.png"
expect_status 2
expect_error '--target'
run ar target-track "$images/box_in_scene.png" --target missing.json
expect_status 5
head -c 20000 box.target.json >cut.json
run ar target-track "$images/box_in_scene.png" --target cut.json
expect_status 5
expect_error 'cut.json'
run ar target-track "$images/box_in_scene.png" --target "$TARSIER_SOURCE/models/haarcascade_none.json"
expect_status 5
echo 'width: 640' >bad.yaml
run ar target-track "$images/box_in_scene.png" --target box.target.json --camera bad.yaml
expect_status 3
printf 'model: pinhole\nwidth: 100\nheight: 400\nfx: 300\nfy: 300\ncx: 50\ncy: 200\n' >tall.yaml
run ar target-track "$images/box_in_scene.png" --target box.target.json --camera tall.yaml
expect_status 3
expect_error "100 x 400"

finish
