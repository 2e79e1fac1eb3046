#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate watch: lists created, changed and queried; plate read --watch: events that name the matching entry, --on-watch,
# earlier entries of the log.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip 'no python3'
export TZ=UTC
umask 077

run plate watch add gate.csv 2863sdn --label 'Ann, blue' --direction approaching --json
expect_status 0
expect_out '^\{"plate":"2863SDN","label":"Ann, blue","errors":0.25,"direction":"approaching","hours":null,"days":null,"state":"added"\}$'
run plate watch add gate.csv 'B-12*' --tolerate 1 --hours '22:00-06:00' --days fri
expect_status 0
run plate watch add gate.csv 2863SDN --label Ann
expect_out '^changed: 2863SDN +Ann +errors 0.25 +approaching +any +any$' # the other columns stay
run plate watch add gate.csv 2863SDN --tolerate 0 --direction any --hours 08:00-09:00 --days mon
expect_out '^changed: 2863SDN +Ann +errors 0 +any +08:00-09:00 +mon$'
run plate watch add gate.csv 2863SDN --tolerate 0.25 --hours any --days any
run plate watch list gate.csv
expect_out '^2863SDN +Ann +errors 0.25 +any +any +any$' '^B12\* .*22:00-06:00 +fri$'
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "the list has $(wc -l <stdout.txt) entries"
run plate watch test gate.csv Z863SDN B12XYZ 1 --at 2026-05-02T03:00 --json
expect_status 0
expect_out '"text":"Z863SDN","watch":\[\{"label":"Ann","entry":"2863SDN","distance":0.25\}\]' '"entry":"B12\*"' '"text":"1","watch":\[\]'
run plate watch test gate.csv B12XYZ --at 2026-05-02T12:00
expect_status 1
expect_out '^B12XYZ: none$'

# Several programs change one list at the same time.
for k in 1 2 3 4 5 6 7 8; do "$TARSIER" plate watch add many.csv "AB${k}CD" --quiet >/dev/null & done
wait
[ "$(grep -c '^AB' many.csv)" -eq 8 ] || fail "entries are lost: $(cat many.csv)"
for k in 1 2 3 4 5 6 7; do "$TARSIER" plate watch remove many.csv "AB${k}CD" --quiet >/dev/null & done
wait
[ "$(grep -c '^AB' many.csv)" -eq 1 ] || fail "entries are back: $(cat many.csv)"

# Vehicles: the event says so at once and at the end; others give no command a run.
run plate read 'synth:drive?frames=20&fps=10&size=960x540' --events --json --watch gate.csv --log plates.db --start 2026-05-01T12:00 --on-event 'cat >>events.jsonl' --on-watch
expect_status 0
cp stdout.txt first.jsonl
run plate read 'synth:drive?frames=20&fps=10&size=960x540' --events --json --watch gate.csv --log plates.db --start 2026-05-02T12:00
python3 - <<'PY' || fail 'the events'
import json
lines = [json.loads(line) for line in open("events.jsonl")]
assert [line["state"] for line in lines] == ["opened", "closed"], lines
assert all(line["watch"] == {"label": "Ann", "entry": "2863SDN", "distance": 0.0} for line in lines), lines
first = json.loads(open("first.jsonl").readline())
assert first == lines[1], first
assert first["history"]["seen_before"] == 0 and first["history"]["first_time"] is None and first["history"]["dwell"] > 1, first
assert isinstance(first["direction"], list)
again = json.loads(open("stdout.txt").readline())["history"]
assert again["seen_before"] == 1 and again["first_time"].startswith("2026-05-01T12:00:0") and again["last_time"] > again["first_time"], again
PY
run plate watch remove gate.csv 2863SDN
expect_status 0
rm events.jsonl
run plate read 'synth:drive?frames=20&fps=10&size=960x540' --events --json --watch gate.csv --on-event 'cat >>events.jsonl' --on-watch
expect_status 0
expect_out '"watch":null'
[ ! -e events.jsonl ] || fail 'a command ran for a vehicle that nobody watches for'
run plate read 'synth:drive?frames=20&fps=10&size=960x540' --events --watch gate.csv --quiet
expect_status 0
expect_out '2863SDN 1.00'
run plate watch remove gate.csv 2863SDN
expect_status 1

# An image is an event as well.
run plate synth -o cars --count 1 --size 640x360 --quiet
plate=$(sed -n 's/.*,//;2p' cars/truth.csv)
run plate watch add gate.csv "$plate" --label 'the car'
run plate read cars/images --watch gate.csv --on-event 'cat >>events.jsonl' --on-watch -o none
expect_status 0
expect_out " watched: $plate the car\$"
grep -q '"watch":{"label":"the car"' events.jsonl || fail 'no event of an image'

# What is wrong on the line and in the file.
for arguments in 'add gate.csv B%' 'add gate.csv 1 --hours 8-9' 'add gate.csv 1 --days someday' 'add gate.csv 1 --tolerate 4' \
  'add gate.csv 1 --direction north' 'test gate.csv 12*' 'test gate.csv 1 --at noon' 'list'; do
  # shellcheck disable=SC2086
  run plate watch $arguments
  expect_status 2
  expect_error '.'
done
run plate watch list missing.csv
expect_status 3
expect_error 'missing.csv: no such file'
run plate watch add missing/gate.csv 1
expect_status 6
printf 'plate\n12%%\n' >broken.csv
cp broken.csv before.csv
run plate watch add broken.csv 1234BCD
expect_status 3
expect_error "broken.csv: line 2: plate '12%'"
cmp -s broken.csv before.csv || fail 'a broken list was changed'
run plate read 'synth:drive?frames=5' --watch broken.csv
expect_status 3
expect_error 'broken.csv: line 2'
run plate read 'synth:drive?frames=5' --on-watch --on-event true
expect_status 2
finish
