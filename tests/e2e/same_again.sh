#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Every verb with one thread and with three: the same files and figures (same_again.py).
. "$(dirname "$0")/lib.sh"
python3 "$TARSIER_SOURCE/tests/e2e/same_again.py" || fail "results depend on the number of threads, or on the run"
finish
