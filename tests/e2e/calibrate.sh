#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Calibration from images of a board and from a video, and all errors; sheets that print true to scale.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
board=(--board chess:9x6 --square 25mm)

# --- sheets ---

run ar marker-sheet --family aruco-original --ids 0-9 --size 50mm -o markers.pdf --json
expect_status 0
expect_out '"family":"aruco-original"' '"pages":2' '"output":\["markers.pdf"\]'
head -c 8 markers.pdf | grep -q '%PDF-1.4' || fail "markers.pdf is no PDF"
run ar marker-sheet --board chess:9x6 --square 25mm -o board.svg
expect_status 0
grep -q 'width="297.0000mm"' board.svg || fail "board.svg is not across an A4 page"
run ar marker-sheet --ids 0-40 --size 50mm -o many.png --dpi 100 --json
expect_status 0
expect_out '"many-1.png","many-2.png"'
run ar marker-sheet --size 300mm -o x.pdf
expect_status 2
expect_error 'does not fit' 'a side of up to 138 mm'
run ar marker-sheet --family 9x9 -o x.pdf
expect_status 2
expect_error '9x9' 'aruco-original'
run ar marker-sheet --ids 0-5000 -o x.pdf
expect_status 2
expect_error '0..586'
run ar marker-sheet --board chess:9x6 -o x.pdf
expect_status 2
expect_error '--square'
run ar marker-sheet --page a3 --dpi 1200 -o x.png
expect_status 2
expect_error 'million pixels'
run ar marker-sheet -o x.doc
expect_status 2
run ar marker-sheet -o /proc/nowhere/x.pdf
expect_status 6

# The paper as another program draws it: size of the page and of a marker.
if command -v pdftoppm >/dev/null && /usr/bin/python3 -c 'import cv2, cv2.aruco' 2>/dev/null; then
  pdftoppm -r 600 -gray -png markers.pdf paper
  /usr/bin/python3 - <<'END' || fail "the printed sheet is not true to scale"
import cv2, numpy
page = cv2.imread("paper-1.png", 0)
mm = 25.4 / 600
assert abs(page.shape[1] * mm - 210) < 0.1 and abs(page.shape[0] * mm - 297) < 0.1, page.shape
family = cv2.aruco.DICT_ARUCO_ORIGINAL
if hasattr(cv2.aruco, "ArucoDetector"):
    found = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(family)).detectMarkers(page)
else:
    found = cv2.aruco.detectMarkers(page, cv2.aruco.Dictionary_get(family))
assert sorted(found[1].ravel()) == [0, 1, 2, 3, 4, 5], found[1]
# By its ink: the first column and row of pixels darker than half.
for quad in found[0]:
    x0, y0 = quad[0].min(axis=0) - 20
    x1, y1 = quad[0].max(axis=0) + 20
    part = page[int(y0):int(y1), int(x0):int(x1)] < 128
    columns = numpy.where(part.mean(axis=0) > 0.3)[0]
    rows = numpy.where(part.mean(axis=1) > 0.3)[0]
    for size in (columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1):
        assert abs(size * mm - 50) < 0.1, size * mm
END
else
  echo "note: no pdftoppm (package poppler-utils) or python3-opencv: the paper is not measured"
fi

# --- videos ---

run calibrate 'synth:board?size=480x360&fps=4&frames=72' "${board[@]}" -o video.yaml --json
expect_status 0
python3 - stdout.txt <<'END' || fail "the video's camera is not its own"
import json, sys
lines = [json.loads(l) for l in open(sys.argv[1])]
summary = lines[-1]
assert abs(summary["fx"] / 408 - 1) < 2e-3 and abs(summary["cx"] - 244.8) < 1, summary
assert summary["rms"] < 0.1 and summary["used"] >= 10, summary
assert all("frame" in l and "time" in l for l in lines[:-1])
END
run calibrate 'synth:board?size=480x360&fps=10&live=1' "${board[@]}" --frames 2 -o none.yaml
expect_status 1
[ ! -e none.yaml ] || fail "a camera was written without views"
run calibrate 'synth:bars?frames=4' "${board[@]}"
expect_status 1

# --- what is no board, no size, no folder ---

