#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The program as a network camera, and a second one that reads it, like a Pi and a PC.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip "no python3"
video=/usr/share/doc/opencv-doc/examples/data/vtest.avi
[ -r $video ] || skip "no sample video (package opencv-doc)"
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
url=http://127.0.0.1:$port/
# A pipe keeps the video paused until the viewer is there.
mkfifo actions
"$TARSIER" cartoon run "$video" "$video" --mode none -o "$url" --json --actions - >camera.txt 2>camera-err.txt <actions &
camera=$!
trap 'kill -KILL $camera 2>/dev/null' EXIT
exec 3>actions
echo pause >&3
for _ in $(seq 3000); do
  grep -q '"paused":true' camera.txt && break
  sleep 0.1
done
grep -q '"paused":true' camera.txt || fail "the video did not pause: $(cat camera-err.txt)"
( # goes on when the viewer is connected to it
  for _ in $(seq 3000); do
    grep -qE "^ *[0-9]+: 0100007F:$(printf %04X "$port") 0100007F:[0-9A-F]{4} 01 " /proc/net/tcp && break
    sleep 0.1
  done
  echo pause >&3
) &
run cartoon run "$url" --mode sketch -o watched.mp4 --frames 5 --connect-timeout 120 --json
expect_status 0
[ "$(grep -c '"frame"' stdout.txt)" -eq 5 ] || fail "frames: $out"
[ -s watched.mp4 ] || fail "no video of the stream"
echo quit >&3
exec 3>&-
status=0
wait $camera || status=$?
err=$(cat camera-err.txt) command_line="the camera"
expect_status 0
finish
