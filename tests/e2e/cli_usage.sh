#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Help, version, and one clear line for every usage error.
. "$(dirname "$0")/lib.sh"

run --version
expect_status 0
expect_out '^tarsier [0-9]+\.[0-9]+\.[0-9]+$'
expect_no_err

# Codecs of videos and rare kinds of images, with all that they bring, are loaded when they are needed: they take
# several times as long to link as the rest. JPEG and PNG need none of them.
loaded_libraries() { # loaded_libraries ARGUMENTS..: the libraries that a run loads
  LD_DEBUG=files timeout 900 "$TARSIER" "$@" 2>&1 >/dev/null </dev/null | grep -oE 'calling init: .*' | sed 's|.*/||' | sort -u
}
run cartoon run synth:scene --frames 1 -o scene.png --quiet
expect_status 0
loaded_libraries cartoon run scene.png -o drawn.jpg --quiet >libraries.txt
grep -q '^libopencv_imgproc' libraries.txt || fail "cannot list the libraries of a run"
heavy='^lib(opencv_imgcodecs|opencv_videoio|avformat|avcodec|gdal)\.so'
grep -E "$heavy" libraries.txt && fail "a run on JPEG and PNG loads codecs that it does not need"
[ "$(wc -l <libraries.txt)" -le 100 ] || fail "a run loads $(wc -l <libraries.txt) libraries"
loaded_libraries cartoon run scene.png -o drawn.webp --quiet | grep -q '^libopencv_imgcodecs' || fail "WebP without OpenCV's codecs"

run --help
expect_status 0
expect_out 'tarsier demo' 'cartoon' 'doctor' 'models' 'Exit status'
expect_no_err
[ "$(wc -l <stdout.txt)" -le 32 ] || fail "--help does not fit a screen: $(wc -l <stdout.txt) lines"
[ "$(wc -L <stdout.txt)" -le 90 ] || fail "--help is wider than 90 characters"

for verb in doctor demo serve "models list" "models info" "models verify" "landmarks fit" "landmarks track" "landmarks eval" \
  "landmarks train tracker" "landmarks annotate" calibrate "ar marker-sheet" "plate read" "sfm reconstruct" "cartoon run"; do
  # shellcheck disable=SC2086  # the words of a verb
  run $verb --help
  expect_status 0
  expect_out "$verb" '--json' '--quiet' '--threads' '--config'
  expect_no_err
done

# Without a verb: the help, but on stderr and with the status of a usage error.
run
expect_status 2
expect_no_out
grep -q 'tarsier demo' stderr.txt || fail "no help without arguments"
run models
expect_status 2
expect_no_out
grep -q 'verify' stderr.txt || fail "no help for an area alone"
grep -q 'tarsier models \[' stderr.txt || fail "the help of an area names it wrong: $err"

expect_usage_error() { # expect_usage_error PATTERN ARGUMENTS..
  local pattern=$1
  shift
  run "$@"
  expect_status 2
  expect_no_out
  expect_error "$pattern"
}
expect_usage_error "did you mean 'doctor'" doktor
expect_usage_error "did you mean 'models'" model list
expect_usage_error "did you mean 'list'" models lst
expect_usage_error "known: .*demo" frobnicate
expect_usage_error "knows no ''" ""
expect_usage_error 'did you mean --json' doctor --jsno
expect_usage_error 'no flag --frobnicate' doctor --frobnicate
expect_usage_error 'flags come after the verb' --json doctor
expect_usage_error 'threads' doctor --threads many
expect_usage_error 'threads' doctor --threads -3
expect_usage_error 'log-level' doctor --log-level loud
expect_usage_error 'progress' doctor --progress sparkling
expect_usage_error 'seed' doctor --seed -1
expect_usage_error 'surplus' doctor surplus
expect_usage_error 'NAME' models info
expect_usage_error 'only' demo --only nothing-such
expect_usage_error 'output' demo -o
expect_usage_error '.' doctor "$(printf 'two\nlines\033[31m')"
case $err in *$'\033'*) fail "an escape sequence reached the terminal" ;; esac

# stdout that cannot be written is an error of its own.
if [ -w /dev/full ]; then
  for verb in "--version" "doctor" "doctor --json" "models list"; do
    status=0
    # shellcheck disable=SC2086  # the words of a verb
    "$TARSIER" $verb >/dev/full 2>stderr.txt </dev/null || status=$?
    err=$(cat stderr.txt) command_line="tarsier $verb >/dev/full"
    expect_status 6
    expect_error 'standard output'
  done
fi
# A reader that goes away must not kill the program by a signal.
status=0
{ "$TARSIER" --help 2>/dev/null; echo $? >status.txt; } | true
status=$(cat status.txt)
[ "$status" -eq 0 ] || [ "$status" -eq 6 ] || fail "closed pipe: exit status $status"
finish
