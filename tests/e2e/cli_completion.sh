#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Completion of bash, as called by the shell: areas, verbs, flags, values, files; at every split of --flag=value.
. "$(dirname "$0")/lib.sh"

run help --bash
expect_status 0
bash -n stdout.txt || fail "the completion script is no bash"
# shellcheck disable=SC1091
. ./stdout.txt
complete -p tarsier | grep -q _tarsier || fail "nothing completes tarsier"
mkdir folder
: >"a video.mp4"

# completes "LINE" WORD..: the words that are offered for the last word of LINE (split as bash splits it).
completes() {
  local line=$1 offered
  shift
  read -ra COMP_WORDS <<<"${line//=/ = }"
  case $line in *' ' | *=) COMP_WORDS+=('') ;; esac
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  COMPREPLY=()
  _tarsier
  offered=" ${COMPREPLY[*]} "
  for word; do
    case $word in
      !*) case $offered in *" ${word#!} "*) fail "'$line' offers ${word#!}: $offered" ;; esac ;;
      *) case $offered in *" $word "*) ;; *) fail "'$line' does not offer $word: $offered" ;; esac ;;
    esac
  done
}
completes "tarsier " cartoon plate demo '!help' '!read'
completes "tarsier pl" plate '!people' '!cartoon'
completes "tarsier --" --help --version
completes "tarsier plate r" read '!eval'
completes "tarsier plate " read train-reader log
completes "tarsier landmarks train t" tracker trees '!track'
completes "tarsier plate read --js" --json '!--jpeg-quality'
completes "tarsier plate read --j" --json --jpeg-quality
completes "tarsier doctor --" --json --help '!--mode'
completes "tarsier cartoon run --skin-style " glow tint
completes "tarsier cartoon run --skin-style=" glow tint
completes "tarsier cartoon run --skin-style=t" tint '!glow'
completes "tarsier cartoon run --skin-style t" tint '!glow'
completes "tarsier doctor --log-level w" warning
completes "tarsier demo --only p" plate pose people
completes "tarsier cartoon run fo" folder
completes "tarsier cartoon run a" "a video.mp4"
completes "tarsier cartoon run x.jpg -o fo" folder
completes "tarsier plate read --json fo" folder
completes "tarsier cartoon run --paint-rounds " '!folder'
[ "${#COMPREPLY[@]}" -eq 0 ] || fail "files are offered for a number"
completes "tarsier frobnicate pl" '!plate'

# Manual pages: one for the program and one for each area; each verb and each flag is on its page.
run help --man pages
expect_status 0
expect_no_err
for area in cartoon plate sfm landmarks aam pose people calibrate ar models doctor demo serve bench; do
  [ -s "pages/tarsier-$area.1" ] || fail "no page for $area"
  grep -qF "tarsier\\-$area" pages/tarsier.1 || fail "tarsier.1 does not name $area"
done
run help --json
expect_status 0
mv stdout.txt tree.json
python3 - <<'PY' || fail "a page lacks a verb or a flag"
import json
for verb in json.load(open("tree.json"))["verbs"]:
    page = open(f"pages/tarsier-{verb['area']}.1").read().replace("\\-", "-")
    assert "tarsier " + verb["verb"] in page, verb["verb"]
    for flag in verb["inputs"] + verb["flags"]:
        assert all(name in page for name in flag["names"]), (verb["verb"], flag["names"])
PY
if command -v mandoc >/dev/null; then
  for page in pages/*.1; do
    mandoc -T lint -W warning "$page" >lint.txt 2>&1 || fail "mandoc: $(head -5 lint.txt)"
  done
fi
if command -v man >/dev/null && man --version >/dev/null 2>&1; then
  for page in pages/*.1; do
    LC_ALL=C.UTF-8 MANWIDTH=80 man --warnings -E UTF-8 -l "$page" >rendered.txt 2>warnings.txt </dev/null || fail "man $page"
    [ ! -s warnings.txt ] || fail "man --warnings $page: $(head -3 warnings.txt)"
  done
fi
# The same source and date give the same bytes.
SOURCE_DATE_EPOCH=1700000000 "$TARSIER" help --man one
SOURCE_DATE_EPOCH=1700000000 "$TARSIER" help --man two
diff -r one two >/dev/null || fail "pages differ from run to run"
grep -q 2023-11-14 one/tarsier.1 || fail "SOURCE_DATE_EPOCH is not taken"
finish
