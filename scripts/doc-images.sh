#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# doc-images.sh [PROGRAM]: regenerates the images of docs/ from scenes that the program renders itself. Needs
# ImageMagick (montage) in addition to the built program.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
tarsier=${1:-build/release/bin/tarsier}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
source='synth:portrait?size=640x480&noise=2'

draw() { # draw MODE: the result, and its stages in $work/MODE
  "$tarsier" cartoon run "$source" --frames 1 --mode "$1" -o "$work/$1.png" --debug-dir "$work/$1" --quiet
}
sheet() { # sheet NAME COLUMNS FILE:LABEL..
  local name=$1 columns=$2 items=() item
  shift 2
  for item in "$@"; do items+=(-label "${item#*:}" "${item%%:*}"); done
  montage "${items[@]}" -font DejaVu-Sans -pointsize 15 -tile "${columns}x" -geometry "${size:-320x240}+4+4" -background white \
    -quality 88 "docs/img/$name.jpg"
}
stage() { # stage MODE NAME: the file of one stage
  find "$work/$1" -name "*-$2.png" | head -n 1
}

for mode in sketch paint cartoon evil evil-sketch alien smooth none; do draw "$mode"; done
sheet cartoon-modes 4 "$work/none.png:none" "$work/sketch.png:sketch" "$work/paint.png:paint" "$work/cartoon.png:cartoon" \
  "$work/evil.png:evil" "$work/evil-sketch.png:evil-sketch" "$work/alien.png:alien" "$work/smooth.png:smooth"
sheet cartoon-sketch 3 "$(stage sketch frame):the frame" "$(stage sketch grey):1 grey" "$(stage sketch median):2 median" \
  "$(stage sketch laplacian):3 Laplacian" "$(stage sketch threshold):4 threshold" "$(stage sketch pepper):5 without pepper"
sheet cartoon-paint 3 "$(stage cartoon half-size):half size" "$(stage cartoon painting):14 bilateral filters" \
  "$work/cartoon.png:with the lines: cartoon"
sheet cartoon-evil 3 "$(stage evil scharr):Scharr" "$(stage evil lines):threshold, median" "$work/evil.png:on the painting"
sheet cartoon-alien 3 "$(stage alien skin):the skin found" "$(stage alien coloured):coloured" "$work/alien.png:with the lines"

# Poses: drawings of the demo.
"$tarsier" demo --only pose -o "$work/demo" --quiet
size=600x360 sheet pose 2 "$work/demo/img/pose-cube.png:a cube of known size and its pose" "$work/demo/img/pose-head.png:the head that was learnt from flat images"

# People: heads that nobody has. Two are enrolled, the third is a stranger; the stages of a crop; strangers in groups.
"$tarsier" pose synth -o "$work/door" --count 24 --people 3 --spread 1.5 --near 450 --far 520 --yaw 14 --roll 10 --pitch 8 --size 320x240 --seed 9 --quiet
door() { # door NUMBER..: images of the heads
  local number
  for number in "$@"; do printf '%s/door/images/00%02d.png\n' "$work" "$number"; done
}
enroll() { # enroll NAME NUMBER..
  local name=$1 images=()
  shift
  mapfile -t images < <(door "$@")
  "$tarsier" people enroll "$name" "${images[@]}" --gallery "$work/people.db" --quiet >/dev/null
}
enroll Ann 1 4 7 10 13
enroll Bob 2 5 8 11 14
mapfile -t asked < <(door 18 19 20)
"$tarsier" people identify "${asked[@]}" --gallery "$work/people.db" -o "$work/named/" --quiet >/dev/null
convert "$work/named/0019.png" "$work/named/0020.png" "$work/named/0018.png" +append -quality 88 docs/img/people-named.jpg
"$tarsier" people show --stages "$work/door/images/0016.png" -o "$work/people-stages.png" --quiet
convert "$work/people-stages.png" -resize 50% -quality 88 docs/img/people-stages.jpg
"$tarsier" people identify "$work/door/images" --keep 3650d --gallery "$work/seen.db" --quiet >/dev/null || [ $? -eq 1 ] # nobody is known
"$tarsier" people group "$work/seen.db" --quiet >/dev/null
"$tarsier" people groups --gallery "$work/seen.db" --draw "$work/people-groups.png" --quiet >/dev/null
convert "$work/people-groups.png" -quality 88 docs/img/people-groups.jpg
# The window of `people live`, as the studio shows it through pipes.
"$tarsier" people name 2 Ann --gallery "$work/seen.db" --quiet >/dev/null
tests=$PWD/tests/e2e
(cd "$work" && TARSIER=$tarsier PYTHONPATH=$tests python3 - <<'PY'
from pipe_window import Session
window = Session(["people", "live", "door/images/0018.png", "--gallery", "seen.db", "--window", "--json"])
window.until("state", lambda: window.state)
window.send(action="groups")
window.until("list", lambda: window.state["state"]["panel"])
window.next_image("people-window.jpg")
window.close()
PY
)
cp "$work/people-window.jpg" docs/img/people-window.jpg

