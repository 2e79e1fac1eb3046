#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# bench-compare.sh: two builds with known figures (scripts that imitate them), then the program against itself.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip "no python3"
compare=$TARSIER_SOURCE/scripts/bench-compare.sh

build() { # build NAME MS_OF_FAST MS_OF_SLOW: a build folder whose program says so
  mkdir -p "$1/bin"
  cat >"$1/bin/tarsier" <<PLAY
#!/bin/sh
case "\$1" in
  help) echo '{"verbs":[{"path":["bench","toys"]}]}' ;;
  *) echo '{"bench":"toys","case":"fast","ms":$2,"fps":7}'; echo '{"bench":"toys","case":"slow","find_ms":$3,"max_ms":99}' ;;
esac
PLAY
  chmod +x "$1/bin/tarsier"
}
expect_comparison() { # expect_comparison STATUS PATTERN..: of the comparison of old and new
  status=0
  "$compare" old new >stdout.txt 2>stderr.txt || status=$?
  command_line="bench-compare" out=$(cat stdout.txt) err=$(cat stderr.txt)
  expect_status "$1"
  shift
  expect_out "$@"
}
build old 1.0 20
build new 1.05 20.1
expect_comparison 0 '^\| toys \| fast \| ms \| 1 ms \| 1.05 ms \| 1.05 \|  \|$'
grep -q max_ms stdout.txt && fail "the largest time was compared"
build new 0.5 22.5
expect_comparison 0 '0.50 \| faster' '1.12 \| slower'
build new 1 24
expect_comparison 1 '1.20 \| SLOWER'

printf '#!/bin/sh\ncase "$1" in help) echo "{\\"verbs\\":[{\\"path\\":[\\"bench\\",\\"toys\\"]}]}" ;; *) echo "{\\"ms\\":1}" ;; esac\n' >new/bin/tarsier
status=0
"$compare" old new >stdout.txt 2>stderr.txt || status=$?
[ "$status" -eq 1 ] && grep -q 'a line without "bench"' stderr.txt || fail "a line without its name: $(cat stderr.txt)"

# The program's own lines fit.
ROUNDS=1 REPEATS=1 "$compare" "$TARSIER" render posit >stdout.txt 2>stderr.txt || fail "the program's own: $(cat stderr.txt)"
grep -q '^| render | gouraud | ms |' stdout.txt || fail "no figure of render: $(cat stdout.txt)"
grep -q '^| posit | ' stdout.txt || fail "no figure of posit: $(cat stdout.txt)"
finish
