#!/usr/bin/env python3
"""The docs as a site: each Markdown page as HTML with search, made without a network and read without one.

    python3 cmake/docs_site.py SOURCE TARGET

SOURCE is the tree (README.md, CONTRIBUTING.md, docs/); TARGET gets index.html and a page for each. The Markdown is the part of
CommonMark that the docs use: headings, paragraphs, lists, tables, fences, quotes, emphasis, code, links, images, <details>.
A link to a page or a heading that is not there is an error.
"""
# SPDX-License-Identifier: Apache-2.0
import html
import json
import pathlib
import re
import shutil
import sys

INLINE_HTML = re.compile(r"</?(?:details|summary|sub|sup|br|kbd|small)\b[^<>]*>")


def slug(text: str) -> str:
    """A heading's anchor as GitHub makes it."""
    text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", lambda m: m.group(1) or "", text)
    return re.sub(r"\s", "-", re.sub(r"[^\w\- ]", "", text.strip().lower()))


class Inline:
    """Text within a block; `link` turns an address of the Markdown into one of the site."""

    def __init__(self, link):
        self.link = link

    def render(self, text: str) -> str:
        kept = []

        def keep(made: str) -> str:
            kept.append(made)
            return f"\0{len(kept) - 1}\0"

        text = re.sub(r"(`+)(.+?)(?<!`)\1(?!`)", lambda m: keep(f"<code>{html.escape(m.group(2).strip())}</code>"), text)
        text = INLINE_HTML.sub(lambda m: keep(m.group(0)), text)
        text = re.sub(r"\\([\\`*_{}\[\]()#+\-.!|<>])", lambda m: keep(html.escape(m.group(1))), text)
        text = html.escape(text, quote=False)
        text = re.sub(r"!\[([^\]]*)\]\(([^)\s]+)\)", lambda m: keep(self.image(m.group(1), m.group(2))), text)
        # A link's text may hold code, which is kept already.
        text = re.sub(r"\[([^\]]+)\]\(([^)\s]+)\)",
                      lambda m: keep(f'<a href="{html.escape(self.link(m.group(2)))}">') + m.group(1) + keep("</a>"), text)
        text = re.sub(r"&lt;(https?://[^\s&]+)&gt;", lambda m: keep(f'<a href="{m.group(1)}">{m.group(1)}</a>'), text)
        text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
        text = re.sub(r"(?<![\w*])\*(?!\s)([^*]+?)(?<!\s)\*(?!\w)", r"<em>\1</em>", text)
        text = re.sub(r"(?<![\w])_(?!\s)([^_]+?)(?<!\s)_(?!\w)", r"<em>\1</em>", text)
        while "\0" in text:
            text = re.sub("\0(\\d+)\0", lambda m: kept[int(m.group(1))], text)
        return text

    def image(self, alt: str, address: str) -> str:
        return f'<img src="{html.escape(self.link(address))}" alt="{html.escape(alt)}" loading="lazy">'