# Appearance models: the modes, and a fit, of faces that nobody has.
"$tarsier" aam explore --grid docs/img/aam-grid.png --modes 3 --cell 110 --quiet
"$tarsier" demo --only aam -o "$work/demo" --quiet
size=200x200 sheet aam-fit 6 "$work/demo/img/aam-fit-0.jpg:start" "$work/demo/img/aam-fit-1.jpg:step 1" \
  "$work/demo/img/aam-fit-2.jpg:step 2" "$work/demo/img/aam-fit-3.jpg:step 4" "$work/demo/img/aam-fit-4.jpg:end" \
  "$work/demo/img/aam-fit-made.jpg:the model's own face"

# Calibration: a drawn video of a board.
"$tarsier" calibrate 'synth:board?fps=5&frames=122' --board chess:9x6 --square 25mm --draw "$work/board" --undistorted "$work/straight" --quiet
size=400x300 sheet calibrate 3 "$work/board/frame-000019.png:a view, its corners" "$work/board/coverage.png:where the board was seen" \
  "$work/straight/frame-000019.png:straightened"

# Things on markers: a drawn desk.
"$tarsier" demo -o "$work/demo" --only markers --quiet
size=400x300 sheet ar 3 "$work/demo/img/markers-plain.jpg:what the camera sees" "$work/demo/img/markers-drawn.jpg:a painted box on each marker" \
  "$work/demo/img/markers-axes.jpg:axes"

# The strip at the top of the README: one image of the demo for each area, of what the program draws itself.
strip=()
"$tarsier" demo -o "$work/demo" --only cartoon,plate,sfm,landmarks,targets --quiet
for name in face-cartoon.jpg plate-0.jpg sfm-found.jpg landmarks-modes.png aam-grid.jpg pose-head.png markers-poster.jpg target-video-3.jpg; do
  part=$work/strip-$name
  case $name in # what matters lies elsewhere than in the middle
    plate-0.jpg) convert "$work/demo/img/$name" -gravity center -crop '50%x50%+0+60' +repage "$part" ;;
    aam-grid.jpg | landmarks-modes.png) convert "$work/demo/img/$name" -gravity north -crop '100%x50%+0+0' +repage "$part" ;;
    *) cp "$work/demo/img/$name" "$part" ;;
  esac
  convert "$part" -resize '300x200^' -gravity center -extent 300x200 "$part.png"
  strip+=("$part.png")
done
montage "${strip[@]}" -tile 4x -geometry 300x200+3+3 -background white -quality 86 docs/img/strip.jpg

# Number plates: a drawn car, the stages of both pipelines. The study of the reader (plate-sweep.png) needs the
# textbook's OCR.xml: tarsier plate sweep OCR.xml -o docs/img/plate-sweep.png
car='synth:car?seed=11&frames=2'
read_car() { # read_car NAME FLAGS..
  local name=$1
  shift
  "$tarsier" plate read "$car" -o "$work/$name-drawn/" --debug-dir "$work/$name" --quiet "$@"
}
car_stage() { find "$work/$1/0002-car-00001" -name "*-$2.png" | head -n 1; } # car_stage NAME STAGE
read_car plates
read_car classic --pipeline classic
size=440x248 sheet plate-stages 2 "$(car_stage plates detected):1 found" "$(car_stage plates aligned):2 aligned: plate, text" \
  "$(car_stage plates line-2):3 the line, straightened" "$work/plates-drawn/car-00001.png:4 read"
size=300x169 sheet plate-classic 3 "$(car_stage classic blurred):grey, blurred" "$(car_stage classic edges):vertical edges" \
  "$(car_stage classic threshold):Otsu's threshold" "$(car_stage classic closed):closed 17x3" \
  "$(car_stage classic candidates):candidates" "$(car_stage classic plate-1):characters"

# Structure from motion: a drawn scene, two of its images, a pair's matches, and the cloud.
"$tarsier" sfm synth -o "$work/scene" --images 8 --size 800x600 --quiet
"$tarsier" sfm reconstruct "$work/scene/images" --camera-file "$work/scene/camera.yaml" -o "$work/model" --match-images --quiet >/dev/null
size=430x260 sheet sfm-stages 2 "$work/scene/images/0002.jpg:1 one of the images" \
  "$work/model/matches/0002-0004.jpg:2 matches: kept green, removed red" "$work/model/view.png:3 cloud and cameras" \
  "$work/scene/images/0006.jpg:another image"

