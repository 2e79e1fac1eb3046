#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Every verb that the program itself lists (`tarsier help --json`), one after another: cli_verbs.py.
. "$(dirname "$0")/lib.sh"
python3 "$TARSIER_SOURCE/tests/e2e/cli_verbs.py" || fail "the table of verbs"
finish
