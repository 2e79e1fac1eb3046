#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The calibration session in a real window: views taken automatically, keys, the camera written at the end.
. "$(dirname "$0")/lib_window.sh"

"$TARSIER" calibrate 'synth:board?size=480x360&fps=8&live=1' --board chess:9x6 --square 25mm --window --json \
  -o camera.yaml >stdout.txt 2>stderr.txt </dev/null &
program=$!
command_line="tarsier calibrate --window"
wait_for_window "Tarsier calibrate"
read -r left top _ _ <<<"$(x11 geometry "Tarsier calibrate")"
xdotool mousemove $((left + 100)) $((top + 100))
views_are() { tail -1 stdout.txt | grep -qE "\"views\":$1,"; }
wait_for "two views" views_are '[2-9]'
keep taken.ppm
press x '"views":0'
wait_for "views again" views_are '[1-9]'
press p '"paused":true'
press h '"paused":true'
keep help.ppm
press h '"paused":true'
press p '"paused":false'
press m '"coverage"'
# Three views of the middle can be explained by a lens that no image can be straightened with.
calibrated() { tail -1 stdout.txt | grep -q '"calibrated":true' && views_are '([6-9]|[1-9][0-9])'; }
wait_for "a camera" calibrated
press u '"straight":true'
keep straight.ppm
press q '"views"'
expect_end 0
grep -q '^fx: 40[0-9]' camera.yaml || fail "the camera is not the video's: $(cat camera.yaml)"
tail -1 stdout.txt | grep -q '"camera":"camera.yaml"' || fail "no summary at the end"
finish
