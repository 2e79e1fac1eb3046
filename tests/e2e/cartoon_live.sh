#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A live network camera, simulated by ffmpeg: recent frames; when the camera is killed, frozen or sends garbage, the
# output recovers soon after it.
. "$(dirname "$0")/lib.sh"
command -v ffmpeg >/dev/null || skip "no ffmpeg to play the camera"
command -v python3 >/dev/null || skip "no python3"
video=/usr/share/doc/opencv-doc/examples/data/vtest.avi
[ -r $video ] || skip "no sample video (package opencv-doc)"
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
url=http://127.0.0.1:$port/cam.mjpg
ffmpeg -v error -i $video -frames:v 100 -vf scale=320:240 -c:v mjpeg -q:v 5 -f mjpeg clip.mjpeg || skip "ffmpeg makes no MJPEG"

camera=
program=
start_camera() { # -listen serves one viewer and ends: started again as a camera would be
  ffmpeg -v quiet -re -stream_loop -1 -f mjpeg -framerate 25 -i clip.mjpeg -c copy -f mpjpeg -listen 1 "$url" &
  camera=$!
}
kill_camera() { # without the shell's word on it
  { kill -KILL "$camera" && wait "$camera"; } 2>/dev/null
}
stop_all() {
  [ -z "$camera" ] || kill -KILL "$camera" 2>/dev/null
  [ -z "$program" ] || kill -KILL "$program" 2>/dev/null
}
trap stop_all EXIT

frames() { grep -c '"frame"' stdout.txt; }
wait_for() { # wait_for SECONDS DESCRIPTION COMMAND..: until the command succeeds
  local deadline=$((SECONDS + $1)) what=$2
  shift 2
  until "$@"; do
    [ $SECONDS -lt $deadline ] || { fail "$what: not in time; states: $(grep '"detail"' stdout.txt | tail -5)"; return 1; }
    sleep 0.1
  done
}
more_frames_than() { [ "$(frames)" -gt "$1" ]; }
expect_output_again() { # expect_output_again DESCRIPTION: there is output again (how soon is measured in docs/results.md), and it stays
  local before
  before=$(frames)
  wait_for 300 "$1" more_frames_than $((before + 10))
}
reported_state() { grep -q "\"source\":\"$1\",\"detail\"" stdout.txt; }

"$TARSIER" cartoon run "$url" --mode sketch --wait -o none --json >stdout.txt 2>stderr.txt </dev/null &
program=$!
wait_for 300 "the state before the camera is there" reported_state connecting
start_camera
expect_output_again "first frames"
wait_for 300 "100 frames" more_frames_than 100
memory_before=$(awk '/VmRSS/ {print $2}' /proc/$program/status)

kill_camera
sleep 1
start_camera
expect_output_again "after the camera was killed"

kill -STOP "$camera"
wait_for 300 "a frozen camera is noticed" reported_state stale
kill_camera # as one that is unplugged and plugged in again
start_camera
expect_output_again "after the camera froze"

kill_camera
python3 - "$port" <<'PY' # a viewer gets headers, then noise
import random, socket, sys
server = socket.socket()
server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
server.bind(("127.0.0.1", int(sys.argv[1])))
server.listen(1)
server.settimeout(120)
viewer, _ = server.accept()
viewer.recv(4096)
try:
    viewer.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=x\r\n\r\n")
    noise = random.Random(1).randbytes(10000)
    for _ in range(200):
        viewer.sendall(noise)
except OSError:
    pass
viewer.close()
PY
start_camera
expect_output_again "after garbage"
memory_after=$(awk '/VmRSS/ {print $2}' /proc/$program/status)
[ "$memory_after" -lt $((memory_before + 60000)) ] || fail "memory grew from $memory_before to $memory_after kB"

kill -INT $program
status=0
wait $program || status=$?
program=
command_line="live" err=$(tail -3 stderr.txt)
expect_status 130
python3 - <<'PY' || fail "ages or JSON of the live frames"
import json, statistics
lines = [json.loads(line) for line in open("stdout.txt")]
frames = [line for line in lines if "frame" in line]
ages = [line["age_ms"] for line in frames]
numbers = [line["frame"] for line in frames]
print("age of %d frames: median %.0f ms, largest %.0f ms" % (len(ages), statistics.median(ages), max(ages)))
assert statistics.median(ages) < 5000, ages  # the figure itself is measured in docs/results.md, not here
assert all(a < b for a, b in zip(numbers, numbers[1:])), "frames out of order"
assert {line["mode"] for line in frames} == {"sketch"}
assert "live" in {line["source"] for line in lines}
PY

# A source that never comes is an error in time; one that is lost, too.
run cartoon run "http://127.0.0.1:$port/" --connect-timeout 1 -o none
expect_status 3
[ -z "$camera" ] || kill_camera
start_camera
"$TARSIER" cartoon run "$url" --mode none --wait --stall 5 --give-up 2 -o lost.mp4 --json >stdout.txt 2>stderr.txt </dev/null &
program=$!
wait_for 300 "frames again" more_frames_than 10
kill_camera
status=0
wait $program || status=$?
program=
err=$(cat stderr.txt) command_line="a lost camera"
expect_status 4
grep -q "error: .*$port" stderr.txt || fail "$command_line: $err"
[ -s lost.mp4 ] || fail "the video of a lost camera is gone"
camera=
finish
