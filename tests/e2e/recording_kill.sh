#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A recording of a live source can be played after a kill at any moment, up to two seconds before it; --segment splits
# it.
. "$(dirname "$0")/lib.sh"

program=
trap '[ -z "$program" ] || kill -KILL "$program" 2>/dev/null' EXIT
source='synth:portrait?live=1&fps=25&size=160x120'
frames_in() { # frames_in FILE: how many can be read
  "$TARSIER" cartoon run "$1" --mode none -o none --json 2>/dev/null | grep -c '"frame"'
}
record_until() { # record_until FRAMES FLAGS..: kills the program when so many frames are in; leaves $last, their time
  local frames=$1 deadline=$((SECONDS + 120))
  shift
  : >stdout.txt
  "$TARSIER" cartoon run "$source" --mode none --json "$@" >stdout.txt 2>stderr.txt </dev/null &
  program=$!
  until [ "$(grep -c '"frame"' stdout.txt)" -ge "$frames" ]; do
    [ $SECONDS -lt $deadline ] || { fail "no frames: $(cat stderr.txt)"; finish; }
    sleep 0.02
  done
  { kill -KILL $program && wait $program; } 2>/dev/null
  program=
  last=$(grep '"frame"' stdout.txt | sed '$d' | tail -1 | grep -o '"time":[0-9.]*' | cut -d: -f2)
}

for ending in mp4 mkv avi; do
  record_until $((90 + RANDOM % 60)) -o video.$ending
  [ ! -e video.$ending ] || fail "video.$ending: has its name before its end"
  kept=$(frames_in video.part.$ending)
  # The video has 25 frames a second whatever came: as many as the last frame's time says.
  awk -v kept="$kept" -v last="$last" 'BEGIN { exit !(kept >= 25 * (last - 2)) }' ||
    fail "video.part.$ending: $kept frames of $last s"
done
# The next one leaves it alone and says so.
run cartoon run "$source" --mode none --frames 5 -o video.mp4
expect_status 0
grep -q "video.part.mp4: left by a recording that was cut off" stderr.txt || fail "no word of the old recording: $err"
[ -s video.part.mp4 ] && [ -s video.mp4 ] || fail "a recording is gone: $(ls)"
[ "$(frames_in video.mp4)" -ge 5 ] || fail "video.mp4 does not play"

run cartoon run 'synth:portrait?frames=50&fps=25&size=160x120' --mode none -o cut.avi --segment 1s
expect_status 0
[ "$(frames_in cut-0001.avi) $(frames_in cut-0002.avi)" = "25 25" ] || fail "segments: $(ls)"
[ ! -e cut-0003.avi ] || fail "an empty segment"
record_until 60 -o part.mkv --segment 1s
[ "$(frames_in part-0001.mkv)" = 25 ] || fail "segments of a recording: $(ls)"
run cartoon run "$source" --mode none -o none --segment 1s
expect_status 2
expect_error "--segment"
finish
