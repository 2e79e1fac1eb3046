#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The index of a gallery: its answers equal those of an exact search to the last digit; newer faces, files of another
# gallery, kills during its construction, and forgetting. The faces are synthetic.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
python3 -c 'import sqlite3' || skip "needs python3"

run pose synth -o heads --count 24 --people 12 --size 320x240 --yaw 6 --pitch 4 --roll 4 --spread 1 --near 450 --far 500 --quiet
expect_status 0
run people index --check
expect_status 3
run people enroll Ann heads/images/0000.png --any-quality --template classic
expect_status 0
run people enroll Ben heads/images/0001.png --any-quality
expect_status 0
python3 - people.db 560 <<'E2'
import math, random, sqlite3, struct, sys, zlib
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
def png(rows):
    head = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"".join(b"\0" + r for r in rows))) + chunk(b"IEND", b"")
database = sqlite3.connect(sys.argv[1])
for number in range(int(sys.argv[2])):
    r = random.Random(number)
    waves = [(r.uniform(.05, .3), r.uniform(0, 6)) for _ in range(4)]
    line = bytes(int(120 + sum(25 * math.sin(a * x + c) for a, c in waves)) for x in range(512))
    places = [int(190 + 190 * math.sin(waves[0][0] * y + waves[1][1])) for y in range(160)]
    rows = [line[place:place + 128] for place in places]
    person = database.execute("INSERT INTO person(name, note, time) VALUES(?, '', 1)", (f"nobody {number}",)).lastrowid
    database.execute("INSERT INTO face(person, crop, quality, measures, source, time) VALUES(?, ?, 0.5, '{}', 'drawn', 1)", (person, png(rows)))
database.execute("UPDATE setting SET value = CAST(CAST(value AS INTEGER) + 1 AS TEXT) WHERE name = 'generation'")
database.commit()
E2

# Few faces: no index is made, and that is said.
run people index
expect_status 1
grep -q '562 faces: with fewer than 20000 comparing all is as fast, no index is made' stderr.txt || fail "not told: $err"
[ ! -e people.db.index ] || fail "an index of a small gallery"
probes=(heads/images/0012.png heads/images/0013.png heads/images/0005.png)
identify_probes() { run people identify "${probes[@]}" --json; sed -E 's/,"ms":[0-9.]+//g' stdout.txt; }
identify_probes >exact.txt
grep -q '"label"' exact.txt || fail "nobody was found: $(cat exact.txt)"
run people index --check
expect_status 1
expect_out 'people.db.index: no index: all faces are compared'

# Made, the same whatever the threads and the memory, and the answers stay to the last digit.
run people index --min-faces 1 --threads 1 --json
expect_status 0
expect_out '"faces":562'
cp people.db.index one
run people index people.db --min-faces 1 --threads 3 --memory 0.01
expect_status 0
cmp -s one people.db.index || fail "the index depends on threads or memory"
[ "$(stat -c %a people.db.index)" = 600 ] || fail "others may read the index"
identify_probes >indexed.txt
cmp exact.txt indexed.txt || fail "answers differ from an exact search"
! grep -q 'not used' stderr.txt || fail "the index was not used: $(cat stderr.txt)"
run people index --check --json
expect_status 0
expect_out '"current":true' '"faces":562' '"newer":0'

# Who is enrolled afterwards is found, beside it.
run people enroll Cid heads/images/0005.png --any-quality
expect_status 0
run people identify heads/images/0017.png --json
expect_out '"label":"Cid"'
run people index --check
expect_status 0
expect_out '562 faces in it, 1 newer'

# Killed at any moment: an index that is whole, or none, and the gallery as it was.
for moment in 0.02 0.05 0.1 0.15 0.2 0.3 0.4 0.6; do
  { timeout -s KILL "$moment" "$TARSIER" people index --min-faces 1 --quiet; } >/dev/null 2>&1
  run people index --check
  expect_status 0
done
run people index --min-faces 1
expect_status 0
expect_out '563 faces in 32 cells|563 faces in 64 cells'
[ ! -e people.db.index.new ] || fail "something half-written was left"
identify_probes >exact.txt
cp people.db.index whole

# Files that are not the gallery's: one line, and the same answers.
expect_index_unused() { # what it says
  identify_probes >other.txt
  grep -q "people.db.index: $1.*: not used, all faces are compared" stderr.txt || fail "$1: $(cat stderr.txt)"
  cmp exact.txt other.txt || fail "$1: answers differ"
  [ "$(grep -c 'people.db.index' stderr.txt)" = 1 ] || fail "$1: more than a line: $(cat stderr.txt)"
  run people index --check
  expect_status 1
}
truncate -s -100 people.db.index; expect_index_unused 'is cut off'
head -c 10 whole >people.db.index; expect_index_unused 'is not an index of templates'
cp people.db people.db.index; expect_index_unused 'is not an index of templates'
cp one people.db.index; expect_index_unused 'is of another state of the gallery'
cp whole people.db.index
printf 'x' | dd of=people.db.index bs=1 seek=90 conv=notrunc status=none; expect_index_unused 'is damaged'
cp whole people.db.index
run people index --check
expect_status 0
size=$(stat -c %s people.db.index)
printf 'x' | dd of=people.db.index bs=1 seek=$((size - 5)) conv=notrunc status=none
run people index --check
expect_status 1
expect_out "is damaged: a cell's sum is another"
cp whole people.db.index

# Forgotten: nothing of an index is left that was learned from him.
cp people.db.index whole
run people forget Ben --yes --json
[ "$status" = 0 ] || [ "$status" = 6 ] || fail "forget: $status"
expect_out '"index":"deleted"'
[ ! -e people.db.index ] || fail "the index is still there"
run people index --min-faces 1 --quiet
expect_status 0
run people index --check
expect_status 0
expect_out '562 faces in it, 0 newer'
finish
