#!/bin/sh
# SPDX-License-Identifier: MIT
# The desktop entry of the studio runs this script. It starts the user's unit, then a browser with a new link. Without
# systemd the server runs until the session ends.
systemctl --user start tarsier-studio.service 2>/dev/null ||
  { tarsier serve --link >/dev/null 2>&1 || setsid tarsier serve --no-browser >/dev/null 2>&1 & }
tries=0
until link=$(tarsier serve --link --quiet 2>/dev/null | grep -m 1 -o 'http[^ ]*'); do
  tries=$((tries + 1))
  if [ "$tries" -gt 50 ]; then
    echo "the studio does not start; see: journalctl --user -u tarsier-studio" >&2
    exit 1
  fi
  sleep 0.2
done
exec xdg-open "$link"
