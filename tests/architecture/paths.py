#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""paths.py ROOT: fails if a comment or a page names a file of the project that does not exist, or links to a missing heading.

It checks comments of headers, sources, scripts and CMake files, and all pages except the changelog. A name counts if it has one
of the project's file endings (.h, .cpp, .py, .md ..) or begins with one of its top folders. It may leave out the first folders
of its path ("text/decode.h", "decode.h"), or be relative to the file that names it.
"""
import os
import re
import sys

from project_files import project_files

CODE = re.compile(r"^(src|apps|examples|fuzz|bench|tests)/.*\.(h|inl|cpp)$")
SCRIPT = re.compile(r"\.(py|sh|cmake)$|(^|/)CMakeLists\.txt$|^(demo|test|\.ci/run)$")
PAGE = re.compile(r"^(README|CONTRIBUTING)\.md$|^(docs|models|bench)/.*\.md$")

NAME = re.compile(r"(?<![\w/.<$*{}~@%:>-])((?:[\w.-]+/)*[\w-][\w.-]*\.(?:h|inl|cpp|py|sh|cmake|md|ts|tsx|mjs))(?![\w/*({])")
FOLDER = re.compile(r"`((?:src|apps|tests|scripts|docs|bench|fuzz|cmake|packaging|examples|models)/[\w./-]*)`")

# Names that are not files of the project: placeholders (NAME.md), library headers, files of an example, a tool of the development data,
# test names.
ALLOWED = re.compile(r"^(NAME\.\w+|jpeglib\.h|stays\.py|eval_ar\.py|fuzz/replay)$")


def endings_of(files):
    """Each path without its first folders, i.e. all names that a text may use; and the same of the folders."""
    endings = set()
    for name in files:
        parts = name.split("/")
        for last in range(1, len(parts) + 1):
            endings.update("/".join(parts[first:last]) for first in range(last))
    return endings


def headings_of(path):
    """The anchors of a page's headings in GitHub's form."""
    with open(path, encoding="utf-8") as file:
        found = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", file.read(), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


def lost_links(root, name, line):
    """The broken links of a page to headings of this page or of another."""
    for path, heading in re.findall(r"\]\(([\w./-]*\.md)?#([^)]+)\)", line):
        page = os.path.join(root, os.path.normpath(os.path.join(os.path.dirname(name), path)) if path else name)
        if os.path.isfile(page) and heading not in headings_of(page):
            yield f"{path}#{heading}"


def comment_of(name, line):
    if PAGE.search(name):
        return line
    mark = r"(?<![:\w])//(.*)" if CODE.search(name) else r"(?:^|\s)#\s(.*)"
    found = re.search(mark, line)
    return found[1] if found else ""


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else "."
    files = set(project_files(root))
    endings = endings_of(files)
    found = looked_at = 0
    for name in sorted(files):
        if not (CODE.search(name) or SCRIPT.search(name) or PAGE.search(name)):
            continue
        with open(os.path.join(root, name), encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                text = comment_of(name, line)
                for link in lost_links(root, name, line) if PAGE.search(name) else ():
                    print(f"{name}:{number}: there is no heading {link}")
                    found += 1
                for called in NAME.findall(text) + FOLDER.findall(text):
                    looked_at += 1
                    path = os.path.normpath(called)
                    beside = os.path.normpath(os.path.join(os.path.dirname(name), called))
                    if path not in endings and beside not in endings and not ALLOWED.search(called):
                        print(f"{name}:{number}: there is no {called}: {line.strip()[:100]}")
                        found += 1
    if found:
        sys.exit(f"{found} names of files that do not exist")
    if looked_at < 200:
        sys.exit(f"only {looked_at} names of files were found: what does this test read?")


main()
