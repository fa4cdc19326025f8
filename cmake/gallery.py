#!/usr/bin/env python3
"""docs/gallery.md: each protocol with its first two sentences, its command, and the picture of its report where docs/images/gallery/ has one.

    python3 cmake/gallery.py SOURCE                           writes the page; with --check says whether it is as it would be written
    python3 cmake/gallery.py SOURCE --make BUILD OUT [NAME..] runs the protocols (or those named) on the simulated rig with the program of
                                                              BUILD, one after the other at the lowest priority, into OUT, and takes the
                                                              pictures of their reports (wants node, chromium and BUILD/tests/page)
"""
# SPDX-License-Identifier: Apache-2.0
import json
import pathlib
import re
import resource
import shutil
import subprocess
import sys

HEAD = """# Gallery of the protocols

Each experiment that comes along: what it does, how it is run on the simulated rig, and the head of the report that it made. Where the protocol as it
stands takes more than a minute of a processor, the picture is of a shorter run, and its command stands below it.
`vitreo describe NAME` has its parameters, [the protocols](protocols.md) where each stands in the thesis. This page is made by `cmake/gallery.py` from the protocols' own words.
"""

CPU_SECONDS = 60  # of a run whose picture is taken

# Short forms; "" runs as it stands. Questions are answered ahead.
SHORT = {
    "calibrate_bench": "places=6",
    "calibrate_in_eye": "landings=4",
    "dock": "angles=2",
    "drift_test": "feedback=one_camera machines=1 repetitions=1 hold=3s settle=1s",
    "hold": "compare=false settle=2s hold=2s width=0.5mm depth=0.5mm align=false",
    "localize_by_focus": "angles=2 surfaces=2 repetitions=3",
    "localize_spiral": "eyes=1 orientation=x turns=0.5 height=2mm",
    "motion_in_gels": "gels=2 robot=ndfeb time=1s",
    "scan_fundus": "views=4",
    "select_colors": "images=4",
    "servo_image": "places=1 time=5s eye=nominal",
    "steer": "duration=5s",
    "track_in_eye": "images=4 legs=1 channels=RG",
    "track_occluded": "images=4 passes=1 speed=3mm/s",
}


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


def pictured(source: pathlib.Path) -> dict:
    """{protocol: the arguments of the run that is pictured}, as --make left them."""
    file = source / "docs/images/gallery/runs.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def page(source: pathlib.Path) -> str:
    parts, runs = [HEAD], pictured(source)
    for path in sorted((source / "protocols").glob("*.lua")):
        title, words = about(path)
        parts.append(f"\n## {title}\n\n{words}\n\n    vitreo run {path.stem}\n")
        if (source / "docs/images/gallery" / f"{path.stem}.jpg").exists():
            parts.append(f"\n![The report of {path.stem}](images/gallery/{path.stem}.jpg)\n")
            if runs.get(path.stem):
                parts.append(f"\nOf `vitreo run {path.stem} {runs[path.stem]}`.\n")
    return "".join(parts)


def run(program: pathlib.Path, path: pathlib.Path, out: pathlib.Path):
    """The folder of a completed run within its minute of processor; else why there is none."""
    limit = lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS + 5))  # noqa: E731
    folder = out / path.stem
    shutil.rmtree(folder, ignore_errors=True)
    try:
        done = subprocess.run(["nice", "-n", "19", program, "run", path, "--json", "--quiet", "--operator", "Eve", "--out", folder, *SHORT.get(path.stem, "").split()],
                              stdin=subprocess.DEVNULL, capture_output=True, text=True, preexec_fn=limit, timeout=900)
    except subprocess.TimeoutExpired:
        return None, "15 minutes"
    report = next(folder.glob("*/report.html"), None)
    if done.returncode != 0 or report is None:
        return None, f"code {done.returncode}: {(done.stderr or done.stdout).strip()[-200:]}"
    return report, ""


def make(source: pathlib.Path, build: pathlib.Path, out: pathlib.Path, names: list) -> int:
    runs, missing = pictured(source), 0
    pictures = source / "docs/images/gallery"
    for path in sorted((source / "protocols").glob("*.lua")):
        if names and path.stem not in names:
            continue
        report, why = run(build / "vitreo", path, out)
        if report is None:
            print(f"{path.stem}: no picture: {why}", flush=True)
            missing += 1
            continue
        subprocess.run(["node", build / "tests/page/report_picture.mjs", report, pictures / f"{path.stem}.jpg", shutil.which("chromium")], check=True)
        runs[path.stem] = SHORT.get(path.stem, "")
        (pictures / "runs.json").write_text(json.dumps(runs, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        print(f"{path.stem}: pictured", flush=True)
    return 1 if missing else 0


def main() -> int:
    source = pathlib.Path(sys.argv[1])
    if "--make" in sys.argv:
        build, out, *names = sys.argv[sys.argv.index("--make") + 1:]
        if make(source, pathlib.Path(build), pathlib.Path(out), names):
            print("some protocols have no picture")
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
