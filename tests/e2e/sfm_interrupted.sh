#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm: an interruption never loses hours of work. Checks come first; a mapped model is written before it is placed;
# mapping resumes after a kill, and Ctrl-C writes the model so far.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 10 --size 240x180 --seed 3
expect_status 0
mapping() { # mapping FOLDER [ARGUMENTS..]: the words that make the model
  local folder=$1
  shift
  words=(sfm reconstruct scene/images --camera-file scene/camera.yaml --max-features 400 -o "$folder" --checkpoint 0
    --quiet "$@")
}
same_as_whole() { # same_as_whole FOLDER WHAT
  for file in cameras images points3D; do
    cmp -s "$1/$file.txt" "whole/$file.txt" || fail "$2: another $file.txt"
  done
}
wait_for_mapping() { # until the mapper of FOLDER has a checkpoint, or the program has ended
  for _ in $(seq 15000); do
    compgen -G "$1/cache/*.mapper" >/dev/null && return
    kill -0 "$program" 2>/dev/null || return
    sleep 0.02
  done
}
field() { # field FOLDER NAME: of report.json
  python3 -c 'import json, sys; print(json.load(open(sys.argv[1] + "/report.json")).get(sys.argv[2], ""))' "$1" "$2"
}
mapping whole
run "${words[@]}"
expect_status 0

# --- killed in the mapper: the same command goes on from the checkpoint, to the same bytes ---
mapping killed
"$TARSIER" "${words[@]}" >/dev/null 2>stderr.txt </dev/null &
program=$!
wait_for_mapping killed
kill -KILL $program 2>/dev/null
wait $program 2>/dev/null
if [ -e killed/report.json ]; then
  printf 'note: the machine was too quick, the run had ended\n'
fi
run "${words[@]}"
expect_status 0
[ "$(field killed resumed)" -ge 2 ] || fail "the mapping began again from nothing"
same_as_whole killed "killed and continued"
# A finished mapping is kept as well: other results of it cost no mapping.
run "${words[@]}" --turntable
expect_status 0
[ "$(field killed resumed)" -eq 10 ] || fail "a finished mapping was done again"
[ -s killed/turntable.gif ] || fail "no turntable"

# --- Ctrl-C in the mapper: the model so far, marked; then the same command goes on ---
mapping stopped
"$TARSIER" "${words[@]}" >/dev/null 2>stderr.txt </dev/null &
program=$!
wait_for_mapping stopped
kill -INT $program
status=0
wait $program || status=$?
if [ "$status" -eq 130 ]; then
  [ "$(field stopped partial)" = True ] || fail "interrupted: report.json does not say so"
  for file in cameras.txt images.txt points3D.txt points.ply; do
    [ -s "stopped/$file" ] || fail "interrupted: no $file"
  done
  run sfm eval stopped --truth scene/truth.jsonl --json
  [ "$status" -eq 0 ] || [ "$status" -eq 3 ] || fail "interrupted: the model cannot be read: $err"
else
  [ "$status" -eq 0 ] || fail "interrupted: exit status $status: $(cat stderr.txt)"
fi
mapping stopped
run "${words[@]}"
expect_status 0
[ "$(field stopped partial)" = "" ] || fail "continued: still partial"
same_as_whole stopped "interrupted and continued"

