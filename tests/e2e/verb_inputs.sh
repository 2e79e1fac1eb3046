#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# What the tests of every verb read, made once for all of them: images, sets, a gallery, a reconstruction (cli_verbs.py).
. "$(dirname "$0")/lib.sh"
python3 "$TARSIER_SOURCE/tests/e2e/cli_verbs.py" --make "${TARSIER_INPUTS:?the folder to fill}" || fail "the inputs"
finish
