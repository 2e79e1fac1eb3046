# SPDX-License-Identifier: MIT
"""check_glb.py FILE: reads a binary glTF 2.0 file by its specification, without Tarsier's code, and prints its content.

If the file breaks a rule that viewers rely on, the script prints a line that says why and ends with status 1.
"""
import json
import struct
import sys

SIZES = {5121: 1, 5123: 2, 5125: 4, 5126: 4}
SHAPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def expect(condition, text):
    if not condition:
        sys.exit(f"{sys.argv[1]}: {text}")


data = open(sys.argv[1], "rb").read()
magic, version, length = struct.unpack_from("<4sII", data)
expect(magic == b"glTF" and version == 2 and length == len(data), "header")
size, kind = struct.unpack_from("<I4s", data, 12)
expect(kind == b"JSON" and size % 4 == 0, "first chunk")
gltf = json.loads(data[20:20 + size])
binary_size, binary_kind = struct.unpack_from("<I4s", data, 20 + size)
expect(binary_kind == b"BIN\0" and binary_size % 4 == 0 and 28 + size + binary_size == length, "second chunk")
binary = data[28 + size:]
expect(gltf["asset"]["version"] == "2.0" and gltf["buffers"] == [{"byteLength": binary_size}], "asset or buffer")
for view in gltf["bufferViews"]:
    expect(view["byteOffset"] % 4 == 0 and view["byteOffset"] + view["byteLength"] <= binary_size, "buffer view")


def read(index):
    accessor = gltf["accessors"][index]
    view = gltf["bufferViews"][accessor["bufferView"]]
    count = accessor["count"] * SHAPES[accessor["type"]]
    expect(count * SIZES[accessor["componentType"]] == view["byteLength"], f"length of accessor {index}")
    letter = {5121: "B", 5125: "I", 5126: "f"}[accessor["componentType"]]
    return struct.unpack_from(f"<{count}{letter}", binary, view["byteOffset"]), accessor


primitive = gltf["meshes"][0]["primitives"][0]
positions, accessor = read(primitive["attributes"]["POSITION"])
vertices = accessor["count"]
for axis in range(3):
    expect(accessor["min"][axis] <= min(positions[axis::3]) + 1e-6, "min of positions")
    expect(accessor["max"][axis] >= max(positions[axis::3]) - 1e-6, "max of positions")
normals, accessor = read(primitive["attributes"]["NORMAL"])
expect(accessor["count"] == vertices, "normals")
for k in range(0, len(normals), 3):
    expect(abs(sum(x * x for x in normals[k:k + 3]) - 1) < 1e-3, "length of a normal")
indices, _ = read(primitive["indices"])
expect(len(indices) % 3 == 0 and max(indices) < vertices, "indices")
kind = "plain"
if "TEXCOORD_0" in primitive["attributes"]:
    uvs, accessor = read(primitive["attributes"]["TEXCOORD_0"])
    expect(accessor["count"] == vertices and min(uvs) >= 0 and max(uvs) <= 1, "texture coordinates")
    image = gltf["bufferViews"][gltf["images"][0]["bufferView"]]
    expect(binary[image["byteOffset"]:image["byteOffset"] + 3] == b"\xff\xd8\xff", "image")
    kind = "textured"
elif "COLOR_0" in primitive["attributes"]:
    colors, accessor = read(primitive["attributes"]["COLOR_0"])
    expect(accessor["count"] == vertices and accessor["normalized"] is True, "colours")
    kind = "coloured"
matrix = gltf["nodes"][0]["matrix"]
for a in range(3):
    for b in range(3):
        dot = sum(matrix[4 * a + k] * matrix[4 * b + k] for k in range(3))
        expect(abs(dot - (a == b)) < 1e-6, "the node's matrix is no rotation")
print(f"{len(indices) // 3} faces, {kind}")
