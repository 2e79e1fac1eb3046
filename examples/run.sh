#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# run.sh SOURCE NEEDS EXPECT PROGRAM ARGS..: the test of an example. Fails unless the program ends with 0 and prints a
# line that matches EXPECT (an extended regular expression), and its source has at most 40 lines. Skipped (77) where the
# file NEEDS is not there, or no typefaces to draw plates with. The program runs in an empty folder of its own.
source=$1 needs=$2 expect=$3
shift 3
lines=$(wc -l <"$source")
[ "$lines" -le 40 ] || { echo "$source has $lines lines, at most 40 are allowed"; exit 1; }
if [ -n "$needs" ] && [ ! -e "$needs" ]; then
  echo "skipped: $needs is not there (Debian's opencv-doc)"
  exit 77
fi
folder=$(mktemp -d)
out=$(cd "$folder" && "$@" 2>errors.txt)
status=$?
err=$(cat "$folder/errors.txt")
rm -rf "$folder"
if [[ $err == *typefaces* ]]; then
  echo "skipped: $err"
  exit 77
fi
[ $status -eq 0 ] || { echo "exit status $status: $err"; exit 1; }
grep -qE -- "$expect" <<<"$out" || { printf 'no line matches %s:\n%s\n%s\n' "$expect" "$out" "$err"; exit 1; }
