#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# --shard, --jsonl, --resume and merge: shards that are killed and resumed give the bytes of one run.
. "$(dirname "$0")/lib.sh"

run ar synth markers -o drawn --count 14 --size 320x240
expect_status 0
mv drawn/images photos
printf 'no image\n' >photos/0007-broken.png
N=4

run ar markers photos --jsonl one.jsonl --csv one.csv
expect_status 0
grep -q '"ms"' one.jsonl && fail 'results have measured times'
[ "$(wc -l <one.jsonl)" -eq 14 ] || fail "one.jsonl has $(wc -l <one.jsonl) lines"
grep -q 'broken' one.jsonl.done || fail 'what could not be read is not noted'
run ar markers photos --json
sed 's/,"ms":[0-9.e-]*//' stdout.txt | cmp - one.jsonl || fail 'results are not the lines of --json'

shards() { # shards FLAGS..: all of them, two at a time
  if command -v parallel >/dev/null; then
    parallel -j2 "$TARSIER" ar markers photos --shard "{}/$N" --jsonl 'part-{}.jsonl' --csv 'part-{}.csv' --quiet "$@" ::: $(seq $N)
  else
    seq $N | xargs -P2 -I{} "$TARSIER" ar markers photos --shard "{}/$N" --jsonl 'part-{}.jsonl' --csv 'part-{}.csv' --quiet "$@"
  fi
}

# The shard with most images, killed when it has said its first line.
largest=$(for i in $(seq $N); do
  "$TARSIER" ar markers photos --shard "$i/$N" --json --quiet 2>/dev/null | wc -l | sed "s/$/ $i/"
done | sort -n | tail -1 | cut -d' ' -f2)
mkfifo lines
"$TARSIER" ar markers photos --shard "$largest/$N" --jsonl "part-$largest.jsonl" --csv "part-$largest.csv" --json --quiet >lines &
pid=$!
{
  read -r _
  kill -KILL $pid
  cat >/dev/null
} <lines
wait $pid 2>/dev/null
if [ -e "part-$largest.jsonl" ] || [ -e "part-$largest.csv" ]; then fail 'a killed run left a part'; fi
[ -s "part-$largest.jsonl.journal" ] || fail 'a killed run left no journal'
run merge "part-$largest.jsonl" -o all.jsonl
expect_status 3
expect_error "part-$largest.jsonl: no such part"
printf '{"input":3,"line":"{\\"ima' >>"part-$largest.jsonl.journal" # as if it was killed while it wrote

shards --resume 2>errors.txt || fail "shards: $(cat errors.txt)"
if ls ./*.journal >/dev/null 2>&1; then fail 'finished shards left a journal'; fi
before=$(stat -c %Y.%i part-1.jsonl)
shards --resume 2>errors.txt || fail "finished shards, again: $(cat errors.txt)"
[ "$before" = "$(stat -c %Y.%i part-1.jsonl)" ] || fail 'a finished shard was done again'
run merge part-*.jsonl -o all.jsonl --json
expect_status 0
expect_out '"shards":4,"inputs":15,"lines":14,"skipped":1'
run merge part-*.csv -o all.csv
expect_status 0
for file in jsonl jsonl.done csv csv.done; do
  cmp "all.$file" "one.$file" || fail "all.$file is not what one run gives"
done

# Merging says what is wrong.
run merge part-1.jsonl part-2.jsonl part-4.jsonl -o again.jsonl
expect_status 3
expect_error 'of which 1 is missing: 3$'
cp part-1.jsonl twice.jsonl
cp part-1.jsonl.done twice.jsonl.done
run merge part-*.jsonl twice.jsonl -o again.jsonl
expect_status 3
expect_error 'is shard 1/4, and so is'
run ar markers photos --shard 2/4 --jsonl part-2.jsonl --min-side 40
expect_status 0
run merge part-*.jsonl -o again.jsonl
expect_status 3
expect_error 'belongs to another batch than part-1.jsonl: different flags'
run ar markers photos --shard 2/4 --jsonl part-2.jsonl --resume
expect_status 3
expect_error 'part-2.jsonl: was written with other inputs, flags or another shard'
[ ! -e again.jsonl ] || fail 'a merge that failed left a file'

# A finished run whose results are missing or changed, or that had no table, is done again.
cp one.jsonl kept.jsonl
cp one.csv kept.csv
rm one.jsonl
run ar markers photos --jsonl one.jsonl --csv one.csv --resume
expect_status 0
printf 'fra' >one.csv
run ar markers photos --jsonl one.jsonl --csv one.csv --resume
expect_status 0
cmp one.jsonl kept.jsonl && cmp one.csv kept.csv || fail 'a missing result was not made again'
rm one.csv one.csv.done
run ar markers photos --jsonl one.jsonl --csv one.csv --resume
expect_status 0
cmp one.csv kept.csv || fail 'the table was not made by --resume'
run ar markers photos --jsonl two.jsonl --csv two.jsonl
expect_status 2
expect_error 'two.jsonl: is used by two flags'

# What is no batch of images.
run ar markers photos --shard 5/4
expect_status 2
expect_error '--shard 5/4: expected i/N'
run ar markers 'synth:scene' --shard 1/4
expect_status 3
expect_error 'synth:scene: is not an image'
run ar markers photos --jsonl x.jsonl --every 2
expect_status 2
expect_error 'not with --sequence, --frames, --every'
run ar markers photos --resume
expect_status 2
run cartoon run photos --shard 1/2
expect_status 2
expect_error 'need -o and no window'
mkdir -p twins/a twins/b
cp photos/0001.png twins/a 2>/dev/null || cp "$(ls -d photos/* | head -1)" twins/a
cp twins/a/* twins/b
run ar markers twins/a twins/b --shard 1/2 -o out/
expect_status 2
expect_error 'have the same file name'
run ar markers photos --jsonl missing/x.jsonl
expect_status 6

# Every verb that shares images so (sfm features and match have shards of a plan): two shards are one run. Nothing has to be found in a share.
run pose synth -o head --count 3 --size 320x240 --near 450 --far 500
expect_status 0
run ar target-train "$(ls -d head/images/* | head -1)" -o head.target.json --trials 2
expect_status 0
run people enroll Ann head/images --any-quality --gallery g.db
expect_status 0
known=$("$TARSIER" help --json | python3 -c 'import json, sys
print("\n".join(v["verb"] for v in json.load(sys.stdin)["verbs"] if {"--shard", "--jsonl"} <= {n for f in v["flags"] for n in f["names"]}))')
while read -r verb; do
  case $verb in
    'cartoon run' | 'people live') words=(head/images -o none) ;;
    'ar target-track') words=(head/images --target head.target.json) ;;
    'people identify') words=(head/images) ;;
    'people verify') words=(Ann head/images) ;;
    *) words=(head/images) ;;
  esac
  case $verb in people*) words+=(--gallery g.db) ;; esac
  # shellcheck disable=SC2086
  for part in 1/1 1/2 2/2; do
    run $verb "${words[@]}" --shard $part --jsonl "verb-${part/\//-}.jsonl" --quiet
    expect_status 0
  done
  run merge verb-1-2.jsonl verb-2-2.jsonl -o verb-all.jsonl
  cmp verb-all.jsonl verb-1-1.jsonl || fail "$verb: two shards are not one run"
  [ "$(wc -l <verb-all.jsonl)" -eq 3 ] || fail "$verb: $(wc -l <verb-all.jsonl) lines"
done <<<"$known"
[ "$(wc -l <<<"$known")" -ge 10 ] || fail "verbs with --shard: $known"
finish
