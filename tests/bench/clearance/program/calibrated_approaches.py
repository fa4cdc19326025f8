"""Benchmark of the clearance that the loop shows after a look at the robot on the retina: runs of calibrated_approach.lua through
the whole program, their records judged by dense points of the true body in the true eye (no code of the product's).

calibrated_approaches.py VITREO FOLDER FIRST RUNS [perturbed|sampled]; VITREO -: the records in FOLDER alone.
perturbed: eyes of table 5.1, the look says which; sampled: the rig sampled_bench, the look gives the image's scale.
SPDX-License-Identifier: Apache-2.0
"""

import glob
import json
import os
import random
import sqlite3
import subprocess
import sys

import numpy as np

HALF_LENGTH, HALF_WIDTH = 1e-3, 0.5e-3  # m, of the robot as it is believed
ALLOWED = 50e-6  # m, of what is shown beyond the truth


def unit_points(count=4000):
    points = np.random.default_rng(1).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def run(vitreo, folder, seed, kind):
    draw = random.Random(seed)
    place = [f"x={draw.uniform(-1.2, 1.2):.3f}mm", f"y={draw.uniform(-1.2, 1.2):.3f}mm"]
    words = [f"eye={seed}", "correction=eye"] if kind == "perturbed" else ["correction=scale"]
    protocol = os.path.join(os.path.dirname(os.path.abspath(__file__)), "calibrated_approach.lua")
    rig = "simulated" if kind == "perturbed" else "sampled_bench"
    done = subprocess.run([vitreo, "run", protocol, *words, *place, "--rig", rig, "--seed", str(seed), "--out", folder],
                          capture_output=True, text=True)
    if done.returncode:
        print(f"seed {seed}: {done.stdout.strip().splitlines()[-3:]}")


class Approach:
    """A record: what was shown and what was so."""

    def __init__(self, path):
        rows = sqlite3.connect(path).execute
        truth = json.loads(rows("select text from event where kind = 'machine'").fetchone()[0])
        results = dict(rows("select name, value from result").fetchall())
        begin = rows("select t_ns from event where kind = 'checkpoint' and text = 'let down'").fetchone()[0] - 1.5e9
        self.places = np.array(rows("select t_ns, x, y, z, axis_x, axis_y, axis_z from sample_truth where t_ns > ?",
                                    (begin,)).fetchall(), float)
        self.shown = np.array(rows("select t_ns, bound, distance, uncertainty from sample_clearance where t_ns > ? "
                                   "and bound is not null", (begin,)).fetchall(), float)
        self.size = truth.get("size_factor", 1)
        # A retina whose sag at 4 mm is larger by c has a radius that is smaller by 2 c (R / 4 mm)^2, of which the simulator
        # takes three tenths at most.
        radius = results["retina_radius"]
        smaller = 2 * truth.get("retina_curvature_m", 0) * (radius / 4e-3) ** 2
        self.radius = radius - min(max(smaller, -0.3 * radius), 0.3 * radius)
        vertex = results["retina_vertex"] + truth["eye_z_m"] + truth.get("retina_depth_m", 0)
        self.center = np.array([truth["eye_x_m"], truth["eye_y_m"], vertex + self.radius])

    def clearance(self, time, points):
        place = self.places[np.argmin(abs(self.places[:, 0] - time))]
        axis = place[4:7] / np.linalg.norm(place[4:7])
        body = HALF_WIDTH * points + (HALF_LENGTH - HALF_WIDTH) * (points @ axis)[:, None] * axis
        return self.radius - np.linalg.norm(place[1:4] + self.size * body - self.center, axis=1).max()

    def judge(self, points):
        """Most that was shown beyond the truth (m), most of the error over the half width."""
        true = np.array([self.clearance(row[0], points) for row in self.shown])
        beyond = np.maximum(self.shown[:, 1], 0) - true
        return beyond.max(), ((self.shown[:, 2] - true) / self.shown[:, 3]).max()


def main():
    vitreo, folder = sys.argv[1], sys.argv[2]
    if vitreo != "-":
        for seed in range(int(sys.argv[3]), int(sys.argv[3]) + int(sys.argv[4])):
            run(vitreo, folder, seed, sys.argv[5] if len(sys.argv) > 5 else "perturbed")
    points, found = unit_points(), []
    for path in sorted(glob.glob(os.path.join(folder, "*", "run.sqlite"))):
        try:
            found.append((*Approach(path).judge(points), path))
        except (TypeError, KeyError, IndexError, ValueError) as error:
            print(f"{path}: not judged: {error!r}")
    good = sum(beyond <= ALLOWED for beyond, _, _ in found)
    over = np.array([ratio for _, ratio, _ in found])
    print(f"{good} of {len(found)} shown <= true + {ALLOWED * 1e6:.0f} um; error over half width, the most of each run: median "
          f"{np.median(over):.2f}, 95 % {np.percentile(over, 95):.2f}, most {over.max():.2f}")
    for beyond, ratio, path in found:
        if beyond > ALLOWED:
            print(f"  {path}: {beyond * 1e6:.0f} um beyond, {ratio:.2f} of the half width")


if __name__ == "__main__":
    main()
