#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# get-data.sh list          lists the public data sets for evaluations: content and terms
# get-data.sh NAME          prints the home of a set, and downloads it if that needs no signed agreement
#
# No data set is part of Tarsier or needed to use it or to run its tests. A test that can use a set reads the folder
# $TARSIER_DATA, and is skipped if the set is not there. A known SHA-256 is checked.
set -euo pipefail

# name|what|terms|home|how: package:NAME, or by-hand
sets() {
  cat <<'TABLE'
opencv-samples|images and videos of OpenCV's documentation|Apache 2.0 and others, see the package's copyright file|Debian and Ubuntu, package opencv-doc|package:opencv-doc
opencv-cascades|trained face and eye detectors|BSD and Apache 2.0|Debian and Ubuntu, package opencv-data|package:opencv-data
lfpw-helen-afw|faces with 68 points (300-W: LFPW, HELEN, AFW)|non-commercial research; trained weights likewise|Intelligent Behaviour Understanding Group, Imperial College London: the 300-W challenge|by-hand
imm|studio faces with points (IMM)|research, cite the Technical University of Denmark (2005)|Technical University of Denmark, the IMM face databases|by-hand
pointing04|heads in 93 poses, 15 people|any purpose, cite Gourier and others (2004)|INRIA, the Head Pose Image Database of Pointing'04|by-hand
orl|40 people, 10 images each|research, credit Olivetti Research Laboratory|AT&T Laboratories Cambridge, the Database of Faces|by-hand
yale|15 people under 11 conditions|non-commercial research|Yale University, the Yale Face Database|by-hand
yale-b-cropped|38 people under 64 lights|research, cite Georghiades and others (2001) and Lee and others (2005)|Yale University, the Extended Yale Face Database B|by-hand
grid|talking faces|CC BY 4.0|the GRID audiovisual sentence corpus, University of Sheffield|by-hand
plates-openalpr|cars of Europe and the USA with their plates|repository AGPL, images unknown: measure only|the OpenALPR benchmarks on GitHub|by-hand
plates-book|12 Spanish cars with their plates|MIT|the example code of the book "Mastering OpenCV with Practical Computer Vision Projects" (Packt)|by-hand
plates-ro|Romanian road scenes with plates, day and night|MIT|not known here|by-hand
dlib-faces|4 group images with 68 points|annotations Boost licence|the examples of dlib|by-hand
plates-uc3m|Spanish scenes and plates with characters|ODbL; for commercial use ask the authors|Universidad Carlos III de Madrid|by-hand
strecha|fountain-P11 and Herz-Jesu-P8: images with known cameras|research, cite Strecha and others (CVPR 2008)|EPFL, Computer Vision Laboratory: multi-view evaluation|by-hand
ict-facekit|a 3D face model|MIT|the ICT-FaceKit repository, USC Institute for Creative Technologies|by-hand
TABLE
}

field() { cut -d'|' -f"$1" <<<"$2"; }

case ${1:-} in
  list)
    printf '%-16s %s\n' NAME 'WHAT (terms)'
    while read -r line; do
      printf '%-16s %s (%s)\n' "$(field 1 "$line")" "$(field 2 "$line")" "$(field 3 "$line")"
    done < <(sets)
    ;;
  '' | -h | --help)
    sed -n 's/^# \{0,1\}//; 3,7p' "${BASH_SOURCE[0]}"
    [ -n "${1:-}" ] || exit 2
    ;;
  *)
    line=$(sets | awk -F'|' -v name="$1" '$1 == name')
    if [ -z "$line" ]; then
      printf 'get-data.sh: no set called %s; the names: %s\n' "$1" "$(sets | cut -d'|' -f1 | paste -sd' ')" >&2
      exit 2
    fi
    printf '%s: %s\nTerms: %s\nHome:  %s\n' "$1" "$(field 2 "$line")" "$(field 3 "$line")" "$(field 4 "$line")"
    how=$(field 5 "$line")
    case $how in
      package:*)
        package=${how#package:}
        if [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ]; then
          echo "It is installed (apt checked its sums when it was)."
        else
          echo "To install it: sudo apt-get install $package"
          [ "$(id -u)" -ne 0 ] || DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$package"
        fi
        ;;
      *)
        echo "No address and no SHA-256 are known for certain here, so nothing is fetched: get it from its home, under its"
        echo "terms, and put it into \$TARSIER_DATA/$1/."
        ;;
    esac
    ;;
esac