class Blocks:
    """Markdown to HTML; collects the headings."""

    def __init__(self, inline: Inline):
        self.inline = inline
        self.headings = []
        self.used = {}

    def render(self, lines) -> str:
        out, at = [], 0
        while at < len(lines):
            line = lines[at]
            if not line.strip():
                at += 1
            elif fence := re.match(r"^(\s*)(```+|~~~+)\s*(\S*)", line):
                at = self.fence(lines, at, fence, out)
            elif head := re.match(r"^(#{1,6})\s+(.*?)\s*#*$", line):
                out.append(self.heading(len(head.group(1)), head.group(2)))
                at += 1
            elif re.match(r"^\s*\|?[^|]*\|", line) and at + 1 < len(lines) and re.match(r"^\s*\|?[\s:|-]*-[\s:|-]*$", lines[at + 1]) and "|" in lines[at + 1]:
                at = self.table(lines, at, out)
            elif re.match(r"^(\s*)([-*+]|\d+[.)])\s+", line):
                at = self.items(lines, at, out)
            elif line.startswith(">"):
                quoted = []
                while at < len(lines) and lines[at].startswith(">"):
                    quoted.append(re.sub(r"^> ?", "", lines[at]))
                    at += 1
                out.append(f"<blockquote>{self.render(quoted)}</blockquote>")
            elif re.match(r"^(-{3,}|\*{3,})\s*$", line):
                out.append("<hr>")
                at += 1
            elif re.match(r"^\s*<!--", line):
                while at < len(lines) and "-->" not in lines[at]:
                    at += 1
                at += 1
            elif re.match(r"^\s*</?(details|summary|p|div|img|picture|br)\b", line):
                out.append(re.sub(r'(src|href)="([^"]+)"', lambda m: f'{m.group(1)}="{self.inline.link(m.group(2))}"', line))
                at += 1
            else:
                at = self.paragraph(lines, at, out)
        return "\n".join(out)

    def heading(self, level: int, text: str) -> str:
        name = slug(text)
        self.used[name] = self.used.get(name, -1) + 1
        if self.used[name]:
            name = f"{name}-{self.used[name]}"
        plain = re.sub(r"<[^>]+>", "", self.inline.render(text))
        self.headings.append((level, name, html.unescape(plain)))
        return f'<h{level} id="{name}">{self.inline.render(text)}<a class="here" href="#{name}" aria-label="link">#</a></h{level}>'

    @staticmethod
    def fence(lines, at, opening, out) -> int:
        indent, mark, language = opening.groups()
        body, at = [], at + 1
        while at < len(lines) and not lines[at].strip().startswith(mark):
            body.append(lines[at][len(indent):] if lines[at].startswith(indent) else lines[at])
            at += 1
        out.append(f'<pre class="{html.escape(language)}"><code>{html.escape(chr(10).join(body))}</code></pre>')
        return at + 1

    def table(self, lines, at, out) -> int:
        def cells(line):
            line = line.strip().removeprefix("|")
            if line.endswith("|") and not line.endswith("\\|"):
                line = line[:-1]
            # A bar in code or after a backslash parts nothing.
            parts = re.split(r"(?<!\\)\|(?=(?:[^`]*`[^`]*`)*[^`]*$)", line)
            return [part.strip().replace("\\|", "|") for part in parts]

        header = cells(lines[at])
        aligns = ["right" if c.endswith(":") and not c.startswith(":") else "" for c in cells(lines[at + 1])]
        at += 2
        rows = []
        while at < len(lines) and "|" in lines[at] and lines[at].strip():
            rows.append(cells(lines[at]))
            at += 1

        def row(values, tag):
            made = []
            for i, value in enumerate(values):
                kind = f' class="{aligns[i]}"' if i < len(aligns) and aligns[i] else ""
                made.append(f"<{tag}{kind}>{self.inline.render(value)}</{tag}>")
            return "<tr>" + "".join(made) + "</tr>"

        table = f'<div class="scroll"><table><thead>{row(header, "th")}</thead><tbody>{"".join(row(r, "td") for r in rows)}</tbody></table></div>'
        # What tests say is for who doubts a rule, not for who reads it first.
        tests = any(re.search(r"\btests?\b", head.lower()) for head in header)
        out.append(f"<details><summary>{len(rows)} rules, each with its test</summary>{table}</details>" if tests and len(rows) > 4 else table)
        return at

    def items(self, lines, at, out) -> int:
        first = re.match(r"^(\s*)([-*+]|\d+[.)])(\s+)", lines[at])
        base, ordered = len(first.group(1)), first.group(2)[0].isdigit()
        tag, made = ("ol" if ordered else "ul"), []
        while at < len(lines):
            item = re.match(r"^(\s*)([-*+]|\d+[.)])(\s+)(.*)$", lines[at])
            if not item or len(item.group(1)) != base or item.group(2)[0].isdigit() != ordered:
                break
            inner = [item.group(4)]
            width = len(item.group(1)) + len(item.group(2)) + len(item.group(3))
            at += 1
            while at < len(lines):
                line = lines[at]
                deeper = len(line) - len(line.lstrip()) > base
                if line.strip() and not deeper and (re.match(r"^\s*([-*+]|\d+[.)])\s+|^#|^```|^\|", line) or not lines[at - 1].strip()):
                    break
                if not line.strip() and (at + 1 >= len(lines) or len(lines[at + 1]) - len(lines[at + 1].lstrip()) <= base):
                    break
                inner.append(line[min(width, len(line) - len(line.lstrip())):])
                at += 1
            # What is one paragraph needs no <p>.
            body = re.sub(r"^<p>(.*?)</p>", r"\1", self.render(inner), count=1, flags=re.S)
            made.append(f"<li>{body}</li>")
            while at < len(lines) and not lines[at].strip():
                following = lines[at + 1] if at + 1 < len(lines) else ""
                if not re.match(rf"^\s{{{base}}}([-*+]|\d+[.)])\s+", following):
                    break
                at += 1
        out.append(f"<{tag}>{''.join(made)}</{tag}>")
        return at

    def paragraph(self, lines, at, out) -> int:
        text = []
        while at < len(lines) and lines[at].strip() and not re.match(r"^(#{1,6}\s|```|~~~|>|\s*([-*+]|\d+[.)])\s+)|^\s*</?(details|summary)\b", lines[at]):
            if text and "|" in lines[at] and at + 1 < len(lines) and re.match(r"^\s*\|?[\s:|-]*-[\s:|-]*\|[\s:|-]*$", lines[at + 1]):
                break
            text.append(lines[at].strip())
            at += 1
        if not text:  # a line that looks like a block and is none
            text, at = [lines[at].strip()], at + 1
        out.append(f"<p>{self.inline.render(' '.join(text))}</p>")
        return at


