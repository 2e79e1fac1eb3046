#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# https and rtsps: only a server with a trusted certificate for its name is read, and gets a password.
. "$(dirname "$0")/lib.sh"
here=$TARSIER_SOURCE/tests/e2e
for tool in openssl ffmpeg python3; do command -v $tool >/dev/null || skip "no $tool to play the camera"; done

authority() { openssl req -x509 -newkey rsa:2048 -nodes -days 2 -keyout "$1.key" -out "$1.pem" -subj "/CN=$1" 2>/dev/null; }
certificate() { # certificate FILE NAMES
  openssl req -newkey rsa:2048 -nodes -keyout "$1.key" -out "$1.csr" -subj "/CN=$1" 2>/dev/null &&
    printf 'subjectAltName=%s\n' "$2" >"$1.ext" &&
    openssl x509 -req -days 2 -in "$1.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -extfile "$1.ext" -out "$1.pem" 2>/dev/null
}
authority ca && certificate camera DNS:localhost,IP:127.0.0.1 && certificate other DNS:camera.example || skip "openssl makes no certificates"
ffmpeg -v error -f lavfi -i testsrc=size=320x240:rate=10 -t 4 -c:v mpeg2video -g 5 -f mpegts video.ts &&
  ffmpeg -v error -f lavfi -i testsrc=size=320x240:rate=10 -frames:v 1 image.jpg || skip "ffmpeg makes no video"

servers=()
stop_all() { kill -KILL "${servers[@]}" 2>/dev/null; }
trap stop_all EXIT
start() { # start CERTIFICATE: leaves $port
  python3 "$here/live_secure.py" "$1.pem" "$1.key" video.ts image.jpg "$1.log" >"$1.port" &
  servers+=($!)
  local deadline=$((SECONDS + 300))
  until port=$(cat "$1.port") && [ -n "$port" ]; do
    [ $SECONDS -lt $deadline ] || { fail "the camera does not start"; finish; }
    sleep 0.05
  done
}
start camera
good=localhost:$port
start other
bad=localhost:$port

play() { run cartoon run "$@" --mode none --frames 3 -o none --json --connect-timeout 30 --stall 30; }
for path in https:cam.mjpg https:video.ts rtsps:cam; do
  scheme=${path%%:*} file=${path#*:}
  play "$scheme://me:secret@$good/$file" --ca-file ca.pem
  expect_status 0
  expect_out '"frame":'
  : >other.log
  play "$scheme://me:secret@$good/$file" # the system's authorities do not know it
  expect_status 3
  expect_error "certificate is not trusted" "--ca-file" "--insecure"
  play "$scheme://me:secret@$bad/$file" --ca-file ca.pem
  expect_status 3
  expect_error "certificate is not for 'localhost'" "--insecure"
  grep -q secret stderr.txt && fail "a password is shown: $err"
  [ ! -s other.log ] || fail "$scheme: a server of another name was asked: $(cat other.log)"
  play "$scheme://$bad/$file" --insecure
  expect_status 0
done
grep -q "GET /cam.mjpg .*with password" camera.log || fail "the password did not get to the camera: $(cat camera.log)"

play "https://$good/away" --ca-file ca.pem
expect_status 3
expect_error "redirects to 'http://" "only https"
play "https://$good/cam.mjpg" --ca-file none.pem
expect_status 3
expect_error "none.pem"
play "https://$good/cam.mjpg" --ca-file ca.pem --insecure
expect_status 2
finish
