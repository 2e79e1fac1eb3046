#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Augmented reality in a real window: keys change what is drawn, freeze and save the image.
. "$(dirname "$0")/lib_window.sh"

"$TARSIER" ar markers 'synth:markers?size=480x360&fps=8&live=1&cover=0&speed=6' --focal 456 --draw cube --window --json \
  >stdout.txt 2>stderr.txt </dev/null &
program=$!
command_line="tarsier ar markers --window"
wait_for_window "Tarsier markers"
read -r left top _ _ <<<"$(x11 geometry "Tarsier markers")"
xdotool mousemove $((left + 100)) $((top + 100))
finds_markers() { tail -1 stdout.txt | grep -q '"id":'; }
wait_for "markers" finds_markers
keep cube.ppm
press a '"draw":"axes"'
keep axes.ppm
press l '"list":true'
keep list.ppm
press space '"paused":true'
press n '"draw":"none"'
press c '"draw":"cube"'
press i '"outlines":true'
keep frozen.ppm
press w '"saved":"./tarsier-0001.png"'
[ -s tarsier-0001.png ] || fail "no saved image"
press e '"shadow":false'
press s '"smooth":false'
press space '"paused":false'
press h '"paused":false'
keep help.ppm
press h '"paused":false'
press f '"markers":0'
press q '"family"'
expect_end 0
finish
