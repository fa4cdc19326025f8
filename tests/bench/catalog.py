"""Times of `vitreo runs` over ten thousand runs: the first listing, which makes the index, the next, and queries.

    python3 tests/bench/catalog.py build/release/vitreo [RUNS]

The folders have one record of the simulated rig, linked: the times are those of the index and of the program's start, and
of the first listing the reading of as many records. Goals: listed in 1 s, a query in 0.1 s.
SPDX-License-Identifier: Apache-2.0
"""

import os
import pathlib
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time

GOALS = {"listed": 1.0, "query": 0.1}


def spent():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def timed(words, environment, repeat=5):
    """The least wall time and processor time, s, of some calls, and the lines of the last."""
    times, processor = [], []
    for _ in range(repeat):
        begun, used = time.perf_counter(), spent()
        said = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
        times.append(time.perf_counter() - begun)
        processor.append(spent() - used)
    return min(times), min(processor), len(said.stdout.splitlines())


def main(program, count):
    program = os.path.abspath(program)
    place = pathlib.Path(tempfile.mkdtemp(prefix="vitreo_catalog_"))
    environment = {**os.environ, "XDG_CACHE_HOME": str(place / "cache"), "XDG_STATE_HOME": str(place / "state")}
    try:
        subprocess.run([program, "run", "hold", "hold=1s", "feedback=pose_sensor", "compare=false", "-q", "--tag", "batch=a", "--out", place / "one"], check=True,
                       env=environment, cwd=place)
        record = next((place / "one").iterdir()) / "run.sqlite"
        # A few kinds, so that a query has something to choose.
        kinds = []
        for i in range(20):
            kinds.append(place / f"{i}.sqlite")
            shutil.copy(record, kinds[-1])
            with sqlite3.connect(kinds[-1]) as database:
                database.execute("UPDATE result SET value = value * ?", (1 + i / 10,))
            database.close()
        runs = place / "runs"
        for i in range(count):
            folder = runs / f"2026-11-24T{i // 3600 % 24:02d}{i // 60 % 60:02d}{i % 60:02d}_hold_{i:05x}"
            folder.mkdir(parents=True)
            os.link(kinds[i % len(kinds)], folder / "run.sqlite")
        listing = [program, "runs", "--runs", str(runs)]
        rows = [("first listing, which makes the index", timed(listing, environment, 1), None),
                ("listed", timed(listing, environment), "listed")]
        for where in ("speed > 0.1mm/s and hold_error_rms < 4um", "outcome = completed and operator ~ o and not tag.batch = b"):
            rows.append((where, timed([*listing, "--where", where], environment), "query"))
        rows.append(("the ten with the largest error", timed([*listing, "--sort=-hold_error_rms", "--columns", "hold_error_rms", "--newest", "10"],
                                                             environment), "query"))
        print(f"{count} runs, seconds (load {os.getloadavg()[0]:.1f}):")
        for what, (seconds, processor, lines), goal in rows:
            print(f"  {what:<60} {seconds:7.3f}, of a processor {processor:7.3f}  {lines:6d} lines" + (f"  (goal {GOALS[goal]})" if goal else ""))
    finally:
        shutil.rmtree(place)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10000)
