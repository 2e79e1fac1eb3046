#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# landmarks annotate, import and show without a window: lines on stdin, a kill during the work, corrupt files.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

annotate() { # annotate ARGUMENTS.. <lines
  status=0
  timeout "${TARSIER_TEST_TIMEOUT:-900}" "$TARSIER" landmarks annotate "$@" >stdout.txt 2>stderr.txt || status=$?
  err=$(cat stderr.txt)
  command_line="tarsier landmarks annotate $*"
}
# check_set FILE EXPRESSION: of the set's payload p.
check_set() {
  python3 - "$1" "$2" <<'PY' || fail "$command_line: $1: not so: $2"
import json, sys
p = json.load(open(sys.argv[1]))["payload"]
s = p["samples"]
sys.exit(not eval(sys.argv[2]))
PY
}

run cartoon run 'synth:portrait?size=640x480&frames=30' --mode none -o video.avi --quiet
expect_status 0

# --- from nothing to a set of three frames ---
points() { for i in 0 1 2 3 4 5 6 7 8 9; do echo "click $((200 + 25 * i)).5 $((150 + 17 * ((i * 3) % 10))).25"; done; }
{
  echo frames 1; echo pick
  echo frames 9; echo pick
  echo frames 9; echo key s
  echo go-on
  points
  echo look points.png
  echo go-on
  echo click 200.5 150.25; echo click 225.5 201.25
  echo go-on
  echo click 200.5 150.25; echo click 425.5 269.25
  echo go-on
  echo drag-all 10 10 16 13
  echo drag 206.5 153.25 210 160.5
  echo look second.png
  echo go-on
  echo go-on
} >lines.txt
annotate video.avi -o set.yaml --actions - --proposals off <lines.txt
expect_status 0
expect_out '^set.yaml: 3 of 3 images done, 10 points$'
check_set set.yaml 'len(s) == 3 and all(len(k["points"]) == 10 for k in s)'
check_set set.yaml 's[0]["image"] == "set-frames/frame-000000.png" and s[2]["image"] == "set-frames/frame-000018.png"'
check_set set.yaml 'abs(s[0]["points"][3][0] - 275.5) < 1e-6 and abs(s[0]["points"][3][1] - 303.25) < 1e-6'
check_set set.yaml 'abs(s[1]["points"][0][0] - 210) < 1e-6 and abs(s[1]["points"][1][0] - 231.5) < 1e-6'
check_set set.yaml 'p["connections"] == [[0, 1]] and p["mirror"] == []' # half a symmetry is none
[ -e set-frames/frame-000009.png ] || fail "the picked frame is not there"
[ -s points.png ] && [ -s second.png ] || fail "no views"

# --- gone on with, without naming the video; what is right stays ---
cp set.yaml before.yaml
echo 'key n' >lines.txt
annotate -o set.yaml --actions - <lines.txt
expect_status 0
cmp -s set.yaml before.yaml || fail "looking changed the set"