expect_usage_error() { # expect_usage_error PATTERN ARGUMENTS..
  local pattern=$1
  shift
  run calibrate "$@"
  expect_status 2
  expect_error "$pattern"
}
expect_usage_error 'INPUT' "${board[@]}"
expect_usage_error 'board' synth:bars --square 25mm
expect_usage_error 'inner corners' synth:bars --board chess --square 25mm
expect_usage_error 'no such kind' synth:bars --board checkers:9x6 --square 25mm
expect_usage_error '25mm' synth:bars --board chess:9x6 --square 25inch
expect_usage_error '25mm' synth:bars --board chess:9x6 --square 0
expect_usage_error 'lens' synth:bars "${board[@]}" --lens mirror
run calibrate nowhere.jpg "${board[@]}"
expect_status 3
expect_error 'nowhere.jpg'
noise 1000 >noise.jpg
run calibrate noise.jpg "${board[@]}"
expect_status 3
expect_error 'noise.jpg'

# --- the images of OpenCV ---

[ -f "$images/left01.jpg" ] || { echo "note: no package opencv-doc: its images are left out"; finish; }
left=("$images"/left[01]?.jpg)
run calibrate "${left[@]}" "${board[@]}" -o camera.yaml --csv views.csv --draw drawn --undistorted straight --json
expect_status 0
python3 - stdout.txt <<'END' || fail "the camera of left*.jpg is not what it should be"
import json, sys
lines = [json.loads(l) for l in open(sys.argv[1])]
assert len(lines) == 14
for line in lines[:-1]:
    assert line["found"] and line["used"] and line["points"] == 54 and line["rms"] < 0.5, line
summary = lines[-1]
assert summary["camera"] == "camera.yaml" and summary["used"] == 13
assert summary["rms"] <= 0.41 and abs(summary["fx"] - 534) < 3, summary
assert 0 < summary["deviations"]["fx"] < 2 and len(summary["distortion"]) == 5
assert summary["missing"], summary
END
[ "$(wc -l <views.csv)" -eq 14 ] || fail "views.csv has $(wc -l <views.csv) lines"
for file in drawn/left01.png drawn/coverage.png straight/left14.png straight/camera.yaml; do
  [ -s $file ] || fail "no $file"
done
grep -q '^model: pinhole' camera.yaml || fail "camera.yaml"
run calibrate "$images"/right[01][1-5].jpg "${board[@]}" -o right.yml --format opencv
expect_status 0
expect_out '9 views' 'fx 53'
grep -q '!!opencv-matrix' right.yml || fail "right.yml is not OpenCV's"
run calibrate "${left[@]:0:8}" "${board[@]}" -o cameras.txt --format colmap --lens rational --quiet
expect_status 0
grep -q '^1 FULL_OPENCV 640 480' cameras.txt || fail "cameras.txt"
# What it wrote is read by the others; a fisheye is refused where it cannot be used.
run calibrate "${left[@]}" "${board[@]}" -o fish.yaml --lens fisheye
expect_status 0
run sfm reconstruct "${left[@]:0:2}" --camera-file fish.yaml -o model
expect_status 3
expect_error 'fisheye'

run calibrate "${left[0]}" "${board[@]}" -o one.yaml
expect_status 3
expect_error '1 view' 'at least 3'
[ ! -e one.yaml ] || fail "a camera of one view was written"
mkdir alike
for i in 1 2 3 4 5; do cp "${left[0]}" alike/$i.jpg; done
run calibrate alike "${board[@]}"
expect_status 3
expect_error 'stands still'
run calibrate "${left[@]:0:2}" --board chess:8x5 --square 25mm
expect_status 1
grep -q 'chess:9x6' stderr.txt || fail "the size that is there is not told: $err"
run calibrate "$images/home.jpg" "$images/box.png" "${board[@]}" --json
expect_status 1
run calibrate "${left[@]}" "${board[@]}" -o /proc/nowhere/c.yaml
expect_status 6

# Interrupted: no file, status 130.
"$TARSIER" calibrate 'synth:board?frames=100000' "${board[@]}" -o stopped.yaml >/dev/null 2>&1 </dev/null &
program=$!
wait_until_ready $program
kill -INT $program
status=0
wait $program || status=$?
command_line="interrupted calibrate" err=
expect_status 130
[ ! -e stopped.yaml ] || fail "an interrupted run wrote a camera"
finish
