#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/layers-image.py BUILD/layers.txt docs/img/layers.svg: draws the modules, each above all that it uses.

The file comes from the configuration of a build (tarsier_module(.. DEPENDS ..)). A module's layer is the longest way
down from it; its colour is its area's.
"""
import functools
import sys

AREAS = {
    "ground": ("#e4dceb", "core media linalg image/draw geometry render synth synth/face"),
    "faces": ("#f6d9cf", "face/detect face/shape face/landmarks face/appearance face/head face/head_view face/train face/recognition "
                         "face/people face/pipelines"),
    "plates": ("#d3e6f5", "plate/text plate/classic plate/tracking plate/networks plate/reader plate/train"),
    "structure from motion": ("#d5ead9", "sfm/scene sfm/view sfm/mapper sfm/pipelines"),
    "cameras, markers": ("#cfe6e6", "planar/markers planar/image_targets planar/calibration planar/sheets planar/augment planar/pipelines"),
    "cartoons": ("#efe0cf", "cartoon"),
    "interaction": ("#e6e3dc", "ui apps/tarsier apps/demo apps/window apps/capture bench"),
}
BOX, ROW, GAP, LEFT, TOP = 34, 54, 8, 64, 62
FONT = 'font-family="ui-monospace,Menlo,DejaVu Sans Mono,monospace"'


def read(path):
    modules = {}
    with open(path, encoding="utf-8") as lines:
        for line in lines:
            name, _, used = line.partition(":")
            modules[name.strip()] = used.split()
    return modules


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    modules = read(sys.argv[1])

    @functools.lru_cache(None)
    def layer(name):
        return 1 + max((layer(used) for used in modules[name]), default=-1)

    colours = {name: colour for colour, names in AREAS.values() for name in names.split()}
    order = list(colours)
    unknown = set(modules) - set(colours)
    if unknown:
        sys.exit(f"no area for {', '.join(sorted(unknown))}: add it to AREAS")
    top = max(map(layer, modules))
    rows = [[name for name in order if name in modules and layer(name) == k] for k in range(top + 1)]
    if "ui" in rows[top] and len(rows[top]) > 1:  # its own: it may use all
        rows[top].remove("ui")
        rows.append(["ui"])
    rows.append(["apps/tarsier", "apps/demo", "bench", "apps/window", "apps/capture"])
    width_of = lambda name: 22 + 8.45 * len(name)
    width = LEFT + max(sum(width_of(name) + GAP for name in row) for row in rows) + 34
    height = TOP + ROW * len(rows) + 8
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" width="{width:.0f}" '
           f'height="{height}" font-family="system-ui,Segoe UI,Roboto,DejaVu Sans,sans-serif" role="img" '
           'aria-label="The modules of Tarsier in layers, programs on top, the core at the bottom; each uses only what is below it">',
           f'<rect width="{width:.0f}" height="{height}" rx="14" fill="#fbf9f4"/>']
    x = 20
    for area, (colour, _) in AREAS.items():
        out.append(f'<rect x="{x:.1f}" y="18" width="14" height="14" rx="4" fill="{colour}" stroke="#00000022"/>'
                   f'<text x="{x + 19:.1f}" y="30" font-size="13" fill="#5c544c">{area}</text>')
        x += 34 + 7.1 * len(area)
    for k, row in enumerate(rows):
        y = TOP + ROW * (len(rows) - 1 - k)
        out.append(f'<text x="30" y="{y + 22}" font-size="14" font-weight="600" text-anchor="middle" fill="#3a3430">{k}</text>')
        x = LEFT
        for name in row:
            out.append(f'<rect x="{x:.1f}" y="{y}" width="{width_of(name):.1f}" height="{BOX}" rx="7" '
                       f'fill="{colours[name]}" stroke="#00000022"/>'
                       f'<text x="{x + width_of(name) / 2:.1f}" y="{y + 22}" font-size="14" text-anchor="middle" '
                       f'fill="#24201c" {FONT}>{name}</text>')
            x += width_of(name) + GAP
    right = width - 18
    out.append(f'<path d="M{right:.0f} {TOP}V{height - 30}" stroke="#b0521a" stroke-width="3"/>'
               f'<path d="M{right - 7:.0f} {height - 32}h14l-7 14z" fill="#b0521a"/>'
               f'<text transform="translate({right - 16:.0f} {TOP + 90}) rotate(90)" font-size="13" '
               'fill="#b0521a">may use</text>')
    out.append("</svg>")
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write("\n".join(out) + "\n")


main()
