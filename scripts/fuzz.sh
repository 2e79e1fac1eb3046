#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/fuzz.sh [--jobs N] [--no-build] [SECONDS [TARGET..]]      e.g.  scripts/fuzz.sh 60 camera_file obj
# Builds the fuzzing programs (preset fuzz; needs clang 16 or later) and runs each target of fuzz/ for SECONDS (600), N
# (1) at a time, from the inputs in fuzz/corpus, those that fuzz_seeds makes, and what earlier runs came upon
# (build/fuzz/corpus). One line for each target; what was found lies in build/fuzz/finds/TARGET, with the log beside it.
# Exit status 1 where there are findings.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/setup.sh
. scripts/setup.sh

jobs=1
build=yes
while [[ ${1:-} == --* ]]; do
  case $1 in
    --jobs) jobs=${2:?--jobs needs a number}; shift 2 ;;
    --no-build) build=no; shift ;;
    *) die "unknown option $1" ;;
  esac
done
seconds=${1:-600}
[[ $seconds =~ ^[0-9]+$ ]] || die "SECONDS is a number, not '$seconds'"
shift || true

out=build/fuzz
if [ "$build" = yes ]; then
  mapfile -t packages < <(fuzz_packages)
  install_packages "${build_packages[@]}" "${packages[@]}"
  compiler=$(fuzz_compiler) || die "clang 16 or later is needed"
  build fuzz -DCMAKE_CXX_COMPILER="$compiler"
fi
list=$out/fuzz/targets.txt
[ -s "$list" ] || die "there is no $list: run without --no-build first"
if [ "$#" -eq 0 ]; then
  mapfile -t targets < <(cut -d' ' -f1 "$list")
else
  targets=("$@")
  for target in "${targets[@]}"; do
    grep -q "^$target " "$list" || die "no target '$target'; there are: $(cut -d' ' -f1 "$list" | paste -sd' ')"
  done
fi

TARSIER_FUZZ_TMP=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")" tarsier-fuzz.XXXXXX)
export TARSIER_FUZZ_TMP
trap 'rm -rf "$TARSIER_FUZZ_TMP"' EXIT
"$out/bin/fuzz_seeds" "$out/seeds" || die "fuzz_seeds failed"

# One target: a line of its figures on stdout; status 1 for findings.
run_target() {
  local target=$1 program corpus=$out/corpus/$1 finds=$out/finds/$1 log dictionary=() folders=() status=0 place
  program=$(sed -n "s/^$target //p" "$list")
  mkdir -p "$corpus" "$finds"
  log=$finds.log
  [ ! -f "fuzz/$target.dict" ] || dictionary=("-dict=fuzz/$target.dict")
  for place in "fuzz/corpus/$target" "$out/seeds/$target"; do
    [ ! -d "$place" ] || folders+=("$place")
  done
  # -max_len: far above what the readers need, far below their limits of size.
  TARSIER_FUZZ=$target "$out/bin/$program" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=1024 \
    -malloc_limit_mb=1024 -max_len=65536 -print_final_stats=1 -artifact_prefix="$finds/" "${dictionary[@]}" \
    "$corpus" "${folders[@]}" >"$log" 2>&1 </dev/null || status=$?
  local executions rate coverage found
  executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log" | tail -1)
  rate=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log" | tail -1)
  coverage=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -1)
  found=$(find "$finds" -type f -newer "$TARSIER_FUZZ_TMP/begin" | wc -l)
  [ "$status" -eq 0 ] || [ "$found" -gt 0 ] || found=1 # it did not even start, or was killed
  printf '%-17s %10s executions %7s/s %6s edges  %s\n' "$target" "${executions:-?}" "${rate:-?}" "${coverage:-?}" \
    "$([ "$found" -eq 0 ] && echo "nothing found" || echo "FOUND $found: $(sed -n 's/^SUMMARY: //p' "$log" | tail -1) ($log)")"
  [ "$found" -eq 0 ]
}
export -f run_target
export out seconds list
touch "$TARSIER_FUZZ_TMP/begin"
phase "fuzzing: ${#targets[@]} targets, $seconds s each, $jobs at a time"
status=0
printf '%s\n' "${targets[@]}" | xargs -P "$jobs" -I{} bash -c 'run_target "$1"' _ {} || status=1
phase_done
exit "$status"
