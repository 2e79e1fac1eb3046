#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# How a window opens and ends: images one by one, q, the close button, SIGINT, a lost display, no display.
. "$(dirname "$0")/lib_window.sh"
samples=/usr/share/doc/opencv-doc/examples/data
[ -r $samples/home.jpg ] || skip "no sample images (package opencv-doc)"

# An image waits; the next comes with the right arrow; what was shown is written.
start $samples/home.jpg $samples/box.png --window -o shown
sleep 0.5
ended && fail "a still image did not wait"
press s '"mode":"sketch"'
[ -z "$(ls shown 2>/dev/null)" ] || fail "written before the user went on"
xdotool key Right
shows_second_image() { grep -q 'home.jpg' stdout.txt; }
wait_for "the next image" shows_second_image
press q '"event":"key '
expect_end 0
[ "$(ls shown)" = $'box.png\nhome.jpg' ] || fail "files: $(ls shown)"
grep -q '"image":"[^"]*home.jpg","mode":"sketch"' stdout.txt || fail "the mode that was shown last is not in $(grep home stdout.txt)"

# In full screen from the start.
start $samples/home.jpg --fullscreen
is_fullscreen() { [ "$(x11 geometry "Tarsier cartoon")" = "0 0 1024 768" ]; }
wait_for "full screen" is_fullscreen
read -r red green blue <<<"$(x11 mean 450 300 100 100)"
[ $((red + green + blue)) -gt 0 ] || fail "nothing on the screen"
press q '"event":"key '
expect_end 0

# A video with a window and a file; it ends by itself, perhaps before anybody could look.
launch $samples/vtest.avi --window -o both.mp4 --frames 8
expect_end 0
[ -s both.mp4 ] || fail "no video beside the window"

# Closed by its button (what a window manager sends), and destroyed.
for way in close destroy; do
  start $samples/vtest.avi --window -o $way.mp4
  sleep 0.5
  if [ $way = close ]; then x11 close "Tarsier cartoon"; else xdotool search --name "Tarsier cartoon" windowclose; fi
  expect_end 0
  [ -s $way.mp4 ] || fail "$way: no video"
done

start $samples/vtest.avi --window
kill -INT $program
expect_end 130

# Without a display, or with one that is gone: one line, no crash.
no_display() { # no_display PATTERN
  run cartoon run $samples/home.jpg --window
  expect_status 3
  expect_error "$1"
  expect_no_out
}
screen=$DISPLAY
DISPLAY=:77 no_display 'no display: .*:77'
unset DISPLAY WAYLAND_DISPLAY
no_display 'no display: DISPLAY is not set'
export DISPLAY=$screen
mkdir lonely
cp "$TARSIER" lonely/tarsier
TARSIER=$PWD/lonely/tarsier no_display 'tarsier-gui'

# The X server dies under the window.
if command -v Xvfb >/dev/null; then
  number=$((100 + $$ % 400))
  Xvfb :$number -screen 0 640x480x24 -noreset 2>/dev/null &
  server=$!
  export DISPLAY=:$number
  server_responds() { xdotool getmouselocation >/dev/null 2>&1; }
  wait_for "another X server" server_responds
  start $samples/vtest.avi --window -o gone.mp4
  sleep 1
  kill -TERM $server
  expect_end 3
  expect_error 'display'
  export DISPLAY=$screen
fi
finish
