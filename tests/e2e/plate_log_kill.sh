#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate read --log, killed at thirty moments: no confirmed vehicle is lost.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip 'no python3'
run plate synth -o cars --count 1 --size 320x180
[ "$status" -eq 3 ] && grep -q typefaces stderr.txt && skip "no typefaces to draw plates with"
python3 "$TARSIER_SOURCE/tests/e2e/plate_log_kill.py" || fail 'see above'
finish
