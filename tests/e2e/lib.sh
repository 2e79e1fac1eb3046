# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Common parts of the end-to-end tests. Source it first: it makes an empty folder $WORK and changes to it.
set -u
: "${TARSIER:?the built program}"
WORK=${WORK:-$(mktemp -d)}
rm -rf "$WORK"
mkdir -p "$WORK"
cd "$WORK" || exit 1
# What this user installed (~/.local/share/tarsier/models) must not decide what a test sees.
export XDG_DATA_HOME=$WORK/data-home
unset TARSIER_MODELS TARSIER_OWN_MODELS
failures=0

# The interpreter itself comes first: a version manager's wrapper of that name costs more than most scripts here, and a
# kill of the wrapper would leave the interpreter running.
: "${TARSIER_TEST_PYTHON:=$(python3 -c 'import os, sys; print(os.path.dirname(sys.executable))' 2>/dev/null)}"
export TARSIER_TEST_PYTHON
[ -z "$TARSIER_TEST_PYTHON" ] || PATH=$TARSIER_TEST_PYTHON:$PATH

fail() {
  failures=$((failures + 1))
  printf 'FAILED: %s\n' "$*"
}

skip() { # skip REASON: the whole test
  printf 'skipped: %s\n' "$*"
  exit 77
}

# noise COUNT: so many pseudo-random bytes to stdout, the same in every run. Bytes of /dev/urandom made a test fail once in some
# hundred runs, where they began with an empty line.
noise() { python3 -c 'import random, sys; sys.stdout.buffer.write(random.Random(1).randbytes(int(sys.argv[1])))' "$1"; }

finish() { # the last line of each test
  [ "$failures" -eq 0 ] || { printf '%d failed\n' "$failures"; exit 1; }
  exit 0
}

# run ARGUMENTS..: the program; leaves $status, $out (stdout) and $err (stderr).
run() {
  status=0
  timeout "${TARSIER_TEST_TIMEOUT:-900}" "$TARSIER" "$@" >stdout.txt 2>stderr.txt </dev/null || status=$?
  out=$(<stdout.txt) err=$(<stderr.txt)
  command_line="tarsier $*"
}

# wait_until_ready PID: until the program takes SIGINT as a wish to stop (which it then blocks), or has ended. Before the
# program begins, the shell blocks SIGINT too, together with SIGCHLD (0x10000).
wait_until_ready() {
  local blocked
  while blocked=$(awk '/^State:/ && $2 == "Z" {exit} /^SigBlk/ {print $2}' "/proc/$1/status" 2>/dev/null) && [ -n "$blocked" ]; do
    [ $((16#$blocked & 0x10002)) -ne 2 ] || return 0
    sleep 0.02
  done
}

expect_status() { [ "$status" -eq "$1" ] || fail "$command_line: exit status $status, expected $1 (stderr: $err)"; }

# One line on stderr that begins as all our errors do and matches each pattern.
expect_error() {
  local pattern
  [ "$(wc -l <stderr.txt)" -eq 1 ] || fail "$command_line: not one line of error: $err"
  case $err in
    "tarsier: error: "?*) ;;
    *) fail "$command_line: error does not begin 'tarsier: error: ': $err" ;;
  esac
  for pattern in "$@"; do
    grep -qE -- "$pattern" stderr.txt || fail "$command_line: error without '$pattern': $err"
  done
}

expect_out() { # stdout matches each pattern
  local pattern
  for pattern in "$@"; do
    grep -qE -- "$pattern" stdout.txt || fail "$command_line: no '$pattern' in: $(head -c 600 stdout.txt)"
  done
}

expect_no_out() { [ ! -s stdout.txt ] || fail "$command_line: unexpected output: $(head -c 300 stdout.txt)"; }
expect_no_err() { [ ! -s stderr.txt ] || fail "$command_line: unexpected on stderr: $err"; }
