#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tiny_face_detector.py FOLDER: an installable face detector with handwritten weights in the format of tensorflow.js: a weights
manifest (tiny-weights_manifest.json) and its shard (tiny.bin). It takes bright areas for faces."""
import json
import os
import struct
import sys

folder = sys.argv[1]
weights, shard = [], bytearray()


def tensor(name, shape, numbers):
    count = 1
    for size in shape:
        count *= size
    values = [0.0] * count
    for index, value in numbers.items():
        values[index] = value
    weights.append({"name": name, "shape": shape, "dtype": "float32"})
    shard.extend(struct.pack(f"<{count}f", *values))


tensor("conv0/filters", [3, 3, 3, 2], {24: 1 / 3, 26: 1 / 3, 28: 1 / 3})
tensor("conv0/bias", [2], {0: 0.43})
for i in range(1, 6):
    tensor(f"conv{i}/depthwise_filter", [3, 3, 2, 1], {8: 1.0})
    tensor(f"conv{i}/pointwise_filter", [1, 1, 2, 2], {0: 1.0})
    tensor(f"conv{i}/bias", [2], {})
tensor("conv8/filters", [1, 1, 2, 25], {4: 20.0})
tensor("conv8/bias", [25], {4 + 5 * anchor: -10.0 for anchor in range(5)})

os.makedirs(folder, exist_ok=True)
with open(os.path.join(folder, "tiny.bin"), "wb") as file:
    file.write(shard)
with open(os.path.join(folder, "tiny-weights_manifest.json"), "w") as file:
    json.dump([{"weights": weights, "paths": ["tiny.bin"]}], file)
