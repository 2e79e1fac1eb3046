#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Deep templates with an untrained network: import, install, enrol, identify, verify, change of templates, export,
# forgetting, and errors. Accuracy is not tested here; tests/data evaluates the real network.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
python3 -c 'import sqlite3' || skip "needs python3"
here=$TARSIER_SOURCE/tests/e2e

# Without the network all is classic, and what asks for it says how to get it, before anything is written.
run pose synth -o heads --count 24 --people 12 --size 320x240 --yaw 6 --pitch 4 --roll 4 --spread 1 --near 450 --far 500 --quiet
expect_status 0
for i in $(seq 0 23); do printf 'heads/images/%04d.png\tperson %d\n' "$i" $((i % 12)); done >faces.lst
head -12 faces.lst >once.lst
run people enroll Ann heads/images/0000.png --any-quality --template deep
expect_status 5
expect_error 'face-embedding.json: is not installed: install it with scripts/get-model.sh face-embedding'
[ ! -e people.db ] || fail "a gallery was made although the network is missing"
run people eval faces.lst -k 1 --seeds 1 --template deep
expect_status 5
expect_error 'get-model.sh face-embedding'
run people enroll Ann heads/images/0000.png --any-quality --template shallow
expect_status 2
expect_error "unknown template 'shallow': auto, classic or deep"
run doctor --json
expect_out 'scripts/get-model.sh face-embedding'

# Import: known weights only, unless others are asked for; a shard that is cut off, a manifest that points elsewhere.
python3 "$here/tiny_face_network.py" tiny
run models import tiny/tiny-weights_manifest.json
expect_status 5
expect_error 'not a known file of the face network'
cp -r tiny named && mv named/tiny-weights_manifest.json named/face_recognition_model-weights_manifest.json
run models import named/face_recognition_model-weights_manifest.json
expect_status 5
expect_error 'SHA-256 is [0-9a-f]{64}, not cbaffa50'
cp -r tiny cut && truncate -s -1 cut/tiny.bin
run models import cut/tiny-weights_manifest.json --any-weights
expect_status 5
expect_error "its shards end within 'fc'"
mkdir elsewhere && sed 's|"tiny.bin"|"../tiny/tiny.bin"|' tiny/tiny-weights_manifest.json >elsewhere/tiny-weights_manifest.json
run models import elsewhere/tiny-weights_manifest.json --any-weights
expect_status 5
expect_error 'not a file name'
[ ! -e data-home ] || fail "something was installed by a refused import"
run models import gone.json --any-weights
expect_status 3
expect_error 'gone.json'

# Installed where the user's models are: found, though the folder of the program has none.
run models import tiny/tiny-weights_manifest.json --any-weights --json
expect_status 0
expect_out '"numbers":128' 'data-home/tarsier/models/face-embedding.json'
run doctor --json
expect_out 'data-home/tarsier/models/face-embedding.json'
run models list
expect_status 0
expect_out 'face-embedding +face-embedding'

# The background that ships is of the real network.
run people eval faces.lst -k 1 --seeds 1 --template deep
expect_status 5
expect_error 'people-deep.json: is of another network'
run people train --learn-background once.lst --template deep -o own.json
expect_status 0
deep=(--background own.json)
run people enroll Zoe heads/images/0001.png --any-quality "${deep[@]}" --gallery none.db --background none
expect_status 2

# A new gallery gets deep templates where they are installed; the same faces are known again.
for person in 0 1 2; do
  run people enroll "person $person" heads/images/000$person.png --any-quality "${deep[@]}" --json
  expect_status 0
done
kind() { python3 - "$1" <<'END'
import sqlite3, sys
print(dict(sqlite3.connect(sys.argv[1]).execute("SELECT name, value FROM setting")).get("algorithm", "default"))
END
}
[ "$(kind people.db)" = deep ] || fail "the gallery is $(kind people.db)"
run people identify heads/images/0001.png --json "${deep[@]}"
expect_out '"label":"person 1"' '"confidence"'
cp stdout.txt first.json
run people identify heads/images/0001.png --json "${deep[@]}" --threads 1
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) <(sed 's/"ms":[0-9.]*//' first.json) >/dev/null || fail "threads change the answer"
run people verify "person 1" heads/images/0001.png "${deep[@]}" --far 0.5
[ "$status" -le 1 ] || fail "verify: $err"
run people train "${deep[@]}" --json
expect_status 0
expect_out '"algorithm":"deep"'
run people train "${deep[@]}" -o model.json --quiet
expect_status 0
run people identify heads/images/0001.png --model model.json --json
expect_out '"label":"person 1"'

