#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Unknown people: grouping, naming; corrections and their log; refused, locked, full-disk and killed runs.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
python3 -c 'import sqlite3' || skip "needs python3"

# Three drawn heads, each in three images.
run pose synth -o heads --count 3 --seed 1 --size 320x240 --near 450 --far 500 --quiet
expect_status 0
mkdir seen
for head in 0 1 2; do
  for copy in a b c; do cp "heads/images/000$head.png" "seen/$head$copy.png"; done
done
first=seen/0a.png second=seen/1a.png third=seen/2a.png

# Nobody is enrolled: all are unknown, and remembered with their faces.
run people identify seen --keep 30d --json
expect_status 1
[ "$(stat -c %a people.db)" = 600 ] || fail "the gallery can be read by others: $(stat -c %a people.db)"
run people list --sightings --json
expect_status 0
[ "$(grep -c '"face":true,"group":null' stdout.txt)" -eq 9 ] || fail "nine faces expected: $out"
run people groups
expect_status 1
grep -q '9 unknown faces are in no group yet' stderr.txt || fail "nothing said of faces that wait: $err"

# In groups: at once, and one image at a time in another gallery and with one thread.
run people group people.db --json
expect_status 0
expect_out '"placed":9,"new":3,"merged":0,"groups":3,"threshold":0\.'
run people group --json
expect_out '"placed":0,"new":0,"merged":0,"groups":3'
run people groups --json --draw groups.png
expect_status 0
[ "$(grep -c '"sightings":3' stdout.txt)" -eq 3 ] || fail "three groups of three expected: $out"
[ -s groups.png ] || fail "no sheet"
run people list --sightings --json
python3 -c 'import json, sys; print([[json.loads(l)[k] for k in ("id", "group")] for l in open("stdout.txt")])' >at-once.txt
for image in seen/*; do
  run people identify "$image" --keep 30d --gallery slow.db --quiet
  run people group slow.db --threads 1 --quiet
  expect_status 0
done
run people list --sightings --json --gallery slow.db
python3 -c 'import json, sys; print([[json.loads(l)[k] for k in ("id", "group")] for l in open("stdout.txt")])' >one-by-one.txt
cmp -s at-once.txt one-by-one.txt || fail "batches change groups: $(cat at-once.txt one-by-one.txt)"
run people groups --group 1 --json
expect_status 0
expect_out '"id":1,"group":1,"time":'
run people groups --group 1 --draw group-1.png --json
expect_status 0
expect_out '"box":\[0,0,128,160\]' '"box":\[256,0,128,160\]'
[ "$(python3 -c 'import struct; print(*struct.unpack(">II", open("group-1.png", "rb").read(24)[16:]))')" = "384 184" ] ||
  fail "three faces with their numbers expected"

# One is named, with markup in the name, and known from then on.
name='<b>O'"'"'Brien</b> & "日本" %s'
run people name 1 "$name" --note "agreed" --json
expect_status 0
expect_out '"correction":1,"name":"<b>O' '"faces":3'
run people identify "$first" --json
expect_status 0
expect_out '"label":"<b>O.*"known":true'
run people list --sightings --json
[ "$(grep -c '"label":"<b>O.*"known":true' stdout.txt)" -eq 3 ] || fail "its sightings have no name: $out"
run people name 2 Ben --quiet
expect_status 0
run people groups --json
[ "$(wc -l <stdout.txt)" -eq 1 ] || fail "named groups are listed: $out"

# Wrong: not this person. The next answer respects it; undone, it is as before.
run people identify "$second" --keep 30d --json
expect_out '"label":"Ben".*"known":true'
sighting=$("$TARSIER" people list --sightings --limit 1 --json | python3 -c 'import json, sys; print(json.loads(sys.stdin.readline())["id"])')
run people correct not --sighting "$sighting" --json
expect_status 0
expect_out '"what":"not","from":"Ben","to":null,"count":2,"undone":null'
run people identify "$second" --json
expect_status 1
grep -q '"label":"Ben"' stdout.txt && fail "still named so: $out"
run people verify Ben "$second"
expect_status 1
expect_out 'is not Ben .a correction excludes it'
run people correct not --sighting "$sighting"
expect_status 3
expect_error "sighting $sighting has no name"
run people correct undo
expect_status 0
run people identify "$second" --json
expect_status 0
expect_out '"label":"Ben".*"known":true'

# An enrolled face that is not the person's; faces that are another's; two names of one person; a person who is two.
run people list --faces Ben --json --draw ben.png
expect_status 0
expect_out '"box":\[128,0,128,160\]'
[ -s ben.png ] || fail "no faces were drawn"
run people list --draw ben.png
expect_status 2
run people list --faces Ben --json
face=$(python3 -c 'import json; print(json.loads(open("stdout.txt").readline())["face"])')
run people correct not --face "$face"
expect_status 0
expect_out 'not Ben'
run people list --json
expect_out '"name":"Ben","faces":2'
run people identify "$second" --json
expect_status 1
run people correct undo --quiet
expect_status 0
run people correct move "$name" --face "$face"
expect_status 0
run people list --json
expect_out '"name":"Ben","faces":2' '"faces":4'
run people correct split Ben Zoe --face "$((face + 1))" --json
expect_status 0
expect_out '"what":"split","from":"Ben","to":"Zoe","count":1'
run people correct merge Zoe Ben
expect_status 0
run people list --json
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "two people expected: $out"
run people correct undo 8
expect_status 3
expect_error 'later changed the same entries: undo it first'
for _ in 1 2 3; do
  run people correct undo --quiet
  expect_status 0
done
run people list --json
expect_out '"name":"Ben","faces":3'
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "undone, two people expected: $out"
run people log --json
expect_status 0
expect_out '"who":"' '"what":"undo"' '"undoes":'
run people log --limit 2
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "two lines of the log expected: $out"

# Groups: one is split, which stays so, and merged again.
run people identify "$third" seen/2b.png --keep 30d --far 0.000001 --quiet
run people group --quiet
ids=$("$TARSIER" people groups --group 3 --json | python3 -c 'import json, sys; print(*[json.loads(l)["id"] for l in sys.stdin][:2])')
run people correct split --group 3 --sighting "${ids% *}" --sighting "${ids#* }" --json
expect_status 0
expect_out '"what":"split group","from":"group 3","to":"group 4","count":2'
run people identify "$third" --keep 30d --far 0.000001 --quiet
run people group --json
expect_out '"groups":2'
run people correct merge 4 3 --groups
expect_status 0
run people groups --json
[ "$(wc -l <stdout.txt)" -eq 1 ] || fail "one group expected: $out"

# A running program sees a correction at its next frame.
mkdir frames
cp "$second" frames/0000.png
python3 -c "import os; [os.link('frames/0000.png', f'frames/{k:04d}.png') for k in range(1, 3000)]"
"$TARSIER" people identify frames --sequence --json -o none >running.jsonl 2>running.err </dev/null &
running=$!
until_running() { # until_running PATTERN: the running program wrote such a line, or has ended
  while kill -0 $running 2>/dev/null; do
    tail -n 2 running.jsonl | grep -q "$1" && return 0
    sleep 0.05
  done
  fail "no $1 of the running program: $(tail -n 1 running.jsonl) $(cat running.err)"
}
until_running '"label":"Ben"'
run people correct merge Ben "$name" --quiet
expect_status 0
until_running '"label":"<b>O'
run people correct undo --quiet
expect_status 0
until_running '"label":"Ben"'
kill -INT $running 2>/dev/null
wait $running 2>/dev/null
rm -r frames

# What is not there, and what cannot be.
run people name 99 Zoe
expect_status 3
expect_error 'people.db' 'no group 99' 'people groups'
run people name 0 Zoe
expect_status 2
run people name 3 $'a\nb'
expect_status 2
expect_error 'control character'
run people correct not --face 999
expect_status 3
expect_error 'no face 999'
run people correct not
expect_status 2
expect_error 'give either --face ID or --sighting ID'
run people correct not --face 1 --sighting 1
expect_status 2
run people correct move Zoe --face 999
expect_status 3
run people correct merge nobody $'a\nb'
expect_status 3
expect_error "nobody is enrolled as 'nobody'"
run people correct merge $'a\nb' nobody
expect_status 3
expect_error 'nobody is enrolled'
run people correct merge x 3 --groups
expect_status 2
expect_error "'x' is not a group number"
run people correct split Ben Zoe
expect_status 2
run people correct split --group 3 --sighting 9999
expect_status 3
run people correct undo 999
expect_status 3
expect_error 'no correction 999'
run people correct undo 99999999999999999999
expect_status 2
run people groups --group 77
expect_status 3
run people forget --group 77 --yes
expect_status 1
run people forget --yes
expect_status 2
run people group none.db
expect_status 3
run people group --false-merges 7
expect_status 2
noise 3000 >noise.db
run people correct undo --gallery noise.db
expect_status 3
expect_error 'noise.db'

# Strangers are forgotten too, with proof.
rm slow.db*
run people forget --group 3 --yes --json
expect_status 0
expect_out '"name":"group 3","faces":0,"sightings":6' '"proven":'
run people groups
expect_status 1
run people forget "$name" --yes --json
[ "$status" -eq 0 ] || [ "$status" -eq 6 ] || fail "forget: $status, $err"
run people log --json
grep -q 'Brien' stdout.txt && fail "the log names who was forgotten: $out"

# In use by another program: said, nothing is changed, and it works afterwards.
before=$("$TARSIER" people log --json | wc -l)
python3 - >locked.txt 2>&1 <<'END' &
import sqlite3, time
d = sqlite3.connect("people.db", isolation_level=None)
d.execute("BEGIN EXCLUSIVE")
open("locked.flag", "w").close()
time.sleep(1800)  # until it is killed below
END
locker=$!
for _ in $(seq 6000); do [ -e locked.flag ] && break; sleep 0.05; done
run people correct move Zoe --face "$face"
expect_status 6
expect_error 'locked by another program'
kill $locker 2>/dev/null
wait $locker 2>/dev/null
[ "$("$TARSIER" people log --json | wc -l)" -eq "$before" ] || fail "a locked gallery was changed"

# A full disk: said in one line, and nothing is lost.
(
  ulimit -f 1
  trap '' XFSZ
  "$TARSIER" people correct move Zoe --face "$face" >full.txt 2>&1 </dev/null
  echo $? >full.status
) 2>/dev/null
[ "$(cat full.status)" -ne 0 ] || fail "no room, and no error: $(cat full.txt)"
run people list --json
expect_status 0
expect_out '"name":"Ben","faces":3'

# Killed at any moment, the gallery has all of a correction or nothing, and the log says which.
for k in $(seq 10); do
  "$TARSIER" people correct move Zoe --face "$face" --quiet >/dev/null 2>&1 </dev/null &
  victim=$!
  sleep "0.0$((k % 5))"
  kill -KILL $victim 2>/dev/null
  wait $victim 2>/dev/null
  moved=$("$TARSIER" people list --json | grep -c '"name":"Zoe"')
  holds=$("$TARSIER" people log --limit 1 --json | grep -c '"what":"move".*"undone":null')
  [ "$moved" -eq "$holds" ] || fail "round $k: moved $moved, the log says $holds"
  [ "$holds" -eq 0 ] || run people correct undo --quiet
done
finish
