#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Every key of the cartoon window has its effect, on the states and on the screen.
. "$(dirname "$0")/lib_window.sh"
video=/usr/share/doc/opencv-doc/examples/data/vtest.avi
[ -r $video ] || skip "no sample video (package opencv-doc)"

start $video $video --window --save-dir saved # twice: it plays in real time, and must last
read -r x y width height <<<"$(x11 geometry "Tarsier cartoon")"
[ "$width" -le 1024 ] && [ "$height" -le 768 ] || fail "larger than the screen: $width x $height"

# Modes, on a frozen frame. The image without the status line below it.
press space '"paused":true'
image() { x11 "$1" "$x" "$y" 640 400; }
new_image_hash() { # new_image_hash: the hash of the screen once it shows what was not seen before
  x11 stable "$max_wait" "$program" "$x" "$y" 640 400 "${!seen[@]}"
}
declare -A seen
for step in s:sketch p:paint c:cartoon e:evil e:evil-sketch a:alien m:smooth n:none; do
  press "${step%%:*}" "\"mode\":\"${step##*:}\""
  hash=$(new_image_hash) || { fail "${step##*:} looks like one of ${seen[*]}"; break; }
  seen[$hash]=${step##*:}
  if [ "${step##*:}" = sketch ]; then
    read -r red green blue <<<"$(image mean)"
    [ "$red" -gt 180 ] && [ "$red" = "$green" ] && [ "$green" = "$blue" ] || fail "a sketch is white with grey lines: $red $green $blue"
  fi
done
keep none.ppm
press d '"debug":true'
new_image_hash >/dev/null || fail "no debug view"
keep debug.ppm
press d '"debug":false'
is_unprocessed() { [ "${seen[$(image hash)]:-}" = none ]; }
wait_for "the image is back" is_unprocessed
press h '"help":true'
new_image_hash >/dev/null || fail "no help"
keep help.ppm
press h '"help":false'
wait_for "the image is back" is_unprocessed
press c '"mode":"cartoon"'
press plus '"sketch_threshold":85'
press minus '"sketch_threshold":80'
press minus '"sketch_threshold":75'
press t '"steady":true'
press t '"steady":false'
press w '"saved":"saved/tarsier-0001.png"'
press w '"saved":"saved/tarsier-0002.png"'
cmp -s saved/tarsier-0001.png saved/tarsier-0002.png || fail "the frozen image was saved twice, differently"
press space '"paused":false'
first=$(image hash)
has_changed() { [ "$(image hash)" != "$first" ]; }
wait_for "the video goes on" has_changed

# Keys that come faster than frames all count.
before=$(events)
xdotool key --delay 0 s p c e e s p c e a
wait_for "ten keys at once" more_events_than $((before + 9))
grep '"event"' stdout.txt | tail -1 | grep -q '"mode":"alien"' || fail "the last of ten keys: $(tail -1 stdout.txt)"

# A slider.
read -r x y width height <<<"$(x11 geometry "Tarsier cartoon")"
for above in 12 16 8 20; do # its groove is a few pixels high, and not where it is in another toolkit's version
  xdotool mousemove $((x + width - 20)) $((y + height - above)) click 1
  sleep 0.5
  xdotool mousemove 300 200
  press s '"evil_threshold":[0-9]+'
  grep '"event"' stdout.txt | tail -1 | grep -q '"evil_threshold":12[,}]' || break
done
grep '"event"' stdout.txt | tail -1 | grep -q '"evil_threshold":12[,}]' && fail "the slider did not move"

# Full screen: all of it, no pointer; and back.
[ "$(x11 cursor)" -gt 0 ] || fail "no pointer in the window"
press f '"event":"key f"'
is_fullscreen() { [ "$(x11 geometry "Tarsier cartoon")" = "0 0 1024 768" ]; }
wait_for "full screen" is_fullscreen
pointer_is_hidden() { xdotool mousemove_relative 3 2 && [ "$(x11 cursor)" -eq 0 ]; }
wait_for "the pointer is hidden" pointer_is_hidden
keep fullscreen.ppm
read -r red green blue <<<"$(x11 mean 0 100 1024 500)"
[ "$red" -gt 150 ] || fail "the sketch does not fill the screen: $red $green $blue"
press p '"mode":"paint"'
press f '"event":"key f"'
is_windowed() { ! is_fullscreen; }
wait_for "back from full screen" is_windowed
pointer_is_shown() { xdotool mousemove_relative 3 2 && [ "$(x11 cursor)" -gt 0 ]; }
wait_for "the pointer is back" pointer_is_shown
keep back.ppm

press Escape '"event":"key '
expect_end 0
[ ! -s stderr.txt ] || fail "on stderr: $err"
finish
