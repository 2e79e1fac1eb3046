#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# doctor: text for people, JSON for programs, on a machine with and without a display, and with an invalid setting.
. "$(dirname "$0")/lib.sh"

env_run() { # env_run VARIABLES.. -- ARGUMENTS..
  local variables=()
  while [ "$1" != -- ]; do variables+=("$1"); shift; done
  shift
  status=0
  env "${variables[@]}" timeout "${TARSIER_TEST_TIMEOUT:-900}" "$TARSIER" "$@" >stdout.txt 2>stderr.txt </dev/null || status=$?
  out=$(cat stdout.txt) err=$(cat stderr.txt) command_line="${variables[*]} tarsier $*"
}

env_run -u DISPLAY -u WAYLAND_DISPLAY -u TARSIER_MODELS -- doctor
expect_status 0
expect_out '^program$' '^machine$' '^cameras$' '^display$' '^data$' '^network$' 'OpenCV +4\.' 'vectors' 'cores' 'memory' \
  'temp folder' 'picam:' 'sample images' ' MQTT ' ' mosquitto ' 'Ready: no problems'
expect_no_err
grep -q $'\033' stdout.txt && fail "colours though stdout is no terminal"
grep -qE 'DISPLAY' stdout.txt || fail "a machine without display is not told so"

env_run -u TARSIER_MODELS DISPLAY=:7654 -- doctor
expect_status 0
expect_out 'X11 +:7654 does not answer'

env_run TARSIER_SIMD=baseline -- doctor
expect_status 0
env_run TARSIER_MODELS=/no/such/folder -- doctor
expect_status 1
expect_out 'PROBLEM models' '/no/such/folder' '1 problem'
env_run TMPDIR=/no/such/folder -- doctor
expect_status 1
expect_out 'PROBLEM temp folder'

run doctor --json
expect_status 0
[ "$(wc -l <stdout.txt)" -eq 1 ] || fail "--json is not one line"
python3 - <<'PY' || fail "doctor --json"
import json
report = json.load(open("stdout.txt"))
assert report["problems"] == 0 and report["version"] and report["cores"] >= 1 and report["simd"]
assert isinstance(report["cameras"], list)
assert len(report["items"]) >= 12
for item in report["items"]:
    assert set(item) == {"area", "name", "finding", "value", "advice"}, item
    assert item["finding"] in ("ok", "note", "problem") and item["value"], item
    assert item["finding"] == "ok" or item["advice"] or item["name"] == "picam:", item
PY
finish
