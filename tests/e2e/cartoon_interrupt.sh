#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Ctrl+C and kill: written output stays and can be played; exit status 130.
. "$(dirname "$0")/lib.sh"
video=/usr/share/doc/opencv-doc/examples/data/vtest.avi
[ -r $video ] || skip "no sample video (package opencv-doc)"

for signal in INT TERM; do
  for output in video-$signal.mp4 frames-$signal none; do
    : >stdout.txt # of the run before
    # The reference is slow enough to be in the middle of its work.
    "$TARSIER" cartoon run $video --quality reference --json -o "$output" >stdout.txt 2>stderr.txt </dev/null &
    program=$!
    for _ in $(seq 6000); do
      [ "$(wc -l <stdout.txt)" -ge 5 ] && break
      sleep 0.05
    done
    kill -$signal $program
    status=0
    wait $program || status=$?
    err=$(cat stderr.txt) command_line="SIG$signal with -o $output"
    expect_status 130
    written=$(wc -l <stdout.txt)
    [ "$written" -ge 5 ] && [ "$written" -lt 700 ] || fail "$command_line: $written frames"
    case $output in
      *.mp4)
        [ -s "$output" ] || fail "$command_line: no video"
        if command -v ffprobe >/dev/null; then
          frames=$(ffprobe -v error -count_frames -show_entries stream=nb_read_frames -of csv=p=0 "$output")
          [ "${frames:-0}" -ge 5 ] || fail "$command_line: the video has ${frames:-no} frames"
        fi
        ;;
      frames-*)
        [ "$(find "$output" -name '*.png' | wc -l)" -ge 5 ] || fail "$command_line: $(ls -A "$output")"
        [ -z "$(find "$output" -name '.*' -type f)" ] || fail "$command_line: half a file stayed"
        ;;
    esac
  done
done
# An older video stays.
echo older >older.mp4
"$TARSIER" cartoon run $video --quality reference --json -o older.mp4 >stdout.txt 2>stderr.txt </dev/null &
program=$!
for _ in $(seq 6000); do
  [ "$(wc -l <stdout.txt)" -ge 5 ] && break
  sleep 0.05
done
kill -INT $program
wait $program || true
[ "$(cat older.mp4)" = older ] || fail 'half a video replaced an older one'
grep -q 'older.mp4: is unchanged' stderr.txt || fail "no warning: $(cat stderr.txt)"
[ -z "$(find . -maxdepth 1 -name '.video*' -o -name '.older*')" ] || fail "half a video stayed: $(ls -A)"
finish