class Site:
    def __init__(self, source: pathlib.Path, target: pathlib.Path):
        self.source, self.target = source, target
        self.pages = {path.relative_to(source): None for path in sorted(
            [source / "README.md", source / "CONTRIBUTING.md", *source.glob("docs/**/*.md")])}
        self.errors, self.anchors, self.links, self.files = [], {}, [], set()

    @staticmethod
    def address(page: pathlib.Path) -> str:
        name = page.as_posix()
        if name == "docs/README.md":
            return "index.html"
        return name.removeprefix("docs/").removesuffix(".md").replace("/", "-") + ".html"

    def link_from(self, page: pathlib.Path):
        def link(address: str) -> str:
            if re.match(r"^[a-z]+:", address):
                return address
            path, _, anchor = address.partition("#")
            if not path:
                self.links.append((page, page, anchor))
                return "#" + anchor
            full = (self.source / page.parent / path).resolve()
            if full.is_dir():
                return self.repository_file(page, full, address)
            try:
                relative = full.relative_to(self.source.resolve())
            except ValueError:
                self.errors.append(f"{page}: {address} leaves the tree")
                return address
            if relative in self.pages:
                if anchor:
                    self.links.append((page, relative, anchor))
                return self.address(relative) + ("#" + anchor if anchor else "")
            return self.repository_file(page, full, address)

        return link

    def repository_file(self, page, full, address) -> str:
        """A picture or a table beside the docs goes along; a source file is named as it stands in the tree."""
        if not full.exists():
            self.errors.append(f"{page}: {address} is not there")
            return address
        if full.is_file() and full.suffix in {".jpg", ".png", ".svg", ".json", ".tsv", ".csv"}:
            name = full.relative_to(self.source.resolve()).as_posix().removeprefix("docs/").replace("/", "-")
            self.files.add((full, name))
            return name
        return "source.html?" + full.relative_to(self.source.resolve()).as_posix()

    def build(self) -> None:
        self.target.mkdir(parents=True, exist_ok=True)
        index = []
        for page in self.pages:
            text = (self.source / page).read_text(encoding="utf-8")
            blocks = Blocks(Inline(self.link_from(page)))
            body = blocks.render(text.split("\n"))
            title = blocks.headings[0][2] if blocks.headings else page.stem
            self.pages[page] = (title, body, blocks.headings)
            self.anchors[page] = {name for _, name, _ in blocks.headings}
            index.extend(self.sections(self.address(page), title, body))
        for page, to, anchor in self.links:
            if anchor and anchor not in self.anchors[to] and not anchor.startswith("L"):
                self.errors.append(f"{page}: {to}#{anchor}: there is no such heading")
        for page, (title, body, headings) in self.pages.items():
            (self.target / self.address(page)).write_text(self.shell(page, title, body, headings), encoding="utf-8")
        (self.target / "source.html").write_text(self.shell(None, "A file of the source tree", SOURCE_NOTE, []), encoding="utf-8")
        (self.target / "search.js").write_text("const kSections = " + json.dumps(index, ensure_ascii=False) + ";\n" + SEARCH, encoding="utf-8")
        (self.target / "site.css").write_text(STYLE, encoding="utf-8")
        for full, name in self.files:
            shutil.copyfile(full, self.target / name)

    @staticmethod
    def sections(address: str, title: str, body: str):
        """Each heading with the plain text below it, for the search."""
        parts = re.split(r'<h[1-6] id="([^"]*)">(.*?)</h[1-6]>', body)
        plain = lambda text: re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", text))).strip()
        for i in range(1, len(parts), 3):
            yield [address + "#" + parts[i], title, plain(parts[i + 1]).removesuffix("#").strip(), plain(parts[i + 2])]

    def shell(self, page, title, body, headings) -> str:
        entries = "".join(
            f'<li><a href="{self.address(p)}"{" class=now" if p == page else ""}>{html.escape(t)}</a></li>' for p, (t, _, _) in self.pages.items())
        inside = "".join(f'<li class="l{level}"><a href="#{name}">{html.escape(text)}</a></li>' for level, name, text in headings if level in (2, 3))
        return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)} · Vitreo</title><link rel="stylesheet" href="site.css"></head>
