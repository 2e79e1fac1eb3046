#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate log: listing, searching, exporting and deleting, with corrupt, locked, full or foreign files. The test writes a
# file in the layout of the first version, which must stay readable.
. "$(dirname "$0")/lib.sh"
umask 077 # what others may open is warned of (media/sqlite_test)
command -v python3 >/dev/null || skip 'no python3'

python3 - <<'PY'
import sqlite3, time
db = sqlite3.connect("plates.db")
db.executescript("""PRAGMA auto_vacuum = INCREMENTAL; PRAGMA journal_mode = WAL;
CREATE TABLE plate(id INTEGER PRIMARY KEY AUTOINCREMENT, first_time INTEGER NOT NULL, last_time INTEGER NOT NULL,
  source TEXT NOT NULL, text TEXT NOT NULL, confidence REAL NOT NULL, country TEXT NOT NULL, frames INTEGER NOT NULL,
  x INTEGER NOT NULL, y INTEGER NOT NULL, w INTEGER NOT NULL, h INTEGER NOT NULL, candidates TEXT NOT NULL,
  readings TEXT NOT NULL, crop BLOB) STRICT;
CREATE INDEX plate_by_time ON plate(last_time);
PRAGMA application_id = 0x54504C31; PRAGMA user_version = 1;""")
now = int(time.time() * 1000)
day = 86400000
rows = [(now - 40 * day, "old, gate", "1234BCD"), (now - 20 * day, "cam", "1254BCF"), (now - 3600000, "cam", "M1204AB"), (now - 60000, "cam", "9999ZZZ")]
for first, source, text in rows:
    db.execute("INSERT INTO plate(first_time,last_time,source,text,confidence,country,frames,x,y,w,h,candidates,readings,crop) "
               "VALUES(?,?,?,?,0.9,'es',5,1,2,3,4,'[{\"text\":\"X\",\"confidence\":0.1}]','[]',?)",
               (first, first + 5000, source, text, None if text == "9999ZZZ" else b"\xff\xd8 image of " + text.encode()))
db.commit()
db.close()
PY
texts() { python3 -c 'import json; print(" ".join(json.loads(l)["text"] for l in open("stdout.txt")))'; }
expect_texts() { [ "$(texts)" = "$1" ] || fail "$command_line: $(texts), expected $1"; }

run plate log plates.db --json
expect_status 0
expect_texts '9999ZZZ M1204AB 1254BCF 1234BCD'
expect_out '"country":"es".*"box":\[1,2,3,4\],"candidates":\[\{.*"text":"X"' '"crop":false' '"first_time":"20..-..-..T..:..:.*Z"'
run plate log plates.db
expect_status 0
expect_out '^20.*  1234BCD .*90 %.*5 s.*old, gate$'
run plate log plates.db --text '12?4*' --json
expect_texts '1254BCF 1234BCD'
run plate log plates.db --text 'i2s4 bcd' --near --json
expect_status 0
expect_texts '1234BCD'
run plate log plates.db --text 'I2S4BCD' --json
expect_status 1
expect_no_out
run plate log plates.db --text MI2O4A --near --json
expect_texts 'M1204AB'
run plate log plates.db --since 2h --json
expect_texts '9999ZZZ M1204AB'
run plate log plates.db --until 2h --limit 1 --json
expect_texts '1254BCF'
run plate log plates.db --source 'old, gate' --json
expect_texts '1234BCD'

run plate log plates.db --csv plates.csv
expect_status 0
expect_no_out
python3 - <<'PY' || fail 'plates.csv'
import csv
rows = list(csv.DictReader(open("plates.csv")))
assert [r["text"] for r in rows] == ["9999ZZZ", "M1204AB", "1254BCF", "1234BCD"], rows
assert rows[3]["source"] == "old, gate" and rows[3]["confidence"] == "0.9000" and rows[3]["w"] == "3"
PY
run plate log plates.db --csv -
expect_out '^id,first_time,.*,state,corrected,author,corrected_time$' '^1,.*,"old, gate",1234BCD,'
run plate log plates.db --crops images --text '*BC*'
expect_status 0
[ "$(ls images)" = "$(printf '1-1234BCD.jpg\n2-1254BCF.jpg')" ] || fail "images: $(ls images)"
grep -q 'image of 1234BCD' images/1-1234BCD.jpg || fail 'an image holds something else'

