#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/fuzz.sh [--jobs N] [--no-build] [--budget S] [--in-all] [--keep] [SECONDS [TARGET..]]
# e.g.  scripts/fuzz.sh 60 camera_file obj
# Builds the fuzzing programs (preset fuzz; needs clang 16 or later) and runs each target of fuzz/ for SECONDS (600), N
# (1) at a time. The inputs are those in fuzz/corpus, those of fuzz_seeds, and those that earlier runs found
# (build/fuzz/corpus). Prints one line for each target; findings are in build/fuzz/finds/TARGET, with the log beside it.
# Runs add up: fuzz/seconds.txt has the total CPU seconds of each target, and those with the fewest run first.
# (Wall-clock seconds would include waiting on a busy machine.)
# --budget S: starts no new target after S seconds, so that a run of any length is useful.
# --in-all: runs a target until its total CPU time, earlier runs included, is SECONDS.
# --keep: afterwards reduces the new inputs to those that cover code which fuzz/corpus does not, and adds them there (at
# most 90 kB per target, 40 files per run). With SECONDS 0 nothing else is done.
# Exit status 1 if there are findings.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/setup.sh
. scripts/setup.sh

jobs=1
build=yes
budget=0
in_all=no
keep=no
while [[ ${1:-} == --* ]]; do
  case $1 in
    --jobs) jobs=${2:?--jobs needs a number}; shift 2 ;;
    --no-build) build=no; shift ;;
    --budget) budget=${2:?--budget needs a number of seconds}; shift 2 ;;
    --in-all) in_all=yes; shift ;;
    --keep) keep=yes; shift ;;
    *) die "unknown option $1" ;;
  esac
done
seconds=${1:-600}
[[ $budget =~ ^[0-9]+$ ]] || die "--budget S: a number of seconds, not '$budget'"
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

# The CPU seconds that each target has had; those with the fewest come first.
ledger=$PWD/fuzz/seconds.txt
touch "$ledger"
had() { awk -v target="$1" '$1 == target {print $2; found = 1} END {if (!found) print 0}' "$ledger"; }
mapfile -t targets < <(for target in "${targets[@]}"; do echo "$(had "$target") $target"; done | sort -s -n -k1,1 | cut -d' ' -f2)

TARSIER_FUZZ_TMP=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")" tarsier-fuzz.XXXXXX)
export TARSIER_FUZZ_TMP
trap 'rm -rf "$TARSIER_FUZZ_TMP"' EXIT
"$out/bin/fuzz_seeds" "$out/seeds" || die "fuzz_seeds failed"

# More CPU seconds of a target into the ledger, whoever else is at it.
add_seconds() {
  (
    flock 9
    awk -v target="$1" -v more="$2" '
      $1 == target {$2 += more; found = 1}
      {print $1, $2}
      END {if (!found) print target, more}' "$ledger" | LC_ALL=C sort >"$TARSIER_FUZZ_TMP/seconds"
    cat "$TARSIER_FUZZ_TMP/seconds" >"$ledger"
  ) 9>"$TARSIER_FUZZ_TMP/lock"
}

# One target for S seconds of the clock: a line of its figures on stdout; status 1 for findings.
run_for() {
  local target=$1 length=$2 program corpus=$out/corpus/$1 finds=$out/finds/$1 log dictionary=() folders=() status=0 place
  program=$(sed -n "s/^$target //p" "$list")
  mkdir -p "$corpus" "$finds"
  log=$finds.log
  [ ! -f "fuzz/$target.dict" ] || dictionary=("-dict=fuzz/$target.dict")
  for place in "fuzz/corpus/$target" "$out/seeds/$target"; do
    [ ! -d "$place" ] || folders+=("$place")
  done
  local TIMEFORMAT='%0U' used
  # -max_len: far above what the readers need, far below their limits of size.
  used=$( { time TARSIER_FUZZ=$target "$out/bin/$program" -max_total_time="$length" -timeout=10 -rss_limit_mb=1024 \
    -malloc_limit_mb=1024 -max_len=65536 -print_final_stats=1 -artifact_prefix="$finds/" "${dictionary[@]}" \
    "$corpus" "${folders[@]}" >"$log" 2>&1 </dev/null; } 2>&1 ) || status=$?
  add_seconds "$target" "${used:-0}"
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

out_of_budget() { [ "$budget" -gt 0 ] && [ $(($(date +%s) - begun)) -ge "$budget" ]; }

# One target for SECONDS; with --in-all for what it lacks, again until it has it (beside other work the clock goes faster).
run_target() {
  local lacks=$seconds
  ! out_of_budget || return 0
  if [ "$in_all" = no ]; then
    run_for "$1" "$seconds"
    return
  fi
  while lacks=$((seconds - $(had "$1"))) && [ "$lacks" -gt 0 ] && ! out_of_budget; do
    run_for "$1" $((lacks < 5 ? 5 : lacks)) || return 1
  done
}

# keep_corpus TARGET: what covers code that neither fuzz/corpus nor the seeds do goes to fuzz/corpus, the smallest first.
keep_corpus() {
  local target=$1 program all=$TARSIER_FUZZ_TMP/all/$1 file size total=0 new=0
  program=$(sed -n "s/^$target //p" "$list")
  [ -d "$out/corpus/$target" ] || return 0
  mkdir -p "$all" "fuzz/corpus/$target"
  for place in "fuzz/corpus/$target" "$out/seeds/$target"; do
    [ ! -d "$place" ] || find "$place" -type f -exec cp -t "$all" {} +
  done
  touch "$TARSIER_FUZZ_TMP/before-$target"
  sleep 0.01 # files after it are newer
  TARSIER_FUZZ=$target "$out/bin/$program" -merge=1 -timeout=10 -rss_limit_mb=1024 -malloc_limit_mb=1024 -max_len=16384 \
    "$all" "$out/corpus/$target" >"$out/finds/$target-merge.log" 2>&1 </dev/null || { echo "$target: not merged ($out/finds/$target-merge.log)"; return 1; }
  total=$(find "fuzz/corpus/$target" -type f -printf '%s\n' | awk '{n += $1} END {print n + 0}')
  while read -r size file; do
    [ $((total + size)) -le 90000 ] && [ "$new" -lt 40 ] || break
    cp "$file" "fuzz/corpus/$target/$(basename "$file")"
    total=$((total + size)) new=$((new + 1))
  done < <(find "$all" -type f -newer "$TARSIER_FUZZ_TMP/before-$target" -printf '%s %p\n' | sort -n)
  printf '%-17s %5d inputs kept, %7d bytes now\n' "$target" "$new" "$total"
}
export -f run_target run_for out_of_budget had add_seconds keep_corpus
begun=$(date +%s)
export out seconds list budget begun ledger in_all
touch "$TARSIER_FUZZ_TMP/begin"
status=0
if [ "$seconds" -gt 0 ]; then
  phase "fuzzing: ${#targets[@]} targets, $seconds s each, $jobs at a time"
  printf '%s\n' "${targets[@]}" | xargs -P "$jobs" -I{} bash -c 'run_target "$1"' _ {} || status=1
  phase_done
  awk '{n += $2; if (min == "" || $2 < min) min = $2} END {printf "%d targets have had %.1f CPU hours in all, each %d s or more\n", NR, n / 3600, min}' "$ledger"
fi
if [ "$keep" = yes ]; then
  phase "keeping what was come upon"
  printf '%s\n' "${targets[@]}" | xargs -P "$jobs" -I{} bash -c 'keep_corpus "$1"' _ {} || status=1
  phase_done
fi
exit "$status"
