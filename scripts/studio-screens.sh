#!/bin/sh
# SPDX-License-Identifier: MIT
# studio-screens.sh [FOLDER]: every screen of the studio as PNG, at 360, 800 and 1440 px, light and dark, for people who
# look at them: NAME-WIDTH.png and NAME-WIDTH-dark.png in FOLDER (build/screens). They are made by the tests of the
# pages, so all data are synthetic. Needs a build (TARSIER_SERVE_BIN, or build/release/bin) and chromium.
set -eu
cd "$(dirname "$0")/.."
folder=${1:-build/screens}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
status=0
for test in tests/web/test_pages.py tests/web/test_area_pages.py; do
  TARSIER_WEB_LOOK=1 TARSIER_WEB_BUILD=$folder XDG_DATA_HOME=$folder/data-home python3 "$test" || status=$?
done
echo "$(find "$folder" -name '*.png' | wc -l) screens in $folder"
exit $status
