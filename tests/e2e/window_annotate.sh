#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# shellcheck disable=SC2046 # two numbers, as two words
# landmarks annotate with a real mouse: ten points on three frames of a video from nothing, killed during the work. The
# video has one frame per second, so that it still runs if keys come late; frames are then stepped through.
. "$(dirname "$0")/lib_window.sh"

run cartoon run 'synth:portrait?size=640x480&frames=60&fps=1' --mode none -o video.avi --quiet
expect_status 0

start_annotate() { # start_annotate ARGUMENTS..
  command_line="tarsier landmarks annotate $*"
  "$TARSIER" landmarks annotate "$@" --size 800x560 --json >stdout.txt 2>stderr.txt </dev/null &
  program=$!
  wait_for_window "Tarsier annotate"
  xdotool mousemove 300 200
  wait_for_image
  read -r left top width height <<<"$(x11 geometry "Tarsier annotate")"
  [ "$width" -eq 800 ] && [ "$height" -eq 560 ] || fail "the window is $width x $height"
}
# screen X Y: where that pixel of the image is on the screen, by the last state.
screen() {
  state | python3 -c 'import json, sys
x, y, left, top = map(float, sys.argv[1:])
a, b, s = json.load(sys.stdin)["state"]["view"]
print(round(left + a + s * x), round(top + b + s * y))' "$1" "$2" "$left" "$top"
}
state() { grep '"event"' stdout.txt | tail -1; }
expect_state() { state | grep -qE -- "$1" || fail "$command_line: no '$1' in $(state)"; }
click() { # click X Y
  local before
  before=$(events)
  xdotool mousemove $(screen "$1" "$2")
  sleep 0.05
  xdotool click 1
  wait_for "a click at $1 $2" more_events_than $((before + 1))
}
drag() { # drag X Y X2 Y2
  local before
  before=$(events)
  xdotool mousemove $(screen "$1" "$2") mousedown 1
  wait_for "the button at $1 $2" more_events_than "$before"
  xdotool mousemove $(screen "$(($1 + 4))" "$2")
  sleep 0.1
  xdotool mousemove $(screen "$3" "$4")
  sleep 0.1
  xdotool mouseup 1
  wait_for "the end of a drag" more_events_than $((before + 1))
}
point_x() { echo $((220 + 40 * ($1 % 5))); }
point_y() { echo $((160 + 90 * ($1 / 5) + 12 * ($1 % 3))); }

start_annotate video.avi -o set.yaml --window
press space '"paused":true'
pick() { # pick NUMBER: the frame on show, unless it is still the one before
  local before
  before=$(events)
  xdotool key s
  wait_for "key s" more_events_than "$before" && state | grep -q "\"message\":\"Picked: $1 "
}
for number in 1 2 3; do
  wait_for "image $number is picked" pick $number
  press Right '"paused":true' # the next frame
done
[ "$(ls set-frames/*.png | wc -l)" -eq 3 ] || fail "three frames should be picked: $(ls set-frames)"
press Return '"stage":"points"'
for i in 0 1 2 3 4 5; do click "$(point_x $i)" "$(point_y $i)"; done
expect_state '"points":6'
keep points.ppm
kill -KILL $program
wait $program 2>/dev/null
program=
is_closed() { ! x11 geometry "Tarsier annotate" >/dev/null; }
wait_for "the killed program's window to go" is_closed

start_annotate video.avi -o set.yaml --window
press g '"points":6'
for i in 6 7 8 9; do click "$(point_x $i)" "$(point_y $i)"; done
expect_state '"points":10'
press u '"points":9'
press ctrl+y '"points":10'
press Return '"stage":"connections"'
click "$(point_x 0)" "$(point_y 0)"
click "$(point_x 1)" "$(point_y 1)"
press Return '"stage":"symmetry"'
keep symmetry.ppm
for pair in 0:4 1:3 2:2 5:9 6:8 7:7; do
  for i in ${pair%:*} ${pair#*:}; do click "$(point_x "$i")" "$(point_y "$i")"; done
done
press Return '"stage":"images"'
has_proposal() { # the proposal is there when the image's points are
  xdotool key i
  sleep 0.2
  state | grep -q '"shown":10'
}
wait_for "a proposal" has_proposal
press '0' '"image":1'

keep proposal.ppm
press Return '"image":2'
wait_for "a proposal" has_proposal
press Tab '"selected":0'
press Right '"selected":0'
press plus '"zoom":1\.25'
press h '"shown":9'
press h '"shown":10'
press question '"help":true'
keep help.ppm
press question '"help":false'
press Return '"done":3'
keep done.ppm
xdotool key q
expect_end 0
[ ! -e set.yaml.journal ] || fail "the journal is still there"
python3 - <<'PY' || fail "the set is not what was clicked: $(head -c 600 set.yaml)"
import json
p = json.load(open("set.yaml"))["payload"]
s = p["samples"]
assert len(s) == 3 and all(len(k["points"]) == 10 and None not in k["points"] for k in s), s
for i, (x, y) in enumerate(s[0]["points"]):
    assert abs(x - (220 + 40 * (i % 5))) <= 1 and abs(y - (160 + 90 * (i // 5) + 12 * (i % 3))) <= 1, (i, x, y)
assert p["mirror"] == [4, 3, 2, 1, 0, 9, 8, 7, 6, 5], p["mirror"]
assert p["connections"] == [[0, 1]], p["connections"]
PY

# The last image again, with the mouse.
start_annotate -o set.yaml --window
press g '"image":'
x=$(python3 -c 'import json; print(round(json.load(open("set.yaml"))["payload"]["samples"][0]["points"][7][0]))')
y=$(python3 -c 'import json; print(round(json.load(open("set.yaml"))["payload"]["samples"][0]["points"][7][1]))')
drag "$x" "$y" $((x + 20)) $((y + 30))
keep dragged.ppm
press q '"stage"'
expect_end 0
python3 - "$x" "$y" <<'PY' || fail "the drag is not in the set"
import json, sys
at = json.load(open("set.yaml"))["payload"]["samples"][0]["points"][7]
assert abs(at[0] - int(sys.argv[1]) - 20) <= 1 and abs(at[1] - int(sys.argv[2]) - 30) <= 1, at
PY

# Looking at the set.
"$TARSIER" landmarks show set.yaml --json >stdout.txt 2>stderr.txt </dev/null &
program=$!
command_line="tarsier landmarks show"
wait_for_window "Tarsier landmarks"
xdotool mousemove 300 200
wait_for_image
press n '"image":1'
press m '"mirrored":true'
press i '"numbers":true'
keep show.ppm
xdotool key q
expect_end 0
[ ! -s stderr.txt ] || fail "on stderr: $err"
finish
