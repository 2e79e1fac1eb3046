#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate read of several cameras in one process: a file of --config, regions, one log, an unreachable camera.
. "$(dirname "$0")/lib.sh"

cat >site.toml <<'TOML'
[plate.read]
input = ["gate=synth:drive?live=1&fps=5&frames=40&size=640x360&seconds=8&cars=2&seed=3",
         "yard=synth:drive?live=1&fps=5&frames=40&size=640x360&seconds=8&cars=2&seed=4"]
log = "site.db"
camera-fps = 5
camera-roi = ["hidden=0,0,0.01,0.01"]
TOML

run plate read 'hidden=synth:drive?live=1&fps=5&frames=40&size=640x360&seconds=8&cars=2&seed=3' --config site.toml --json
expect_status 0
expect_no_err_line() { if grep -q "$1" stderr.txt; then fail "$command_line: $1 on stderr: $err"; fi; }
expect_no_err_line error
for camera in gate yard; do
  grep -q "\"event\":\"plate\",\"state\":\"closed\",.*\"source\":\"$camera\"" stdout.txt || fail "no vehicle of $camera: $(cut -c1-300 stdout.txt)"
  grep -q "{\"source\":\"ended\",.*\"camera\":\"$camera\"}" stdout.txt || fail "no end of $camera"
done
if grep -q '"state":"closed",.*"source":"hidden"' stdout.txt; then fail 'a vehicle outside of --camera-roi'; fi
expect_out '"cameras":\[\{"camera":"(gate|hidden)","received":[0-9]+,"looked_at":[0-9]+,"moving":[0-9]+,"read":[0-9]+,"in_part":[1-9][0-9]*,"vehicles":[0-9]+,"restarts":0,"cpu_s":'
# The ids count through all cameras, and the log has each vehicle once.
grep '"state":"closed"' stdout.txt | sed 's/.*"id":\([0-9]*\).*/\1/' | sort | uniq -d | grep -q . && fail 'an id is there twice'
vehicles=$(grep -c '"state":"closed"' stdout.txt)
run plate log site.db --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq "$vehicles" ] || fail "the log has $(wc -l <stdout.txt) of $vehicles vehicles"

# One camera is not there: the other one is read, until SIGINT.
"$TARSIER" plate read dead=http://127.0.0.1:1/ \
  'live=synth:drive?live=1&fps=5&frames=40&size=640x360&seconds=8&cars=2&seed=3' --camera-fps 5 --json >alone.txt 2>alone.err &
pid=$!
while kill -0 $pid 2>/dev/null && ! grep -q '"source":"ended"' alone.txt; do sleep 0.1; done
kill -INT $pid
wait $pid
[ $? -eq 130 ] || fail "interrupted: $(cat alone.err)"
grep -q '"state":"closed",.*"source":"live"' alone.txt || fail "nothing of the live camera: $(cut -c1-300 alone.txt)"
grep -q '"camera":"dead","received":0' alone.txt || fail "no report of the dead one: $(tail -1 alone.txt)"

# Plates of other countries are counted as for a single source.
run plate read 'a=synth:drive?live=1&fps=5&frames=15&size=640x360&seconds=4&seed=3' --country br --motion 0
grep -q 'readings fit no layout of --country br' stderr.txt || fail "no warning of other countries: $err"

# What goes with one source alone, and what is no camera.
two=('synth:drive?live=1' 'synth:drive?live=1&seed=2')
run plate read "${two[@]}" -o drawn/
expect_status 2
expect_error 'images cannot be written for several cameras'
run plate read "${two[@]}" --window
expect_status 2
run plate read "${two[@]}" --csv read.csv
expect_status 2
expect_error 'csv needs a single source; for several cameras use --log'
[ ! -e read.csv ] || fail "a table was begun"
run plate read "${two[@]}" --debug-dir stages
expect_status 2
expect_error 'debug-dir needs a single source'
for flag in --camera-roi=a=0,0,1,1 --camera-fps=10 --motion=0; do
  run plate read synth:drive $flag
  expect_status 2
  expect_error "${flag%%=*}: needs several cameras"
done
run plate read a=photo.jpg b=photo.jpg
expect_status 3
run plate read "${two[@]}" --camera-roi 'gate=0,0,1,1'
expect_status 2
expect_error '--camera-roi gate=0,0,1,1: expected NAME='
run plate read 'a=synth:drive?live=1' 'a=synth:drive?live=1&seed=2'
expect_status 2
expect_error 'a: two cameras of one name'
run plate read "${two[@]}" synth:drive
expect_status 2
expect_error 'cameras and files cannot be combined'
run plate read 'a=synth:drive'
expect_status 2
expect_error 'NAME=SOURCE names cameras and streams'
finish
