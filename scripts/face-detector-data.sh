#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# face-detector-data.sh DATA OUT: collects training and test data for a face detector from the sets in DATA
# (scripts/get-data.sh list) and Debian's opencv-doc, into the folder OUT:
#   learn.txt   faces68: all.txt without every third line of frontal.txt
#   held.txt    that third, held out
#   none/       links to images without faces, for training (every third: for the choice of the threshold)
#   judge/      links to held-out images without faces
# Then, in OUT: tarsier landmarks train face-networks learn.txt --without none --turned 1 --false-alarms 50 --terms 'non-commercial research (LFPW, HELEN, AFW)' -o face-detector.json
set -euo pipefail
data=$(realpath "${1:?the folder of the data}")
out=${2:?a folder for the lists}
doc=${OPENCV_DOC:-/usr/share/doc/opencv-doc/examples/data}
mkdir -p "$out/none" "$out/judge"
out=$(realpath "$out")
find "$out/none" "$out/judge" -type l -delete

faces=$data/faces68
awk 'NR % 3 == 0' "$faces/frontal.txt" >"$out/held.names"
{ grep -vxFf "$out/held.names" "$faces/all.txt"; } | sed "s|^|$faces/|" >"$out/learn.txt"
sed "s|^|$faces/|" "$out/held.names" >"$out/held.txt"
rm "$out/held.names"

# link FOLDER NAME: images on stdin
link() {
  local file
  while read -r file; do ln -s "$file" "$out/$1/$2-$(basename "$file" | tr '#=' '__')"; done
}
files() { find "$data/$1" -type f \( -name '*.jpg' -o -name '*.png' -o -name '*.JPG' -o -name '*.ppm' \) | LC_ALL=C sort; }

# Not among these: images with people, a baboon's and a dog's face, heads of monkeys, drawn heads.
printf "$doc/%s\n" HappyFish.jpg LinuxLogo.jpg WindowsLogo.jpg aloeGT.png aloeL.jpg aloeR.jpg apple.jpg board.jpg \
  building.jpg cards.png digits.png ellipses.jpg gradient.png home.jpg left.jpg right.jpg licenseplate_motion.jpg \
  opencv-logo-white.png opencv-logo.png orange.jpg pic2.png pic3.png pic6.png rubberwhale1.png rubberwhale2.png \
  squirrel_cls.jpg starry_night.jpg stuff.jpg text_defocus.jpg text_motion.jpg | link none doc
printf "$doc/%s\n" aero1.jpg aero3.jpg blox.jpg box.png box_in_scene.png butterfly.jpg chessboard.png detect_blob.png \
  ela_modified.jpg ela_original.jpg fruits.jpg graf1.png graf3.png imageTextN.png imageTextR.png leuvenA.jpg \
  leuvenB.jpg mask.png ml.png notes.png pca_test1.jpg pic4.png pic5.png smarties.png sudoku.png tmpl.png | link judge doc
# Of the four videos of plates-ro two.
files plates-ro | grep -E 'dayride_type1_00[12]' | link none ro
files plates-ro | grep -vE 'dayride_type1_00[12]' | link judge ro
files plates-book | link none book
files plates-uc3m/images | link none uc3m
files sfm-fountain-P11 | link none fountain
files sfm-crazyhorse | link none crazyhorse
files sfm-dino48 | awk 'NR % 4 == 1' | link none dino
files sfm-Herz-Jesu-P8 | link judge herzjesu

for list in learn held; do printf '%s: %d faces\n' "$out/$list.txt" "$(wc -l <"$out/$list.txt")"; done
for folder in none judge; do printf '%s: %d images\n' "$out/$folder" "$(find "$out/$folder" -type l | wc -l)"; done
