#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A user's own models: a face detector trained on boxes, a tracker adapted to one person; `show` of both.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/messi5.jpg" ] || skip "needs the package opencv-doc"

# "Faces" on noise: bright squares with a dark cross; two images show none.
python3 - <<'END'
import random
random.seed(3)
W, H = 200, 160
lines = ["<dataset><images>"]
for k in range(10):
    image = bytearray(random.randrange(90, 120) for _ in range(W * H))
    boxes = ""
    if k < 8:
        side = random.randrange(52, 68)
        left, top = random.randrange(20, 110), random.randrange(15, 80)
        for y in range(side):
            for x in range(side):
                u, v = x / side, y / side
                cross = min(abs(u - v), abs(1 - u - v)) < 0.08 and 0.2 < u < 0.8
                image[(top + y) * W + left + x] = 40 if cross else 210
        boxes = f"<box left='{left}' top='{top}' width='{side}' height='{side}'/>"
    for y in range(120, 150):
        for x in range(5, 60):
            if (x - 30) ** 2 + (y - 135) ** 2 < 200:
                image[y * W + x] = 200
    open(f"{k}.pgm", "wb").write(b"P5 %d %d 255\n" % (W, H) + bytes(image))
    lines.append(f"<image file='{k}.pgm'>{boxes}</image>")
text = "\n".join(lines + ["</images></dataset>"])
open("boxes.xml", "w").write(text)
open("gone.xml", "w").write(text.replace(".pgm", ".png"))
open("none.xml", "w").write("<dataset><images><image file='9.pgm'></image></images></dataset>")
open("cut.xml", "w").write(text[:200])
END
run landmarks train face-detector boxes.xml -o own.json --window 48 --epsilon 0.1 --json
expect_status 0
expect_out '"images":10,"boxes":8,"ignored":0' '"knows_shapes":false'
run landmarks eval boxes.xml --detection --face-detector own.json --json
expect_status 0
expect_out '"images":10,"objects":8'
run landmarks show own.json -o own.png
expect_status 0
[ -s own.png ] || fail "no image of the filter"
run landmarks fit "$images/graf1.png" --face-detector own.json --strict --min-face 64
expect_status 1

# What cannot be learned from says so, and leaves no file.
run landmarks train face-detector boxes.xml -o x.json --window 150
expect_status 3
expect_error 'boxes.xml.*--upsample'
for set in gone none cut; do
  run landmarks train face-detector $set.xml -o x.json
  expect_status 3
  expect_error "$set.xml"
done
run landmarks train face-detector boxes.xml -o x.json --window 7
expect_status 2
[ ! -e x.json ] || fail "a model was written without data"
run landmarks fit "$images/messi5.jpg" --face-detector boxes.xml
expect_status 5
expect_error 'boxes.xml'
python3 - <<'END'
text = open("own.json").read()
open("small.json", "w").write(text.replace('"width":48', '"width":96').replace('"width": 48', '"width": 96'))
END
run landmarks fit "$images/messi5.jpg" --face-detector small.json
expect_status 5
expect_error 'small.json'

# Ctrl-C while it trains.
"$TARSIER" landmarks train face-detector boxes.xml -o x.json --window 48 --epsilon 0.0001 --c 1000000 --quiet &
program=$!
wait_until_ready $program
kill -INT $program 2>/dev/null || true
status=0
wait $program || status=$?
[ $status -eq 130 ] || [ $status -eq 0 ] || fail "interrupted training ended with $status"
[ $status -eq 0 ] || [ ! -e x.json ] || fail "an interrupted training wrote a model"

# One image whose points lie 3 px lower than the model puts them: adapted, it puts them there.
run landmarks fit "$images/messi5.jpg" --json
expect_status 0
cp stdout.txt before.txt
python3 - "$images/messi5.jpg" <<'END'
import json, sys
points = json.loads(open("before.txt").readline())["faces"][0]["points"]
def write(name, points):
    sample = {"image": sys.argv[1], "points": points}
    payload = {"mirror": [], "connections": [], "samples": [sample]}
    json.dump({"type": "landmark-set", "version": 1, "provenance": {}, "payload": payload}, open(name, "w"))
write("person.yaml", [[x, y + 3] for x, y in points])
write("few.yaml", points[:10])
END
run landmarks adapt person.yaml -o person.json --json
expect_status 0
expect_out '"faces":1' '"chosen":false'
run landmarks fit "$images/messi5.jpg" --model person.json --json
expect_status 0
python3 - <<'END' || fail "the adapted model did not move its points"
import json
def points(path):
    return json.loads(open(path).readline())["faces"][0]["points"]
moves = [b[1] - a[1] for a, b in zip(points("before.txt"), points("stdout.txt"))]
assert 1.5 < sum(moves) / len(moves) < 4, sum(moves) / len(moves)
END
run landmarks adapt few.yaml -o x.json
expect_status 3
expect_error '10 points, the model 68'
run landmarks adapt person.yaml --model own.json -o x.json
expect_status 5
expect_error 'own.json'

# The patches on an image.
run landmarks show person.json --on "$images/messi5.jpg" -o responses.png --json
expect_status 0
expect_out '"points":68' '"response":0'
[ -s responses.png ] || fail "no sheet of responses"
run landmarks show person.json --on "$images/graf1.png" -o x.png
expect_status 1
[ ! -e x.png ] || fail "a sheet without a face"
run landmarks show person.json --on nowhere.png -o x.png
expect_status 3
run landmarks show person.json --on "$images/messi5.jpg" --search 20 -o x.png
expect_status 2
finish
