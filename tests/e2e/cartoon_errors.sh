#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# All errors of inputs and outputs: the right exit status, one line that names the object, no partial file.
. "$(dirname "$0")/lib.sh"
unset DISPLAY WAYLAND_DISPLAY
samples=/usr/share/doc/opencv-doc/examples/data
[ -r $samples/home.jpg ] || skip "no sample images (package opencv-doc)"
good=$samples/home.jpg

expect_failure() { # expect_failure STATUS PATTERN ARGUMENTS..
  local expected=$1 pattern=$2
  shift 2
  run cartoon run "$@"
  expect_status "$expected"
  expect_error "$pattern"
  expect_no_out
  [ -z "$(find . -name 'out*' -type f)" ] || fail "$command_line: left $(find . -name 'out*' -type f)"
}

# Inputs.
mkdir empty
echo "no image at all" >text.jpg
head -c 4000 $good >truncated.jpg
printf '\211PNG\r\n\032\n\0\0\0\rIHDR\0\0\352\140\0\0\352\140\10\2\0\0\0\0\0\0\0' >huge.png # 60000x60000
: >nothing.png
expect_failure 3 'missing\.jpg' missing.jpg -o out.png
expect_failure 3 'empty' empty -o out
expect_failure 3 'text\.jpg' text.jpg -o out.png
expect_failure 3 'truncated\.jpg' truncated.jpg -o out.png
expect_failure 3 'huge\.png.*60000x60000' huge.png -o out.png
expect_failure 3 'nothing\.png' nothing.png -o out.png
expect_failure 3 'camera 99' 99 -o out.mp4
expect_failure 3 'http:///no-host' http:///no-host -o out.mp4
expect_failure 3 'gopher' gopher://example.org/ -o out.mp4
expect_failure 3 'videotestsrc' 'videotestsrc ! filesink location=out' -o out.mp4
[ ! -e out ] || fail "user text reached a pipeline"
expect_failure 3 '127\.0\.0\.1:9' http://127.0.0.1:9/ --connect-timeout 1 -o out.mp4
expect_failure 3 'none.txt' @none.txt -o out
expect_failure 3 "$(printf '%s' '\\x1b')" "$(printf 'a\033[31m.jpg')" -o out.png
case $err in *$'\033'*) fail "an escape sequence reached the terminal" ;; esac
mkdir broken
cp text.jpg truncated.jpg broken
run cartoon run broken -o gone
expect_status 3
[ "$(grep -c error: stderr.txt)" -eq 1 ] || fail "not one error: $err"

# Usage.
expect_failure 2 "unknown mode 'crayon'.*sketch, paint, cartoon" $good --mode crayon -o out.png
expect_failure 2 'quality' $good --quality best -o out.png
expect_failure 2 'median' $good --sketch-median 4 -o out.png
expect_failure 2 'threshold' $good --sketch-threshold 300 -o out.png
expect_failure 2 'rounds' $good --paint-rounds -1 -o out.png
expect_failure 2 'skin-color.*#rrggbb' $good --skin-color '#12345' -o out.png
expect_failure 2 'skin-lower.*three numbers' $good --skin-lower 1,2,300 -o out.png
expect_failure 2 'skin-style' $good --skin-style shiny -o out.png
expect_failure 2 'actions' $good --actions file -o out.png
expect_failure 2 '--jpeg-quality: expected 1..100' $good --jpeg-quality 0 -o out.jpg
expect_failure 2 'folder' $good $samples/box.png -o out.png
expect_failure 2 'folder' $samples/vtest.avi -o out.png
expect_failure 2 'INPUT' -o out.png
cp $good same.jpg
expect_failure 2 'also an input' same.jpg -o same.jpg
cmp -s $good same.jpg || fail "the input was written to"
expect_failure 2 'token' $good -o http://0.0.0.0:0/

# Outputs.
expect_failure 6 'no/such/out.png' $good -o no/such/out.png
expect_failure 6 '/proc' $good -o /proc/out.png
echo >file
expect_failure 6 'file' $good -o file/
[ ! -w /dev/full ] || expect_failure 6 '/dev/full' $good -o /dev/full

# No output replaces an input or a file of another flag.
mkdir one two
cp $good one/b.jpg
cp $samples/fruits.jpg two/b.jpg
cp $good taken.jpg
run ar target-train taken.jpg -o target.json --quiet
before=$(cat one/* two/* taken.jpg target.json | md5sum)
for words in 'cartoon run one/b.jpg two/b.jpg -o two/' 'cartoon run one/b.jpg -o one/b.jpg' 'ar markers taken.jpg --csv taken.jpg' \
  'ar target-train taken.jpg -o taken.jpg' 'calibrate one two --board chess:9x6 --square 25mm -o two/b.jpg' \
  'ar target-track one --target target.json --csv target.json'; do
  # shellcheck disable=SC2086 # several words
  run $words
  expect_status 2
  expect_error 'is an input|is also an input|is used by two flags'
done
[ "$before" = "$(cat one/* two/* taken.jpg target.json | md5sum)" ] || fail 'an input was replaced'
# An older table stays if no image can be read.
echo 'kept' >table.csv
run ar markers text.jpg --csv table.csv
expect_status 3
[ "$(cat table.csv)" = kept ] || fail "the older table was changed to: $(cat table.csv)"

# A full disk, where this machine lets us make a small one.
mkdir small
if mount -t tmpfs -o size=64k tmpfs small 2>/dev/null; then
  for output in small/out.png small/out.mp4 small/; do
    run cartoon run $samples/vtest.avi --mode none --frames 40 -o "$output"
    if [ "$output" = small/out.png ]; then run cartoon run $good --mode none -o "$output"; fi
    expect_status 6
    grep -q 'error: .*small' stderr.txt || fail "$command_line: $err"
    [ ! -e small/out.png ] && [ ! -e small/out.mp4 ] || fail "$command_line: half a file: $(ls -la small)"
    [ -z "$(find small -name '.*' -type f)" ] || fail "$command_line: left $(find small -type f)"
    rm -rf small/*
  done
  umount small
else
  echo "no small disk can be mounted here: a full disk is tried with /dev/full only"
fi

# Nowhere to show it.
expect_failure 3 'no display: DISPLAY is not set; .*give -o OUT' $good
DISPLAY=:77 expect_failure 3 'no display: .*:77' $good --window
finish
