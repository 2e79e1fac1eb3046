#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A user's own networks: --embedding and --detector-model with tiny untrained ONNX files. Calibration, galleries that
# record their network, licence and SHA-256, and refused files. Accuracy is not tested.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
[ -f "$(dirname "$TARSIER")/tarsier-onnx.so" ] || skip "needs OpenCV's dnn (tarsier-onnx.so is not built)"
onnx=$TARSIER_SOURCE/tests/e2e/tiny_onnx.py
python3 "$onnx" embedding face.onnx
python3 "$onnx" embedding other.onnx 2
run pose synth -o heads --count 24 --people 12 --size 320x240 --yaw 6 --pitch 4 --roll 4 --spread 1 --near 450 --far 500 --quiet
expect_status 0
for i in $(seq 0 11); do printf 'heads/images/%04d.png\tperson %d\n' "$i" "$i"; done >once.lst

# Without a background it is not calibrated: said, before anything is written.
run people enroll Ann heads/images/0000.png --any-quality --embedding face.onnx
expect_status 5
grep -q 'face.onnx: is not calibrated, no background is given: train a background with .people train --learn-background LIST --embedding FILE' stderr.txt || fail "no word of calibration: $err"
[ ! -e people.db ] || fail "a gallery was made with a network that is not calibrated"
run people enroll Ann heads/images/0000.png --embedding face.onnx --template classic
expect_status 2
expect_error 'embedding or --template classic, not both'

# SHA-256 and licence are told: unknown, or what the text beside the file says.
sum=$(sha256sum face.onnx | cut -d' ' -f1)
run people train --learn-background once.lst --embedding face.onnx -o face.people.json
expect_status 0
grep -q "face.onnx: SHA-256 $sum, licence unknown: ask who gave it" stderr.txt || fail "SHA-256 and licence are not told: $err"
run models info face.onnx --json
expect_status 0
expect_out "\"sha256\":\"$sum\"" '"licence":"unknown: ask who gave it"' '"inputs":"data 1x3x112x112"' '"outputs":"numbers 1x32"' '"layers":4'
run doctor --json
expect_out 'tarsier-onnx.so'

# The file beside the network (face.people.json) is its background. The same faces are known again, for any number of threads.
own=(--embedding face.onnx)
for person in 0 1 2; do
  run people enroll "person $person" heads/images/000$person.png --any-quality "${own[@]}" --json
  expect_status 0
done
run people identify heads/images/0001.png --json "${own[@]}"
expect_out '"label":"person 1"' '"confidence"'
cp stdout.txt first.json
run people identify heads/images/0001.png --json "${own[@]}" --threads 1
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) <(sed 's/"ms":[0-9.]*//' first.json) >/dev/null || fail "threads change the answer"
run people verify "person 1" heads/images/0001.png "${own[@]}" --far 0.5
[ "$status" -le 1 ] || fail "verify: $err"
run people train "${own[@]}" -o model.json --json
expect_status 0
expect_out '"algorithm":"deep"' '"calibrated":true'
run people identify heads/images/0001.png --model model.json --json "${own[@]}"
expect_out '"label":"person 1"'
run people eval once.lst -k 1 --seeds 1 "${own[@]}"
[ "$status" -le 3 ] || fail "eval: $err"

# A gallery knows its network, by the SHA-256 of the file: the same file under another name is the same.
cp face.onnx renamed.onnx
run people identify heads/images/0001.png --json --embedding renamed.onnx --background face.people.json
expect_out '"label":"person 1"'
run people identify heads/images/0001.png
expect_status 3
expect_error "people.db: its templates were computed with face.onnx .SHA-256 ${sum:0:12}..., which is not given: pass that file with --embedding"
run people train --learn-background once.lst --embedding other.onnx -o other.people.json --quiet
expect_status 0
run people identify heads/images/0001.png --embedding other.onnx --quiet
expect_status 3
grep -q 'its templates are of face.onnx (SHA-256 .*), not of other.onnx' stderr.txt || fail "another network: $err"
run people identify heads/images/0001.png --embedding other.onnx --background face.people.json --quiet
[ "$status" -eq 3 ] || fail "another network and a background of the first: $status"
run people identify heads/images/0001.png --model model.json --embedding other.onnx --quiet
expect_status 5
grep -q 'model.json: was trained with another network than other.onnx' stderr.txt || fail "model of another network: $err"
run people train --embedding other.onnx --json
expect_status 0
run people identify heads/images/0001.png --json --embedding other.onnx
expect_out '"label":"person 1"'
run people train --template classic --json
expect_status 0
expect_out '"algorithm":"default"'
run people identify heads/images/0001.png --json "${own[@]}"
expect_status 3
grep -q 'its templates are classic, not of face.onnx' stderr.txt || fail "classic templates: $err"
run people train "${own[@]}" --json
expect_status 0
run people identify heads/images/0001.png --json "${own[@]}"
diff <(sed 's/"ms":[0-9.]*//' stdout.txt) <(sed 's/"ms":[0-9.]*//' first.json) >/dev/null || fail "templates that were made again answer otherwise"
run people forget "person 1" --yes --json
expect_status 0
expect_out '"proven":true'

# How it takes its image is part of what it is: the background is of another network then.
printf 'licence: MIT\nmean: 127.5\nscale: 0.0078125\n' >face.onnx.txt
run people identify heads/images/0001.png "${own[@]}"
expect_status 5
grep -q 'face.people.json: is of another network than face.onnx' stderr.txt || fail "other means: $err"
run models info face.onnx
expect_out 'licence MIT'
printf 'meen: 3\n' >face.onnx.txt
run people identify heads/images/0001.png "${own[@]}"
expect_status 5
expect_error "face.onnx.txt: line 1: unknown word 'meen'"
rm face.onnx.txt

# A detector of one's own, in place of ours: it sees one face where it was told to, whatever the image shows.
read -r -a points < <(python3 - <<'END'
import json
truth = json.loads(open("heads/truth.jsonl").readline())["points"]
mean = lambda *which: [sum(truth[i][k] for i in which) / len(which) for k in (0, 1)]
five = mean(36, 39) + mean(42, 45) + truth[30] + truth[48] + truth[54]
print(*(round(0.4 * value, 2) for value in five))
END
)
python3 "$onnx" detector finder.onnx 128 96 "${points[@]}"
run people show --stages heads/images/0000.png -o stages.png --detector-model finder.onnx --quiet
expect_status 0
run people identify heads/images/0000.png --json --detector-model finder.onnx --gallery nobody.db
[ "$status" -eq 3 ] || [ "$(grep -c '"box"' stdout.txt)" -eq 1 ] || fail "the detector finds no face: $out $err"
run people identify heads/images/0000.png --detector-model face.onnx
expect_status 5
grep -q 'not of the YuNet family' stderr.txt || fail "an embedding as detector: $err"
run people identify heads/images/0000.png --embedding finder.onnx
expect_status 5

# Hostile files: one line, exit status 5, nothing more.
python3 "$onnx" hostile hostile
run people identify heads/images/0000.png --embedding gone.onnx
expect_status 5
expect_error 'gone.onnx: cannot be read'
run people identify heads/images/0000.png --embedding heads
expect_status 5
expect_error 'heads: is a folder'
for file in hostile/*.onnx; do
  for flag in --embedding --detector-model; do
    run people identify heads/images/0000.png "$flag" "$file" --quiet
    expect_status 5
    expect_error "$file: "
  done
done
truncate -s 600M hostile/large.onnx
run models info hostile/large.onnx
expect_status 5
expect_error 'larger than 536870912 bytes'
finish
