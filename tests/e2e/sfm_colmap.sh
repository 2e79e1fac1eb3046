#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm and COLMAP's files: our files are read back, and if COLMAP is installed each program continues the other's work.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 6 --size 400x300 --seed 3
expect_status 0
common=(--camera-file scene/camera.yaml --max-features 1200 --no-cache)
run sfm reconstruct scene/images "${common[@]}" -o model --export database binary
expect_status 0
for file in cameras.bin images.bin points3D.bin database.db; do
  [ -s "model/$file" ] || fail "no $file"
done

# error_of FOLDER: registered images, and the mean error of their centres in hundredths of a percent of the extent.
error_of() {
  run sfm eval "$1" --truth scene/truth.jsonl
  awk '$1 == "registered" {n = $2} $1 == "center_mean_percent" {e = $2} END {printf "%d %d", n, 100 * e + 0.5}' stdout.txt
}

# expect_accurate FOLDER WHAT
expect_accurate() {
  local registered hundredths
  read -r registered hundredths <<<"$(error_of "$1")"
  [ "$registered" -eq 6 ] && [ "$hundredths" -le 10 ] || fail "$2: $registered images, $hundredths/100 % off"
}

mkdir binary
cp model/*.bin binary/
[ "$(error_of binary)" = "$(error_of model)" ] || fail "the binary model is another one than the text model"
run sfm reconstruct scene/images --database model/database.db --no-cache -o again
expect_status 0
expect_accurate again "from our own database"

# --- what cannot go on ---
run sfm reconstruct scene/images --database none.db -o none
expect_status 3
printf 'text' >text.db
run sfm reconstruct scene/images --database text.db -o none
expect_status 3
run sfm reconstruct scene/images --database model/database.db --matches flow -o none
expect_status 2
cp model/database.db other.db
python3 - <<'PY'
import sqlite3
with sqlite3.connect("other.db") as db:
    db.execute("UPDATE images SET name = 'x' || name")
PY
run sfm reconstruct scene/images --database other.db --no-cache -o none
expect_status 1
case $err$out in *"contains no image with this name"*) ;; *) fail "images that the database does not know: $err" ;; esac

# --- pose priors of a database, as COLMAP 4 writes them: the place of a model ---
run sfm synth --observations --trajectory ring --images 24 --seed 3 -o priors
expect_status 0
run sfm reconstruct --database priors/database.db --align gps -o none
expect_status 3
expect_error '0 of 24 images have a position in EXIF or in the database'
# with_priors FILE SYSTEM: a copy of the database; its priors are the true positions, or places on the Earth.
with_priors() {
  cp priors/database.db "$1"
  python3 - "$1" "$2" <<'PY'
import json, sqlite3, struct, sys
path, system = sys.argv[1], int(sys.argv[2])
truth = {line["name"]: line["C"] for line in map(json.loads, open("priors/truth.jsonl"))}
with sqlite3.connect(path) as db:
    db.execute("""CREATE TABLE pose_priors (pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER NOT NULL,
        corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT NULL, position BLOB, position_covariance BLOB, gravity BLOB,
        coordinate_system INTEGER NOT NULL)""")
    for image, name in db.execute("SELECT image_id, name FROM images").fetchall():
        x, y, z = truth[name]
        if system == 0:  # about 47 N 8 E, metres as degrees
            x, y, z = 47 + y / 111176, 8 + x / 76055, 400 + z
        db.execute("INSERT INTO pose_priors VALUES (?, ?, 1, 0, ?, NULL, NULL, ?)",
                   (100 - image, image, struct.pack("<3d", x, y, z), system))
PY
}
with_priors cartesian.db 1
run sfm reconstruct --database cartesian.db --align gps -o cartesian
expect_status 0
python3 - <<'PY' || fail "cartesian pose priors do not place the model"
import json
aligned = json.load(open("cartesian/report.json"))["placed"]["aligned"]
assert aligned["images"] == 24 and aligned["mean_residual"] < 0.05, aligned
PY
with_priors wgs84.db 0
run sfm reconstruct --database wgs84.db --align gps -o wgs84
expect_status 0
python3 - <<'PY' || fail "pose priors in degrees do not place the model"
import json
aligned, cartesian = (json.load(open(name + "/report.json"))["placed"]["aligned"] for name in ("wgs84", "cartesian"))
assert aligned["images"] == 24 and aligned["mean_residual"] < 0.05, aligned
assert abs(aligned["scale"] / cartesian["scale"] - 1) < 0.01, (aligned, cartesian)
PY
python3 - <<'PY'
import sqlite3
with sqlite3.connect("wgs84.db") as db:
    db.execute("UPDATE pose_priors SET position = zeroblob(23) WHERE corr_data_id = 2")
PY
run sfm reconstruct --database wgs84.db --align gps -o none
expect_status 3
expect_error 'pose prior of image 2: 23 bytes for 3 numbers'
run sfm reconstruct --database wgs84.db -o cartesian # not read without --align
expect_status 0

# --- from a model ---
run sfm synth -o twelve --images 12 --size 320x240 --seed 3
expect_status 0
mkdir eight nine
cp twelve/images/000[0-7].jpg eight/
cp twelve/images/000[1-9].jpg nine/
fewer=(--max-features 800 --no-cache)
lens=(--camera-file twelve/camera.yaml)
run sfm reconstruct eight "${fewer[@]}" "${lens[@]}" -o of-eight --export binary
expect_status 0
# expect_all_twelve FOLDER WHAT
expect_all_twelve() {
  run sfm eval "$1" --truth twelve/truth.jsonl
  awk '$1 == "registered" {n = $2} $1 == "center_mean_percent" {e = $2} END {exit !(n == 12 && e <= 0.1)}' stdout.txt || fail "$2: $out"
}
# Text and binary, with the lens of the model, which four more images share.
mkdir eight-binary
cp of-eight/*.bin eight-binary/
for model in of-eight eight-binary; do
  run sfm reconstruct twelve/images "${fewer[@]}" --start-model "$model" -o "on-$model"
  expect_status 0
  expect_out 'start model: 8 of 8 images'
  expect_out 'model 0: 12 of 12 images'
  expect_all_twelve "on-$model" "going on from $model"
done
for file in cameras.txt images.txt points3D.txt; do
  cmp "on-of-eight/$file" "on-eight-binary/$file" || fail "the binary model gives another $file"
done
python3 - <<'PY' || fail "report.json does not say what it went on from"
import json
report = json.load(open("on-of-eight/report.json"))
start = report["start_model"]
assert start["images"] == start["here"] == start["registered"] == 8 and not start["fixed_poses"], start
assert {image["focal_from"] for image in report["images"]} == {"start model"}
assert report["models"][0]["cameras"][0]["distortion"] == [0, 0, 0, 0, 0]
PY
# same_poses FOLDER OTHER: those of the images that both have, to the last digits.
same_poses() {
  python3 - "$1" "$2" <<'PY'
import sys
def poses(folder):
    lines = [line for line in open(folder + "/images.txt").read().split("\n") if not line.startswith("#")]
    return {line.split()[9]: [float(x) for x in line.split()[1:8]] for line in lines[::2] if line}
a, b = (poses(folder) for folder in sys.argv[1:])
sys.exit(not all(abs(x - y) < 1e-12 for name in a.keys() & b.keys() for x, y in zip(a[name], b[name])))
PY
}
run sfm reconstruct twelve/images "${fewer[@]}" --start-model of-eight --fixed-poses -o fixed
expect_status 0
same_poses of-eight fixed || fail "fixed poses have moved"
expect_all_twelve fixed "with fixed poses"
same_poses of-eight on-of-eight && fail "nothing was adjusted"
run sfm reconstruct twelve/images "${fewer[@]}" --start-model of-eight --fixed-poses --only-start-images -o only
expect_status 0
expect_out 'model 0: 8 of 12 images'
expect_out 'not registered: 0011.jpg: the image is not in the start model'
same_poses of-eight only || fail "fixed poses have moved"
run sfm reconstruct nine "${fewer[@]}" --start-model of-eight -o of-nine
expect_status 0
expect_out 'start model: 7 of 8 images'
case $err in *"1 of 8 images of this model are not among the inputs, for example '0000.jpg'"*) ;; *) fail "an image that is not here: $err" ;; esac

# What contradicts the matches is refused: a mirrored model. So is a lens that there is not, and what cannot be combined.
python3 - <<'PY'
import os, shutil
for folder in ("mirrored", "fisheye"):
    shutil.copytree("of-eight", folder, ignore=shutil.ignore_patterns("*.bin", "*.html", "*.ply", "*.png"))
lines = open("of-eight/images.txt").read().split("\n")
for i in [i for i, line in enumerate(lines) if line and not line.startswith("#")][::2]:
    words = lines[i].split(" ")
    q = [float(x) for x in words[1:8]]
    words[1:8] = map(repr, [q[0], q[1], -q[2], -q[3], -q[4], q[5], q[6]])
    lines[i] = " ".join(words)
open("mirrored/images.txt", "w").write("\n".join(lines))
open("fisheye/cameras.txt", "w").write("1 OPENCV_FISHEYE 320 240 320 320 160 120 0 0 0 0\n")
PY
run sfm reconstruct twelve/images "${fewer[@]}" --start-model mirrored -o none
expect_status 1
expect_out 'no model: the start model is rejected: it contradicts the matches'
run sfm reconstruct twelve/images "${fewer[@]}" --start-model fisheye -o none
expect_status 3
expect_error 'has a fisheye lens'
run sfm reconstruct scene/images --start-model of-eight -o none --only-start-images --no-cache
expect_status 1
case $err in *'400x300 px, but its camera in of-eight has 320x240 px'*) ;; *) fail "an image of another size: $err" ;; esac
run sfm reconstruct twelve/images --start-model none -o none
expect_status 3
expect_error 'cameras.txt'
run sfm reconstruct twelve/images --start-model of-eight --mapper global -o none
expect_status 2
expect_error 'start-model'
run sfm reconstruct twelve/images --fixed-poses -o none
expect_status 2
expect_error 'start-model'
run sfm reconstruct twelve/images --start-model of-eight --fixed-poses --align gps -o none
expect_status 2
expect_error 'fixed-poses'

# --- folders in a folder, as of several cameras ---
mkdir -p rig/cam0 rig/cam1
for i in 0 1 2; do
  cp "twelve/images/000$((2 * i)).jpg" "rig/cam0/000$i.jpg"
  cp "twelve/images/000$((2 * i + 1)).jpg" "rig/cam1/000$i.jpg"
done
run sfm reconstruct rig "${fewer[@]}" "${lens[@]}" -o rig/model --export database undistorted --match-images
expect_status 0
expect_out 'model 0: 6 of 6 images'
grep -q ' cam1/0002.jpg$' rig/model/images.txt || fail "no image is named by its folder"
for file in undistorted/images/cam0/0000.jpg undistorted/images/cam1/0000.jpg matches/cam0_0000-cam1_0000-0-3.jpg; do
  [ -s "rig/model/$file" ] || fail "no $file"
done
run sfm reconstruct rig --database rig/model/database.db --start-model rig/model --no-cache -o rig-again
expect_status 0
expect_out 'start model: 6 of 6 images'
expect_out 'model 0: 6 of 6 images'

command -v colmap >/dev/null || { echo "COLMAP is not installed: what it makes of the files was not tried"; finish; }
export QT_QPA_PLATFORM=offscreen
fixed=(--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0)
mkdir theirs adjusted triangulated
colmap mapper --database_path model/database.db --image_path scene/images --output_path theirs "${fixed[@]}" >colmap.log 2>&1 </dev/null ||
  fail "colmap mapper"
expect_accurate theirs/0 "COLMAP's mapper on our database"
colmap bundle_adjuster --input_path binary --output_path adjusted --BundleAdjustment.refine_focal_length 0 \
  --BundleAdjustment.refine_extra_params 0 >>colmap.log 2>&1 </dev/null || fail "colmap bundle_adjuster"
expect_accurate adjusted "COLMAP's adjustment of our model"
colmap point_triangulator --database_path model/database.db --image_path scene/images --input_path binary --output_path triangulated \
  >>colmap.log 2>&1 </dev/null || fail "colmap point_triangulator"
expect_accurate triangulated "COLMAP's points for our cameras"
{
  colmap feature_extractor --database_path own.db --image_path scene/images --SiftExtraction.use_gpu 0 \
    --SiftExtraction.max_num_features 1500 &&
    colmap exhaustive_matcher --database_path own.db --SiftMatching.use_gpu 0
} >>colmap.log 2>&1 </dev/null || fail "COLMAP's features and matches"
run sfm reconstruct scene/images --database own.db --camera-file scene/camera.yaml --no-cache -o from-colmap
expect_status 0
expect_accurate from-colmap "our mapper on COLMAP's database"

# Either program goes on from the other's model of four of the six images.
mkdir four theirs-of-four theirs-of-ours
cp scene/images/000[0-3].jpg four/
(cd four && printf '%s\n' *.jpg) >four.txt
colmap mapper --database_path own.db --image_path scene/images --image_list_path four.txt --output_path theirs-of-four >>colmap.log 2>&1 </dev/null ||
  fail "colmap mapper of four images"
run sfm reconstruct scene/images --database own.db --start-model theirs-of-four/0 --no-cache -o ours-of-theirs
expect_status 0
expect_out 'start model: 4 of 4 images'
# The lens is that of COLMAP's four images.
read -r registered hundredths <<<"$(error_of ours-of-theirs)"
[ "$registered" -eq 6 ] && [ "$hundredths" -le 60 ] || fail "our mapper on COLMAP's model: $registered images, $hundredths/100 % off"
run sfm reconstruct four "${common[@]}" -o four-model
expect_status 0
colmap mapper --database_path model/database.db --image_path scene/images --input_path four-model --output_path theirs-of-ours "${fixed[@]}" \
  >>colmap.log 2>&1 </dev/null || fail "colmap mapper on our model"
expect_accurate theirs-of-ours "COLMAP's mapper on our model"

# Its fusion of our dense workspace: the points lie where ours are. Its Poisson surface is read.
run sfm synth -o dense-scene --images 5 --size 240x180 --depth --quiet
expect_status 0
run sfm dense dense-scene/truth/sparse --images dense-scene/images -o dense --threads 1 --quiet
expect_status 0
colmap stereo_fusion --workspace_path dense --output_path dense/fused.ply --StereoFusion.min_num_pixels 3 >>colmap.log 2>&1 </dev/null ||
  fail "colmap stereo_fusion"
# expect_accurate_surface FIELD WHAT: of the cloud or the surface at least 90 % is within 1 % of the extent.
expect_accurate_surface() {
  python3 -c "import json, sys; sys.exit(not json.loads(sys.argv[1])$1[2]['accuracy'] >= 0.9)" "$out" || fail "$2: $out"
}
run sfm eval dense --dense --truth dense-scene/truth --json
expect_status 0
expect_accurate_surface '["cloud"]' "COLMAP's fusion of our depth maps"
colmap poisson_mesher --input_path dense/fused.ply --output_path poisson.ply --PoissonMeshing.trim 7 >>colmap.log 2>&1 </dev/null ||
  fail "colmap poisson_mesher"
run sfm eval dense --dense --mesh poisson.ply --truth dense-scene/truth --json
expect_status 0
expect_accurate_surface '["mesh"]["thresholds"]' "COLMAP's surface of our depth maps"
finish
