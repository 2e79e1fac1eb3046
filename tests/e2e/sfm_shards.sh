#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm plan, features, match, map, merge: shards in any order, one of them killed, give the model of `sfm reconstruct` to
# the byte. Missing and corrupt parts are named with the command that makes them. The Slurm script submits all stages.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"

run sfm synth -o scene --images 12 --size 320x240 --seed 5
expect_status 0
N=3
options=(--camera-file scene/camera.yaml --max-features 500)
run sfm reconstruct scene/images "${options[@]}" -o whole --quiet
expect_status 0
same_as_whole() { # same_as_whole FOLDER WHAT
  for file in cameras.txt images.txt points3D.txt points.ply; do
    cmp -s "$1/$file" "whole/$file" || fail "$2: another $file"
  done
}

run sfm plan scene/images "${options[@]}" -o 'my work' --shards $N --slurm --json
expect_status 0
expect_out '"images":12,"unreadable":0,"shards":3'
mv 'my work' kept
run sfm plan scene/images "${options[@]}" -o work --shards $N
expect_status 0
expect_out '12 images, 3 shards'
expect_out 'seq 3 \| parallel -q'
cmp kept/plan.json work/plan.json || fail 'the same images and options give another plan'

# --- what is missing is named with its command ---
run sfm match work --shard 1/$N
expect_status 3
expect_error 'run: tarsier sfm features work --shard 1/3'
run sfm map work -o model
expect_status 3
expect_error '3 of 3 shards'
run sfm features work --shard 1/4
expect_status 2
expect_error 'the plan has 3 shards'
run sfm features nowhere
expect_status 3
expect_error 'there is no plan'

# --- a shard that is killed begins again with the same command ---
"$TARSIER" sfm features work --shard 2/$N --threads 1 --quiet >/dev/null 2>stderr.txt </dev/null &
program=$!
wait_until_ready $program # it is about to begin
kill -KILL $program 2>/dev/null
wait $program 2>/dev/null
for shard in 3 1; do
  run sfm features work --shard $shard/$N --threads $shard
  expect_status 0
done
if [ -e work/features-2-of-3.done ]; then
  printf 'note: the machine was too quick, the shard had ended\n'
  rm work/features-2-of-3*
fi
run sfm match work --shard 2/$N
expect_status 3
expect_error 'features-2-of-3: is (missing|not finished).*; run: tarsier sfm features work --shard 2/3'
run sfm features work --shard 2/$N --json
expect_status 0
expect_out '"stage":"features","shard":\[2,3\],"images":4,"left_out":0'
cp work/features-2-of-3 before
rm work/features-2-of-3.done
run sfm features work --shard 2/$N --threads 3
expect_status 0
cmp before work/features-2-of-3 || fail 'a shard that is done again has other bytes'
run sfm features work
expect_status 0
[ "$(grep -c 'done before' stdout.txt)" -eq 3 ] || fail "finished shards were done again: $out"

if command -v parallel >/dev/null; then
  seq $N | parallel -q -j2 "$TARSIER" sfm match work --threads 1 --quiet --shard "{}/$N" || fail 'GNU parallel'
else
  seq $N | xargs -P2 -I{} "$TARSIER" sfm match work --threads 1 --quiet --shard "{}/$N" || fail 'xargs'
fi
run sfm map work -o model --json
expect_status 0
same_as_whole model 'three shards'
run sfm map work -o again --threads 1 --no-cache --export binary --turntable
expect_status 0
same_as_whole again 'one thread'
[ -s again/points3D.bin ] && [ -s again/turntable.gif ] || fail 'no further files'

