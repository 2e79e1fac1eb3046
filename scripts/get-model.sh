#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# get-model.sh face-embedding|face-detector [--from FILE.tgz|FOLDER] [-o FILE]
#
# Installs a third-party network for this user. The networks are not part of Tarsier: both come from the npm package
# @vladmandic/face-api (MIT).
#   face-embedding   deep face templates (`tarsier people --template deep`): face_recognition_model, 6 MB, dlib's network
#   face-detector    detects more faces with sunglasses, caps, beards: tiny_face_detector_model, 190 kB
# The package is downloaded from the user's npm registry (by npm, else by curl), or read from FILE.tgz or FOLDER, a
# downloaded package. The SHA-256 is checked. `tarsier models import` writes the model file, by default
# face-embedding.json or face-anchors.json in ~/.local/share/tarsier/models ($XDG_DATA_HOME). Set $TARSIER to the program
# if it is neither in build/release nor on the PATH. Exit status: 0 done, 2 usage, 3 download failed, 5 unknown
# weights.
set -euo pipefail

package=@vladmandic/face-api
version=1.7.15

say() { printf 'get-model.sh: %s\n' "$*"; }
die() { # die STATUS TEXT
  local status=$1
  shift
  printf 'get-model.sh: error: %s\n' "$*" >&2
  exit "$status"
}
usage() { sed -n 's/^# \{0,1\}//; 3,13p' "${BASH_SOURCE[0]}"; }

case ${1:-} in
  face-embedding) network=face_recognition_model use='people enroll --template deep, people train --template deep' ;;
  face-detector) network=tiny_face_detector_model use='face detection uses it from now on, except with landmarks --face-detector own' ;;
  -h | --help)
    usage
    exit 0
    ;;
  '')
    usage >&2
    exit 2
    ;;
  *) die 2 "no model called $1; the names: face-embedding, face-detector" ;;
esac
shift
manifest=model/$network-weights_manifest.json
from='' output=()
while [ $# -gt 0 ]; do
  case $1 in
    --from) from=${2:?--from needs a file or folder} && shift 2 ;;
    -o | --output) output=(-o "${2:?-o needs a file}") && shift 2 ;;
    *) die 2 "unknown word $1" ;;
  esac
done

program=${TARSIER:-}
if [ -z "$program" ]; then
  program=$(dirname "${BASH_SOURCE[0]}")/../build/release/bin/tarsier
  [ -x "$program" ] || program=$(command -v tarsier) || die 2 "no program tarsier: build it, or set TARSIER to it"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The registry that npm would ask: from the environment, ~/.npmrc, or the usual one.
registry() {
  local set=${NPM_CONFIG_REGISTRY:-${npm_config_registry:-}}
  [ -n "$set" ] || set=$(sed -n 's/^registry *= *//p' "${HOME:-/nowhere}/.npmrc" 2>/dev/null | tail -n 1)
  printf '%s' "${set:-https://registry.npmjs.org/}"
}

fetch() { # leaves $work/package.tgz
  if command -v npm >/dev/null; then
    say "fetching $package $version by npm"
    if (cd "$work" && npm pack --silent "$package@$version" >names 2>npm.log); then
      mv "$work/$(tail -n 1 "$work/names")" "$work/package.tgz" && return
    fi
    die 3 "npm pack $package@$version: $(grep -m 1 -E 'code|network|reason' "$work/npm.log" || tail -n 1 "$work/npm.log"); with the package at hand: --from FILE.tgz"
  fi
  command -v curl >/dev/null || die 3 "neither npm nor curl is there; with the package at hand: --from FILE.tgz"
  local address
  address=$(registry)
  address=${address%/}/$package/-/${package##*/}-$version.tgz
  say "fetching $address"
  curl --fail --silent --show-error --location --max-time 600 -o "$work/package.tgz" "$address" 2>"$work/curl.log" ||
    die 3 "$(tail -n 1 "$work/curl.log"); with the package at hand: --from FILE.tgz"
}

if [ -d "$from" ]; then
  folder=$from
else
  if [ -n "$from" ]; then
    [ -f "$from" ] || die 3 "$from: no such file or folder"
    cp "$from" "$work/package.tgz"
  else
    fetch
  fi
  # Only these two: nothing else of the package is looked at, let alone run.
  tar -xzf "$work/package.tgz" -C "$work" "package/$manifest" "package/model/$network.bin" 2>"$work/tar.log" ||
    die 5 "${from:-the package} is no package $package with the face network: $(tail -n 1 "$work/tar.log")"
  folder=$work/package
fi
[ -f "$folder/$manifest" ] || die 5 "$folder: there is no $manifest"
"$program" models import "$folder/$manifest" "${output[@]}" || exit $?
say "terms: MIT, as the package states; people.md describes its use: $use"
