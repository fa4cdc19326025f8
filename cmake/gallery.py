#!/usr/bin/env python3
"""docs/gallery.md: each protocol with its first two sentences, its command, and the picture of its report where docs/images/gallery/ has one.

    python3 cmake/gallery.py SOURCE        writes the page; with --check says whether it is as it would be written
"""
# SPDX-License-Identifier: Apache-2.0
import pathlib
import re
import sys

HEAD = """# Gallery of the protocols

Each experiment that comes along: what it does, how it is run on the simulated rig, and, where it runs without one or in seconds, the head of the report that it made.
`vitreo describe NAME` has its parameters, [the protocols](protocols.md) where each stands in the thesis. This page is made by `cmake/gallery.py` from the protocols' own words.
"""


def about(path: pathlib.Path):
    """Title, and the first two sentences of the comment at the top."""
    text = path.read_text(encoding="utf-8")
    comment = []
    for line in text.split("\n"):
        if not line.startswith("--"):
            break
        if "SPDX" not in line:
            comment.append(line.lstrip("- ").strip())
    title = re.search(r'\btitle\s*=\s*"([^"]+)"', text)
    sentences = re.split(r"(?<=[.:])\s+(?=[A-Z])", " ".join(comment))
    return title.group(1) if title else path.stem, " ".join(sentences[:2])


def page(source: pathlib.Path) -> str:
    parts = [HEAD]
    for path in sorted((source / "protocols").glob("*.lua")):
        title, words = about(path)
        parts.append(f"\n## {title}\n\n{words}\n\n    vitreo run {path.stem}\n")
        if (source / "docs/images/gallery" / f"{path.stem}.jpg").exists():
            parts.append(f"\n![The report of {path.stem}](images/gallery/{path.stem}.jpg)\n")
    return "".join(parts)


def main() -> int:
    source = pathlib.Path(sys.argv[1])
    target, made = source / "docs" / "gallery.md", page(source)
    if "--check" in sys.argv:
        if not target.exists() or target.read_text(encoding="utf-8") != made:
            print("docs/gallery.md is not as cmake/gallery.py writes it")
            return 1
        return 0
    target.write_text(made, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
