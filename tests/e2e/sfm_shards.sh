#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm plan, features, match, map: shards in any order, one of them killed, give the model of `sfm reconstruct` to the
# byte; what is missing or broken is named with the command that makes it; the script for Slurm submits all stages.
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
broken match-1-of-3 'is not the file that its .done describes' cat work/match-2-of-3
broken features-3-of-3 'run: tarsier sfm features work --shard 3/3' head -c 0
broken match-1-of-3.done 'run: tarsier sfm match' sed 's/"version":1/"version":9/'
broken match-1-of-3.done 'is of another plan' sed 's/"plan":"[0-9a-f]*"/"plan":"00"/'
broken match-1-of-3.done 'run: tarsier sfm match' printf '[[[['
broken plan.json 'plan.json: is no plan' sed 's/"shards": 3/"shards": 0/'
broken plan.json 'max_count' sed 's/"max_count": 500/"max_count": -1/'
cp scene/images/0000.jpg original.jpg
cp scene/images/0001.jpg scene/images/0000.jpg
rm work/features-1-of-3.done
run sfm features work --shard 1/$N
expect_status 3
expect_error '0000.jpg: is not the image that was planned'
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
grep -q 'job 4 makes' stdout.txt || fail "sfm.sbatch says: $(cat stdout.txt)"
same_as_whole 'slurm work/model' 'Slurm' # each image with all 11 others is all with all
finish
