#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/layers-image.py [--check] docs/architecture.md docs/img/layers.svg

Draws the page's table of modules: one row per layer, the lowest at the bottom. Layer 3 has a box for each family; modules stand
above those that they use. --check writes nothing. It fails if the image differs from the table, or if a module uses a module
of a higher layer or one that is not in the table (the test architecture/diagram).
"""
import functools
import re
import sys

FAMILIES = {  # of layer 3, left to right: colour, title
    "cartoon": ("#efe0cf", "cartoon"),
    "plate": ("#d3e6f5", "plate/"),
    "face": ("#f6d9cf", "face/"),
    "planar": ("#cfe6e6", "planar/"),
    "sfm": ("#d5ead9", "sfm/"),
}
GROUND, APPS = "#e4dceb", "#e6e3dc"
LAYERS = {0: "base", 1: "input, maths", 2: "geometry", 3: "applications", 4: "synthetic", 5: "sessions", 6: "programs"}
BOX, STEP, GAP, LEFT, TOP, PAD = 28, 36, 8, 136, 22, 12  # px
FONT = 'font-family="ui-monospace,Menlo,DejaVu Sans Mono,monospace"'
WIDEST = 3  # max modules side by side in a family


def read_table(path):
    """{module: (layer, what it uses)}, in the order of the table."""
    modules = {}
    with open(path, encoding="utf-8") as lines:
        for line in lines:
            row = re.match(r"\| (\d) \| `([a-z_/]+)` \| .* \| ([^|]*) \|$", line)
            if row:
                modules[row[2]] = int(row[1]), row[3].split()
    if len(modules) < 40:
        sys.exit(f"{path}: only {len(modules)} modules: what became of the table?")
    return modules


def check_layers(modules):
    wrong = []
    for name, (layer, uses) in modules.items():
        if layer > 4:
            continue  # in words: checked where the build links them
        for used in uses:
            if used == "-":
                continue
            if used not in modules:
                wrong.append(f"{name} uses {used}, which is no row of the table")
            elif modules[used][0] > layer and not name.endswith("/train"):
                wrong.append(f"{name} of layer {layer} uses {used} of layer {modules[used][0]}")
    if wrong:
        sys.exit("\n".join(wrong))


def rows_of(names, modules):
    """The modules of one family or layer, lowest row first. Each stands above all modules that it uses."""
    @functools.lru_cache(None)
    def depth(name):
        return 1 + max((depth(used) for used in modules[name][1] if used in names), default=-1)

    rows = []
    for k in range(max(map(depth, names)) + 1):
        row = [name for name in names if depth(name) == k]
        rows += [row[i:i + WIDEST] for i in range(0, len(row), WIDEST)]
    return rows


def width_of(text):
    return 18 + 7.9 * len(text)


def box(x, y, text, colour):
    return (f'<rect x="{x:.1f}" y="{y}" width="{width_of(text):.1f}" height="{BOX}" rx="6" fill="{colour}" stroke="#00000022"/>'
            f'<text x="{x + width_of(text) / 2:.1f}" y="{y + 19}" font-size="13" text-anchor="middle" fill="#24201c" {FONT}>{text}</text>')


def draw(modules):
    columns = {}  # of layer 3: rows of names without the family's prefix
    for family in FAMILIES:
        names = tuple(name for name, (layer, _) in modules.items() if layer == 3 and name.split("/")[0] == family)
        columns[family] = [[name.split("/")[-1] for name in row] for row in rows_of(names, modules)]
    others = [name for name, (layer, _) in modules.items() if layer == 3 and name.split("/")[0] not in FAMILIES]
    if others:
        sys.exit(f"no family for {', '.join(others)}: add it to FAMILIES")
    across = {f: 2 * PAD + max(sum(map(width_of, row)) + GAP * (len(row) - 1) for row in rows) for f, rows in columns.items()}
    width = LEFT + sum(across.values()) + GAP * (len(across) - 1) + 52
    tallest = 30 + STEP * max(map(len, columns.values()))

    y, out = TOP, []
    for layer in sorted(LAYERS, reverse=True):
        high = tallest if layer == 3 else BOX
        middle = y + high // 2
        out.append(f'<text x="26" y="{middle + 5}" font-size="15" font-weight="600" text-anchor="middle" fill="#3a3430">{layer}</text>'
                   f'<text x="42" y="{middle + 4}" font-size="12" fill="#7a7168">{LAYERS[layer]}</text>')
        x = LEFT
        if layer == 3:
            for family, rows in columns.items():
                colour, title = FAMILIES[family]
                out.append(f'<rect x="{x:.1f}" y="{y}" width="{across[family]:.1f}" height="{tallest}" rx="10" fill="{colour}" '
                           f'fill-opacity="0.45" stroke="#00000022"/>'
                           f'<text x="{x + PAD:.1f}" y="{y + 20}" font-size="13" font-weight="600" fill="#3a3430" {FONT}>{title}</text>')
                for k, row in enumerate(rows):
                    at = x + PAD
                    for name in row:
                        out.append(box(at, y + tallest - STEP * (k + 1), name, colour))
                        at += width_of(name) + GAP
                x += across[family] + GAP
        else:
            for name in (name for name, row in modules.items() if row[0] == layer):
                out.append(box(x, y, name, APPS if layer > 4 else GROUND))
                x += width_of(name) + GAP
        y += high + 14
    height = y + 6
    right = width - 20
    out.append(f'<path d="M{right:.0f} {TOP + 6}V{height - 34}" stroke="#b0521a" stroke-width="3"/>'
               f'<path d="M{right - 7:.0f} {height - 36}h14l-7 14z" fill="#b0521a"/>'
               f'<text transform="translate({right - 14:.0f} {TOP + 60}) rotate(90)" font-size="13" fill="#b0521a">may use</text>')
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" width="{width:.0f}" height="{height}" '
        'font-family="system-ui,Segoe UI,Roboto,DejaVu Sans,sans-serif" role="img" '
        'aria-label="The modules of Tarsier in layers 0 to 6, the core at the bottom, programs on top; each uses only what is below it">',
        f'<rect width="{width:.0f}" height="{height}" rx="14" fill="#fbf9f4"/>', *out, "</svg>\n"])


def main():
    words = sys.argv[1:]
    checking = "--check" in words
    paths = [word for word in words if word != "--check"]
    if len(paths) != 2:
        sys.exit(__doc__)
    modules = read_table(paths[0])
    check_layers(modules)
    image = draw(modules)
    if not checking:
        with open(paths[1], "w", encoding="utf-8") as file:
            file.write(image)
        return
    with open(paths[1], encoding="utf-8") as file:
        if file.read() != image:
            sys.exit(f"{paths[1]} is not what the table of {paths[0]} gives: run scripts/layers-image.py {paths[0]} {paths[1]}")


main()
