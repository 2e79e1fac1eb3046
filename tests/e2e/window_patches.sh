#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# landmarks show MODEL in a window: the patches one by one, by key and by button, on an image.
. "$(dirname "$0")/lib_window.sh"
image=/usr/share/doc/opencv-doc/examples/data/messi5.jpg
[ -f "$image" ] || skip "needs the package opencv-doc"

show() { # show ARGUMENTS..
  command_line="tarsier landmarks show $*"
  "$TARSIER" landmarks show "$@" --json >stdout.txt 2>stderr.txt </dev/null &
  program=$!
  wait_for_window "Tarsier patches"
  xdotool mousemove 300 200
  wait_for_image
}

show "$TARSIER_SOURCE/models/landmarks68.json" --on "$image"
press n '"patch":1,.*"patches":68'
press Right '"patch":2,'
press p '"patch":1,'
press w '"search":31'
grep '"event"' stdout.txt | tail -1 | grep -q '"image":"messi5.jpg"' || fail "$command_line: not on the image"
read -r left top width _ <<<"$(x11 geometry "Tarsier patches")"
before=$(x11 stable "$max_wait" "$program" "$left" "$top" 900 500)
xdotool mousemove $((left + 185 * width / 1000)) $((top + 558 * width / 1000)) # the button "next"
sleep 0.1
xdotool click 1
x11 stable "$max_wait" "$program" "$left" "$top" 900 500 "$before" >/dev/null || fail "another patch looks the same"
keep patches.ppm
press question '"help":true.*"patch":2,'
xdotool key q
expect_end 0
finish
