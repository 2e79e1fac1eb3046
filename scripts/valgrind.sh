#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/valgrind.sh [AREA ..]: small runs of each area of the program under valgrind's memcheck: no invalid access, no
# use of uninitialised memory, no definite leak. cmake/valgrind.supp has the suppressions for libraries, with reasons.
# TARSIER selects another program than build/release/bin/tarsier. Takes minutes: code runs about 50 times slower there.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/setup.sh
. "$root/scripts/setup.sh"
install_packages valgrind
tarsier=${TARSIER:-$root/build/release/bin/tarsier}
[ -x "$tarsier" ] || die "no program $tarsier: build it (./demo, ./test) or set TARSIER"
export TARSIER_MODELS=${TARSIER_MODELS:-$root/models}
work=${WORK:-$root/build/valgrind}
rm -rf "$work"
mkdir -p "$work"
cd "$work"
areas=${*:-cartoon plate landmarks aam pose people calibrate ar sfm models}

make() { "$tarsier" "$@" --quiet >/dev/null || [ $? -eq 1 ] || die "cannot make the inputs: tarsier $*"; }
make cartoon run synth:scene --frames 1 -o scene.png
make pose synth -o head --count 3 --size 320x240 --near 450 --far 500
make pose synth -o other --count 1 --size 320x240 --near 450 --far 500 --seed 7
make plate synth -o cars --count 1 --size 320x180
make ar synth markers -o markers --count 1 --size 320x240
make ar target-train scene.png -o scene.target.json --trials 2
make sfm synth -o views --images 3 --size 320x240
printf '%s\n' '0 0 0' '10 0 0' '0 10 0' '10 10 0' '0 0 10' '10 0 10' >cube.txt
printf '%s\n' '-66 0' '66 0' '-66 133' '66 133' '-46 -22' '68 -22' >seen.txt

failures=0 runs=0
check() { # check AREA ARGUMENTS..: that area's run; 0 and 1 (nothing found) are the program's own good ends
  local area=$1 status=0 start=$SECONDS
  shift
  case " $areas " in *" $area "*) ;; *) return 0 ;; esac
  runs=$((runs + 1))
  valgrind --quiet --error-exitcode=99 --leak-check=full --show-leak-kinds=definite --errors-for-leak-kinds=definite --num-callers=30 \
    --suppressions="$root/cmake/valgrind.supp" --log-file="$work/log-$runs.txt" --gen-suppressions=all \
    "$tarsier" "$@" --quiet --threads 2 >stdout.txt 2>stderr.txt </dev/null || status=$?
  case $status in
    0 | 1) printf '   clean (%d s): tarsier %s\n' $((SECONDS - start)) "$*" ;;
    *)
      failures=$((failures + 1))
      printf 'FAILED (exit status %d, %d s): tarsier %s: %s\n' "$status" $((SECONDS - start)) "$*" "$(tail -1 stderr.txt)"
      grep -v '^{\|^}\|^   [a-zA-Z<]' "log-$runs.txt" | head -40
      ;;
  esac
}
check models models verify landmarks68
check pose pose solve --object cube.txt --points seen.txt --focal 800
check pose pose track head/images/0000.png -o posed.png
check cartoon cartoon run scene.png -o drawn.png
check cartoon cartoon run scene.png -o video.avi --mode sketch --sequence
check ar ar marker-sheet --ids 0-1 -o sheet.pdf
check ar ar markers markers/images -o marked
check ar ar target-track scene.png --target scene.target.json -o found.png
check landmarks landmarks fit head/images/0000.png -o fitted.png
check landmarks landmarks train shape head/set.json -o shape.json
check landmarks landmarks train patches head/set.json -o patches.json --patch 5
check aam aam train head/set.json -o aam.json --width 24 --levels 1 --no-colour --no-detector
check aam aam explore -o face.png
check people people enroll Ann head/images --any-quality
check people people identify other/images -o named
check people people forget Ann --yes
check plate plate read cars/images -o read --log plates.db
check plate plate log plates.db
check calibrate calibrate 'synth:board?size=320x240&fps=5&frames=15' --board chess:9x6 --square 25mm -o lens.yaml
check sfm sfm reconstruct views/images -o model --no-cache
printf '%d runs, %d failed\n' "$runs" "$failures"
[ "$failures" -eq 0 ]
