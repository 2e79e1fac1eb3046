#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# people-lists.sh DATA OUT: writes lists path<TAB>person of the sets of faces in DATA (scripts/get-data.sh list), for
# `tarsier people eval` and `people train`, to the folder OUT: orl.lst, yale.lst, yale-b.lst, pointing04.lst (yaw and
# pitch of at most 15 degrees), pointing04-front.lst and pointing04-yaw30.lst, -yaw45.lst, -yaw60.lst (no pitch;
# frontal, and with that yaw to either side: `people eval pointing04-yaw45.lst --train-list pointing04-front.lst`),
# faces-wild.lst, faces68.lst (one image each: for --learn-background). Missing sets are reported.
set -euo pipefail
data=$(realpath "${1:?the folder of the data}")
out=${2:?a folder for the lists}
mkdir -p "$out"

list() { # list NAME: stdin into NAME.lst
  local lines
  lines=$(cat)
  if [ -n "$lines" ]; then
    printf '%s\n' "$lines" >"$out/$1.lst"
    printf '%s: %d images of %d people\n' "$out/$1.lst" "$(wc -l <"$out/$1.lst")" "$(cut -f2 "$out/$1.lst" | sort -u | wc -l)"
  else
    printf '%s: not in %s\n' "$1" "$data"
  fi
}
files() { { [ ! -d "$data/$1" ] || find "$data/$1" -type f -name "$2"; } | LC_ALL=C sort; }

files orl '*.pgm' | awk -F/ '{print $0 "\t" $(NF-1)}' | list orl
files yale 'subject*.pgm' | awk -F/ '{split($NF, a, "_"); print $0 "\t" a[1]}' | list yale
files yale-b-cropped '*.pgm' | awk -F/ '{print $0 "\t" $(NF-1)}' | list yale-b
# person<PP><series><number><tilt><pan>.jpg
heads() { # heads MAX_TILT MIN_PAN MAX_PAN: degrees, to either side
  files pointing04 'person*.jpg' | awk -F/ -v most="$1" -v low="$2" -v high="$3" '{
    name = $NF; sub(/\.jpg$/, "", name)
    if (name ~ /^person[0-9]/ && match(name, /[+-][0-9]+[+-][0-9]+$/)) {
      angles = substr(name, RSTART)
      match(angles, /^[+-][0-9]+/)
      tilt = substr(angles, 2, RLENGTH - 1) + 0; pan = substr(angles, RLENGTH + 2) + 0
      if (tilt <= most && pan >= low && pan <= high) print $0 "\tperson" substr(name, 7, 2)
    }
  }'
}
heads 15 0 15 | list pointing04
heads 0 0 0 | list pointing04-front
for yaw in 30 45 60; do heads 0 "$yaw" "$yaw" | list "pointing04-yaw$yaw"; done
if [ -f "$data/faces-wild/list.lst" ]; then
  awk -v folder="$data/faces-wild/" '{print folder $0}' "$data/faces-wild/list.lst" | list faces-wild
else
  list faces-wild </dev/null
fi
if [ -f "$data/faces68/frontal.txt" ]; then
  awk -v folder="$data/faces68/" '{print folder $1 "\t" $1}' "$data/faces68/frontal.txt" | list faces68
else
  list faces68 </dev/null
fi
