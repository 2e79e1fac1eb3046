#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tiny untrained ONNX files, written without the package onnx: protobuf's wire format is a few lines.

  tiny_onnx.py embedding FILE [SEED]     3 x 112 x 112 -> 32 numbers: convolution, rectifier, matrix; random weights
  tiny_onnx.py detector FILE W H X0 Y0 .. X4 Y4
                                         3 x H x W -> the outputs of the YuNet family at cells of 8 px: for any image
                                         one face with these five points (eyes, nose, corners of the mouth; px)
  tiny_onnx.py hostile FOLDER            files that must be refused, each named by its fault
"""
import math
import os
import random
import struct
import sys


def varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def field(number, value):
    """A number as varint; a text or message with its length."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    if isinstance(value, str):
        value = value.encode()
    return varint(number << 3 | 2) + varint(len(value)) + value


def tensor(name, shape, numbers):
    return b"".join(field(1, side) for side in shape) + field(2, 1) + field(8, name) + field(
        9, struct.pack(f"<{len(numbers)}f", *numbers))


def integers(name, shape, numbers):
    return b"".join(field(1, side) for side in shape) + field(2, 7) + field(8, name) + field(
        9, struct.pack(f"<{len(numbers)}q", *numbers))


def attribute(name, value):
    if isinstance(value, list):
        return field(1, name) + b"".join(field(8, one) for one in value) + field(20, 7)
    return field(1, name) + field(3, value) + field(20, 2)


def node(kind, inputs, outputs, **attributes):
    return b"".join(field(1, one) for one in inputs) + b"".join(field(2, one) for one in outputs) + field(
        3, f"node_{outputs[0]}") + field(4, kind) + b"".join(field(5, attribute(name, value)) for name, value in attributes.items())


def form(name, shape):
    sides = b"".join(field(1, field(1, side)) for side in shape)
    return field(1, name) + field(2, field(1, field(1, 1) + field(2, sides)))


def model(nodes, tensors, inputs, outputs):
    graph = b"".join(field(1, one) for one in nodes) + field(2, "tiny") + b"".join(field(5, one) for one in tensors) + b"".join(
        field(11, one) for one in inputs) + b"".join(field(12, one) for one in outputs)
    return field(1, 7) + field(2, "tiny_onnx.py") + field(7, graph) + field(8, field(2, 11))


def gauss(draw, count, spread):
    return [draw.gauss(0, spread) for _ in range(count)]


