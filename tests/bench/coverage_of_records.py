#!/usr/bin/env python3
"""Coverage of the uncertainty that a servo loop recorded, by the simulator's truth.

coverage_of_records.py RUN_FOLDER...: of each run, and of all, the part of positions in the stream `servo` whose truth lies within
1.96 of their sigma along x, y and z (95 % where the statement is right), the median sigma and the median error, um. Only rows in
which the target moved are judged: a robot that lies or waits is one place, however often it is seen.
"""
import bisect
import pathlib
import sqlite3
import statistics
import sys

AXES = "xyz"


def column(record, stream, names):
    rows = record.execute(f"SELECT t_ns, {', '.join(names)} FROM sample_{stream} ORDER BY t_ns").fetchall()
    return [row for row in rows if None not in row]


def interpolated(truth, times, moment):
    i = bisect.bisect(times, moment)
    if i in (0, len(times)):
        return None
    before, after = truth[i - 1], truth[i]
    part = (moment - before[0]) / (after[0] - before[0])
    return [a + part * (b - a) for a, b in zip(before[1:], after[1:])]


def judged(folder):
    """(errors, sigmas) along x, y, z of each row that counts."""
    record = sqlite3.connect(f"file:{pathlib.Path(folder) / 'run.sqlite'}?mode=ro", uri=True)
    truth = column(record, "truth", list(AXES))
    times = [row[0] for row in truth]
    names = [*AXES, *(f"sigma_{axis}" for axis in AXES), *(f"target_{axis}" for axis in AXES)]
    found, target = [], None
    for row in column(record, "servo", names):
        moved, target = target is not None and row[7:] != target, row[7:]
        real = interpolated(truth, times, row[0])
        if moved and real:
            found.append(([a - b for a, b in zip(row[1:4], real)], row[4:7]))
    return found


def line(name, rows):
    if not rows:
        return f"{name}: no row to judge"
    parts = []
    for k, axis in enumerate(AXES):
        within = sum(abs(error[k]) < 1.96 * sigma[k] for error, sigma in rows) / len(rows)
        sigma = 1e6 * statistics.median(s[k] for _, s in rows)
        error = 1e6 * statistics.median(abs(e[k]) for e, _ in rows)
        parts.append(f"{axis} {100 * within:.1f} % (sigma {sigma:.0f}, error {error:.0f} um)")
    return f"{name}: {len(rows)} rows, within 95 %: " + ", ".join(parts)


def main(folders):
    everything = []
    for folder in folders:
        rows = judged(folder)
        everything += rows
        print(line(pathlib.Path(folder).name, rows))
    print(line("all", everything))


if __name__ == "__main__":
    main(sys.argv[1:])
