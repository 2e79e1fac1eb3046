#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The face detector that a user can install in addition to the shipped one, with weights written by hand: import, use,
# missing file, and errors. tests/data evaluates the real one.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
here=$TARSIER_SOURCE/tests/e2e
run pose synth -o heads --count 2 --people 2 --size 320x240 --yaw 6 --pitch 4 --roll 4 --spread 1 --near 450 --far 500 --quiet
expect_status 0
run doctor --json
expect_out 'scripts/get-model.sh face-detector'
run models list
expect_out 'face-anchors +not installed'
run landmarks fit heads/images/0000.png --json
expect_status 0
sed 's/"ms":[0-9.]*//' stdout.txt >before.json

# Known weights only, unless others are asked for; damaged ones.
python3 "$here/tiny_face_detector.py" tiny
cp -r tiny named && mv named/tiny-weights_manifest.json named/tiny_face_detector_model-weights_manifest.json
run models import named/tiny_face_detector_model-weights_manifest.json
expect_status 5
expect_error 'SHA-256 is [0-9a-f]{64}, not 5d1af484'
cp -r tiny cut && truncate -s -4 cut/tiny.bin
run models import cut/tiny-weights_manifest.json --any-weights
expect_status 5
expect_error "its shards end within 'conv8/bias'"
[ ! -e data-home ] || fail "something was installed by a refused import"

run models import tiny/tiny-weights_manifest.json --any-weights --json
expect_status 0
expect_out '"type":"face-anchors"' 'data-home/tarsier/models/face-anchors.json'
run doctor --json
expect_out 'data-home/tarsier/models/face-anchors.json'
run models list
expect_out 'face-anchors +face-anchors'

# It is used, with any number of threads; `own` goes without.
run landmarks fit heads/images/0000.png --json
expect_status 0
sed 's/"ms":[0-9.]*//' stdout.txt >with.json
run landmarks fit heads/images/0000.png --json --threads 1
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) with.json >/dev/null || fail "threads change the answer"
run landmarks fit heads/images/0000.png --json --face-detector own
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) before.json >/dev/null || fail "--face-detector own is not what it was"
run people enroll Ann heads/images/0000.png --any-quality --template classic
expect_status 0

# Damaged: said so.
truncate -s 300 data-home/tarsier/models/face-anchors.json
run landmarks fit heads/images/0000.png
expect_status 5
expect_error 'face-anchors.json'
run landmarks fit heads/images/0000.png --face-detector own
expect_status 0

# The script that fetches it.
get=$TARSIER_SOURCE/scripts/get-model.sh
export TARSIER
mkdir -p package/model
printf '[]' >package/model/tiny_face_detector_model-weights_manifest.json
printf 'x' >package/model/tiny_face_detector_model.bin
tar -czf package.tgz package
"$get" face-detector --from package.tgz 2>stderr.txt
{ [ $? -eq 5 ] && grep -q 'SHA-256' stderr.txt; } || fail "get-model.sh with other weights: $(cat stderr.txt)"
finish
