#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm dense: one line for each error of a model; it resumes after a kill; no image is skipped silently.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 5 --size 200x150 --depth --quiet
expect_status 0
model=scene/truth/sparse
dense=(sfm dense --images scene/images --quality draft --threads 1)
field() { # field FILE EXPRESSION: of a JSON file, as `j`
  python3 -c 'import json, sys; j = json.load(open(sys.argv[1])); print(eval(sys.argv[2]))' "$1" "$2"
}
# make_changed_model NAME SCRIPT: a copy of the model whose lines (of cameras, images or points, as lists of words) SCRIPT changes
make_changed_model() {
  cp -r $model "$1"
  python3 - "$1" "$2" <<'PY'
import sys
folder, script = sys.argv[1:]
read = lambda name: [line.split() for line in open(f"{folder}/{name}.txt") if not line.startswith("#")]
cameras, images, points = read("cameras"), read("images"), read("points3D")
exec(script)
for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
    open(f"{folder}/{name}.txt", "w").writelines(" ".join(line) + "\n" for line in lines)
PY
}

# --- what is no model ---
run "${dense[@]}" scene/images -o none
expect_status 3
expect_error 'scene/images: is not a model: give a folder made by'
[ ! -e none ] || fail 'a refused model left a folder'

# --- whole: depths of all images, a cloud, a page ---
run "${dense[@]}" $model -o whole --json
expect_status 0
[ -s whole/fused.ply ] && [ -s whole/view.png ] && [ -s whole/view.html ] || fail "files of a whole run: $(ls whole)"
[ "$(field whole/dense.json 'len(j["images"]) == 5 and all(i["known"] > 0.4 for i in j["images"])')" = True ] || fail "dense.json: $(cat whole/dense.json)"

# --- killed in the matching: the same command goes on, to the same bytes ---
"$TARSIER" "${dense[@]}" $model -o killed >/dev/null 2>&1 </dev/null &
program=$!
for _ in $(seq 15000); do
  compgen -G 'killed/stereo/state/*.photometric.json' >/dev/null && break
  kill -0 $program 2>/dev/null || break
  sleep 0.02
done
kill -KILL $program 2>/dev/null
wait $program 2>/dev/null; :
first=$(compgen -G 'killed/stereo/depth_maps/*.photometric.bin' | head -n 1)
before=$(stat -c %Y.%i "$first")
run "${dense[@]}" $model -o killed
expect_status 0
cmp -s killed/fused.ply whole/fused.ply || fail "killed and continued: another cloud"
[ "$(stat -c %Y.%i "$first")" = "$before" ] || fail "$first was made again"

# --- an image that shares nothing with others is named, with the reason ---
make_changed_model lonely 'images[0][5:8] = ["1000", "0", "0"]'
run "${dense[@]}" lonely -o lonely-dense
expect_status 0
grep -q '0000.jpg' stderr.txt || fail "no word of the image that is left out: $err"
[ "$(field lonely-dense/dense.json 'bool(j["images"][0]["reason"])')" = True ] || fail "no reason in dense.json"

# --- nothing can be done: one line, and why ---
make_changed_model one 'images[2:] = []; points[:] = []'
run "${dense[@]}" one -o no
expect_status 3
expect_error
make_changed_model same 'images[1::2] = images[1::2]
for i in range(2, len(images), 2): images[i][1:8] = images[0][1:8]'
run "${dense[@]}" same -o no
expect_status 3
expect_error 'taken from the same position as the others'
make_changed_model nan 'points[0][1] = "nan"'
run "${dense[@]}" nan -o no
expect_status 3
expect_error points3D
make_changed_model tilted 'images[0][1:5] = ["nan", "0", "0", "0"]'
run "${dense[@]}" tilted -o no
expect_status 3
expect_error images.txt
[ ! -e no/fused.ply ] || fail "a cloud of nothing"

# --- a range of depths where nothing is: an empty cloud, and the status says so ---
run "${dense[@]}" $model -o far --min-depth 500 --max-depth 600
expect_status 1
run "${dense[@]}" $model -o far --min-depth 6 --max-depth 5
expect_status 2
expect_error min-depth

# --- a plane, which has no depth of its own to hold on to ---
run sfm synth -o flat --content plane --images 4 --size 200x150 --depth
run sfm dense flat/truth/sparse --images flat/images -o flat-dense --quality draft --threads 1 --json
expect_status 0
[ "$(field flat-dense/dense.json 'min(i["known"] for i in j["images"]) > 0.6')" = True ] || fail "a plane: $(cat flat-dense/dense.json)"
run sfm eval flat-dense --dense --truth flat/truth --json
python3 -c 'import json, sys; sys.exit(not json.loads(sys.argv[1])["depth_median"] < 0.003)' "$out" || fail "depths of a plane: $out"

# --- flat images, whose rounded sides differ from their aspect ratio by more than 1 % ---
run sfm synth -o strip --images 3 --size 1280x162 --focal 900 --depth
run sfm dense strip/truth/sparse --images strip/images -o strip-dense --quality draft
expect_status 0

# --- a folder with a binary model in sparse/, as COLMAP makes it ---
run sfm reconstruct strip/images --camera-file strip/camera.yaml --export binary -o strip-model
mkdir -p theirs/sparse
cp strip-model/*.bin theirs/sparse
run sfm dense theirs --images strip/images -o theirs-dense --quality draft
expect_status 0

# --- a full disk (files may not grow beyond 40 kB): status 6, and no broken file ---
(
  ulimit -f 40
  trap '' XFSZ
  "$TARSIER" "${dense[@]}" $model -o full >stdout.txt 2>stderr.txt </dev/null
  echo $? >full.status
) 2>/dev/null
status=$(cat full.status) err=$(cat stderr.txt) command_line="sfm dense on a full disk"
expect_status 6
[ -z "$(find full -name '*.bin' -o -name 'fused.ply')" ] || fail "half-written files: $(find full -type f)"
run "${dense[@]}" $model -o full
expect_status 0
cmp -s full/fused.ply whole/fused.ply || fail "after a full disk: another cloud"

# --- 1 GB ---
(
  ulimit -v 2000000
  "$TARSIER" "${dense[@]}" $model -o small --memory 1GB >stdout.txt 2>stderr.txt </dev/null
  echo $? >small.status
)
status=$(cat small.status) err=$(cat stderr.txt) command_line="sfm dense --memory 1GB"
expect_status 0
cmp -s small/fused.ply whole/fused.ply || fail "--memory 1GB: another cloud"
finish
