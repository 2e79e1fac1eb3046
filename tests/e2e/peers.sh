#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# bench/peers/run.py on a few synthetic scenes: one table, evaluated by the program; missing peers are reported.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
/usr/bin/python3 -c 'import cv2, numpy; cv2.aruco, cv2.SIFT_create' 2>/dev/null || skip "needs python3-opencv with cv2.aruco"
peers() { PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 "$TARSIER_SOURCE/bench/peers/run.py" --program "$TARSIER" "$@" >table.md 2>progress.txt; }

run ar synth markers -o data/ar --count 6 --level easy --family 36h11,6x6_250 --min-markers 1 --quiet
expect_status 0
mv data/ar/truth.jsonl data/ar/markers.jsonl
peers --data data --only markers,people,plates --out out || fail "run.py: $(tail -n 3 progress.txt)"
cmp -s table.md out/peers.md || fail "the table of --out is another one"
/usr/bin/python3 - <<'END' || fail "the table: $(cat table.md)"
import json
run = json.load(open("out/peers.json"))
assert run["processor"] and run["version"].startswith("tarsier")
rows = run["rows"]
of = lambda area, word: [r for r in rows if r["area"] == area and word in r["method"]]
# Degrees: corners in another order than the truth's would be off by 90 or 180.
for method, most in (("tarsier", 2), ("cv::aruco", 30)):
    found = [r for r in of("markers", method) if r["state"] == "measured"]
    assert len(found) == 2, (method, rows)
    assert all(r["figures"]["recall"] > 0.5 and r["figures"]["rot_deg_median"] < most for r in found), found
# The program that runs AprilTag is built on request: either it ran, or what to do is said.
for r in of("markers", "AprilTag"):
    if r["state"] == "measured":
        assert r["figures"]["recall"] > 0.5 and r["figures"]["rot_deg_median"] < 30, r
    else:
        assert "tarsier_peers" in r["result"], r
assert of("markers", "AprilTag")
assert all(r["state"] == "skipped" and "get-data.sh" in r["result"] for r in rows if r["area"] == "people"), rows
assert of("plates", "OpenALPR") and all(r["state"] == "reference" for r in of("plates", "OpenALPR"))
END
head -n 1 table.md | grep -q 'Processor: ' || fail "no processor: $(head -n 1 table.md)"
grep -q 'reference, not run here' table.md || fail "references are not marked"

# Nothing to measure is no success; neither is a word that means nothing.
peers --data nowhere --only planar && fail "no data, and no failure"
grep -q 'skipped: no ar/planar.jsonl' table.md || fail "no word about missing data: $(cat table.md)"
peers --only nonsense && fail "an area that is not there"
finish
