#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Every session through a pipe window, as `tarsier serve` shows it in a browser, and a viewer's camera: pipe_window.py.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip "no python3 to be the other side of the pipes"

run cartoon run 'synth:portrait?size=640x480&frames=3' --mode none -o images --quiet
expect_status 0
run cartoon run 'synth:portrait?size=640x480&frames=1' --mode none -o face.jpg --quiet
expect_status 0
run sfm synth -o scene --images 16 --size 320x240 --trajectory line --seed 5 --quiet
expect_status 0
python3 "$TARSIER_SOURCE/tests/e2e/pipe_window.py" || fail "pipe_window.py"

# What is not a window is said at once, and no display is asked for.
for wrong in pipe:3 pipe:70:71 x11; do
  status=0
  env -u DISPLAY TARSIER_WINDOW=$wrong "$TARSIER" aam explore >stdout.txt 2>stderr.txt </dev/null || status=$?
  err=$(cat stderr.txt) command_line="TARSIER_WINDOW=$wrong tarsier aam explore"
  expect_status 3
  expect_error "TARSIER_WINDOW=$wrong: "
done
run cartoon run viewer:me -o none
expect_status 3
expect_error 'viewer:me: TARSIER_VIEWER is not set'
finish
