#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The pose of an object with known points: a cube and a flat square seen by a known camera, hostile files.
# shellcheck source=tests/e2e/lib.sh
source "$TARSIER_SOURCE/tests/e2e/lib.sh"

python3 - <<'END'
import math
def mul(a, b): return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
def rx(a): return [[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]]
def ry(a): return [[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]]
R, T, F = mul(rx(0.4), ry(-0.7)), (12.0, -7.0, 400.0), 760.0
def see(p):
    x = [sum(R[i][k] * p[k] for k in range(3)) + T[i] for i in range(3)]
    return F * x[0] / x[2], F * x[1] / x[2]
def write(name, points): open(name, "w").write("# made by hand\n" + "".join(" ".join("%.9g" % v for v in p) + "\n" for p in points))
cube = [(x, y, z) for z in (0, 100) for y in (0, 100) for x in (0, 100)]
write("cube.txt", cube)
write("seen.txt", [see(p) for p in cube])
write("corner.txt", [(u + 319.5, v + 239.5) for u, v in map(see, cube)])
square = [(x, y, 0) for y in (-40, 0, 40) for x in (-40, 0, 40)]
write("square.txt", square)
write("square-seen.txt", [see(p) for p in square])
write("line.txt", [(i, 2 * i, 3 * i) for i in range(8)])
write("three.txt", cube[:3])
write("three-seen.txt", [see(p) for p in cube[:3]])
open("nan.txt", "w").write("nan 1\n" * 8)
open("words.txt", "w").write("one two three\n")
open("truth.txt", "w").write(" ".join("%.17g" % v for r in R for v in r) + " %g %g %g" % T)
END

cat >check.py <<'END'
import json, sys
line = json.loads(open("stdout.txt").readline())
truth = [float(v) for v in open("truth.txt").read().split()]
pose = line["poses"][0]
assert max(abs(a - b) for a, b in zip(pose["rotation"], truth)) < float(sys.argv[1]), pose
assert max(abs(a - b) for a, b in zip(pose["translation"], truth[9:])) < float(sys.argv[2]), pose
END
exact() { python3 check.py "$@" 2>python.txt || fail "$command_line: not the true pose: $(tail -1 python.txt)"; }

# Each method finds the true pose of the cube; from the image's corner as from its middle.
for method in auto posit posit-classic; do
  run pose solve --object cube.txt --points seen.txt --focal 760 --method $method --json
  expect_status 0
  exact 1e-4 0.05
done
run pose solve --object cube.txt --points seen.txt --focal 760 --no-refine --json
expect_status 0
exact 1e-3 0.5
run pose solve --object cube.txt --points corner.txt --camera 760,760,319.5,239.5 --json -o axes.png
expect_status 0
exact 1e-4 0.05
[ -s axes.png ] || fail "no image with the axes"
# Points that are off by a px leave the pose uncertain by as much as they tell.
awk '!/^#/ { print $1 + (NR % 2 ? 1 : -1), $2 + (NR % 3 ? -0.5 : 1) }' seen.txt >off.txt
run pose solve --object cube.txt --points off.txt --focal 760 --json
expect_status 0
python3 -c 'import json
pose = json.loads(open("stdout.txt").readline())["poses"][0]
assert len(pose["turn_sigma_deg"]) == len(pose["translation_sigma"]) == 3
assert all(0.05 < s < 5 for s in pose["turn_sigma_deg"]), pose
assert pose["translation_sigma"][2] > 3 * pose["translation_sigma"][0]' || fail "the deviations of a noisy pose"
run pose solve --object cube.txt --points off.txt --focal 760
expect_out 'turn \+- .* degrees about x, y, z'
run pose solve --object cube.txt --points seen.txt --camera 760,760,319.5,239.5 --origin center --json
expect_status 0
exact 1e-4 0.05
run pose solve --object cube.txt --points seen.txt --focal 760
expect_status 0
expect_out 'rotation' 'translation +12.000 +-7.000 +400.000' 'rms'

# A flat object has two poses, the better one first.
run pose solve --object square.txt --points square-seen.txt --focal 760 --json
expect_status 0
exact 1e-4 0.05
expect_out '"method":"planar"'
[ "$(grep -o '"rotation"' stdout.txt | wc -l)" -eq 2 ] || fail "not both poses of the square"
run pose solve --object square.txt --points square-seen.txt --focal 760
expect_out 'two poses, the better one first'

# What has no answer says why.
expect_refusal() { # STATUS PATTERN ARGUMENTS..
  local status_wanted=$1 pattern=$2
  shift 2
  run pose solve "$@"
  expect_status "$status_wanted"
  expect_error "$pattern"
}
expect_refusal 3 'coplanar' --object square.txt --points square-seen.txt --focal 760 --method posit
expect_refusal 3 'line' --object line.txt --points seen.txt --focal 760
expect_refusal 3 'at least 4 points' --object three.txt --points three-seen.txt --focal 760
expect_refusal 3 'nan.txt: line 1: .*not finite' --object cube.txt --points nan.txt --focal 760
expect_refusal 3 "words.txt: line 1: expected a number, got 'one'" --object words.txt --points seen.txt --focal 760
expect_refusal 3 'has 9 points, the object 8' --object cube.txt --points square-seen.txt --focal 760
expect_refusal 3 'line 2: 2 numbers where a point has 3' --object seen.txt --points seen.txt --focal 760
expect_refusal 3 'gone.txt' --object gone.txt --points seen.txt --focal 760
expect_refusal 2 '--focal' --object cube.txt --points seen.txt
expect_refusal 2 'corner' --object cube.txt --points seen.txt --focal 760 --origin corner
expect_refusal 2 'reference' --object cube.txt --points seen.txt --focal 760 --reference 8
expect_refusal 2 '-o needs' --object cube.txt --points seen.txt --focal 760 -o x.png
expect_refusal 6 'nowhere' --object cube.txt --points corner.txt --camera 760,760,319.5,239.5 -o /proc/nowhere/x.png
finish
