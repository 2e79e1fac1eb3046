#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tiny_face_network.py FOLDER [SEED]: an untrained face network in the format of tensorflow.js: a weights manifest
(tiny-weights_manifest.json) and its shard (tiny.bin). It has random weights, all kinds of layers, 128 numbers per face. That
is enough for everything except right answers."""
import json
import os
import random
import struct
import sys

folder = sys.argv[1]
draw = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
weights, shard = [], bytearray()


def levels(name, shape, low, high):
    count = 1
    for size in shape:
        count *= size
    weights.append({"name": name, "shape": shape, "dtype": "float32",
                    "quantization": {"dtype": "uint8", "scale": (high - low) / 255, "min": low}})
    shard.extend(draw.randrange(256) for _ in range(count))


def layer(name, kernel, inputs, outputs):
    reach = (6 / (kernel * kernel * inputs)) ** 0.5
    levels(f"{name}/conv/filters", [kernel, kernel, inputs, outputs], -reach, reach)
    levels(f"{name}/conv/bias", [outputs], -0.1, 0.1)
    levels(f"{name}/scale/weights", [outputs], 0.8, 1.2)
    levels(f"{name}/scale/biases", [outputs], -0.1, 0.1)


layer("conv4_down", 7, 3, 4)
for block, inputs, outputs in (("conv4_1", 4, 4), ("conv8_down", 4, 8), ("conv16_down", 8, 16), ("conv16_1", 16, 16)):
    layer(f"{block}/conv1", 3, inputs, outputs)
    layer(f"{block}/conv2", 3, outputs, outputs)
weights.append({"name": "fc", "shape": [16, 128], "dtype": "float32"})
shard.extend(struct.pack("<2048f", *(draw.gauss(0, 0.3) for _ in range(2048))))

os.makedirs(folder, exist_ok=True)
with open(os.path.join(folder, "tiny.bin"), "wb") as file:
    file.write(shard)
with open(os.path.join(folder, "tiny-weights_manifest.json"), "w") as file:
    json.dump([{"weights": weights, "paths": ["tiny.bin"]}], file)
