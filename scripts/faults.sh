#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/faults.sh [ROUNDS=20] [SEED=1] [VERB ..]: runs every verb that writes, ROUNDS times for each set of words,
# with a full, read-only or failing disk, without memory, and killed (tests/faults/faults.py lists the checks). Builds
# the release build.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
rounds=${1:-20} seed=${2:-1}
shift $(($# < 2 ? $# : 2))
build=${TARSIER_BUILD:-$root/build/release}
[ -f "$build/build.ninja" ] || cmake --preset release -S "$root" -DTARSIER_BUILD_TESTS=ON >/dev/null
nice ninja -C "$build" tarsier tarsier_fault_shim >/dev/null
work=$build/faults
rm -rf "$work"
mkdir -p "$work"
cd "$work"
export TARSIER=$build/bin/tarsier TARSIER_FAULT_SHIM
TARSIER_FAULT_SHIM=$(ls "$build"/bin/libtarsier_fault_shim.so)
exec nice -n 10 python3 "$root/tests/faults/faults.py" --seed "$seed" --rounds "$rounds" "$@"
