#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# sfm mesh: a surface from exact depth maps, its files, errors of input and output.
. "$TARSIER_SOURCE/tests/e2e/lib.sh"
check_glb=$TARSIER_SOURCE/tests/e2e/check_glb.py

run sfm synth -o scene --images 5 --size 240x180 --depth --noise 0
expect_status 0
cp -r scene/images scene/truth/images
dense=scene/truth

# --- glTF, read by somebody else ---
run sfm mesh $dense -o mesh.glb --faces 5000 --texture 1024 --view view.png --turntable mesh.gif --page mesh.html --json
expect_status 0
python3 "$check_glb" mesh.glb >glb.txt || fail "mesh.glb"
grep -q "faces, textured" glb.txt || fail "mesh.glb: $(cat glb.txt)"
python3 - "$out" <<'PY' || fail "the report: $out"
import json, sys
report = json.loads(sys.argv[1])
sys.exit(not (report["views"] == 5 and 4900 <= report["faces"] <= 5000 and report["volume"] is None and not report["closed"]
              and report["texture"]["charts"] >= 1 and 30 < report["area"] < 400))
PY
grep -q 'data-layer="mesh"' mesh.html || fail "no mesh.html"
head -c 8 view.png | grep -q PNG || fail "no view.png"
head -c 6 mesh.gif | grep -q GIF89a || fail "no mesh.gif"

# --- the vertices lie on the surface that was drawn ---
run sfm mesh $dense -o mesh.ply --faces 0 --json
expect_status 0
python3 - <<'PY' || fail "mesh.ply is not where the depth maps are"
import math, struct, sys
data = open("mesh.ply", "rb").read()
end = data.index(b"end_header\n") + 11
count = int(data.split(b"element vertex ")[1].split()[0])
vertices = [struct.unpack_from("<3f", data, end + 27 * i) for i in range(count)]
camera, image = None, None
line = [l for l in open("scene/truth/sparse/cameras.txt") if not l.startswith("#")][0].split()
fx, fy, cx, cy = (float(x) for x in line[4:8])
pose = [l for l in open("scene/truth/sparse/images.txt") if not l.startswith("#")][0].split()
w, x, y, z = (float(v) for v in pose[1:5])
t = [float(v) for v in pose[5:8]]
r = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
depth = open("scene/truth/stereo/depth_maps/" + pose[9] + ".geometric.bin", "rb").read()
width, height, _, rest = depth.split(b"&", 3)
width, height = int(width), int(height)
offset = len(depth) - len(rest)
errors = []
for v in vertices[::7]:
    c = [sum(r[i][k] * v[k] for k in range(3)) + t[i] for i in range(3)]
    u, q = round(fx * c[0] / c[2] + cx - 0.5), round(fy * c[1] / c[2] + cy - 0.5)
    if 0 <= u < width and 0 <= q < height:
        errors.append(abs(struct.unpack_from("<f", depth, offset + 4 * (q * width + u))[0] - c[2]))
errors.sort()
print(len(errors), errors[len(errors) // 2])
sys.exit(not (len(errors) > 1000 and errors[len(errors) // 2] < 0.03))  # voxels of about 0.06
PY

# --- and fit the true surface that synth wrote ---
run sfm eval $dense --dense --mesh mesh.ply --truth scene/truth --errors errors --json
expect_status 0
python3 - "$out" <<'PY' || fail "the surface of exact depth maps: $out"
import json, sys
mesh = json.loads(sys.argv[1])["mesh"]
half = [t for t in mesh["thresholds"] if t["threshold"] == 0.005][0]
sys.exit(not (half["accuracy"] > 0.99 and half["completeness"] > 0.95 and mesh["distance_median"] < 1e-3 * mesh["extent"]))
PY
head -c 3 errors/mesh.ply | grep -q ply || fail "no errors/mesh.ply"
run sfm eval $dense --mesh mesh.ply --truth scene/truth
expect_status 2
expect_error "--dense"
run sfm eval $dense --dense --mesh mesh.glb --truth scene/truth
expect_status 3
expect_error ".ply"
mv scene/truth/mesh.ply true.ply
run sfm eval $dense --dense --mesh mesh.ply --truth scene/truth
expect_status 3
expect_error "sfm synth --depth"
mv true.ply scene/truth/mesh.ply

# --- a known distance ---
run sfm mesh $dense -o other.obj --faces 1000 --texture 256 --distance-between 0000.jpg 0004.jpg --distance 1000 --json
expect_status 0
[ -s other.obj ] && [ -s other.mtl ] && [ -s other.png ] || fail "other.obj comes with other.mtl and other.png"
run sfm mesh $dense -o no.obj --distance-between 0000.jpg nobody.jpg --distance 1
expect_status 2
expect_error nobody.jpg

# --- markers: a scene without any ---
run sfm mesh $dense -o no.obj --marker-size 5cm
expect_status 3
expect_error "scale from markers: no marker was detected"
run sfm mesh $dense -o no.obj --marker-size 5cm --marker-family 9x9
expect_status 2
expect_error 9x9
run sfm mesh $dense -o no.obj --marker-size 5cm --distance-between 0000.jpg 0004.jpg --distance 1
expect_status 2
expect_error marker-size
[ ! -e no.obj ] || fail "a surface without the scale that was asked for"

# --- what is wrong is said, and nothing is written ---
run sfm mesh $dense -o mesh.stl
expect_status 2
expect_error ".glb"
run sfm mesh $dense -o no.glb --page no.txt
expect_status 2
expect_error "no.txt"
run sfm mesh nowhere -o no.glb
expect_status 3
expect_error nowhere
mkdir empty
run sfm mesh empty -o no.glb
expect_status 3
run sfm mesh $dense -o missing/no.glb
expect_status 6
cp -r $dense bare
rm -r bare/stereo
run sfm mesh bare -o no.glb
expect_status 3
expect_error "sfm dense"
cp -r $dense spoilt
for map in spoilt/stereo/depth_maps/*; do printf '240&180&1&' >"$map"; done
run sfm mesh spoilt -o no.glb
expect_status 3
run sfm mesh $dense -o no.glb --voxel 0.00002
expect_status 2
expect_error "--voxel"
[ ! -e no.glb ] && [ ! -e no.obj ] || fail "something was written"
if [ -e /dev/full ]; then
  ln -s /dev/full full.ply
  run sfm mesh $dense -o full.ply --faces 1000
  expect_status 6
fi
finish
