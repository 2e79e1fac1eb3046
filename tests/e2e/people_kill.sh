#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Enrolment killed at twenty moments: the gallery opens each time, and what was told to be taken is there.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"
pictures=/usr/share/doc/opencv-doc/examples/data
[ -f "$pictures/ml.png" ] || skip "needs the package opencv-doc"
python3 -c 'import sqlite3' || skip "needs python3"
mkdir faces
for i in $(seq -w 40); do ln "$pictures/ml.png" "faces/$i.jpg" 2>/dev/null || cp "$pictures/ml.png" "faces/$i.jpg"; done
faces_in_it() {
  python3 - <<'END'
import sqlite3
try:
    print(sqlite3.connect("file:people.db?mode=ro", uri=True).execute("SELECT count(*) FROM face").fetchone()[0])
except sqlite3.Error:
    print(0)
END
}
before=0
for round in $(seq 20); do
  "$TARSIER" people enroll Lena faces --any-quality --faces 40 --quiet >/dev/null 2>&1 </dev/null &
  program=$!
  # Every other round not before a face was added, however slow the machine is.
  if [ $((round % 2)) -eq 0 ]; then
    for _ in $(seq 300); do
      [ "$(faces_in_it)" -gt "$before" ] && break
      kill -0 $program 2>/dev/null || break
      sleep 0.05
    done
  fi
  sleep "0.$((RANDOM % 90 + 10))"
  # What is committed before the kill must be there after it.
  seen=$(faces_in_it)
  kill -KILL $program 2>/dev/null
  wait $program 2>/dev/null
  [ -e people.db ] || continue
  check=$(python3 - <<'END'
import sqlite3
d = sqlite3.connect("people.db")
print(d.execute("PRAGMA integrity_check").fetchone()[0])
END
)
  [ "$check" = ok ] || fail "round $round: $check"
  run people list --json
  case $status in
    0) ;;
    1 | 3) [ "$seen" -eq 0 ] || fail "round $round: $seen faces were there, now none: $err" ;;
    *) fail "round $round: status $status: $err" ;;
  esac
  after=$(python3 -c 'import json; print(sum(json.loads(l)["faces"] for l in open("stdout.txt")))')
  [ "$after" -ge "$seen" ] || fail "round $round: $seen faces before the kill, $after after it"
  [ "$after" -ge "$before" ] || fail "round $round: faces of an earlier round are gone"
  before=$after
done
[ "$before" -gt 0 ] || fail "nothing was ever enrolled"
run people identify "$pictures/ml.png" --json
expect_status 0
finish
