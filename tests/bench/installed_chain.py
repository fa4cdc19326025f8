#!/usr/bin/env python3
"""Runs that take what an earlier run has installed, on drawn benches: how true is what they state?

installed_chain.py VITREO FOLDER FIRST_SEED BENCHES [calibrate_bench|calibrate_in_eye] [NAME=VALUE...]: on each bench (a seed's, on a
rig whose eye, lens, microscope and retina are drawn) localize_spiral and hold without a calibration, then the session, then both
again, which now begin with the installed file. NAME=VALUE are arguments of the session. Of each bench and of all it prints the
part of positions within 1.96 of their sigma (tests/bench/coverage_of_records.py), median sigma and median error, along x, y, z.
What stands in FOLDER from an earlier call is not run again.
"""
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import coverage_of_records as coverage

RIG = """return {
  base = "spiral_coni",
  title = "A drawn bench, whose calibration is installed",
  keep_out = { eye = "table_5_1" },
  truth = { machine = "sampled", optics = { bench = "sampled" } },
  calibrations = { installed = { file = "bench.json" } },
}
"""
SPIRAL = ["localize_spiral", "eye=nominal", "eyes=1", "pictures=0", "turns=1", "speed=2mm/s"]
HOLD = ["hold", "compare=false", "align=false", "settle=2s", "hold=2s", "speed=2mm/s"]


def run(vitreo, bench, name, words):
    """The run's folder; nothing where it failed."""
    into = bench / name
    if not into.exists():
        seed = bench.name.removeprefix("bench_")
        command = [vitreo, "run", *words, "--rig", "rig.lua", "--seed", seed, "--quiet", "--out", name]
        with open(bench / f"{name}.log", "a") as log:
            subprocess.run(command, cwd=bench, stdout=log, stderr=log, check=False)
    found = sorted(into.glob(f"*_{words[0]}_*"))
    return found[-1] if found else None


def judged(bench, name, folder):
    rows = coverage.judged(folder) if folder else []
    print(coverage.line(f"{bench.name} {name}", rows), flush=True)
    return rows


def main(vitreo, folder, first, count, session="calibrate_bench", *arguments):
    everything = {}
    for seed in range(int(first), int(first) + int(count)):
        bench = pathlib.Path(folder) / f"bench_{seed}"
        bench.mkdir(parents=True, exist_ok=True)
        (bench / "rig.lua").write_text(RIG)
        # What is installed stands beside the runs: those without it have a folder of their own.
        for name, words in (("before", SPIRAL), ("before_hold", HOLD)):
            everything.setdefault(name, []).extend(judged(bench, name, run(vitreo, bench, name, words)))
        if not (bench / "runs").exists():
            run(vitreo, bench, "runs", [session, *arguments])
        for name, words in (("after", SPIRAL), ("after_hold", HOLD)):
            if not list((bench / "runs").glob(f"*_{words[0]}_*")):
                with open(bench / f"{name}.log", "w") as log:
                    subprocess.run([vitreo, "run", *words, "--rig", "rig.lua", "--seed", str(seed), "--quiet"],
                                   cwd=bench, stdout=log, stderr=log, check=False)
            done = sorted((bench / "runs").glob(f"*_{words[0]}_*"))
            installed = (bench / "runs" / "calibrations" / "bench.json").exists()
            everything.setdefault(name, []).extend(judged(bench, name, done[-1] if done and installed else None))
    for name, rows in everything.items():
        print(coverage.line(f"all {name}", rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
