#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Nodes, a broker and a hub in network namespaces, killed and disconnected: plate_links.py.
. "$(dirname "$0")/lib.sh"
[ -n "${TARSIER_TEST_ALL:-}" ] || skip 'long: ./test --all runs it'
command -v python3 >/dev/null || skip 'no python3'
PATH=$PATH:/usr/sbin:/sbin
command -v mosquitto >/dev/null || skip 'no mosquitto (sudo apt install mosquitto mosquitto-clients)'
"$TARSIER" doctor --json | grep -q 'this build has no MQTT' && skip 'this build has no MQTT (libmosquitto-dev)'
command -v ip >/dev/null || skip 'no ip (sudo apt install iproute2)'
# A network of its own, in which this user may do everything; the namespaces end with it.
isolate=(unshare --net --mount)
[ "$(id -u)" -eq 0 ] || isolate+=(--user --map-root-user)
"${isolate[@]}" sh -c 'mount -t tmpfs none /run && mkdir -p /run/netns && ip netns add a && ip netns exec a true' 2>/dev/null ||
  skip 'this user may make no network namespaces (unshare --net)'
"${isolate[@]}" sh -c "mount -t tmpfs none /run && exec python3 '$TARSIER_SOURCE/tests/e2e/plate_links.py'" || fail 'see above'
finish
