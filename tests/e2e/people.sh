#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# People: enrolling, naming, forgetting with proof, exporting, sightings, events, and errors.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
images=/usr/share/doc/opencv-doc/examples/data
[ -f "$images/messi5.jpg" ] || skip "needs the package opencv-doc"
[ -f "$images/ml.png" ] || skip "needs the package opencv-doc"
python=python3
$python -c 'import sqlite3' || skip "needs python3"
leo="$images/messi5.jpg"
lena="$images/ml.png" # a drawn face

# Nobody is there yet.
run people list
expect_status 3
expect_error 'people.db'
run people identify "$leo" --json
expect_status 3

# One person, by any name; small faces are said to be small.
run people enroll "../O'Brien \"Leo\" 日本" "$leo" --note "agreed, 2024-05-01" --json
case $status in
  0) ;;
  1) run people enroll "../O'Brien \"Leo\" 日本" "$leo" --note "agreed, 2024-05-01" --any-quality --json ;;
esac
expect_status 0
expect_out '"added":1' '"faces":1' '"same_as":\[\]'
[ "$(stat -c %a people.db)" = 600 ] || fail "the gallery can be read by others: $(stat -c %a people.db)"
name=$($python -c 'import json; print(json.load(open("stdout.txt"))["name"])')

# The same image is known; another person is not, but has a nearest label.
run people identify "$leo" --json
expect_status 0
expect_out '"image":"/usr/share/doc/opencv-doc/examples/data/messi5.jpg"' '"known":true' '"ms":'
run people identify "$lena" --json -o lena.png
expect_status 1
expect_out '"known":false' '"label":"../O'
[ -s lena.png ] || fail "no image"
run people verify "$name" "$leo"
expect_status 0
# The confidence is one half at the threshold, which depends on --far.
for far in 0.999 0.01 1e-9; do
  run people verify "$name" "$lena" --far "$far" --json
  expect_out '"same":(true.*"confidence":(1|0\.[5-9])|false.*"confidence":0(,|\.[0-4]))'
done
run people verify "$name" "$lena"
expect_status 1
run people verify nobody "$leo"
expect_status 3
expect_error 'nobody'

# Adding to a known person; somebody else; a second name for the same face is warned of.
run people enroll "$name" "$leo" --any-quality --json
expect_status 0
expect_out '"added":1,"faces":2'
run people enroll Lena "$lena" --any-quality --json
expect_status 0
run people enroll "Second name" "$leo" --any-quality --json
expect_status 0
expect_out '"same_as":\["../O'
grep -q 'one person, two names' stderr.txt || fail "two names for one face: no warning"
# One image under two names: what the other name keeps is no trace, and nothing is called proven.
run people forget "Second name" --yes --json
expect_status 0
expect_out '"proven":false' '"shared_with":\["../O' '"unproven":[1-9]'
run people list --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "two people expected: $out"
run people identify "$lena" --json
expect_status 0
expect_out '"label":"Lena"'

# An image without a face, one with several.
run people enroll Nobody "$images/blox.jpg"
expect_status 1
grep -q 'no face' stderr.txt || fail "no word about the missing face: $err"
# Something that is hardly a face: named with a mark, and not enrolled unless the user insists.
run people enroll Nobody "$images/graf1.png"
expect_status 1
grep -q 'uncertain face' stderr.txt || fail "no word about the uncertain face: $err"
run people identify "$images/graf1.png" --json
expect_status 1
expect_out '"known":false,"trusted":false'
run cartoon run "$leo" --mode none -o one.ppm --quiet
expect_status 0
$python - <<'END' || fail "no image of five faces"
with open("one.ppm", "rb") as file:
    assert file.readline() == b"P6\n"
    width, _ = map(int, file.readline().split())
    file.readline()
    pixels = file.read()
