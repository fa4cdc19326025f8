#!/usr/bin/env python3
"""Every sentence with which the program refuses or fails is found in docs/troubleshooting.md.

    python3 tests/docs/error_sentences.py TREE [--list]

The sentences are the literals in `throw ...("...")`, `require(..., "...")` and in Lua's `error("...")`. The page's rows begin with what the
sentence says, `...` standing for anything: a sentence that no row fits is an error, and so is a row that fits none.
"""
# SPDX-License-Identifier: Apache-2.0
import pathlib
import re
import sys

LITERAL = r'"(?:[^"\\]|\\.)*"'
THROWN = re.compile(r"\b(?:throw\s+[\w:]+\s*[({]|\brequire\s*\(|\berror\s*\(|\brefuse\s*\()")


def statement(text: str, at: int) -> str:
    """From `at` to the end of the statement, literals whole."""
    depth, i = 0, at
    while i < len(text):
        if text[i] == '"':
            literal = re.compile(LITERAL).match(text, i)
            i = literal.end() if literal else i + 1
            continue
        depth += text[i] in "({["
        depth -= text[i] in ")}]"
        if depth < 0 or (text[i] == ";" and depth <= 0):
            break
        i += 1
    return text[at:i]


def sentences(path: pathlib.Path):
    """The literals of each statement that throws, joined where they stand side by side, "..." where values come in."""
    text = path.read_text(encoding="utf-8", errors="replace")
    text = re.sub(r"^\s*(//|--).*$", "", text, flags=re.M)
    for thrown in THROWN.finditer(text):
        body = statement(text, thrown.start())
        made, last = "", None
        for literal in re.finditer(LITERAL, body):
            between = body[last:literal.start()] if last is not None else ""
            made += ("..." if made and between.strip() else "") + literal.group(0)[1:-1]
            last = literal.end()
        made = re.sub(r"\{[^}]*\}|%[-+.\d]*[a-z]", "...", made).replace('\\"', '"').replace("\\n", " ")
        made = re.sub(r"\\u[0-9a-f]{4}", "...", made)
        if len(re.findall(r"[a-z]{2,}", made)) >= 2:
            yield re.sub(r"\s+", " ", made).strip()


def rows(page: pathlib.Path):
    """The first cells of the page's tables: code, `...` for anything."""
    for line in page.read_text(encoding="utf-8").split("\n"):
        if cell := re.match(r"^\|\s*((?:`[^`]+`(?:,\s*)?)+)\s*\|", line):
            for pattern in re.findall(r"`([^`]+)`", cell.group(1)):
                yield pattern, pattern.lower().split("...")


def fits(parts: list[str], sentence: str) -> bool:
    """Do the parts stand in the sentence in their order? Each at its first place: no later one would leave more room."""
    at = 0
    for part in parts:
        at = sentence.find(part, at)
        if at < 0:
            return False
        at += len(part)
    return True


def main() -> int:
    tree = pathlib.Path(sys.argv[1])
    files = [path for room in ("optics", "vision", "control", "devices", "host") for path in sorted((tree / room).rglob("*.cpp")) + sorted((tree / room).rglob("*.h"))
             if "node_modules" not in path.parts]
    files += sorted((tree / "scripts").rglob("*.lua")) + sorted((tree / "protocols").rglob("*.lua"))
    found = {}
    for path in files:
        for sentence in sentences(path):
            found.setdefault(sentence, path.relative_to(tree))
    patterns = list(rows(tree / "docs" / "troubleshooting.md")) if (tree / "docs" / "troubleshooting.md").exists() else []
    used, missing = set(), []
    for sentence, path in found.items():
        lower = sentence.lower()
        fitting = [pattern for pattern, parts in patterns if fits(parts, lower)]
        used.update(fitting)
        if not fitting:
            missing.append(f"{path}: {sentence}")
    if "--list" in sys.argv:
        print("\n".join(missing))
    print(f"{len(found)} sentences, {len(patterns)} rows, {len(missing)} sentences in no row")
    stale = [pattern for pattern, _ in patterns if pattern not in used]
    for line in missing[:40] if "--list" not in sys.argv else []:
        print("in no row: " + line)
    for pattern in stale:
        print("fits no sentence: " + pattern)
    return 1 if missing or stale else 0


if __name__ == "__main__":
    sys.exit(main())