# --- hostile and stale files: one line, with the command ---
broken() { # broken FILE PATTERN FILTER..: with what the filter makes of FILE in its place
  local file=work/$1 pattern=$2
  shift 2
  mv "$file" kept-file
  "$@" <kept-file >"$file"
  run sfm map work -o unused
  expect_status 3
  expect_error "$pattern"
  mv kept-file "$file"
}
broken match-1-of-3 'match-1-of-3: is damaged; run: tarsier sfm match work --shard 1/3' head -c 4000
broken match-1-of-3 'does not match the checksum in its .done file' cat work/match-2-of-3
broken features-3-of-3 'run: tarsier sfm features work --shard 3/3' head -c 0
broken match-1-of-3.done 'run: tarsier sfm match' sed 's/"version":[0-9]*/"version":99/'
broken match-1-of-3.done 'belongs to another plan' sed 's/"plan":"[0-9a-f]*"/"plan":"00"/'
broken match-1-of-3.done 'run: tarsier sfm match' printf '[[[['
broken plan.json 'plan.json: is not a plan' sed 's/"shards": 3/"shards": 0/'
broken plan.json 'max_count' sed 's/"max_count": 500/"max_count": -1/'
cp scene/images/0000.jpg original.jpg
cp scene/images/0001.jpg scene/images/0000.jpg
rm work/features-1-of-3.done
run sfm features work --shard 1/$N
expect_status 3
expect_error '0000.jpg: the image was changed after the plan was made'
cp original.jpg scene/images/0000.jpg

# --- Slurm: the script is one, and its stages do the work, in order ---
run sfm plan scene/images "${options[@]}" -o 'slurm work' --shards $N --pairs retrieval --nearest 11 --slurm
expect_status 0
expect_out "bash 'slurm work/sfm.sbatch'"
bash -n 'slurm work/sfm.sbatch' || fail 'sfm.sbatch is no script'
mkdir programs
cat >programs/sbatch <<'SBATCH'
#!/usr/bin/env bash
# Runs what it is given at once; an array one after the other.
array=
printf '%s\n' "$*" >>"$CALLS"
while [[ ${1:-} == --* ]]; do
  case $1 in
  --array) array=$2 ;;
  esac
  case $1 in
  --parsable | --requeue) shift ;;
  --*=*) shift ;;
  *) shift 2 ;;
  esac
done
if [ -n "$array" ]; then
  for SLURM_ARRAY_TASK_ID in $(seq "${array#1-}"); do
    export SLURM_ARRAY_TASK_ID
    bash "$@" >&2
  done
else
  bash "$@" >&2
fi
printf '%s;here\n' "$(wc -l <"$CALLS")"
SBATCH
chmod +x programs/sbatch
CALLS=$PWD/calls PATH=$PWD/programs:$PATH bash 'slurm work/sfm.sbatch' --time=10 >stdout.txt 2>stderr.txt </dev/null ||
  fail "sfm.sbatch: $(cat stderr.txt)"
[ "$(wc -l <calls)" -eq 4 ] || fail "sfm.sbatch: $(cat calls)"
grep -q 'afterany:3 .*stage-map' calls || fail "sfm.sbatch: the map does not wait: $(cat calls)"
grep -q -- '--array 1-3 .*stage-match' calls || fail "sfm.sbatch: no array of matches: $(cat calls)"
[ "$(grep -c -- '--time=10' calls)" -eq 4 ] || fail 'sfm.sbatch: flags of sbatch are lost'
grep -q 'job 4 writes the model' stdout.txt || fail "sfm.sbatch says: $(cat stdout.txt)"
same_as_whole 'slurm work/model' 'Slurm' # each image with all 11 others is all with all

