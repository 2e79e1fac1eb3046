#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# people live with a real mouse: two people from the first halves of two clips, known in the second, a third unknown.
. "$(dirname "$0")/lib_window.sh"
grid=${TARSIER_DATA:-/nowhere}/face-videos/grid
[ -d "$grid" ] || skip "needs face-videos of TARSIER_DATA"
/usr/bin/python3 -c 'import cv2' 2>/dev/null || skip "needs python3-opencv"

# One film: Ann and Ben (first halves), Ann, Ben (second halves), a third person; grey between. It plays in real time: few
# frames a second, so that the program keeps up and the mouse has time on any machine.
/usr/bin/python3 - "$grid" <<'PY' || skip "the clips cannot be read"
import cv2, numpy, sys
def frames(name):
    capture, out = cv2.VideoCapture(f"{sys.argv[1]}/{name}"), []
    while True:
        ok, image = capture.read()
        if not ok:
            return out
        out.append(image)
ann, ben, third = frames("brbk7n.mpg"), frames("bbaf2n.mpg"), frames("lrwp9a.mpg")
grey = [numpy.full_like(ann[0], 127)] * 40
# There and back again: enough seconds for the mouse.
long = lambda part: (part[::2] + part[::-2]) * 3
writer = cv2.VideoWriter("people.avi", cv2.VideoWriter_fourcc(*"MJPG"), 6, (ann[0].shape[1], ann[0].shape[0]))
for image in long(ann[:38]) + grey + long(ben[:38]) + grey + ann[38:] + ben[38:] + third:
    writer.write(image)
writer.release()
PY

"$TARSIER" people live people.avi --window --names Ann,Ben --json -o none >stdout.txt 2>stderr.txt </dev/null &
program=$!
command_line="tarsier people live"
wait_for_window "Tarsier people"
read -r left top _ _ <<<"$(x11 geometry "Tarsier people")"
mode_is() { tail -1 stdout.txt | grep -q "\"mode\":\"$1\""; }
click() { # click X Y, of the window
  xdotool mousemove $((left + $1)) $((top + $2))
  sleep 0.05
  xdotool click 1
}
wait_for "faces" mode_is detect
click 60 25 # Add Person
wait_for "collecting" mode_is collect
taken() { tail -1 stdout.txt | grep -q "\"faces\":[2-9],\"name\":\"$1\""; }
wait_for "two faces of Ann" taken Ann
keep collect.ppm
# Until Ben is there.
no_face() { tail -1 stdout.txt | grep -q '"faces":\[\]'; }
a_face() { ! no_face; }
wait_for "grey" no_face
click 60 25
wait_for "Ben" a_face
wait_for "two faces of Ben" taken Ben
keep ben.ppm
wait_for "grey" no_face
click 250 250 # elsewhere: ends collecting and trains
wait_for "recognising" mode_is recognize
known() { tail -1 stdout.txt | grep -q "\"label\":\"$1\".*\"known\":true"; }
wait_for "Ann known" known Ann
keep known.ppm
wait_for "Ben known" known Ben
unknown() { tail -1 stdout.txt | grep -q '"known":false'; }
wait_for "the third unknown" unknown
keep unknown.ppm
xdotool key b
keep debug.ppm
xdotool key q
wait_for "the end" ended
status=0
wait $program || status=$?
program=
err=$(cat stderr.txt)
expect_status 0
python3 - <<'PY' || fail "names are not as they should be"
import json
lines = [json.loads(l) for l in open("stdout.txt")]
lines = [l for l in lines if "frame" in l]
first = next(i for i, l in enumerate(lines) if l["mode"] == "recognize" and l["faces"])
frames = [l for l in lines[first:] if l["faces"]]
by = lambda a, b: frames[a:b]
right = lambda part, name: sum(l["faces"][0]["label"] == name and l["faces"][0]["known"] for l in part) / max(1, len(part))
assert right(by(0, 37), "Ann") > 0.85, right(by(0, 37), "Ann")
assert right(by(37, 74), "Ben") > 0.85, right(by(37, 74), "Ben")
third = frames[78:]
assert sum(l["faces"][0]["known"] for l in third) / len(third) < 0.1, third[-1]
PY
finish
