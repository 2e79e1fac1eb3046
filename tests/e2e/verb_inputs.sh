#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The inputs of the tests of every verb, made once for all: images, sets, a gallery, a reconstruction (cli_verbs.py).
. "$(dirname "$0")/lib.sh"
python3 "$TARSIER_SOURCE/tests/e2e/cli_verbs.py" --make "${TARSIER_INPUTS:?the folder to fill}" || fail "the inputs"
finish
