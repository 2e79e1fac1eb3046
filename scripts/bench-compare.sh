#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/bench-compare.sh BUILD_A BUILD_B [BENCH ..]   are the hot paths of B slower than those of A?
# scripts/bench-compare.sh BUILD [BENCH ..]             one table (Markdown) of all figures of a build
# BUILD is a build folder or a program; BENCH is a name of `tarsier bench` (default: all that measure time). The builds
# run alternately, ROUNDS (3) times each. The best value of each figure is used, because other load only adds time.
# Ratios outside 10 % are marked; exit status 1 if one is slower than LIMIT (1.15). REPEATS (5) is passed to the
# benches.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
exec python3 "$root/bench/compare.py" "$@"
