#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Enrolment killed at twenty moments: the gallery can be opened each time and keeps all earlier faces: people_kill.py.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/ml.png" ] || skip "needs the package opencv-doc"
python3 -c 'import sqlite3' || skip "needs python3"
python3 "$TARSIER_SOURCE/tests/e2e/people_kill.py" "$images/ml.png" || fail "the gallery did not survive a kill"
run people identify "$images/ml.png" --json
expect_status 0
finish
