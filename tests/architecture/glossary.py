#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""glossary.py ROOT: fails on words that docs/glossary.md refuses (its last column, in backquotes).

A word that ends in _ is the beginning of a part of an identifier (least_ in min_views or kMinViews). A word with a capital first
letter is a whole identifier. Others are words of sentences, with their endings. JSON keys, which follow a quotation mark, are
allowed. The script checks headers, sources, pages of the studio, scripts, and all pages except the changelog.
"""
import os
import re
import sys

from project_files import project_files

CHECKED = re.compile(r"^(src|apps|examples|fuzz|bench)/.*\.(h|inl|cpp)$|^(README|CONTRIBUTING)\.md$|^docs/.*\.md$|^models/.*\.md$"
                     r"|^apps/web/client/(src|test)/.*\.tsx?$|^scripts/.*\.(py|sh)$|^(demo|test)$")

# The list itself, and files that accept flags by their former names.
EXEMPT = ("docs/glossary.md", "apps/tarsier/framework/parse.cpp", "apps/tarsier/framework/command_test.cpp")
# Files that read a key of the program's JSON by its name.
READS_KEY = {"apps/web/client/src/pages/reconstruct/model_view.tsx": "photograph"}


def given_up(path):
    """(pattern, word, term) of each row."""
    rules = []
    with open(path, encoding="utf-8") as file:
        for line in file:
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if len(cells) != 3:
                continue
            for word in re.findall(r"`([A-Za-z_]+)`", cells[2]):
                if word.endswith("_"):
                    part = word[:-1]
                    pattern = rf"(?<![A-Za-z\"]){part}_(?!squares|common\b)[a-z]|\bk{part.capitalize()}[A-Z]|--{part}-"
                elif word[0].isupper():
                    pattern = rf"\b{word}\b"
                else:
                    pattern = rf'(?i)(?<!["\w]){word}(s|ed|ing)?(?!\w)(?!s?")'
                rules.append((re.compile(pattern), word, cells[0]))
    return rules


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else "."
    rules = given_up(os.path.join(root, "docs", "glossary.md"))
    if not rules:
        sys.exit("docs/glossary.md gives up no word: is its table still of three columns?")
    found = 0
    for name in sorted(project_files(root)):
        if not CHECKED.search(name) or name in EXEMPT:
            continue
        with open(os.path.join(root, name), encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                for pattern, word, term in rules:
                    if pattern.search(line) and READS_KEY.get(name) != word:
                        print(f"{name}:{number}: '{word}' (docs/glossary.md: {term}): {line.strip()[:100]}")
                        found += 1
    if found:
        sys.exit(f"{found} uses of words that were given up")


main()