# A reader while another program writes; a writer has to wait, and says so.
python3 - <<'PY' &
import sqlite3, time, os
db = sqlite3.connect("plates.db", isolation_level=None)
db.execute("BEGIN IMMEDIATE")
open("locked", "w").close()
while not os.path.exists("unlock"): time.sleep(0.02)
db.execute("ROLLBACK")
PY
holder=$!
until [ -e locked ]; do sleep 0.02; done
run plate log plates.db --json
expect_status 0
expect_texts '9999ZZZ M1204AB 1254BCF 1234BCD'
run plate log plates.db --keep 30d
expect_status 6
expect_error 'plates.db: is locked by another program'
touch unlock
wait "$holder"

run plate log plates.db --keep 30d --json
expect_status 0
expect_out '^\{"deleted":1\}$'
run plate log plates.db --keep 12h
expect_out '^1 deleted$'
run plate log plates.db --json
expect_texts '9999ZZZ M1204AB'
# It is of this version now, and found by its indexes.
run plate log plates.db --text '*04A*' --json
expect_texts 'M1204AB'
run plate log plates.db --text 'M12O4AX' --near --json
expect_texts 'M1204AB'

# What is wrong on the line.
for arguments in '--keep 30' '--keep -1d' '--keep 1d --text X' '--text %' '--near' '--since never' '--since 1h --until 2h' '--limit -1'; do
  # shellcheck disable=SC2086
  run plate log plates.db $arguments
  expect_status 2
  expect_error '.'
done
run plate log plates.db --csv /dev/full
expect_status 6
run plate log plates.db --csv missing/plates.csv
expect_status 6

# What is wrong with the file.
run plate log missing.db
expect_status 3
expect_error 'missing.db: No such file'
[ ! -e missing.db ] || fail 'plate log made a file'
: >empty.db
run plate log empty.db
expect_status 3
expect_error 'empty.db: is empty'
noise 5000 >noise.db
cp noise.db before.db
for arguments in '' '--keep 1d'; do
  # shellcheck disable=SC2086
  run plate log noise.db $arguments
  if [ -z "$arguments" ]; then expect_status 3; else expect_status 6; fi
  expect_error 'noise.db: is not a database'
done
cmp -s noise.db before.db || fail 'a strange file was changed'
mkdir folder.db
run plate log folder.db
expect_status 3
expect_error 'folder.db'
python3 - <<'PY'
import sqlite3, shutil
db = sqlite3.connect("songs.db"); db.execute("CREATE TABLE song(title)"); db.commit(); db.close()
src = sqlite3.connect("plates.db"); dst = sqlite3.connect("newer.db"); src.backup(dst)
dst.execute("PRAGMA user_version = 9"); dst.commit(); dst.close()
dst = sqlite3.connect("trigger.db"); src.backup(dst); dst.executescript("""DROP TABLE plate;
CREATE TABLE secret(x); CREATE VIEW plate AS SELECT 1 AS id, 2 AS first_time, 3 AS last_time, 'a' AS source, 'b' AS text, 0.5 AS confidence,
 '' AS country, 1 AS frames, 1 AS x, 1 AS y, 1 AS w, 1 AS h, '[]' AS candidates, '[]' AS readings, NULL AS crop"""); dst.close()
PY
run plate log songs.db
expect_status 3
expect_error 'songs.db: is not a Tarsier plate log'
run plate log newer.db
expect_status 3
expect_error 'newer.db: .* version 9'
run plate log trigger.db
expect_status 3
expect_error 'trigger.db'
finish