left, top, side = 190, 50, 120
grey = bytes([90]) * (3 * side)
def rows(faces):  # so many times the same face, twice as large
    for y in range(side):
        at = 3 * ((top + y) * width + left)
        row = pixels[at : at + 3 * side] * faces + grey * (3 - faces)
        wide = b"".join(row[i : i + 3] * 2 for i in range(0, len(row), 3))
        yield wide + wide
with open("five.ppm", "wb") as file:
    file.write(b"P6\n%d %d\n255\n" % (6 * side, 4 * side) + b"".join(rows(3)) + b"".join(rows(2)))
END
run people enroll Five five.ppm --any-quality
expect_status 1
grep -q 'several faces' stderr.txt || fail "five faces: $err"
run people enroll Five five.ppm --largest --any-quality
expect_status 0
run people forget Five --yes
expect_status 0

# Events and sightings.
run people identify "$leo" "$lena" --on-event 'cat >>events.jsonl' --keep 30d --json --csv named.csv
expect_status 0
[ "$(head -1 named.csv)" = frame,time,image,face,label,confidence,known,x,y,width,height ] || fail "heading of named.csv"
$python - "$name" <<'END' || fail "named.csv is not what --json says: $(cat named.csv)"
import csv, json, sys
rows = list(csv.DictReader(open("named.csv")))
lines = [json.loads(line) for line in open("stdout.txt") if '"faces"' in line]
faces = [(line["image"], face) for line in lines for face in line["faces"]]
assert len(rows) == len(faces) >= 2
for row, (image, face) in zip(rows, faces):
    assert row["image"] == image and row["label"] == face["label"] and (row["known"] == "1") == face["known"]
    assert [int(row[k]) for k in ("x", "y", "width", "height")] == face["box"]
    assert float(row["confidence"]) == face["confidence"]
assert rows[0]["label"] == sys.argv[1]
END
run people live "$leo" -o none --csv live.csv --json
expect_status 0
[ "$(wc -l <live.csv)" -eq 2 ] || fail "live.csv: $(cat live.csv)"
cut -d, -f3- live.csv | cmp -s - <(head -2 named.csv | cut -d, -f3-) || fail "live.csv: $(cat live.csv)"
[ "$(wc -l <events.jsonl)" -eq 2 ] || fail "two events expected: $(cat events.jsonl)"
$python -c 'import json; [json.loads(l)["label"] for l in open("events.jsonl")]' || fail "events are no JSON"
run people list --sightings --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq 2 ] || fail "two sightings expected: $out"
$python - <<'END'
import sqlite3
d = sqlite3.connect("people.db")
d.execute("UPDATE sighting SET time = 1000 WHERE id = 1")
d.commit()
END
run people list --keep 30d --json
expect_status 0
expect_out '"deleted":1,"kept":1'
run people identify "$leo" --keep nonsense
expect_status 2

# Export: images, a list that trains, JSON.
run people export -o out --json
expect_status 0
expect_out '"people":2'
[ "$(wc -l <out/faces.lst)" -eq 3 ] || fail "faces.lst: $(cat out/faces.lst)"
run people train --list out/faces.lst --raw -o model.json --json
expect_status 0
expect_out '"people":2'
run people identify out/person-1/face-1.png --model model.json --raw --json
expect_status 0
run people export -o out
expect_status 6
rm -rf out

# Looking inside.
run people show --face "$leo" -o inside.png
expect_status 0
[ -s inside.png ] || fail "no image of the inside"
run people show --stages "$leo" -o stages.png
expect_status 0

# Fisherfaces and Eigenfaces of the gallery; then the default again.
for algorithm in eigen fisher lbph default; do
  run people train --algorithm $algorithm --json
  expect_status 0
  expect_out "\"algorithm\":\"$algorithm\""
done