# One gallery keeps one kind, until it is asked to change; then the templates are made again from the crops.
run people enroll "person 3" heads/images/0003.png --any-quality --template classic
expect_status 3
expect_error 'its templates are deep, and one gallery keeps one kind: recompute them with .people train --template classic'
run people identify heads/images/0001.png --template classic
expect_status 3
expect_error 'its templates are deep'
run people train --template classic --json
expect_status 0
expect_out '"algorithm":"default"'
run people identify heads/images/0001.png --json
expect_out '"label":"person 1"'
run people enroll "person 3" heads/images/0003.png --any-quality --template deep "${deep[@]}"
expect_status 3
expect_error 'its templates are classic'
run people train --template deep "${deep[@]}" --json
expect_status 0
expect_out '"algorithm":"deep"'
run people identify heads/images/0001.png --json "${deep[@]}"
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) <(sed 's/"ms":[0-9.]*//' first.json) >/dev/null ||
  fail "templates that were made again answer otherwise"

# Export and forgetting are what they are with classic templates.
run people export -o all
expect_status 0
[ "$(wc -l <all/faces.lst)" -eq 3 ] || fail "export: $(wc -l <all/faces.lst) faces"
rm -r all
run people forget "person 1" --yes --json
expect_status 0
expect_out '"proven":true'
run people identify heads/images/0001.png --json "${deep[@]}"
grep -q '"label":"person 1"' stdout.txt && fail "who was forgotten is still named"

# The network gone, or another: said so, not guessed.
mv data-home/tarsier/models/face-embedding.json kept.json
run people identify heads/images/0001.png
expect_status 5
expect_error 'get-model.sh face-embedding'
python3 "$here/tiny_face_network.py" other 2
run models import other/tiny-weights_manifest.json --any-weights --quiet
run people identify heads/images/0001.png "${deep[@]}"
expect_status 5
expect_error 'own.json: is of another network'
head -c 20000 kept.json >data-home/tarsier/models/face-embedding.json
run people identify heads/images/0001.png "${deep[@]}"
expect_status 5
expect_error 'face-embedding.json'

# The script that fetches it: from a package at hand; without the network, or with other bytes, it says so.
get=$TARSIER_SOURCE/scripts/get-model.sh
export TARSIER
"$get" >/dev/null 2>&1
[ $? -eq 2 ] || fail "get-model.sh without a name"
"$get" nothing 2>stderr.txt
{ [ $? -eq 2 ] && grep -q 'face-embedding' stderr.txt; } || fail "get-model.sh nothing"
mkdir -p package/model
printf '[]' >package/model/face_recognition_model-weights_manifest.json
printf 'x' >package/model/face_recognition_model.bin
tar -czf package.tgz package
"$get" face-embedding --from package.tgz 2>stderr.txt
{ [ $? -eq 5 ] && grep -q 'SHA-256' stderr.txt; } || fail "get-model.sh with other weights: $(cat stderr.txt)"
"$get" face-embedding --from tiny/tiny.bin 2>stderr.txt
{ [ $? -eq 5 ] && grep -q 'is no package' stderr.txt; } || fail "get-model.sh with something else: $(cat stderr.txt)"
"$get" face-embedding --from gone.tgz 2>stderr.txt
{ [ $? -eq 3 ] && grep -q 'no such file' stderr.txt; } || fail "get-model.sh --from gone.tgz"
mkdir bin
for tool in bash sed tail dirname mktemp rm curl grep cat; do
  found=$(command -v "$tool") && ln -s "$found" bin/
done
PATH=$WORK/bin NPM_CONFIG_REGISTRY=http://127.0.0.1:9 "$get" face-embedding 2>stderr.txt >stdout.txt
{ [ $? -eq 3 ] && grep -q 'with the package at hand' stderr.txt; } || fail "get-model.sh without npm and network: $(cat stderr.txt)"
finish