# --- killed in the middle: nothing is lost ---
mkdir images
cp set-frames/*.png images/
mkfifo pipe
"$TARSIER" landmarks annotate images -o killed.yaml --actions - --json <pipe >steps.txt 2>stderr.txt &
program=$!
exec 7>pipe
points | head -6 >&7
until [ "$(grep -c '"points":6' steps.txt)" -ge 1 ]; do sleep 0.05; kill -0 $program || break; done
kill -KILL $program
wait $program 2>/dev/null
exec 7>&-
[ ! -e killed.yaml ] || fail "the set is written too early for this test"
{ points | tail -4; echo stage-images; echo go-on; } >lines.txt
annotate images -o killed.yaml --actions - <lines.txt
expect_status 0
check_set killed.yaml 'len(s) == 2 and len(s[0]["points"]) == 10 and abs(s[0]["points"][5][1] - 235.25) < 1e-6'
check_set killed.yaml 's[0]["image"] == "images/frame-000000.png"'
printf '{"why":"to' >>killed.yaml.journal
echo 'key n' >lines.txt
annotate images -o killed.yaml --actions - <lines.txt
expect_status 0
echo 'nonsense' >>killed.yaml.journal
echo '{}' >>killed.yaml.journal
annotate images -o killed.yaml --actions - </dev/null
expect_status 3
expect_error 'killed.yaml.journal: line [0-9]+ is damaged'
rm killed.yaml.journal

# --- two at once, no display, nothing to annotate ---
mkfifo other
"$TARSIER" landmarks annotate images -o busy.yaml --actions - <other >/dev/null 2>&1 &
program=$!
exec 8>other
until [ -e busy.yaml.journal ]; do sleep 0.05; kill -0 $program || break; done
# Until it is locked, too.
until grep -q ":$(stat -c %i busy.yaml.journal) " /proc/locks; do sleep 0.05; kill -0 $program || break; done
annotate images -o busy.yaml --actions - </dev/null
expect_status 3
expect_error 'busy.yaml.journal: another program'
exec 8>&-
wait $program
[ $? -eq 1 ] || fail "a set without points is nothing found"
[ ! -e busy.yaml ] || fail "a set of nothing was written"
status=0
(unset DISPLAY WAYLAND_DISPLAY; timeout 900 "$TARSIER" landmarks annotate images -o window.yaml) >stdout.txt 2>stderr.txt || status=$?
command_line="landmarks annotate without a display" err=$(cat stderr.txt)
expect_status 3
expect_error
[ ! -e window.yaml.journal ] || fail "a journal was begun without a window"
run landmarks annotate -o nothing.yaml
expect_status 2
run landmarks annotate missing.avi -o nothing.yaml
expect_status 3
expect_error 'missing.avi'
mkdir empty
run landmarks annotate empty -o nothing.yaml --actions -
expect_status 3
echo '{"type": "shape-model", "version": 1, "provenance": {}, "payload": {}}' >wrong.yaml
run landmarks annotate images -o wrong.yaml --actions -
expect_status 3
expect_error 'wrong.yaml: '
run landmarks annotate images -o no/such/folder/set.yaml --actions -
expect_status 6
expect_error
# A video that breaks off.
head -c 40000 video.avi >short.avi
printf 'frames 30\npick\ngo-on\nclick 100 100\n' >lines.txt
annotate short.avi -o short.yaml --actions - <lines.txt
[ "$status" -eq 0 ] || [ "$status" -eq 3 ] || fail "a video that breaks off: status $status, $err"

# --- show ---
run landmarks show set.yaml -o sheet.png --numbers
expect_status 0
expect_out '^sheet.png: 3 of 3 samples'
[ -s sheet.png ] || fail "no sheet"
rm images/frame-000009.png
run landmarks show killed.yaml -o sheet.png # an image that is gone is a dark cell
expect_status 0
run landmarks show missing.yaml -o sheet.png
expect_status 3
expect_error 'missing.yaml'
echo '{"type": "plate-reader", "version": 1, "provenance": {}, "payload": {}}' >plate.json
run landmarks show plate.json -o sheet.png
expect_status 3
expect_error "plate.json: is a 'plate-reader'" 'known: '

# --- import ---
mkdir marks
cp set-frames/frame-000000.png marks/a.png
cp set-frames/frame-000009.png marks/b.png
printf 'version: 1\nn_points: 3\n{\n10 20\n30.5 40\n50 60\n}\n' >marks/a.pts
printf 'version: 1\nn_points: 3\n{\n11 21\n31.5 41\n51 61\n}\n' >marks/b.pts
printf 'version: 1\nn_points: 3\n{\n1 2\n3 4\n5 6\n}\n' >marks/alone.pts
run landmarks import marks -o imported.yaml --offset 1
expect_status 0
expect_out '^imported.yaml: 2 samples of 3 points, 0 connections, symmetry not known, 1 left out$'
grep -q 'alone' stderr.txt || fail "what was left out is not named: $err"
check_set imported.yaml 's[0]["points"] == [[9, 19], [29.5, 39], [49, 59]]'
run landmarks import marks -o imported.yaml --json
expect_status 0
expect_out '"samples":2' '"skipped":\["[^"]*alone'
run landmarks import marks/a.pts -o imported.yaml --format pts
expect_status 0
run landmarks import empty -o imported.yaml
expect_status 3
expect_error 'empty'
run landmarks import marks -o imported.yaml --format xyz
expect_status 2
finish
