#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# people live with a real mouse: two people from the first halves of two clips, recognised in the second halves; a third
# person stays unknown.
. "$(dirname "$0")/lib_window.sh"
[ -n "${TARSIER_TEST_ALL:-}" ] || skip "long: ./test --all runs it"
grid=${TARSIER_DATA:-/nowhere}/face-videos/grid
[ -d "$grid" ] || skip "needs face-videos of TARSIER_DATA"
/usr/bin/python3 -c 'import cv2' 2>/dev/null || skip "needs python3-opencv"

# One video: Ann and Ben (first halves), Ann, Ben (second halves), a third person; grey between. It plays in real time: few
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
at = 0
with open("parts.txt", "w") as parts:
    for name, images in (("", long(ann[:38]) + grey + long(ben[:38]) + grey), ("Ann", ann[38:]), ("Ben", ben[38:]), ("third", third)):
        if name:
            print(name, at, at + len(images), file=parts)
        for image in images:
            writer.write(image)
        at += len(images)
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
has_two_faces() { tail -1 stdout.txt | grep -q "\"faces\":[2-9],\"name\":\"$1\""; }
wait_for "two faces of Ann" has_two_faces Ann
keep collect.ppm
# Until Ben is there.
has_no_face() { tail -1 stdout.txt | grep -q '"faces":\[\]'; }
has_face() { ! has_no_face; }
wait_for "grey" has_no_face
click 60 25
wait_for "Ben" has_face
wait_for "two faces of Ben" has_two_faces Ben
keep ben.ppm
wait_for "grey" has_no_face
click 250 250 # elsewhere: ends collecting and trains
wait_for "recognising" mode_is recognize
is_known() { tail -1 stdout.txt | grep -q "\"label\":\"$1\".*\"known\":true"; }
wait_for "Ann known" is_known Ann
keep known.ppm
wait_for "Ben known" is_known Ben
is_unknown() { tail -1 stdout.txt | grep -q '"known":false'; }
wait_for "the third unknown" is_unknown
is_late_in_third() { [ "$(tail -1 stdout.txt | grep -oE '"frame":[0-9]+' | cut -d: -f2)" -gt $(($(awk '/third/ {print $2}' parts.txt) + 40)) ]; }
wait_for "more of the third" is_late_in_third
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
shown = [l for l in lines if l["mode"] == "recognize" and l["faces"]]
# Where each is in the video, but for the frames after the cut, in which the votes for the one before fade.
parts = {name: range(int(first) + 10, int(end)) for name, first, end in map(str.split, open("parts.txt"))}
for name, part in parts.items():
    faces = [l["faces"][0] for l in shown if l["frame"] in part]
    assert len(faces) >= 8, (name, len(faces))
    if name == "third":
        assert sum(face["known"] for face in faces) / len(faces) < 0.1, faces
    else:
        assert sum(face["label"] == name and face["known"] for face in faces) / len(faces) > 0.85, (name, faces)
PY
finish
