#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm and COLMAP's files: our own come back, and where COLMAP is installed either program goes on with the other's work.
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

# good FOLDER WHAT
good() {
  local registered hundredths
  read -r registered hundredths <<<"$(error_of "$1")"
  [ "$registered" -eq 6 ] && [ "$hundredths" -le 10 ] || fail "$2: $registered images, $hundredths/100 % off"
}

mkdir binary
cp model/*.bin binary/
[ "$(error_of binary)" = "$(error_of model)" ] || fail "the binary model is another one than the text model"
run sfm reconstruct scene/images --database model/database.db --no-cache -o again
expect_status 0
good again "from our own database"

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
case $err$out in *"has no image of this name"*) ;; *) fail "images that the database does not know: $err" ;; esac

command -v colmap >/dev/null || { echo "COLMAP is not installed: what it makes of the files was not tried"; finish; }
export QT_QPA_PLATFORM=offscreen
fixed=(--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0)
mkdir theirs adjusted triangulated
colmap mapper --database_path model/database.db --image_path scene/images --output_path theirs "${fixed[@]}" >colmap.log 2>&1 </dev/null ||
  fail "colmap mapper"
good theirs/0 "COLMAP's mapper on our database"
colmap bundle_adjuster --input_path binary --output_path adjusted --BundleAdjustment.refine_focal_length 0 \
  --BundleAdjustment.refine_extra_params 0 >>colmap.log 2>&1 </dev/null || fail "colmap bundle_adjuster"
good adjusted "COLMAP's adjustment of our model"
colmap point_triangulator --database_path model/database.db --image_path scene/images --input_path binary --output_path triangulated \
  >>colmap.log 2>&1 </dev/null || fail "colmap point_triangulator"
good triangulated "COLMAP's points for our cameras"
{
  colmap feature_extractor --database_path own.db --image_path scene/images --SiftExtraction.use_gpu 0 \
    --SiftExtraction.max_num_features 1500 &&
    colmap exhaustive_matcher --database_path own.db --SiftMatching.use_gpu 0
} >>colmap.log 2>&1 </dev/null || fail "COLMAP's features and matches"
run sfm reconstruct scene/images --database own.db --camera-file scene/camera.yaml --no-cache -o from-colmap
expect_status 0
good from-colmap "our mapper on COLMAP's database"

# Its fusion of our dense workspace: the points lie where ours are. Its Poisson surface is read.
run sfm synth -o dense-scene --images 5 --size 240x180 --depth --quiet
expect_status 0
run sfm dense dense-scene/truth/sparse --images dense-scene/images -o dense --threads 1 --quiet
expect_status 0
colmap stereo_fusion --workspace_path dense --output_path dense/fused.ply --StereoFusion.min_num_pixels 3 >>colmap.log 2>&1 </dev/null ||
  fail "colmap stereo_fusion"
# exact FIELD WHAT: of the cloud or the surface at least 90 % is within 1 % of the extent.
exact() {
  python3 -c "import json, sys; sys.exit(not json.loads(sys.argv[1])$1[2]['accuracy'] >= 0.9)" "$out" || fail "$2: $out"
}
run sfm eval dense --dense --truth dense-scene/truth --json
expect_status 0
exact '["cloud"]' "COLMAP's fusion of our depth maps"
colmap poisson_mesher --input_path dense/fused.ply --output_path poisson.ply --PoissonMeshing.trim 7 >>colmap.log 2>&1 </dev/null ||
  fail "colmap poisson_mesher"
run sfm eval dense --dense --mesh poisson.ply --truth dense-scene/truth --json
expect_status 0
exact '["mesh"]["thresholds"]' "COLMAP's surface of our depth maps"
finish
