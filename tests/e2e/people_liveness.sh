#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The liveness challenge: synthetic heads that follow it, and photos of them rotated in front of the camera. JSON
# events, exit status. docs/results.md has the error rates.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
make_video() { # make_video NAME head|photo SEED
  run pose synth -o "$1" --challenge "$2" --tasks 2 --seed "$3" --yaw 30 --size 400x300 --near 450 --far 500 --quiet
  expect_status 0
}
run_liveness() { # run_liveness NAME SEED
  run people liveness "$1/images" --sequence --fps 15 --fixed-order --tasks 2 --seed "$2" --json
}

make_video real head 1
run_liveness real 1
expect_status 0
expect_out '"event":"liveness"' '"state":"ask"' '"state":"passed"' '"done":2' '"liveness":\{"state":"look"'

make_video print photo 1
run_liveness print 1
expect_status 1
grep -q '"state":"passed"' stdout.txt && fail "a photograph passed"
expect_out '"event":"liveness"'

# Another order than it was made for; stills; nobody.
run people liveness real/images/0000.png
expect_status 2
expect_error 'a challenge needs a video or a camera'
run people liveness real/images --sequence --fps 15 --tasks 0
expect_status 2
finish