# --- clusters: mapped apart, merged; missing ones are named; Slurm submits them ---
run sfm plan scene/images "${options[@]}" -o clusters --shards 2 --cluster-size 6 --slurm
expect_status 0
expect_out '12 images, 2 shards, 2 clusters' 'seq 2 \| parallel -q .* sfm map .* --cluster \{\}/2' 'sfm merge'
run sfm merge clusters -o merged
expect_status 3
expect_error 'run: tarsier sfm features clusters --shard 1/2'
run sfm features clusters
run sfm match clusters
run sfm map clusters --cluster 2/2 --json
expect_status 0
expect_out '"stage":"map","cluster":\[2,2\],"images":[0-9]+,"own":6,"registered":[0-9]+,"models":1,"was_done":false'
run sfm merge clusters -o merged
expect_status 3
expect_error 'model-1-of-2: is missing; run: tarsier sfm map clusters --cluster 1/2'
run sfm map clusters --cluster all --threads 3
expect_status 0
expect_out 'cluster 1/2: [0-9]+ images \(6 of its own\)' 'cluster 2/2: .*\(done before\)'
cp clusters/model-2-of-2 before
rm clusters/model-2-of-2*
run sfm map clusters --cluster 2/2 --threads 1 --no-cache
expect_status 0
cmp before clusters/model-2-of-2 || fail 'a cluster that is mapped again has other bytes'
run sfm merge clusters -o merged
expect_status 0
expect_out 'model 0: 12 of 12 images'
grep -q '"joined": true' merged/report.json || fail 'report.json does not say what was joined'
run sfm eval merged --truth scene/truth.jsonl --json
expect_status 0
python3 - stdout.txt <<'PY' || fail "the merged model is not exact: $out"
import json, sys
scores = json.load(open(sys.argv[1]))
sys.exit(not (scores["registered"] == 12 and scores["center_mean"] < 1e-3 * scores["extent"]))
PY
for bad in "clusters" "clusters --cluster 1/3" "clusters --cluster 1/2 -o x" "work --cluster 1/3" "clusters --cluster 1/2 --turntable"; do
  # shellcheck disable=SC2086
  run sfm map $bad
  expect_status 2
done
run sfm merge work -o x
expect_status 3
expect_error 'has no clusters'
rm -r calls clusters/model-*
CALLS=$PWD/calls PATH=$PWD/programs:$PATH bash clusters/sfm.sbatch >stdout.txt 2>stderr.txt </dev/null || fail "sfm.sbatch: $(cat stderr.txt)"
grep -q -- '--array 1-2 .*stage-clusters' calls || fail "sfm.sbatch: no array of clusters: $(cat calls)"
grep -q 'afterany:3 .*stage-merge' calls || fail "sfm.sbatch: the merge does not wait: $(cat calls)"
for file in cameras.txt images.txt points3D.txt; do
  cmp -s clusters/model/$file merged/$file || fail "clusters by Slurm: another $file"
done