# --- the same of all images at once: killed, and Ctrl-C, between its steps ---
run sfm synth -o ring --images 40 --size 240x180 --seed 4
expect_status 0
mapping_ring() { # mapping_ring FOLDER
  words=(sfm reconstruct ring/images --camera-file ring/camera.yaml --max-features 400 -o "$1" --mapper global --checkpoint 0
    --threads 1 --quiet)
}
same_as_ring() { # same_as_ring FOLDER WHAT
  for file in cameras images points3D; do
    cmp -s "$1/$file.txt" "ring-whole/$file.txt" || fail "$2: another $file.txt"
  done
}
mapping_ring ring-whole
run "${words[@]}"
expect_status 0
partial=0
for signal in KILL INT INT INT; do # until an interruption comes after the positions and before the end
  rm -rf ring-stopped
  mapping_ring ring-stopped
  "$TARSIER" "${words[@]}" >/dev/null 2>stderr.txt </dev/null &
  program=$!
  wait_for_mapping ring-stopped
  until grep -qs 'global: positions' ring-stopped/cache/*.mapper || ! kill -0 $program 2>/dev/null; do :; done
  kill -$signal $program 2>/dev/null
  status=0
  wait $program 2>/dev/null || status=$?
  if [ "$signal" = INT ] && [ -e ring-stopped/report.json ] && [ "$(field ring-stopped partial)" = True ]; then
    partial=1
    [ "$status" -eq 130 ] || fail "global, interrupted: exit status $status"
    for file in cameras.txt images.txt points3D.txt points.ply; do
      [ -s "ring-stopped/$file" ] || fail "global, interrupted: no $file"
    done
    run sfm eval ring-stopped --truth ring/truth.jsonl --json
    [ "$status" -eq 0 ] || [ "$status" -eq 3 ] || fail "global, interrupted: the model cannot be read: $err"
  elif [ "$signal" = INT ] && [ "$status" -ne 0 ] && [ "$status" -ne 130 ]; then
    fail "global, interrupted: exit status $status: $(cat stderr.txt)"
  fi
  run "${words[@]}"
  expect_status 0
  same_as_ring ring-stopped "global, $signal and continued"
  [ $partial -eq 0 ] || break
done
[ $partial -gt 0 ] || printf 'note: no Ctrl-C came between positions and the end\n'

# --- what can be checked is checked before the work ---
expect_refusal() { # expect_refusal STATUS PATTERN ARGUMENTS..: without a look at an image's features
  local expected=$1 pattern=$2
  shift 2
  mapping unused "$@"
  run "${words[@]}"
  expect_status "$expected"
  expect_error "$pattern"
  ! compgen -G 'unused/cache/*.features' >/dev/null || fail "$*: found features before it was refused"
}
printf '0000.jpg,0,0,0\n0001.jpg,1,0,0\nelsewhere.jpg,0,1,0\n' >two.csv
printf '0000.jpg,0,0,0\n0001.jpg,1,1,1\n0002.jpg,2,2,2\n' >line.csv
printf '0000.jpg,0,0\n' >bad.csv
expect_refusal 3 'missing.csv' --align missing.csv
expect_refusal 3 'line 1' --align bad.csv
expect_refusal 3 '2 of 3 names' --align two.csv
expect_refusal 3 'collinear' --align line.csv
expect_refusal 3 '0 of 10 images' --align gps
expect_refusal 2 'nobody.jpg' --distance 2 --distance-between 0000.jpg nobody.jpg
expect_refusal 2 'two images' --distance 2 --distance-between 0000.jpg 0000.jpg
expect_refusal 2 'needs --distance-between' --distance 2
expect_refusal 2 'needs --distance,' --distance-between 0000.jpg 0001.jpg
printf '0000.jpg nobody.jpg\n' >pairs.txt
expect_refusal 3 'line 1' --pairs pairs.txt

# --- what shows only afterwards leaves the model, and says so ---
mkdir mixed
for k in 0 1 2 3; do cp "scene/images/000$k.jpg" mixed/; done
run sfm synth -o wall --images 3 --size 240x180 --content nothing
for k in 0 1 2; do cp "wall/images/000$k.jpg" "mixed/wall-$k.jpg"; done
printf 'wall-0.jpg,0,0,0\nwall-1.jpg,1,0,0\nwall-2.jpg,0,1,0\n' >walls.csv
words=(sfm reconstruct mixed --camera-file scene/camera.yaml --max-features 400 --quiet)
run "${words[@]}" -o unplaced --align walls.csv
expect_status 3
expect_error 'walls.csv: 0 positions belong to images of the model'
[ -s unplaced/points3D.txt ] && [ -s unplaced/view.html ] || fail "--align that does not fit: there is no model"
[ -n "$(field unplaced not_placed)" ] || fail "--align that does not fit: report.json does not say so"
cp unplaced/images.txt unplaced.txt
run "${words[@]}" -o unplaced --distance 2 --distance-between 0000.jpg wall-1.jpg
expect_status 3
expect_error "'wall-1.jpg' is not in the model"
cmp -s unplaced/images.txt unplaced.txt || fail "--distance-between that does not fit changes the model"

# --- models of an earlier run go, and nothing else does ---
mkdir both
for k in 0 1 2 3; do cp "scene/images/000$k.jpg" "both/a-$k.jpg"; done
run sfm synth -o other --images 3 --size 240x180 --seed 9
for k in 0 1 2; do cp "other/images/000$k.jpg" "both/b-$k.jpg"; done
words=(sfm reconstruct both --camera-file scene/camera.yaml --max-features 400 --quiet)
run "${words[@]}" -o two
expect_status 0
[ -s two/model-1/images.txt ] || fail "two scenes gave no second model"
mkdir two/model-7
cp two/model-1/images.txt two/model-7/
printf 'mine\n' >two/model-1/notes.txt
rm both/b-*
run "${words[@]}" -o two
expect_status 0
[ ! -e two/model-1/images.txt ] || fail "the second model of the run before is still there"
[ -s two/model-1/notes.txt ] && [ -s two/model-7/images.txt ] || fail "files of somebody else are gone"
finish
