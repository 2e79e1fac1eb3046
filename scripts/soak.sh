#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/soak.sh [HOURS=2] [SEED=1]: runs live sources whose server and child are killed at random moments, and checks
# memory, descriptors, threads and children for growth (tests/soak/soak.py has the limits). Samples:
# build/soak/samples.csv. TARSIER selects another program than build/release/bin/tarsier, SOAK_NICE its priority. Needs
# little processor time: 5 frames/s of 320x240.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export TARSIER=${TARSIER:-$root/build/release/bin/tarsier}
[ -x "$TARSIER" ] || { echo "soak: no program $TARSIER: build it (./demo, ./test) or set TARSIER" >&2; exit 2; }
out=${SOAK_OUT:-$root/build/soak}
rm -rf "$out"
mkdir -p "$out"
cd "$out"
exec nice -n "${SOAK_NICE:-15}" python3 "$root/tests/soak/soak.py" --hours "${1:-2}" --seed "${2:-1}"
