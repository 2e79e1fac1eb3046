#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The textbook pipeline: training from files and folders, the study of the reader, segmentation, invalid input.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

# Characters with a shape of their own, four of each of three classes and many of them.
python3 - <<'PY'
import os, random
random.seed(2)
def pgm(path, pixels, w, h):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    open(path, 'wb').write(b'P5\n%d %d\n255\n' % (w, h) + bytes(pixels))
for k in range(50):
    for name, shape in (('1', lambda x, y: 8 <= x <= 11), ('L', lambda x, y: x < 5 or y > 15), ('T', lambda x, y: y < 5 or 8 <= x <= 11)):
        dx, dy = random.randint(-1, 1), random.randint(-1, 1)
        pgm('chars/%s/%02d.pgm' % (name, k), [230 if shape(x + dx, y + dy) and random.random() > .05 else random.randint(0, 40) for y in range(20) for x in range(20)], 20, 20)
    pgm('plates/plate/%02d.pgm' % k, [40 if (x // 9) % 2 and 8 < y < 25 else 210 + random.randint(-20, 20) for y in range(33) for x in range(144)], 144, 33)
    pgm('plates/no-plate/%02d.pgm' % k, [random.randint(0, 255) for y in range(33) for x in range(144)], 144, 33)
PY

for features in pixels hog pca lbp; do
  run plate train-detector --pipeline classic plates -o svm-$features.json --features $features --json
  expect_status 0
  expect_out '"error_of_unseen":0\.0'
done
run plate train-detector --pipeline classic plates -o svm-again.json
cmp -s svm-pixels.json svm-again.json || fail "the same seed trains another SVM"
for reader in hog mlp; do
  run plate train-reader --pipeline classic chars -o $reader.json --reader $reader --json
  expect_status 0
  expect_out '"characters":150'
done
run plate sweep chars --train 100 --features 5,10 --neurons 5,10 --splits 2 --csv study.csv -o study.svg --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq 4 ] || fail "4 cells expected"
cp stdout.txt first.txt
[ "$(wc -l <study.csv)" -eq 5 ] || fail "study.csv: 5 lines expected"
grep -q '<svg' study.svg || fail "no plot"
run plate sweep chars --train 100 --features 5,10 --neurons 5,10 --splits 2 --json --threads 1
cmp -s stdout.txt first.txt || fail "the number of threads changes the study"
run plate sweep chars --train 100 --reader hog --splits 3 --json
expect_out '"error_mean":0\.0'
run plate sweep chars --train 1000
expect_status 2

samples=/usr/share/doc/opencv-doc/examples/data
if [ -e "$samples/board.jpg" ]; then
  run plate segment "$samples/board.jpg" "$samples/building.jpg" -o candidates --json
  [ "$status" -le 1 ] || fail "segment: status $status: $err"
  if [ "$status" -eq 0 ]; then
    [ -s candidates/sheet.png ] || fail "no contact sheet"
    [ "$(find candidates -mindepth 2 -name '*.png' | wc -l)" -eq "$(wc -l <stdout.txt)" ] || fail "lines and images differ"
  fi
fi

# Hostile files.
python3 -c "open('deep.xml','w').write('<opencv_storage>' + '<a>' * 200000)"
run plate train-reader --pipeline classic deep.xml -o x.json
expect_status 3
expect_error 'deep.xml'
printf '<opencv_storage><TrainingData type_id="opencv-matrix"><rows>999999999</rows><cols>4752</cols><dt>f</dt><data>1</data></TrainingData></opencv_storage>' >huge.xml
run plate train-detector --pipeline classic huge.xml -o x.json
expect_status 3
mkdir empty
run plate train-reader --pipeline classic empty -o x.json
expect_status 3
run plate train-reader --pipeline classic chars -o /nowhere/x.json
expect_status 6
[ ! -e x.json ] || fail "a failed training left a model"
run plate read chars/1/00.pgm --pipeline classic --classic-reader mlp --reader svm-pixels.json
expect_status 5
finish
