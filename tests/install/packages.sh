#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# packages.sh FOLDER: installs the packages of FOLDER (scripts/package.sh made them) on this system, a throw-away one,
# as root, and tries them as their user would, far from the source tree. Not a part of ./test.
set -euo pipefail
debs=$(realpath "${1:?folder of the .deb files}")
sample=$(mktemp -d) work=$(mktemp -d)
cd "$work"
export DEBIAN_FRONTEND=noninteractive
fail() {
  echo "FAILED: $*"
  exit 1
}

apt-get update -qq
apt-get install -y -qq --no-install-recommends "$debs"/tarsier_*.deb "$debs"/tarsier-models_*.deb >install.log 2>&1 ||
  { tail -n 20 install.log; fail "apt-get install"; }
echo "== tarsier without its window: $(dpkg-query -W -f '${Package}\n' | wc -l) packages, $(du -shx / 2>/dev/null | cut -f1) on disk"
tarsier --version
for package in libqt5gui5 libqt5gui5t64 libqt6gui6 libgtk-3-0 libgtk-3-0t64 libopencv-highgui406 libopencv-highgui410; do
  if dpkg-query -W -f '${db:Status-Status}' $package 2>/dev/null | grep -qx installed; then
    fail "$package came along without tarsier-gui"
  fi
done
tarsier models verify --quiet
tarsier models list >models.txt
head -3 models.txt
told=$(DISPLAY=:99 tarsier cartoon run synth:scene --window 2>&1) && fail "--window without tarsier-gui"
[[ $told == *"install the package tarsier-gui"* ]] || fail "--window does not tell of tarsier-gui: $told"
tarsier demo --quiet -o page || fail "tarsier demo"
[ -s page/index.html ] || fail "no page"
echo "== the demo's page: $(find page -type f | wc -l) files"
bash -c '. /usr/share/bash-completion/completions/tarsier; COMP_WORDS=(tarsier pl); COMP_CWORD=1; _tarsier; echo "${COMPREPLY[*]}"' |
  grep -qx plate || fail "completion"

apt-get install -y -qq --no-install-recommends "$debs"/tarsier-gui_*.deb man-db systemd xvfb xauth >>install.log 2>&1 || fail "tarsier-gui"
# Bare systems leave manual pages out; the pages themselves are in the package.
dpkg-deb --fsys-tarfile "$debs"/tarsier_*.deb | tar -x -C "$sample" ./usr/share/man
man --warnings -l "$sample/usr/share/man/man1/tarsier-plate.1.gz" >man.txt 2>man.err </dev/null || fail "man"
[ ! -s man.err ] || fail "man: $(cat man.err)"
systemd-analyze verify --man=no tarsier-mirror.service tarsier-plates.service tarsier-plates-keep.service tarsier-plates-keep.timer \
  tarsier-studio.service ||
  fail "systemd-analyze verify"
systemd-analyze verify --man=no --user /usr/lib/systemd/user/tarsier-studio.service || fail "systemd-analyze verify --user"
systemd-analyze security --offline=true tarsier-mirror.service tarsier-plates.service tarsier-plates-keep.service \
  tarsier-studio.service 2>/dev/null |
  grep Overall || true
# The studio as installed: it answers, starts a verb, and ends its children with itself.
tarsier serve --workspace "$work/studio" --port 8765 --no-browser >studio.log 2>&1 &
studio=$!
for _ in $(seq 50); do
  [ -e "$work/studio/.studio/server.json" ] && break
  sleep 0.2
done
ask() { # python3 or curl need not be there: bash alone
  exec 3<>/dev/tcp/127.0.0.1/8765
  printf '%s\r\nHost: 127.0.0.1:8765\r\nAuthorization: Bearer %s\r\nContent-Type: application/json\r\nContent-Length: %d\r\nConnection: close\r\n\r\n%s' \
    "$1" "$(cat "$work/studio/.studio/api-token")" "${#2}" "$2" >&3
  cat <&3
  exec 3>&-
}
[[ $(ask 'POST /api/run HTTP/1.1' '{"verb":"models list"}') == *'"exit":0'* ]] || fail "the studio: $(cat studio.log)"
[[ $(ask 'GET / HTTP/1.1' '') == *'<!doctype html>'* ]] || fail "the studio has no pages"
kill "$studio"
wait "$studio" || true
[ -x /usr/libexec/tarsier/open-studio ] && [ -s /usr/share/applications/tarsier-studio.desktop ] || fail "no studio in the menu"
xvfb-run -a tarsier cartoon run synth:scene --frames 20 --window --quiet || fail "the window: exit status $?"

apt-get install -y -qq --no-install-recommends "$debs"/libtarsier-dev_*.deb g++ cmake ninja-build >>install.log 2>&1 || fail "libtarsier-dev"
if [ -d /usr/share/doc/libtarsier-dev/examples ]; then # some bare systems leave documentation out
  cp -r /usr/share/doc/libtarsier-dev/examples/find_package "$sample/"
else
  dpkg-deb --fsys-tarfile "$debs"/libtarsier-dev_*.deb | tar -x -C "$sample" ./usr/share/doc
  cp -r "$sample/usr/share/doc/libtarsier-dev/examples/find_package" "$sample/"
fi
cmake -G Ninja -S "$sample/find_package" -B "$sample/build" >cmake.log 2>&1 || { tail cmake.log; fail "cmake"; }
cmake --build "$sample/build" >build.log 2>&1 || { tail build.log; fail "the sample"; }
tarsier cartoon run synth:scene --frames 1 -o scene.png --quiet
"$sample/build/ink" scene.png ink.png && [ -s ink.png ] || fail "ink"
# Removed without traces.
apt-get purge -y -qq tarsier tarsier-gui tarsier-models libtarsier-dev >>install.log 2>&1 || fail "purge"
[ ! -e /usr/share/tarsier ] && [ ! -e /usr/lib/tarsier ] || fail "files stayed behind"
echo "all packages work"