# Forgetting: asked for, then proven. A copy beside the gallery is found.
run people forget "$name"
expect_status 2
expect_error -- '--yes'
run people export -o all
expect_status 0
run people forget "$name" --yes --json
expect_status 6
grep -q 'all/person-' stderr.txt || fail "the export below the folder was not found: $err"
expect_out '"proven":false' '"left_in":\["'
rm -rf all
run people enroll "$name" "$leo" --any-quality --quiet
expect_status 0
cp people.db stolen.copy
run people forget "$name" --yes --json
expect_status 6
grep -q 'stolen.copy' stderr.txt || fail "the copy was not found: $err"
rm stolen.copy
run people enroll "$name" "$leo" --any-quality --quiet
expect_status 0
$python - <<'END'
import sqlite3
d = sqlite3.connect("people.db")
blob = [r for r in d.execute("SELECT crop, numbers FROM face JOIN person ON person.id = face.person LEFT JOIN template ON template.face = face.id WHERE name LIKE '%Leo%'")]
assert blob and all(b and t for b, t in blob)
open("../secret.bin", "wb").write(b"".join(b[60:] + (t or b"") for b, t in blob))
END
run people forget "$name" --yes --json
expect_status 0
expect_out '"proven":true' '"left_in":\[\]' 'people.db'
$python - <<'END' || fail "bytes of the face are left"
import os
secret = open("../secret.bin", "rb").read()
for entry in os.scandir("."):
    if entry.is_file():
        data = open(entry.path, "rb").read()
        for at in range(0, len(secret) - 32, 16):
            piece = secret[at:at + 32]
            assert len(set(piece)) < 8 or piece not in data, (entry.name, at)
END
rm ../secret.bin
run people identify "$leo" --json
expect_status 1
expect_out '"known":false'
run people forget "$name" --yes
expect_status 1

# Names and files that cannot be used.
for bad in '' "$(printf 'x%.0s' $(seq 10000))" $'a\nb' $'\xff'; do
  run people enroll "$bad" "$leo"
  expect_status 2
done
cp people.db version.db
$python -c 'import sqlite3; d = sqlite3.connect("version.db"); d.execute("PRAGMA user_version = 9"); d.commit()'
run people list --gallery version.db
expect_status 3
expect_error 'version.db' 'version 9'
noise 3000 >noise.db
run people list --gallery noise.db
expect_status 3
expect_error 'noise.db'
head -c 9000 people.db >cut.db
run people identify "$leo" --gallery cut.db
[ "$status" -eq 3 ] || [ "$status" -eq 6 ] || fail "a gallery cut short: status $status, $err"
$python - >locked.txt 2>&1 <<'END' &
import sqlite3, time
d = sqlite3.connect("people.db", isolation_level=None)
d.execute("BEGIN EXCLUSIVE")
open("locked.flag", "w").close()
time.sleep(1800)  # until it is killed below
END
locker=$!
for _ in $(seq 6000); do [ -e locked.flag ] && break; sleep 0.05; done
run people enroll Ann "$lena" --any-quality
expect_status 6
grep -q 'locked' stderr.txt || fail "locked: $err"
kill $locker 2>/dev/null
wait $locker 2>/dev/null

# Read-only: named from, not written to.
mkdir closed
cp people.db closed/
chmod 400 closed/people.db
chmod 500 closed
if [ "$(id -u)" -ne 0 ]; then
  run people identify "$lena" --gallery closed/people.db
  expect_status 0
  run people enroll Ann "$lena" --any-quality --gallery closed/people.db
  expect_status 6
  expect_error 'closed/people.db'
fi
chmod 700 closed
rm people.db*
run people enroll Ann "$lena" --any-quality --gallery /proc/nowhere/people.db
expect_status 6

# Lists and models that cannot be used.
printf '%s\tLena\n' "$lena" >one.lst
run people train --list one.lst --algorithm fisher -o x.json
expect_status 3
expect_error 'two people'
printf 'gone.png\tLena\n' >gone.lst
run people train --list gone.lst -o x.json
expect_status 3
echo '{' >broken.json
run people identify "$lena" --model broken.json
expect_status 5
expect_error 'broken.json'
run people train --list one.lst
expect_status 2
finish
