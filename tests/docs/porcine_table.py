#!/usr/bin/env python3
"""The tables of docs/porcine_session.md have every sentence of the thesis' sections once, and name what there is.

    python3 tests/docs/porcine_table.py TREE

The left column counts the sentences of a section from 1: none is left out, none is there twice. Each name in the right column is a
word of the protocols, of the modules that a session is made of, or of its rig.
"""
# SPDX-License-Identifier: Apache-2.0
import pathlib
import re
import sys

SENTENCES = {"7.2": 23, "7.2.1": 29, "7.3": 10, "7.4": 36}
SOURCES = ("protocols/*.lua", "scripts/session/*.lua", "scripts/rigs/*.lua", "scripts/analysis/published.lua",
           "optics/system/prescriptions.cpp", "devices/sim/*.cpp", "control/*.cpp", "host/lua/*/*.cpp")


def rows(page: str):
    section = None
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) != 3 or not line.startswith("|"):
            continue
        if heading := re.fullmatch(r"thesis (7[.\d]+)", cells[1]):
            section = heading.group(1)
        elif section and not set(cells[0]) <= set("-"):
            yield section, cells[0], cells[2]


def main() -> int:
    tree = pathlib.Path(sys.argv[1])
    told = "\n".join(path.read_text(encoding="utf-8") for pattern in SOURCES for path in sorted(tree.glob(pattern)))
    told += " ".join(path.stem for folder in ("protocols", "scripts/rigs") for path in (tree / folder).glob("*.lua"))
    counted = {section: [] for section in SENTENCES}
    errors = []
    for section, left, right in rows((tree / "docs/porcine_session.md").read_text(encoding="utf-8")):
        counted[section] += [int(number) for number in re.findall(r"\d+", left) if "figure" not in left]
        for name in re.findall(r"`([^`]+)`", right):
            for word in re.findall(r"[A-Za-z_]\w*", name):
                if not re.search(rf"\b{word}\b", told):
                    errors.append(f"{section}, {left}: nothing is called {word}")
    for section, last in SENTENCES.items():
        if counted[section] != list(range(1, last + 1)):
            errors.append(f"{section}: its sentences are 1 to {last}, got {counted[section]}")
    print("\n".join(errors) or f"{sum(SENTENCES.values())} sentences")
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())
