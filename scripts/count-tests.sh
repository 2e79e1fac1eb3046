#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# count-tests.sh FOLDER
# Adds up the results that ./test wrote to FOLDER: ctest.junit (one entry per test program or script) and an .xml for
# each GoogleTest program (its cases). Lists failures and the reasons of skipped tests; the last line is the total. Exit
# status 1 if anything failed.
set -euo pipefail
folder=${1:?folder of results}

# name|status of each ctest entry; status: run, fail, notrun, disabled. A test whose program is missing is no skipped
# one: ctest says "notrun" of both, and only of the skipped ones that it was their own wish.
entries() {
  awk '
    /<testcase / {
      match($0, /name="[^"]*"/); name = substr($0, RSTART + 6, RLENGTH - 7)
      match($0, /status="[a-z]*"/); state = substr($0, RSTART + 8, RLENGTH - 9)
      if (state != "notrun") print name "|" state
    }
    state == "notrun" && /<skipped/ { print name "|" (/SKIP_/ ? "notrun" : "fail"); state = "" }
  ' "$folder/ctest.junit"
}

# passed failed skipped of the cases of one GoogleTest program; names of the others go to stderr
cases() {
  awk '
    function close_case() {
      if (open && failed) { bad++; print "failed:  " suite "." name > "/dev/stderr" }
      else if (open && skipped) { skip++; print "skipped: " suite "." name (why == "" ? "" : ": " why) > "/dev/stderr" }
      else if (open) good++
      open = 0
    }
    function attribute(key,   found) {
      if (!match($0, " " key "=\"[^\"]*\"")) return ""
      found = substr($0, RSTART, RLENGTH)
      gsub("^ " key "=\"|\"$", "", found)
      gsub("&#x0A;|&#xA;", " ", found); gsub("&apos;", "\x27", found); gsub("&quot;", "\"", found); gsub("&amp;", "\\&", found)
      return found
    }
    /<testcase / {
      close_case(); open = 1; failed = 0; why = ""
      name = attribute("name"); suite = attribute("classname"); skipped = /result="skipped"|status="notrun"/
    }
    /<failure/ { failed = 1 }
    /<skipped/ { why = attribute("message"); sub("^[^ ]*:[0-9]+ ", "", why) }
    END { close_case(); print good + 0, bad + 0, skip + 0 }' "$1"
}

passed=0 failed=0 skipped=0
while IFS='|' read -r name state; do
  report=$folder/${name//\//_}.xml
  if [ -s "$report" ]; then
    read -r good bad skip < <(cases "$report")
    passed=$((passed + good)) failed=$((failed + bad)) skipped=$((skipped + skip))
    # It failed, but no case did: it crashed after the last one, or a sanitizer spoke up.
    if [ "$state" = fail ] && [ "$bad" -eq 0 ]; then
      failed=$((failed + 1))
      echo "failed:  $name (outside its cases)" >&2
    fi
  else
    case $state in
      run) passed=$((passed + 1)) ;;
      fail)
        failed=$((failed + 1))
        echo "failed:  $name" >&2
        ;;
      *)
        skipped=$((skipped + 1))
        echo "skipped: $name" >&2
        ;;
    esac
  fi
done < <(entries)
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ]
