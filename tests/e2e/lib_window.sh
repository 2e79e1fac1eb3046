# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Common parts of the window tests. Source it first: it runs the test again on a screen of its own (Xvfb).
for tool in xvfb-run xdotool python3; do
  command -v $tool >/dev/null || { echo "skipped: no $tool"; exit 77; }
done
python3 -c 'import ctypes; ctypes.CDLL("libX11.so.6"); ctypes.CDLL("libXfixes.so.3")' 2>/dev/null ||
  { echo "skipped: no libX11 or libXfixes"; exit 77; }
[ -e "$(dirname "$TARSIER")/tarsier-window.so" ] || { echo "skipped: the program was built without a window"; exit 77; }
if [ -z "${ON_TEST_SCREEN:-}" ]; then
  ON_TEST_SCREEN=1 exec xvfb-run -a -s "-screen 0 1024x768x24 -noreset" bash "$0"
fi
# In a sanitizer build: what the toolkit, fontconfig and D-Bus keep until the end is not ours.
export ASAN_OPTIONS="${ASAN_OPTIONS:+$ASAN_OPTIONS:}detect_leaks=0"
here=$(cd "$(dirname "$0")" && pwd)
. "$here/lib.sh"
x11() { python3 "$here/lib_x11.py" "$@"; }

program=
trap '[ -z "$program" ] || kill -KILL $program 2>/dev/null' EXIT

launch() { # launch ARGUMENTS..: the program, in the background
  "$TARSIER" cartoon run "$@" --json >stdout.txt 2>stderr.txt </dev/null &
  program=$!
  command_line="tarsier cartoon run $*"
}
start() { # start ARGUMENTS..: the program with a window that shows its first image
  launch "$@"
  wait_for_window "Tarsier cartoon"
  xdotool mousemove 300 200 # without a window manager, keys go to where the pointer is
  wait_for_image
}

max_wait=${TARSIER_TEST_TIMEOUT:-300} # s; a machine may do much else
wait_for() { # wait_for DESCRIPTION COMMAND..: until it succeeds
  local deadline=$((SECONDS + max_wait)) what=$1
  shift
  until "$@"; do
    if [ -n "$program" ] && ended; then
      "$@" && return
      fail "$command_line: $what: the program ended; $(tail -1 stdout.txt) $(cat stderr.txt)"
      return 1
    fi
    [ $SECONDS -lt $deadline ] || { fail "$command_line: $what: not in time; $(tail -1 stdout.txt) $(cat stderr.txt)"; return 1; }
    sleep 0.05
  done
}
# One process that looks again and again: each start of one costs more than a look.
wait_for_window() { # wait_for_window TITLE: until it is there
  x11 wait-window "$max_wait" "$program" "$1" || fail "$command_line: no window '$1' $(cat stderr.txt)"
}
wait_for_image() { # until the corner of the screen is not black
  x11 wait-image "$max_wait" "$program" 0 0 200 200 || fail "$command_line: no image $(cat stderr.txt)"
}
keep() { # keep FILE: the screen, for people to look at
  [ -z "${KEEP_IMAGES:-}" ] || x11 save "$KEEP_IMAGES/$1"
}
events() { grep -c '"event"' stdout.txt; }
more_events_than() { [ "$(events)" -gt "$1" ]; }

press() { # press KEY PATTERN: the state after it has the pattern
  local before
  before=$(events)
  xdotool key "$1"
  wait_for "key $1" more_events_than "$before" || return
  grep '"event"' stdout.txt | tail -1 | grep -qE -- "$2" ||
    fail "$command_line: key $1: no '$2' in $(grep '"event"' stdout.txt | tail -1)"
}

ended() { ! kill -0 "$program" 2>/dev/null; }
expect_end() { # expect_end STATUS
  wait_for "the end" ended
  status=0
  wait "$program" || status=$?
  program=
  err=$(cat stderr.txt)
  expect_status "$1"
}
