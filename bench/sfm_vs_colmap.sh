#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm_vs_colmap.sh PROGRAM FOLDER..: reconstructs each folder (images/, K.txt, gt.jsonl) with `tarsier` and with COLMAP
# (Debian's colmap, CPU), the camera known and fixed, and prints CPU seconds, peak memory and the error of the cameras.
set -euo pipefail
tarsier=$(realpath "${1:?the built program}")
shift
command -v colmap >/dev/null || { echo "apt-get install colmap" >&2; exit 3; }
command -v /usr/bin/time >/dev/null || { echo "apt-get install time" >&2; exit 3; }
export QT_QPA_PLATFORM=offscreen
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

measured() { # measured NAME COMMAND..: CPU seconds and peak KB into $work/NAME
  local name=$1
  shift
  /usr/bin/time -a -o "$work/$name" -f '%U %S %M' "$@" >"$work/log" 2>&1 || { tail -n 5 "$work/log" >&2; exit 1; }
}
row() { # row SET PROGRAM TIMES MODEL TRUTH
  local cost errors
  cost=$(awk '{c += $1 + $2; if ($3 > m) m = $3} END {printf "%.0f CPU s, %.0f MB", c, m / 1024}' "$3")
  errors=$("$tarsier" sfm eval "$4" --truth "$5" --json)
  printf '%-16s %-8s %s  %s\n' "$1" "$2" "$cost" "$errors"
}

for folder in "$@"; do
  set_name=$(basename "$folder")
  out=$work/$set_name
  mkdir -p "$out/colmap"
  measured "$set_name.t" "$tarsier" sfm reconstruct "$folder/images" --camera-file "$folder/K.txt" -o "$out/tarsier" --quiet
  row "$set_name" tarsier "$work/$set_name.t" "$out/tarsier" "$folder/gt.jsonl"
  # COLMAP's pixel centres lie at one half.
  camera=$(awk '{k[NR] = $0} END {split(k[1], a); split(k[2], b); printf "%s,%s,%s,%s", a[1], b[2], a[3] + 0.5, b[3] + 0.5}' "$folder/K.txt")
  measured "$set_name.c" colmap feature_extractor --database_path "$out/db" --image_path "$folder/images" \
    --ImageReader.single_camera 1 --ImageReader.camera_model PINHOLE --ImageReader.camera_params "$camera" --SiftExtraction.use_gpu 0
  measured "$set_name.c" colmap exhaustive_matcher --database_path "$out/db" --SiftMatching.use_gpu 0
  measured "$set_name.c" colmap mapper --database_path "$out/db" --image_path "$folder/images" --output_path "$out/colmap" \
    --Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_principal_point 0 --Mapper.ba_refine_extra_params 0
  colmap model_converter --input_path "$out/colmap/0" --output_path "$out/colmap/0" --output_type TXT >/dev/null
  row "$set_name" colmap "$work/$set_name.c" "$out/colmap/0" "$folder/gt.jsonl"
done
