#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# `tarsier bench`, `tarsier demo` and `tarsier serve` are separate programs that replace tarsier's process; they are
# beside it, or in ../libexec/tarsier.
. "$(dirname "$0")/lib.sh"
programs=$(dirname "$TARSIER")

# What only a benchmark needs is not linked into tarsier, nor is the page of the demo within it.
needed_libraries() { readelf -d "$1" | grep NEEDED; }
needed_libraries "$TARSIER" | grep -q libopencv_imgproc || fail "cannot list the libraries of the program"
needed_libraries "$TARSIER" | grep -i apriltag && fail "tarsier links a library of bench markers"
grep -q 'Classical computer vision on an ordinary CPU, offline' "$programs/tarsier-demo" || fail "cannot find the demo's text in tarsier-demo"
grep -q 'Classical computer vision on an ordinary CPU, offline' "$TARSIER" && fail "tarsier holds the demo's page"

grep -q tarsier_session "$programs/tarsier-serve" || fail "cannot find the cookie of the studio in tarsier-serve"
grep -q tarsier_session "$TARSIER" && fail "tarsier holds the studio's server"

# Started by hand they are the same verbs.
"$TARSIER" bench posit --help >by-tarsier.txt
"$programs/tarsier-bench" posit --help >by-hand.txt
cmp by-tarsier.txt by-hand.txt || fail "tarsier-bench posit --help differs"
[ "$("$programs/tarsier-serve" --version)" = "$("$TARSIER" --version)" ] || fail "tarsier-serve --version"
[ "$("$programs/tarsier-demo" --version)" = "$("$TARSIER" --version)" ] || fail "tarsier-demo --version"

# A bench that draws what it measures: seconds and counts of each stage, and how exact the result is.
"$TARSIER" bench sfm --only ring12 --size 200x150 --repeats 1 --json --quiet >stages.jsonl || fail "bench sfm: exit status $?"
python3 - <<'PY' || fail "bench sfm: $(cat stages.jsonl)"
import json
lines = [json.loads(line) for line in open("stages.jsonl")]
assert [line["case"] for line in lines] == [f"ring12 200x150 {stage}" for stage in "features pairs match reconstruct all".split()], lines
assert all(line["bench"] == "sfm" and line["cpu_ms"] >= 0 and line["wall_ms"] >= 0 for line in lines)
features, pairs, match, reconstruct, whole = lines
assert features["images"] == 12 and features["features"] > 2000 and pairs["pairs"] == 66
assert match["matches"] >= match["inliers"] > 500 and 0 < match["pairs"] <= 66
assert reconstruct["registered"] == 12 and reconstruct["observations"] > 2 * reconstruct["points"] > 200
assert whole["center_percent"] < 1
PY

# Alone: described, refused with one line, and not started.
mkdir -p alone/bin alone/libexec/tarsier
cp "$TARSIER" alone/bin/tarsier
TARSIER=$PWD/alone/bin/tarsier
for words in "bench posit" "demo" "serve"; do
  name=tarsier-${words%% *}
  # shellcheck disable=SC2086  # the words of a verb
  run $words --help
  expect_status 0
  expect_out "Usage: tarsier $words"
  # shellcheck disable=SC2086
  run $words
  expect_status 3
  expect_no_out
  expect_error "alone/bin/$name: no such program"
done
run bench posit --repeats 0
expect_status 2
expect_error 'repeats'

# Words, streams and the exit status pass through, and the process stays the same one; what lies beside tarsier comes first.
make_fake_companion() { # make_fake_companion FILE STATUS
  # shellcheck disable=SC2016  # for the script
  printf '#!/bin/sh\necho "$0"; printf "<%%s>" "$@"; echo " as $$"; echo "on stderr" >&2; cat; exit %s\n' "$2" >"$1"
  chmod +x "$1"
}
make_fake_companion alone/libexec/tarsier/tarsier-bench 5
echo 'repeats = 3' >bench.toml
status=0
echo input | sh -c 'echo "$$" >pid.txt; exec "$@"' sh "$TARSIER" bench posit --config bench.toml 'an image.png' --quiet >stdout.txt 2>stderr.txt || status=$?
out=$(cat stdout.txt) err=$(cat stderr.txt) command_line="tarsier bench posit, a script"
expect_status 5
expect_out 'libexec/tarsier/tarsier-bench' '<posit><--config><bench.toml><an image.png><--quiet>' " as $(cat pid.txt)$" '^input$'
[ "$err" = "on stderr" ] || fail "stderr: $err"
make_fake_companion alone/bin/tarsier-bench 4
run bench posit
expect_status 4
expect_out 'alone/bin/tarsier-bench'
finish
