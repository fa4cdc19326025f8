#!/usr/bin/env python3
"""Path error of a run among emulated instruments, by the truth that `vitreo emulate --truth FILE` wrote.

judge_by_truth.py RUN_FOLDER TRUTH.csv: one line, um rms of the robot's true distance from the loop's target over the longest
stretch in which the target moved on, sideways and in depth, and the mean distance of the loop's position from the truth. The
run knows nothing of the truth; both are laid on the machine's monotonic clock by the run's event "clock".
"""
import bisect
import csv
import math
import pathlib
import re
import sqlite3
import sys

STANDING = 0.5  # s without a new target, by which a stretch ends


def clock_zero(record):
    """The monotonic clock, s, at the zero of the run's clock."""
    row = record.execute("SELECT text FROM event WHERE kind = 'clock'").fetchone()
    found = row and re.search(r"and ([0-9.]+) s of the monotonic clock", row[0])
    if not found:
        sys.exit("the run has no event 'clock': it was recorded on a simulated rig")
    return float(found.group(1))


def servo_rows(record):
    """(t, target, position or None) of each row, on the monotonic clock."""
    zero = clock_zero(record)
    columns = "t_ns, target_x, target_y, target_z, x, y, z"
    rows = record.execute(f"SELECT {columns} FROM sample_servo ORDER BY t_ns").fetchall()
    return [(zero + row[0] * 1e-9, row[1:4], None if None in row[4:] else row[4:]) for row in rows if None not in row[1:4]]


def longest_way(rows):
    """The rows of the longest stretch in which the target moved on."""
    best, begin, moved = (0, 0), None, None
    for i in range(1, len(rows)):
        if rows[i][1] != rows[i - 1][1]:
            begin = i if begin is None or rows[i][0] - rows[moved][0] > STANDING else begin
            moved = i
            if rows[i][0] - rows[begin][0] > rows[best[1]][0] - rows[best[0]][0]:
                best = (begin, i)
    return rows[best[0] : best[1] + 1]


def truth_of(file):
    """Times and positions, sorted; rows without a robot are left out."""
    with open(file, newline="", encoding="ascii") as opened:
        rows = [row for row in csv.DictReader(opened) if row["x (m)"]]
    return [float(row["monotonic (s)"]) for row in rows], [tuple(float(row[f"{axis} (m)"]) for axis in "xyz") for row in rows]


def at(times, places, moment):
    """The place at a moment, between its neighbors; None outside."""
    i = bisect.bisect(times, moment)
    if i in (0, len(times)):
        return None
    part = (moment - times[i - 1]) / (times[i] - times[i - 1])
    return [a + part * (b - a) for a, b in zip(places[i - 1], places[i])]


def rms(vectors):
    return math.sqrt(sum(sum(c * c for c in v) for v in vectors) / len(vectors))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    file = pathlib.Path(sys.argv[1]) / "run.sqlite"
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as record:
        rows = longest_way(servo_rows(record))
    times, places = truth_of(sys.argv[2])
    off, missed = [], []
    for moment, target, position in rows:
        truth = at(times, places, moment)
        if truth is None:
            continue
        off.append([a - b for a, b in zip(truth, target)])
        if position is not None:
            missed.append([a - b for a, b in zip(position, truth)])
    if not off or not missed:
        sys.exit("no robot and target at the same time")
    um = 1e6
    print(
        f"by truth: path error {rms(off) * um:.1f} um rms (sideways {rms([v[:2] for v in off]) * um:.1f}, "
        f"depth {rms([v[2:] for v in off]) * um:.1f}), localization {sum(map(math.hypot, *zip(*missed))) / len(missed) * um:.1f} um "
        f"mean, over {rows[-1][0] - rows[0][0]:.1f} s"
    )


if __name__ == "__main__":
    main()
