#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate read: synthetic cars and drives, JSON, images, logs, regions, and errors.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run plate synth -o none --count 1 --kind nowhere
expect_status 2
run plate synth -o cars --count 6 --size 1024x768 --seed 4
[ "$status" -eq 3 ] && grep -q typefaces stderr.txt && skip "no typefaces to draw plates with"
expect_status 0
[ "$(ls cars/images | wc -l)" -eq 6 ] || fail "6 images expected"
head -1 cars/truth.csv | grep -q '^image,x,y,w,h,text$' || fail "truth.csv has no header"
run plate synth -o again --count 6 --size 1024x768 --seed 4
cmp -s cars/truth.csv again/truth.csv || fail "the same seed draws other cars"

# --- images ---
run plate read cars/images --json --csv read.csv
expect_status 0
cp stdout.txt read.jsonl
python3 - <<'PY' || fail "read.csv is not what --json says: $(head -3 read.csv)"
import csv, json
rows = list(csv.DictReader(open("read.csv")))
plates = [(line["image"], plate) for line in map(json.loads, open("read.jsonl")) for plate in line["plates"]]
assert len(rows) == len(plates) >= 5
assert list(rows[0]) == ["frame", "time", "image", "text", "confidence", "country", "x", "y", "width", "height"]
for row, (image, plate) in zip(rows, plates):
    assert row["image"] == image and row["text"] == plate["text"] and abs(float(row["confidence"]) - plate["confidence"]) < 1e-3
    assert [int(row[k]) for k in ("x", "y", "width", "height")] == plate["box"]
PY
[ "$(wc -l <read.jsonl)" -eq 6 ] || fail "6 lines expected, not $(wc -l <read.jsonl)"
expect_out '"image":"cars/images/car-00000.jpg"' '"plates":\[\{"text":"[A-Z0-9]+"' '"candidates":' '"corners":' '"ms":'
run plate eval read.jsonl --truth cars/truth.csv --json
expect_status 0
python3 - "$out" <<'PY' || fail "drawn cars are read badly: $out"
import json, sys
scores = json.loads(sys.argv[1])
sys.exit(not (scores["recall"] >= 0.8 and scores["exact"] >= 0.7))
PY
run plate eval cars/images --truth cars/truth.csv --json
expect_status 0
run plate read cars/images/car-00000.jpg
expect_status 0
expect_out '^cars/images/car-00000.jpg: [A-Z0-9]+ [01]\.[0-9]+'
run plate read cars/images/car-00000.jpg -o drawn.png --debug-dir stages --json
expect_status 0
[ -s drawn.png ] || fail "no image was drawn"
ls stages/*/*detected.png stages/*/*aligned.png >/dev/null || fail "stages are missing"
run plate read cars/images/car-00000.jpg --pipeline classic --json --debug-dir classic
[ "$status" -le 1 ] || fail "classic pipeline: status $status"
ls classic/*/*closed.png >/dev/null || fail "classic stages are missing"

run plate read 'synth:car?seed=4&frames=2' --json
expect_status 0
expect_out '"image":"car-00000"' '"image":"car-00001"'

# --- videos ---
run plate read 'synth:drive?seconds=8&cars=2&parked=1&far=0&fps=4&seed=4&size=640x360' --events --json --log seen.db
expect_status 0
[ "$(grep -c '"event":"plate"' stdout.txt)" -eq "$(wc -l <stdout.txt)" ] || fail "lines other than events with --events"
events=$(wc -l <stdout.txt)
[ "$events" -ge 1 ] && [ "$events" -le 2 ] || fail "2 cars gave $events events"
run plate log seen.db --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq "$events" ] || fail "the log has $(wc -l <stdout.txt) entries, not $events"
[ "$(stat -c %a seen.db)" = 600 ] || fail "the log can be read by others"
python3 - <<'PY' || fail "times or states of the log"
import datetime, json
now = datetime.datetime.now(datetime.timezone.utc)
for line in map(json.loads, open("stdout.txt")):
    first, last = (datetime.datetime.fromisoformat(line[k].replace("Z", "+00:00")) for k in ("first_time", "last_time"))
    assert first <= last <= now and (now - first).total_seconds() < 3600, line
    assert (last - first).total_seconds() < 8.1 and line["state"] == "closed", line
    assert "drive?" in line["source"], line
PY
run plate read 'synth:drive?seconds=3&cars=1&parked=1&far=0&fps=5&seed=3&size=640x360' --events --json --on-event 'cat >>told.jsonl; sleep 0.1'
expect_status 0
python3 - <<'PY' || fail "--on-event: $(cat told.jsonl)"
import json
told = [json.loads(line) for line in open("told.jsonl")]
opened = {t["id"]: t for t in told if t["state"] == "opened"}
closed = [t for t in told if t["state"] == "closed"]
assert closed == [json.loads(line) for line in open("stdout.txt")] and closed, told
assert all(opened[t["id"]]["frames"] < t["frames"] for t in closed if t["id"] in opened) and opened, told
PY
run plate read 'synth:drive?seconds=1&cars=1&parked=1&far=0&fps=5' --on-event-timeout 3
expect_status 2
printf 'P5 320 240 255\n' >grey.pgm # an image without a plate
head -c 76800 /dev/zero | tr '\0' '\200' >>grey.pgm
run plate read grey.pgm
expect_status 1
expect_out '^grey.pgm: no plate$'
run plate read 'synth:drive?seconds=1' cars/images --start 2026-05-01
expect_status 2
run plate read 'synth:drive?seconds=3&cars=1&parked=1&far=0&fps=5&seed=3&size=640x360' --events --json --start 2026-05-01T12:30
expect_out '"first_seen":"2026-05-01T12:30:0'
run plate read 'synth:drive?seconds=4&cars=1&parked=1&far=0&fps=5&seed=3&size=640x360' --events --json --roi 0,0,0.3,0.3
expect_status 1
expect_no_out
run plate read 'synth:drive?seconds=3&cars=1&parked=1&far=0&fps=5&light=infrared&size=640x360' --json
expect_status 0
expect_out '"frame":0'

# --- what it must refuse ---
run plate read 'synth:bars?frames=1' --json
expect_status 1
expect_out '"plates":\[\]'
printf 'P5\n1 1\n255\nA' >one.pgm
run plate read one.pgm --json
expect_status 1
run plate read cars/images/car-00000.jpg --country atlantis
expect_status 2
expect_error 'atlantis'
run plate read cars/images/car-00000.jpg --roi 1,2,3
expect_status 2
run plate read cars/images/car-00000.jpg --min-confidence 3
expect_status 2
printf '{"type":"plate-reader"' >broken.json
run plate read cars/images/car-00000.jpg --reader broken.json
expect_status 5
expect_error 'broken.json'
run plate read cars/images/car-00000.jpg --detector missing.json
expect_status 5
run plate read nothing.jpg
expect_status 3
printf 'no database' >text.db
run plate read cars/images/car-00000.jpg --log text.db
[ "$status" -eq 6 ] || [ "$status" -eq 3 ] || fail "a log that is no database: status $status"
run plate read cars/images/car-00000.jpg --log /nowhere/x.db
[ "$status" -eq 6 ] || [ "$status" -eq 3 ] || fail "a log that cannot be made: status $status"
finish