def embedding(seed=1, outputs=32, side=112, kernels=None):
    draw = random.Random(seed)
    cells = (side // 16) ** 2
    return model(
        [node("Conv", ["data", "kernels", "bias"], ["maps"], kernel_shape=[16, 16], strides=[16, 16], pads=[0, 0, 0, 0]),
         node("Relu", ["maps"], ["kept"]),
         node("Flatten", ["kept"], ["flat"], axis=1),
         node("Gemm", ["flat", "matrix", "shift"], ["numbers"], transB=1)],
        [tensor("kernels", kernels or [8, 3, 16, 16], gauss(draw, 8 * 3 * 256, 1 / 16)), tensor("bias", [8], gauss(draw, 8, 1)),
         tensor("matrix", [outputs, 8 * cells], gauss(draw, 8 * cells * outputs, 0.05)), tensor("shift", [outputs], gauss(draw, outputs, 0.1))],
        [form("data", [1, 3, side, side])], [form("numbers", [1, outputs])])


def detector(width, height, points):
    columns, rows, stride = width // 8, height // 8, 8
    eyes = [(points[0] + points[2]) / 2, (points[1] + points[3]) / 2]
    x, y = min(columns - 1, int(eyes[0] / stride)), min(rows - 1, int(eyes[1] / stride))
    here = y * columns + x
    size = 2.4 * math.dist(points[0:2], points[2:4])
    per_cell = {"cls": [1.0], "obj": [0.9], "bbox": [0.5, 0.5, math.log(size / stride), math.log(size / stride)],
                "kps": [value / stride - (y if i % 2 else x) for i, value in enumerate(points)]}
    nodes = [node("GlobalAveragePool", ["data"], ["mean"]), node("Flatten", ["mean"], ["flat"], axis=1)]
    tensors, outputs = [], []
    for kind, numbers in per_cell.items():
        each, count = len(numbers), columns * rows * len(numbers)
        values = [0.0] * count
        values[here * each:(here + 1) * each] = numbers
        name = f"{kind}_{stride}"
        tensors += [tensor(f"{kind}_matrix", [count, 3], [0.0] * (3 * count)), tensor(f"{kind}_shift", [count], values),
                    integers(f"{kind}_shape", [3], [1, columns * rows, each])]
        nodes += [node("Gemm", ["flat", f"{kind}_matrix", f"{kind}_shift"], [f"{kind}_row"], transB=1),
                  node("Reshape", [f"{kind}_row", f"{kind}_shape"], [name])]
        outputs.append(form(name, [1, columns * rows, each]))
    return model(nodes, tensors, [form("data", [1, 3, height, width])], outputs)


def hostile(folder):
    os.makedirs(folder, exist_ok=True)
    whole = embedding()
    other = lambda kind: model([node(kind, ["data"], ["numbers"])], [], [form("data", [1, 3, 112, 112])], [form("numbers", [1, 32])])
    huge = field(1, 1 << 20) + field(1, 1 << 20) + field(2, 1) + field(8, "huge") + field(9, b"\0" * 16)
    external = field(1, 4) + field(2, 1) + field(8, "away") + field(13, field(1, "location") + field(2, "/etc/passwd")) + field(14, 1)
    relu = [node("Relu", ["data"], ["numbers"])]
    image, numbers = [form("data", [1, 3, 112, 112])], [form("numbers", [1, 32])]
    files = {
        "empty": b"",
        "text": b"this is no network\n" * 40,
        "cut": whole[:len(whole) // 2],
        "cut-late": whole[:-3],
        "loop": other("Loop"),
        "unknown": other("NoSuchLayer"),
        "huge-tensor": model(relu, [huge], image, numbers),
        "external": model(relu, [external], image, numbers),
        "wrong-kernels": embedding(kernels=[8, 3, 8, 32]),
        "wrong-length": embedding(kernels=[8, 3, 16, 17]),
        "two-inputs": model(relu, [], image + [form("more", [1, 3, 112, 112])], numbers),
        "no-image": model(relu, [], [form("data", [1, 3])], numbers),
        "many-channels": model(relu, [], [form("data", [1, 64, 112, 112])], numbers),
        "huge-image": model(relu, [], [form("data", [1, 3, 1 << 20, 1 << 20])], numbers),
        "open-size": model(relu, [], [form("data", [1, 3, 0, 0])], numbers),
        "image-out": model(relu, [], image, [form("numbers", [1, 3, 112, 112])]),
        "no-group": model([node("Conv", ["data", "w"], ["numbers"], group=0)], [tensor("w", [1, 3, 1, 1], [1.0] * 3)], image, numbers),
        "missing-input": model([node("Add", ["data", "nobody"], ["numbers"])], [], image, numbers),
        "no-such-output": model(relu, [], image, [form("elsewhere", [1, 32])]),
        "huge-layers": model([node("ConvTranspose", ["data", "w"], ["numbers"], strides=[500, 500], kernel_shape=[1, 1])],
                             [tensor("w", [3, 4, 1, 1], [1.0] * 12)], image, numbers),
        "few-numbers": embedding(outputs=4),
    }
    for name, content in files.items():
        with open(os.path.join(folder, f"{name}.onnx"), "wb") as file:
            file.write(content)


if __name__ == "__main__":
    kind, path = sys.argv[1:3]
    if kind == "hostile":
        hostile(path)
    else:
        content = embedding(int(sys.argv[3]) if len(sys.argv) > 3 else 1) if kind == "embedding" else detector(
            int(sys.argv[3]), int(sys.argv[4]), [float(word) for word in sys.argv[5:15]])
        with open(path, "wb") as file:
            file.write(content)