# .. All images at once, what repeats itself, models that share images, and what can be drawn.
"$tarsier" sfm synth -o "$work/flight" --trajectory grid --images 49 --size 400x300 --seed 5 --quiet
"$tarsier" sfm reconstruct "$work/flight/images" --camera-file "$work/flight/camera.yaml" -o "$work/flight-model" --mapper global --max-features 1000 \
  --debug-dir "$work/flight-stages" --quiet >/dev/null
size=320x240 sheet sfm-global 3 "$work/flight/images/0000.jpg:one of 49 images" "$work/flight-stages/grown-001-before.png:all positions, from the images' rays" \
  "$work/flight-stages/model-0.png:adjusted, with all points"
"$tarsier" sfm synth -o "$work/box" --content symmetric --details 0.1 --trajectory ring --images 36 --size 800x600 --focal 1400 --seed 2 --quiet
"$tarsier" sfm reconstruct "$work/box/images" --camera-file "$work/box/camera.yaml" -o "$work/box-model" --mapper global --debug-dir "$work/box-stages" --quiet >/dev/null
size=300x225 sheet sfm-repeats 4 "$work/box/images/0000.jpg:one side" "$work/box/images/0009.jpg:the next one" \
  "$work/box-stages/grown-013-after.png:the first model: folded" "$work/box-stages/model-0.png:the result: a box"
"$tarsier" sfm synth -o "$work/ring" --trajectory ring --images 60 --size 320x240 --seed 4 --quiet
images=("$work"/ring/images/*.jpg)
ring=(sfm reconstruct --camera-file "$work/ring/camera.yaml" --max-features 500 --quiet)
"$tarsier" "${ring[@]}" "${images[@]:0:33}" -o "$work/first" >/dev/null
"$tarsier" "${ring[@]}" "${images[@]:27:33}" "${images[@]:0:4}" -o "$work/second" >/dev/null
"$tarsier" sfm merge "$work/first" "$work/second" -o "$work/merged" --quiet >/dev/null
size=320x240 sheet sfm-merge 3 "$work/first/view.png:images 0 to 32" "$work/second/view.png:images 27 to 59 and 0 to 3" "$work/merged/view.png:merged: all 60"
for scene in walk city grid; do
  "$tarsier" sfm synth -o "$work/$scene" --trajectory "$scene" --images 20 --size 640x480 --quiet
done
"$tarsier" sfm synth -o "$work/temple" --trajectory ring --content temple --focal 1100 --images 60 --size 640x480 --quiet
size=300x225 sheet sfm-scenes 4 "$work/walk/images/0005.jpg:walk" "$work/city/images/0000.jpg:city" "$work/grid/images/0000.jpg:grid" \
  "$work/temple/images/0010.jpg:temple"

# Dense reconstruction: the stages of one image, and the cloud.
"$tarsier" sfm synth -o "$work/dense-scene" --size 1200x800 --depth --quiet
"$tarsier" sfm dense "$work/dense-scene/truth/sparse" --images "$work/dense-scene/images" -o "$work/dense" --debug-dir "$work/stages" --quiet >/dev/null
size=430x287 sheet dense-stages 3 "$work/dense-scene/images/0003.jpg:1 one of the images" "$work/stages/0003.jpg-depth.png:2 depth" \
  "$work/stages/0003.jpg-normal.png:3 normals" "$work/stages/0003.jpg-cost.png:4 cost: black is good" \
  "$work/stages/0003.jpg-kept.png:5 what others agree with" "$work/dense/view.png:6 cloud and cameras"

# The strip of the README's section: an image, the sparse cloud, the dense one, the surface.
"$tarsier" sfm synth -o "$work/strip-scene" --images 8 --size 640x480 --quiet
"$tarsier" sfm reconstruct "$work/strip-scene/images" --camera-file "$work/strip-scene/camera.yaml" -o "$work/strip-model" --quiet >/dev/null
"$tarsier" sfm dense "$work/strip-model" -o "$work/strip-dense" --quality draft --quiet >/dev/null
"$tarsier" sfm mesh "$work/strip-dense" -o "$work/strip.glb" --faces 60000 --texture 2048 --view "$work/strip.png" --quiet >/dev/null
size=300x225 sheet sfm-strip 4 "$work/strip-scene/images/0003.jpg:one of 8 images" "$work/strip-model/view.png:sparse" \
  "$work/strip-dense/view.png:dense" "$work/strip.png:surface"
