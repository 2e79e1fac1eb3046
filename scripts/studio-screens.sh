#!/bin/sh
# SPDX-License-Identifier: MIT
# studio-screens.sh [FOLDER] [--docs]: writes every screen of the studio as PNG, at 360, 800 and 1440 px, light and
# dark, for visual checks: NAME-WIDTH.png and NAME-WIDTH-dark.png in FOLDER (build/screens). The tests of the pages make
# them, so all data are synthetic. Needs a build (TARSIER_SERVE_BIN, or build/release/bin) and chromium. --docs crops
# the images of docs/img from them (ffmpeg); --docs-only does this with the screens already in FOLDER.
set -eu
cd "$(dirname "$0")/.."
folder=${1:-build/screens}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
status=0
[ "${2:-}" = --docs-only ] || for test in tests/web/test_pages.py tests/web/test_area_pages.py tests/web/test_area_making.py; do
  TARSIER_WEB_LOOK=1 TARSIER_WEB_BUILD=$folder XDG_DATA_HOME=$folder/data-home python3 "$test" || status=$?
done
# Screen, then width, height, left, top of the part in px, width in the documents.
if [ -n "${2:-}" ]; then
  while read -r image screen part width; do
    ffmpeg -v error -y -i "$folder/$screen.png" -vf "crop=$part,scale=$width:-1:flags=area" -update 1 -frames:v 1 -q:v 3 \
      "docs/img/studio-$image" </dev/null || status=$?
  done <<'END'
home.png home-1440 1440:995:0:0 760
phone.png home-360 360:660:0:0 320
session.jpg session-1440 1440:640:0:0 900
reconstruct.jpg path-reconstruct-surface-1440 1440:800:0:0 900
people-faces.jpg path-people-faces-800 760:620:20:85 700
path-people.jpg path-people-recognised-1440 1020:1060:0:0 700
path-annotate.jpg path-annotate-points-1440 1440:990:0:0 1000
path-worst.jpg path-train-worst-1440 760:700:670:1130 750
path-calibrate.jpg path-calibrate-live-1440 1440:960:0:0 1000
path-plates.jpg path-plates-search-1440 1440:1000:0:0 1000
END
fi
echo "$(find "$folder" -name '*.png' | wc -l) screens in $folder"
exit $status
