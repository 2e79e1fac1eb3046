#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# tarsier hub --log postgresql://.., with a server that the test starts itself: hub_postgres.py.
. "$(dirname "$0")/lib.sh"
command -v python3 >/dev/null || skip 'no python3'
PATH=$PATH:/usr/sbin
command -v mosquitto >/dev/null || skip 'no mosquitto (sudo apt install mosquitto mosquitto-clients)'
"$TARSIER" doctor --json | grep -q 'this build has no MQTT' && skip 'this build has no MQTT (libmosquitto-dev)'
servers=(/usr/lib/postgresql/*/bin)
[ -x "${servers[-1]}/initdb" ] || skip 'no PostgreSQL server (sudo apt install postgresql)'
export TARSIER_POSTGRES=${servers[-1]}
python3 "$TARSIER_SOURCE/tests/e2e/hub_postgres.py" || fail 'see above'
finish
