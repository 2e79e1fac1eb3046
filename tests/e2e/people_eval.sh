#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# people eval of the shipped models: with the background, at the requested rate, with counts and intervals.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"

# Faces that nobody has, in files of their own for each person.
run pose synth -o heads --count 24 --people 4 --size 320x240 --yaw 6 --pitch 4 --roll 4 --spread 1 --near 450 --far 500 --quiet
expect_status 0
for i in $(seq 0 23); do printf 'heads/images/%04d.png\tperson %d\n' "$i" $((i % 4)); done >faces.lst

eval_faces() { # eval_faces NAME WORDS..: its lines in NAME.json
  local name=$1
  shift
  run people eval faces.lst -k 2 --seeds 2 --json --quiet "$@"
  expect_status 0
  cp stdout.txt "$name.json"
}
eval_faces shipped --algorithm default,eigen
eval_faces none --algorithm default --background none
eval_faces named --algorithm default --background "$TARSIER_SOURCE/models/people-background.json"
eval_faces one --algorithm default --enrolled 1
python3 - <<'END' || fail "people eval: its figures"
import json
def lines(name): return [json.loads(line) for line in open(name + ".json")]
def figures(line): return {k: v for k, v in line.items() if k not in ("train_s", "identify_ms", "background")}
shipped, eigen = lines("shipped")
(none,), (named,), (one,) = lines("none"), lines("named"), lines("one")
assert shipped["background"].endswith("people-background.json"), shipped
assert none["background"] is None and eigen["background"] is None
assert figures(shipped) == figures(named), "the file that ships, and the same one named, differ"
assert figures(shipped) != figures(none), "without a background all is as with one"
for line in (shipped, none, one):
    for key in ("identified", "stated_true", "stated_right", "stated_false", "chosen_true", "chosen_right"):
        count = line[key]
        assert 0 <= count["hits"] <= count["trials"] and count["draws"] == 2, (key, count)
        assert 0 <= count["low"] <= count["rate"] <= count["high"] <= 1 and count["low"] < count["high"], (key, count)
        assert abs(count["rate"] - count["hits"] / count["trials"]) < 1e-4, (key, count)
found = 24 - shipped["not_found"]
assert shipped["identified"]["trials"] == 2 * (24 - 8), shipped["identified"]
trusted = found - shipped["uncertain"]  # uncertain faces do not train and are counted apart
assert shipped["stated_true"]["trials"] + shipped["stated_false"]["trials"] == 2 * (trusted - 4), shipped
if shipped["uncertain"] > 0: assert shipped["uncertain_identified"]["trials"] == 2 * shipped["uncertain"], shipped
assert shipped["stated_rate"] == 0.01 and shipped["enrolled"] == 2 and one["enrolled"] == 1
END
# One enrolled person and nothing known of faces in general: nobody can be told from strangers, and that is said.
eval_faces guess --algorithm default --enrolled 1 --background none
grep -q '"stated_false":null' guess.json || fail "a rate without a threshold: $(cat guess.json)"

run people eval faces.lst -k 2 --seeds 2 --algorithm default --quiet
expect_status 0
expect_out 'people-background.json' 'at the stated rate of 1 %' 'false accepts +[0-9.]+ % \([0-9]+ of [0-9]+; [0-9.]+ to [0-9.]+ %\)' \
  'chosen on these very scores'
run people eval faces.lst -k 2 --background gone.json
expect_status 5
expect_error 'gone.json'

# Faces that were cut in another way go without what was learnt from those that the program cuts, unless it is named.
for i in $(seq 0 23); do printf 'heads/images/%04d.png\tperson %d\n' "$i" $((i % 4)); done >raw.lst
run people eval raw.lst --raw --size 64x80 -k 2 --seeds 1 --algorithm default --json --quiet
expect_status 0
expect_out '"background":null'
run people eval raw.lst --raw --size 64x80 -k 2 --seeds 1 --algorithm default --json --quiet \
  --background "$TARSIER_SOURCE/models/people-background.json"
expect_status 0
expect_out '"background":".*people-background.json"'
run people eval raw.lst --raw --size 64x80 -k 2 --enrolled 4 --algorithm lbph
expect_status 3
expect_error 'leave no strangers'

# Some images are enrolled, others are asked for: no draws.
head -n 8 raw.lst >front.lst
tail -n 12 raw.lst >later.lst
run people eval later.lst --train-list front.lst --raw --size 64x80 --seeds 1 --algorithm lbph --json --quiet
expect_status 0
expect_out '"training":null,"training_images":8' '"trials":12'
run people eval later.lst --train-list front.lst --raw --size 64x80 --seeds 1 --algorithm lbph --quiet
expect_status 0
expect_out '12 faces of 4 people in later.lst, 8 more training images of front.lst'
grep -v 'person 2' front.lst >three.lst
run people eval later.lst --train-list three.lst --raw --size 64x80 --seeds 1 --algorithm lbph
expect_status 3
expect_error 'later.lst: person 2 has no face in three.lst'
run people eval later.lst --train-list front.lst -k 2 --raw
expect_status 2

# How much more alike strangers before one camera are: the constants of the program are fitted in this way.
run people eval faces.lst -k 2 --seeds 1 --fit-same-camera --json --quiet
expect_status 0
expect_out '"shift":-?[0-9.]+,"spread":[0-9.]+,"compiled_shift"' '"people":4' '"galleries":4'
run people eval faces.lst -k 2 --fit-same-camera --background none
expect_status 2
finish
