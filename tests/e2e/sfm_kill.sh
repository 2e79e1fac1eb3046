#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm reconstruct by both mappers, and sfm merge, killed at random moments of all their stages: the same command gives
# the same files in the end: sfm_kill.py. 200 images, 20 kills: python3 sfm_kill.py 200 20
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
if [ -n "${TARSIER_TEST_ALL:-}" ]; then
  images=40 kills=6
else
  images=12 kills=3
fi
python3 "$TARSIER_SOURCE/tests/e2e/sfm_kill.py" $images $kills || fail "a killed run, resumed, gave other files"
finish
