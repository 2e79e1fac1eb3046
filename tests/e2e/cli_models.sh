#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# models list, info and verify: without models, with valid ones, and with a folder that was tampered with.
. "$(dirname "$0")/lib.sh"

mkdir empty
for verb in list verify; do
  run models $verb --models-dir empty
  expect_status 0
  expect_out 'No models'
  expect_no_err
  run models $verb --models-dir empty --json
  expect_status 0
  expect_no_out
done
run models list --models-dir missing
expect_status 5
expect_error 'missing'
run models info anything --models-dir empty
expect_status 5
expect_error 'anything' 'no such model'

mkdir good
cat >good/reader.json <<'JSON'
{"type": "plate-reader", "version": 1, "provenance": {"data": "drawn", "terms": "MIT"}, "payload": {"weights": [1, 2]}}
JSON
printf '# A card\n\nMade for the test.\n\n| | |\n|---|---|\n| Used by | `plate read` |\n| Without it | `--reader FILE` |\n' >good/reader.md
(cd good && sha256sum reader.json reader.md >SHA256SUMS)

run models list --models-dir good
expect_status 0
expect_out 'reader +plate-reader +1 .*MIT' 'used by: plate read' 'without it: --reader FILE'
TARSIER_MODELS=good run models list --json
expect_status 0
python3 - <<'PY' || fail "models list --json"
import json
model = json.loads(open("stdout.txt").read())
assert model["name"] == "reader" and model["type"] == "plate-reader" and model["version"] == 1
assert model["problem"] is None and model["terms"] == "MIT"
PY
run models info reader --models-dir good
expect_status 0
expect_out 'plate-reader, version 1' 'as in the index' 'Made for the test' 'drawn'
run models info reader.json --models-dir good --json
expect_status 0
expect_out "\"sha256\":\"$(sha256sum <good/reader.json | cut -d' ' -f1)\""
cp good/reader.json elsewhere.json # no model of the folder
run models info elsewhere.json --models-dir good
expect_status 0
expect_out 'elsewhere: plate-reader, version 1' 'not in the index'
run models verify --models-dir good
expect_status 0
expect_out '^ok +reader$'
run models info raeder --models-dir good
expect_status 5
expect_error "did you mean 'reader'"

# One byte changed; a file gone; a file that nobody listed; not a model at all; nested without end.
cp -r good changed
sed -i 's/drawn/drown/' changed/reader.json
run models verify --models-dir changed
expect_status 5
expect_out 'PROBLEM +reader has changed'
run models verify reader --json --models-dir changed
expect_status 5
expect_out '"ok":false'

cp -r good gone
rm gone/reader.json
run models verify --models-dir gone
expect_status 5
expect_out 'PROBLEM +reader is in the index but missing'

cp -r good extra
cp good/reader.json extra/stranger.json
run models verify --models-dir extra
expect_status 5
expect_out '^ok +reader$' 'PROBLEM +stranger is not in SHA256SUMS'

mkdir broken
printf 'no json' >broken/text.json
: >broken/void.json
head -c 100000 /dev/zero | tr '\0' '[' >broken/nested.json
noise 5000 >broken/noise.json
run models list --models-dir broken
expect_status 5
for name in text void nested noise; do expect_out "^$name +unusable: "; done
run models info text --models-dir broken
expect_status 5
expect_error 'text.json'

cp -r good bad-index
printf 'nonsense\n' >>bad-index/SHA256SUMS
run models verify --models-dir bad-index
expect_status 5
expect_error 'SHA256SUMS' 'line 3'
printf '%064d  ../../etc/passwd\n' 0 >bad-index/SHA256SUMS
run models list --models-dir bad-index
expect_status 5
expect_error 'line 1'

# The models that ship: each states its terms, who uses it and how to do without, and the doctor names those whose
# terms are narrower than the program's.
run models list --json
expect_status 0
python3 - <<'PY' || fail "a model that ships lacks its terms, its users or the way to do without it"
import json
models = [json.loads(line) for line in open("stdout.txt")]
assert len(models) >= 10
for model in models:
    assert model["terms"] and model["card"] and model["used_by"] and model["without_it"], model["name"]
PY

# A model of one's own takes the place of the one that ships, for every verb, until it is removed.
shipped="$TARSIER_SOURCE/models"
python3 - "$shipped/head.json" <<'PY'
import json, sys
head = json.load(open(sys.argv[1]))
head["provenance"]["data"] = "drawn for the test"
json.dump(head, open("mine.json", "w"))
head["version"] = 99
json.dump(head, open("newer.json", "w"))
head["version"] = 1
del head["payload"]["mean"]
json.dump(head, open("cut.json", "w"))
json.dump({"type": "shape-model", "version": 1, "provenance": {}, "payload": {}}, open("stranger.json", "w"))
PY
sum=$(sha256sum <mine.json | cut -d' ' -f1)
run models install mine.json
expect_status 2
expect_error 'TARSIER_OWN_MODELS'
export TARSIER_OWN_MODELS=$PWD/own/models
run models install mine.json --json
expect_status 0
expect_out "\"sha256\":\"$sum\"" '"name":"head"' 'pose track'
cmp mine.json own/models/head.json || fail "the installed file is another one"
run models list --json
expect_status 0
python3 - "$sum" <<'PY' || fail "models list does not tell which models are the user's own"
import json, sys
models = {model["name"]: model for model in map(json.loads, open("stdout.txt"))}
assert models["head"]["own"] and models["head"]["sha256"] == sys.argv[1] and models["head"]["card"] is None
assert models["head"]["used_by"] and not models["landmarks68"]["own"]
PY
run models list
expect_out 'head .*your own'
run models info head
expect_out 'drawn for the test' 'as in the index'
run models verify head
expect_status 0
expect_out 'ok +head .your own.'
# Verbs take it: one that is damaged afterwards is what they stumble over.
printf '{}' >own/models/head.json
run pose solve --help
run models verify
expect_status 5
expect_out 'PROBLEM +head has changed'
run pose synth -o heads --count 1 --size 160x120
expect_status 5
expect_error 'own/models/head.json'
# What is refused leaves the one before in its place.
run models install mine.json
expect_status 0
for file in newer cut stranger; do
  run models install $file.json
  expect_status 5
  expect_error "$file.json"
done
run models install stranger.json --as head
expect_status 5
run models install mine.json --as landmarks68
expect_status 2
expect_error 'can replace only head'
run models install "$shipped/plate-hog.json"
expect_status 2
expect_error 'plate-hog, plate-mlp'
run models install "$shipped/plate-mlp.json" --as plate-hog
expect_status 0
cmp mine.json own/models/head.json || fail "a refused model changed the one before"
run models remove ../models/head
expect_status 2
run models remove head
expect_status 0
run models remove head
expect_status 1
run models verify head
expect_status 0
expect_out '^ok +head$'
unset TARSIER_OWN_MODELS

run doctor --json
expect_out 'non-commercial research only: aam68, .*landmarks68'
finish
