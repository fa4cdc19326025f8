#!/usr/bin/env python3
"""Runs the mutants of the safety code against its tests: make mutate.

    mutate.py BUILD/tests/mutation [--all] [--jobs N] [--file PART]

Without --all so many of each file are drawn, always the same ones. A mutant is killed by a test that
fails, crashes, computes four times as long as all do without, or stands still for as long. Ends with
1 below the goal.
SPDX-License-Identifier: Apache-2.0
"""
import argparse
import concurrent.futures
import os
import pathlib
import random
import resource
import subprocess
import sys
import tempfile
import time

GOAL = 0.95
# Source: mutants that are drawn, and the tests that are to kill them; what the first let live goes to the next.
FILES = {
    'host/safety/interlock.cpp': (110, 'InterlockR*:InterlockH*:InterlockL*:InterlockT*:InterlockW*:CoilRest*',
                                  'TimedInterlock*:HeldCurrent*:CurrentWatch*:HeartbeatLine*'),
    'host/safety/coil_temperature.cpp': (37, 'CoilTemperature*:CoilHeat*'),
    'host/engine/watchdog.cpp': (45, 'WatchedRun*', 'RunWatchdog*:StuckRun*'),
    'host/session/alarms.cpp': (61, 'AlarmsTest*'),
    'devices/time/virtual_clock.cpp': (60, 'VirtualClock*:RealTimePace*:Watchdog*:Task*:'
                                              'Interrupt*:Deadlock*'),
    'devices/time/wall_clock.cpp': (45, 'WallClock*:Watchdog*:TaskAlone*'),
    'host/safety/guardian.cpp': (45, 'GuardianUnit*'),
    'host/servo/frame_validator.cpp': (80, 'FrameValidator*:ArrivalDelay*'),
    'host/servo/stamp_watch.cpp': (50, 'StampWatch*'),
    'host/servo/view_watch.cpp': (45, 'ViewWatch*'),
    'host/session/run_control.cpp': (60, 'RunControlUnit*', 'WatchedRun*:RunWatchdog*:StuckRun*'),
}


def reasons(folder):
    """Survivors that were judged: file, the line's text, class -> why."""
    known = {}
    for line in (folder / 'survivors.tsv').read_text(encoding='utf-8').splitlines():
        if line and not line.startswith('#'):
            file, kind, text, why = line.split('\t')
            known[(file, kind, text)] = why
    return known


def run(program, tests, number, patience, computing=600):
    """How it ended, whether the mutant was reached, and the seconds that it took."""
    took, reached = 0, False
    for part in tests:
        ending, there, seconds = run_part(program, part, number, patience, computing)
        took, reached = took + seconds, reached or there
        if ending == 'killed':
            break
    return ending, reached, took


def run_part(program, tests, number, patience, computing):
    computing = int(computing) + 1
    bound = lambda: resource.setrlimit(resource.RLIMIT_CPU, (computing, computing + 1))
    with tempfile.TemporaryDirectory() as folder:
        mark = os.path.join(folder, 'reached')
        environment = dict(os.environ, VITREO_MUTANT=str(number), VITREO_MUTANT_REACHED=mark,
                           TMPDIR=folder)
        began = time.monotonic()
        try:
            done = subprocess.run([program, '--gtest_filter=' + tests, '--gtest_fail_fast'],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                  stdin=subprocess.DEVNULL, env=environment, timeout=patience,
                                  check=False, preexec_fn=bound)
            ending = 'survived' if done.returncode == 0 else 'killed'
        except subprocess.TimeoutExpired:
            ending = 'killed'
        return ending, os.path.exists(mark), time.monotonic() - began


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--all', action='store_true')
    parser.add_argument('--jobs', type=int, default=os.cpu_count())
    parser.add_argument('--file', default='')
    options = parser.parse_args()
    program = str(options.folder / 'mutants')
    known = reasons(pathlib.Path(__file__).parent)
    killed_of_all = counted_of_all = 0
    survivors = []
    print(f'{"file":38} {"made":>5} {"drawn":>5} {"killed":>6} {"excused":>7} {"of the rest":>11}')
    for name, (count, *tests) in FILES.items():
        if options.file not in name:
            continue
        listing = options.folder / (name.replace('/', '_') + '.tsv')
        mutants = [line.split('\t') for line in listing.read_text(encoding='utf-8').splitlines()]
        drawn = mutants
        if not options.all and len(mutants) > count:
            drawn = random.Random(name).sample(mutants, count)
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        ending, _, alone = run(program, tests, 0, 300)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        computing = max(2.0, 4 * (used.ru_utime + used.ru_stime - spent.ru_utime - spent.ru_stime))
        if ending != 'survived':
            print(f'{name}: its tests fail without a mutant')
            return 2
        patience = max(5.0, 4 * alone * options.jobs)
        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            endings = list(pool.map(lambda one: run(program, tests, int(one[0]), patience, computing), drawn))
        killed = excused = 0
        for mutant, (ending, reached, _) in zip(drawn, endings):
            number, file, line, kind, text = mutant
            if ending == 'killed':
                killed += 1
            elif (file, kind, text) in known:
                excused += 1
            else:
                survivors.append(f'{number}\t{file}:{line}\t{kind}\t'
                                 f'{"" if reached else "never reached: "}{text}')
        counted = len(drawn) - excused
        killed_of_all += killed
        counted_of_all += counted
        print(f'{name:38} {len(mutants):5} {len(drawn):5} {killed:6} {excused:7} '
              f'{100 * killed / max(counted, 1):10.0f} %', flush=True)
    part = killed_of_all / max(counted_of_all, 1)
    print(f'{killed_of_all} of {counted_of_all} killed: {100 * part:.1f} %, goal {100 * GOAL:.0f} %')
    for survivor in survivors:
        print(survivor)
    return 0 if part >= GOAL else 1


if __name__ == '__main__':
    sys.exit(main())
