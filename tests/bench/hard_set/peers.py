#!/usr/bin/env python3
"""Peers on the hard set: OpenCV's CSRT, KCF and MOSSE, started from the truth's box in frame 0.

peers.py HARD_SET PHOTOS [--seeds N] [VARIANT ...]: HARD_SET is the built program, PHOTOS the folder of photographs; seeds 1 to N
(1); by default a few variants. Wants Debian's python3-opencv, which is no part of the build. Judged as hard_set does: lost while 30 % or more is to be
seen; wrong where nothing is, or beyond 5 px (a box has no covariance, so sigmas are not asked).
"""
import argparse
import csv
import math
import subprocess
import tempfile
import time

import cv2

VARIANTS = ["plain", "ground drifts 2", "robot leaves", "hidden for", "light x 0.5", "defocus of 5"]
GROUNDS = ["vessels A", "hemorrhages", "fundus, left", "fur"]


def tracker_of(name):
    made = getattr(cv2, f"Tracker{name}_create", None) or getattr(cv2.legacy, f"Tracker{name}_create")
    return made()


def box_of(row):
    """The upright box round an ellipse of full axes A, B, turned by phi."""
    a, b, phi = float(row["A"]) / 2, float(row["B"]) / 2, math.radians(float(row["phi_deg"]))
    half_u, half_v = math.hypot(a * math.cos(phi), b * math.sin(phi)), math.hypot(a * math.sin(phi), b * math.cos(phi))
    return tuple(int(round(x)) for x in (float(row["cx"]) - half_u, float(row["cy"]) - half_v, 2 * half_u, 2 * half_v))


def judge(name, frames, rows):
    tracker = tracker_of(name)
    tracker.init(frames[0], box_of(rows[0]))
    lost = wrong = there = 0
    off = spent = 0.0
    for frame, row in zip(frames[1:], rows[1:]):
        start = time.process_time()
        found, (u, v, width, height) = tracker.update(frame)
        spent += time.process_time() - start
        visible = float(row["visible"])
        if not found:
            lost += visible >= 0.3
            continue
        away = math.hypot(u + width / 2 - float(row["cx"]), v + height / 2 - float(row["cy"]))
        wrong += visible <= 0 or away > 5
        if visible > 0:
            there += 1
            off += away
    return lost, wrong, there, off, spent, len(frames) - 1


def judge_all(sums, frames, rows):
    for name in sums:
        sums[name] = [a + b for a, b in zip(sums[name], judge(name, frames, rows))]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("photos")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("variants", nargs="*", default=VARIANTS)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"{'':34}{'lost':>6}{'wrong':>6}{'px':>8}{'fps':>7}   {args.seeds} seeds, {len(GROUNDS)} grounds, 79 frames each")
    for variant in args.variants:
        sums = {name: [0] * 6 for name in ("CSRT", "KCF", "MOSSE")}
        for seed in range(1, args.seeds + 1):
            for ground in GROUNDS:
                with tempfile.TemporaryDirectory() as folder:
                    subprocess.run([args.program, "--photos", args.photos, "--variant", variant, "--ground", ground,
                                    "--seeds", f"{seed}-{seed}", "--dump", folder],
                                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                    with open(f"{folder}/truth.csv", encoding="ascii") as file:
                        rows = list(csv.DictReader(file))
                    judge_all(sums, [cv2.imread(f"{folder}/frame_{row['frame']}.png") for row in rows], rows)
        for name, (lost, wrong, there, off, spent, count) in sums.items():
            print(f"{variant:26}{name:8}{lost:6}{wrong:6}{off / max(there, 1):8.2f}{count / max(spent, 1e-9):7.0f}", flush=True)


if __name__ == "__main__":
    main()
