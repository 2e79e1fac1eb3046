#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Augmented reality in a real window: what is drawn is switched by keys, frozen, saved.
. "$(dirname "$0")/lib_window.sh"

"$TARSIER" ar markers 'synth:markers?size=480x360&fps=8&live=1&cover=0&speed=6' --focal 456 --draw cube --window --json \
  >stdout.txt 2>stderr.txt </dev/null &
program=$!
command_line="tarsier ar markers --window"
wait_for "the window" x11 geometry "Tarsier markers" >/dev/null
read -r left top _ _ <<<"$(x11 geometry "Tarsier markers")"
xdotool mousemove $((left + 100)) $((top + 100))
finds_markers() { tail -1 stdout.txt | grep -q '"id":'; }
wait_for "markers" finds_markers
sleep 0.3
x11 save cube.ppm
press a '"draw":"axes"'
x11 save axes.ppm
press l '"list":true'
x11 save list.ppm
press space '"paused":true'
press n '"draw":"none"'
press c '"draw":"cube"'
press i '"outlines":true'
x11 save frozen.ppm
press w '"saved":"./tarsier-0001.png"'
[ -s tarsier-0001.png ] || fail "no saved picture"
press e '"shadow":false'
press s '"smooth":false'
press space '"paused":false'
press h '"paused":false'
x11 save help.ppm
press h '"paused":false'
press f '"markers":0'
press q '"family"'
expect_end 0
finish