<body><header><a href="index.html"><b>Vitreo</b></a><input id="search" type="search" placeholder="search the docs (press /)" aria-label="search"><ol id="found" hidden></ol></header>
<div class="columns"><nav aria-label="pages"><ul>{entries}</ul></nav><main>{body}</main><aside aria-label="on this page"><ul>{inside}</ul></aside></div>
<script src="search.js"></script></body></html>
"""


SOURCE_NOTE = """<h1>A file of the source tree</h1><p>This link leads to <code id="file"></code> in the sources, which are not part of these pages.</p>
<script>document.getElementById('file').textContent = decodeURIComponent(location.search.slice(1))</script>"""

SEARCH = """
const box = document.getElementById('search'), found = document.getElementById('found');
function look() {
  const words = box.value.toLowerCase().split(/\\s+/).filter((w) => w.length > 1);
  found.textContent = '';
  found.hidden = words.length === 0;
  if (!words.length) return;
  const hits = [];
  for (const [address, page, heading, text] of kSections) {
    const head = (heading + ' ' + page).toLowerCase(), low = text.toLowerCase();
    if (!words.every((w) => head.includes(w) || low.includes(w))) continue;
    hits.push([words.reduce((sum, w) => sum + (heading.toLowerCase().includes(w) ? 20 : 0) + (page.toLowerCase().includes(w) ? 5 : 0) + Math.min(5, low.split(w).length - 1), 0), address, page, heading, text]);
  }
  hits.sort((a, b) => b[0] - a[0]);
  for (const [, address, page, heading, text] of hits.slice(0, 20)) {
    const item = document.createElement('li'), link = document.createElement('a'), line = document.createElement('span');
    link.href = address, link.textContent = heading === page ? page : page + ' \\u203a ' + heading;
    const at = Math.max(0, text.toLowerCase().indexOf(words[0]) - 50);
    line.textContent = (at ? '\\u2026' : '') + text.slice(at, at + 160);
    item.append(link, line), found.append(item);
  }
  if (!hits.length) found.append(Object.assign(document.createElement('li'), { textContent: 'nothing found' }));
}
box.addEventListener('input', look);
box.addEventListener('keydown', (event) => {
  if (event.key === 'Escape') box.value = '', look();
  if (event.key === 'Enter') found.querySelector('a')?.click();
});
addEventListener('keydown', (event) => { if (event.key === '/' && document.activeElement !== box) event.preventDefault(), box.focus(); });
document.querySelector('nav .now')?.scrollIntoView({ block: 'center' });
"""

STYLE = """:root { color-scheme: light dark; --ink: #1f252b; --soft: #59626b; --line: #dde1e5; --wash: #f3f5f7; --page: #fff; --link: #00629b; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8edf2; --soft: #aab6c2; --line: #2c3640; --wash: #161c23; --page: #0f1419; --link: #56b4e9; } }
* { box-sizing: border-box; } body { margin: 0; font: 16px/1.55 Inter, system-ui, sans-serif; color: var(--ink); background: var(--page); }
a { color: var(--link); text-decoration: none; } a:hover { text-decoration: underline; }
header { position: sticky; top: 0; z-index: 2; display: flex; gap: 24px; align-items: center; padding: 10px 24px; background: var(--wash); border-bottom: 1px solid var(--line); }
header input { font: inherit; width: min(28rem, 60vw); padding: 6px 10px; border: 1px solid var(--line); border-radius: 6px; background: var(--page); color: inherit; }
#found { position: absolute; top: 52px; left: 24px; max-width: 46rem; max-height: 70vh; overflow: auto; margin: 0; padding: 8px 16px; list-style: none; background: var(--page);
  border: 1px solid var(--line); border-radius: 8px; box-shadow: 0 8px 30px #0004; } #found[hidden] { display: none; } #found li { padding: 6px 0; } #found span { display: block; color: var(--soft); font-size: 14px; }
.columns { display: grid; grid-template-columns: 15rem minmax(0, 52rem) 14rem; gap: 32px; padding: 0 24px; justify-content: center; }
nav, aside { position: sticky; top: 56px; align-self: start; max-height: calc(100vh - 56px); overflow: auto; padding: 20px 0; font-size: 14px; }
nav ul, aside ul { list-style: none; margin: 0; padding: 0; } nav li, aside li { padding: 3px 0; } .now { font-weight: 700; } aside .l3 { padding-left: 14px; }
main { padding: 20px 0 80px; min-width: 0; } h1 { font-size: 32px; line-height: 1.2; } h2 { margin-top: 2.2em; padding-bottom: 4px; border-bottom: 1px solid var(--line); }
.here { opacity: 0; margin-left: 8px; } h1:hover .here, h2:hover .here, h3:hover .here { opacity: 0.5; }
pre { background: var(--wash); padding: 12px 16px; overflow-x: auto; border-radius: 8px; font-size: 13.5px; line-height: 1.5; } code { font-family: 'DejaVu Sans Mono', Menlo, Consolas, monospace; font-size: 0.88em; }
p code, li code, td code { background: var(--wash); padding: 1px 4px; border-radius: 4px; overflow-wrap: anywhere; } img { max-width: 100%; height: auto; border-radius: 6px; background: #fff; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 14.5px; } th, td { text-align: left; vertical-align: top; padding: 5px 16px 5px 0; border-bottom: 1px solid var(--line); }
.right { text-align: right; } details { border: 1px solid var(--line); border-radius: 8px; padding: 8px 14px; margin: 12px 0; } summary { cursor: pointer; font-weight: 600; }
blockquote { margin: 0; padding-left: 16px; border-left: 3px solid var(--line); color: var(--soft); }
@media (max-width: 1100px) { .columns { grid-template-columns: 14rem minmax(0, 1fr); } aside { display: none; } } @media (max-width: 720px) { .columns { display: block; } nav { position: static; max-height: 12rem; } }
@media print { header, nav, aside { display: none; } .columns { display: block; } }
"""


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    site = Site(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
    site.build()
    for error in site.errors:
        print(error, file=sys.stderr)
    pictures = sum(1 for _, name in site.files if name.endswith((".jpg", ".png", ".svg")))
    print(f"{len(site.pages)} pages, {pictures} pictures in {site.target}/index.html")
    return 1 if site.errors else 0


if __name__ == "__main__":
    sys.exit(main())
