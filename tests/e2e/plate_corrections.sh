#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Corrected texts of a log: stored beside the reading, searchable by both, undone, exported for train-reader.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip 'no python3'
umask 077

run plate synth -o cars --count 4 --size 640x360 --seed 3 --quiet
run plate read cars/images --log plates.db -o none --quiet
expect_status 0
run plate log plates.db --json
expect_out '"correction":null'
python3 - >ids.txt <<'PY'
import csv, json
truth = {row["image"]: row["text"] for row in csv.DictReader(open("cars/truth.csv"))}
for line in open("stdout.txt"):
    entry = json.loads(line)
    text = truth[entry["source"].split("/")[-1]]
    if abs(len(text) - len(entry["text"])) <= 1:
        print(entry["id"], text, entry["text"])
PY
read -r id right first <ids.txt || fail 'no plate was read'

run plate log plates.db --correct "$id" zz99yyx --author 'Ann B.' --json
expect_status 0
expect_out "^\{\"id\":$id,\"text\":\"$first\".*\"correction\":\{\"text\":\"ZZ99YYX\",\"author\":\"Ann B.\",\"time\":\"20"
run plate log plates.db --correct "$id" "$right"
expect_status 0
expect_out "  $first .*  corrected: $right \(.+\)$"
run plate log plates.db --text "$right" --json
expect_out "\"id\":$id,"
run plate log plates.db --text '*99YY*'
expect_status 1
run plate log plates.db --undo-correction "$id" --json
expect_out '"correction":\{"text":"ZZ99YYX","author":"Ann B."'
run plate log plates.db --text '*99YY*' --json
expect_status 0
expect_out "\"id\":$id,\"text\":\"$first\""
[ "$(wc -l <stdout.txt)" -eq 1 ] || fail 'an entry was found twice'
run plate log plates.db --csv -
expect_out ',ZZ99YYX,Ann B.,20..-.*Z$'
run plate log plates.db --undo-correction "$id" --json
expect_out '"correction":null'
run plate log plates.db --undo-correction "$id"
expect_status 1
run plate log plates.db --corrections none --quiet
expect_status 1

while read -r entry text _; do
  run plate log plates.db --correct "$entry" "$text" --quiet
  expect_status 0
done <ids.txt
run plate log plates.db --corrections corrected --json
expect_status 0
[ "$(find corrected -name '*.jpg' | wc -l)" -eq "$(wc -l <ids.txt)" ] || fail "written: $(ls corrected) of $(cat ids.txt)"
expect_out "\"image\":\"0*${id}_log-$right.jpg\",\"text\":\"$right\",\"read\":\"$first\""
python3 - <<'PY' || fail 'the labels'
import glob
alphabet = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
for path in glob.glob("corrected/*.txt"):
    rows = [line.split() for line in open(path)]
    assert "".join(alphabet[int(row[0])] for row in rows) == path[:-4].rsplit("-", 1)[1], path
    middles = [float(row[1]) for row in rows]
    assert middles == sorted(middles) and 0 < middles[0] and middles[-1] < 1, (path, middles)
PY
# What was written is what train-reader takes; --from goes on from the reader that ships.
run plate train-reader corrected --scenes cars --from plate-reader --steps 2 --calibration 0 -o mine.json --quiet
expect_status 0
run plate read cars/images --reader mine.json -o none --quiet
expect_status 0
# All in one: characters, then the confidence and the judgement of what is found.
run plate train-reader corrected --scenes cars --found cars --from plate-reader --steps 2 --calibration 0 -o whole.json
expect_status 0
grep -q 'detections in 4 images, [1-9]' stderr.txt || fail "$command_line: $err"
python3 - <<'PY' || fail 'whole.json has not what it should'
import json
mine, whole = (json.load(open(name)) for name in ("mine.json", "whole.json"))
assert whole["payload"]["line"] == mine["payload"]["line"], "--found changed the characters"
assert whole["payload"]["judge"] != mine["payload"]["judge"], "--found fitted nothing"
assert whole["provenance"]["found"] and whole["provenance"]["inputs"], whole["provenance"]
PY
# What is a plate is fitted to whole images; the characters stay as they were, and what they were learnt from.
run plate train-reader cars --from plate-reader --confidence-only --calibration 0 -o judged.json
expect_status 0
grep -q 'detections in 4 images, [1-9]' stderr.txt || fail "$command_line: $err"
python3 - <<'PY' || fail 'judged.json has not what it should'
import json
judged = json.load(open("judged.json"))
assert judged["provenance"]["confidence"]["found"], judged["provenance"]
assert "plates-uc3m" in judged["provenance"]["terms"], judged["provenance"]
PY
run plate read cars/images --reader judged.json -o none --quiet
expect_status 0
run plate train-reader nowhere --from plate-reader --confidence-only --calibration 0 -o judged.json
expect_status 3
expect_error 'nowhere'
run plate train-reader corrected --scenes cars --from missing.json --steps 2 -o mine.json
expect_status 5
expect_error 'missing.json'

for arguments in "--correct $id" "--correct x 1234BCD" "--correct $id 12*" "--correct $id %" '--undo-correction 0' "--correct $id 1 --text 2" \
  "--author Ann" "--correct $id 1 --undo-correction 1" '--keep 1d --corrections x' '--reader x'; do
  # shellcheck disable=SC2086
  run plate log plates.db $arguments
  expect_status 2
  expect_error '.'
done
run plate log plates.db --correct 999 1234BCD
expect_status 3
expect_error 'plates.db: has no entry 999'
finish
