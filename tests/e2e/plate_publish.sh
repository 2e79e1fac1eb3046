#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Events by MQTT: plate_publish.py.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip 'no python3'
PATH=$PATH:/usr/sbin
command -v mosquitto >/dev/null || skip 'no mosquitto (sudo apt install mosquitto mosquitto-clients)'
command -v mosquitto_sub >/dev/null || skip 'no mosquitto_sub (sudo apt install mosquitto-clients)'
"$TARSIER" doctor --json | grep -q 'this build has no MQTT' && skip 'this build has no MQTT (libmosquitto-dev)'
python3 "$TARSIER_SOURCE/tests/e2e/plate_publish.py" || fail 'see above'
finish