# --- scale and place, and further files, as of a single run ---
mkdir located
python3 - <<'PY'
# Writes the images with GPS in their EXIF, about 47 N 8 E; and positions.csv, which differs from it.
import json, struct
def degrees(angle):
    units = round(angle * 3600 * 100000)  # of 1e-5 arc seconds
    return struct.pack("<6I", units // (3600 * 100000), 1, units // (60 * 100000) % 60, 1, units % (60 * 100000), 100000)
def exif(latitude, longitude, altitude):
    def field(tag, kind, count, value):
        return struct.pack("<HHII", tag, kind, count, value)
    gps, data = 26, 26 + 2 + 5 * 12 + 4
    tiff = b"II" + struct.pack("<HIH", 42, 8, 1) + field(0x8825, 4, 1, gps) + struct.pack("<IH", 0, 5)
    tiff += field(1, 2, 2, ord("N")) + field(2, 5, 3, data) + field(3, 2, 2, ord("E")) + field(4, 5, 3, data + 24)
    tiff += field(6, 5, 1, data + 48) + struct.pack("<I", 0) + degrees(latitude) + degrees(longitude)
    tiff += struct.pack("<2I", round(altitude * 1000), 1000)
    return b"\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff
positions = ""
for line in map(json.loads, open("scene/truth.jsonl")):
    x, y, z = line["C"]
    image = open("scene/images/" + line["name"], "rb").read()
    open("located/" + line["name"], "wb").write(image[:2] + exif(47 + y / 111176, 8 + x / 76055, 400 + z) + image[2:])
    positions += "%s,%r,%r,%r\n" % (line["name"], 10 - z, y, x)
open("positions.csv", "w").write(positions)
PY
retrieval=("${options[@]}" --pairs retrieval --nearest 4)
exports=(--export binary database undistorted)
run sfm plan located "${retrieval[@]}" -o by-gps --shards 2 --cluster-size 6
run sfm features by-gps
run sfm match by-gps
run sfm plan located "${retrieval[@]}" -o by-csv --shards 2 --positions positions.csv
run sfm features by-csv
run sfm match by-csv
cmp -s by-gps/plan.json by-csv/plan.json && fail 'plan.json has no given positions'
for place in gps positions.csv; do
  run sfm reconstruct located "${retrieval[@]}" -o "single-$place" --align $place "${exports[@]}"
  expect_status 0
  work=by-gps
  [ $place = gps ] || work=by-csv
  run sfm map $work -o "mapped-$place" --align $place "${exports[@]}"
  expect_status 0
  for file in cameras.txt images.txt points3D.txt images.bin points3D.bin undistorted/sparse/images.txt; do
    cmp -s "single-$place/$file" "mapped-$place/$file" || fail "map --align $place: another $file"
  done
  [ -s "mapped-$place/database.db" ] || fail "map --align $place: no database.db"
done
run sfm map by-gps --cluster all
run sfm merge by-gps -o merged-gps --align gps "${exports[@]}"
expect_status 0
expect_out 'model 0: 12 of 12 images'
run sfm merge by-gps -o merged-distance --distance 2 --distance-between 0000.jpg 0011.jpg
expect_status 0
python3 - <<'PY' || fail 'scale and place of a merged model'
import json
def centers(folder):
    result = {}
    lines = [line.split() for line in open(folder + "/images.txt") if not line.startswith("#")][::2]
    for words in lines:
        w, x, y, z = map(float, words[1:5])
        t = list(map(float, words[5:8]))
        rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
        result[words[9]] = [-sum(rows[k][i] * t[k] for k in range(3)) for i in range(3)]
    return result
def distance(a, b):
    return sum((x - y) ** 2 for x, y in zip(a, b)) ** 0.5
merged, mapped = centers("merged-gps"), centers("mapped-gps")
assert len(merged) == 12
truth = {line["name"]: line["C"] for line in map(json.loads, open("scene/truth.jsonl"))}
mean = [sum(c[k] for c in truth.values()) / 12 for k in range(3)]
extent = max(distance(c, mean) for c in truth.values())
for name, center in merged.items():  # metres, the origin at the mean
    assert distance(center, mapped[name]) < 0.002 * extent, (name, center, mapped[name])
    assert distance(center, [truth[name][k] - mean[k] for k in range(3)]) < 0.01 * extent, (name, center)
scaled = centers("merged-distance")
assert abs(distance(scaled["0000.jpg"], scaled["0011.jpg"]) - 2) < 1e-6
PY
for file in points3D.bin database.db undistorted/images/0000.jpg; do
  [ -s "merged-gps/$file" ] || fail "merge: no $file"
done
run sfm merge by-gps -o merged-none --align positions.csv --distance 2 --distance-between 0000.jpg none.jpg
expect_status 2
printf 'none.jpg,0,0,0\n' >none.csv
run sfm plan located "${retrieval[@]}" -o none --positions none.csv
expect_status 3
expect_error "no name belongs to an image"
run sfm plan located "${retrieval[@]}" -o none --positions missing.csv
expect_status 3

# --- models of folders that share images ---
mkdir few
for k in 0 1 2 3 4 5 6 7; do ln -s "$PWD/scene/images/000$k.jpg" few/; done
run sfm reconstruct few "${options[@]}" -o first --quiet
rm few/*
for k in 04 05 06 07 08 09 10 11; do ln -s "$PWD/scene/images/00$k.jpg" few/; done
run sfm reconstruct few "${options[@]}" -o second --quiet
run sfm merge first second -o both
expect_status 0
expect_out 'model 0: 12 of 12 images'
run sfm merge first second -o both --align gps
expect_status 2
run sfm merge first second -o both-placed --align positions.csv --export binary
expect_status 0
grep -A1 '"aligned"' both-placed/report.json | grep -q '"images": 12' || fail 'merged folders: not aligned'
[ -s both-placed/points3D.bin ] || fail 'merged folders: no binary model'
run sfm merge first nowhere -o both
expect_status 3
expect_error 'nowhere'
rm few/*
for k in 07 08 09 10 11; do ln -s "$PWD/scene/images/00$k.jpg" few/; done
run sfm reconstruct few "${options[@]}" -o third --quiet
run sfm merge first third -o apart
expect_status 0
expect_out 'not joined: first and third: 1 image in common, 3 are needed'
[ -s apart/model-1/points3D.txt ] || fail 'what is not joined is not there'
finish
