#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# aam explore with a real mouse: a slider and keys change the face on the screen.
. "$(dirname "$0")/lib_window.sh"

command_line="tarsier aam explore --window"
"$TARSIER" aam explore --window --json >stdout.txt 2>stderr.txt </dev/null &
program=$!
wait_for_window "Tarsier appearance"
xdotool mousemove 300 400
wait_for_image
# The window takes its size in steps, and is looked for again each time.
read_geometry() { read -r left top width height <<<"$(x11 geometry "Tarsier appearance")"; }
face() { read_geometry && x11 mean $((left + width / 2 - 60)) $((top + height / 2 - 20)) 120 120; }

is_mean_face() { [ "$before" = "$(face)" ]; }
is_other_face() { [ "$before" != "$(face)" ]; }

# The mean face lies on the screen, and the window in its place, when six readings in a row agree.
before='' equal_readings=0
is_settled() {
  local last=$before
  read_geometry
  before="$left $top $width $height $(face)"
  if [ "$last" = "$before" ]; then equal_readings=$((equal_readings + 1)); else equal_readings=0; fi
  [ "$equal_readings" -ge 5 ]
}
wait_for "a still image" is_settled
before=$(face)
press r '"mode":"shape 1"'
wait_for "a random face on the screen" is_other_face
grep '"event"' stdout.txt | tail -1 | grep -q '"shape":\[0\.0,0\.0,' && fail "r gave the mean face"
press 0 '"shape":\[0\.0,0\.0,'
wait_for "the mean face after 0" is_mean_face
press n '"mode":"shape 2"'
press plus '"shape":\[0\.0,0\.25,'

# A slider: its groove is a few pixels high, and not where it is in another toolkit's version.
moved=no
for above in 12 16 8 20; do
  events_before=$(events)
  read_geometry
  xdotool mousemove $((left + width - 20)) $((top + height - above)) click 1
  sleep 1
  if more_events_than "$events_before"; then moved=yes && break; fi
done
[ $moved = yes ] || fail "no slider moved"
grep '"event"' stdout.txt | tail -1 | grep -qE '"event":"[^"]*(shape|look) [1-4]' ||
  fail "no slider moved: $(grep '"event"' stdout.txt | tail -1)"
wait_for "the slider's face on the screen" is_other_face
read_geometry
xdotool mousemove $((left + width / 2)) $((top + height / 2))
xdotool key q
expect_end 0
finish
