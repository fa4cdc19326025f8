#!/usr/bin/env python3
"""Runs the mutants of the safety code against its tests: make mutate; with --numeric those of the
numeric code and of the record: make mutate-numeric.

    mutate.py BUILD/tests/mutation [--numeric] [--all] [--jobs N] [--file PART]

Without --all so many of each file are drawn, always the same ones; what has no meaning (a product
of matrices as a quotient) is none. A mutant is killed by a test that fails, crashes, computes four
times as long as its part of the tests does without, or stands still for as long. Ends with 1 where
a file is below its goal.
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
    'devices/time/virtual_clock.cpp': (60, 'VirtualClock*:Task.*:Interrupt*:Deadlock*',
                                    'RealTimePace*:TaskAlone*', 'Watchdog*'),
    'devices/time/wall_clock.cpp': (45, 'WallClock*', 'TaskAlone*', 'Watchdog*'),
    'host/safety/guardian.cpp': (45, 'GuardianUnit*'),
    'host/servo/frame_validator.cpp': (80, 'FrameValidator*:ArrivalDelay*'),
    'host/servo/stamp_watch.cpp': (50, 'StampWatch*'),
    'host/servo/view_watch.cpp': (45, 'ViewWatch*'),
    'host/session/run_control.cpp': (60, 'RunControlUnit*:RunControlRef*:RunControlState*', 'StopBetween*:WatchedRun*:RunWatchdog*:StuckRun*'),
    'host/session/stop_between.cpp': (60, 'StopBetween*'),
}
# With the goal of each and the program that has its tests.
NUMERIC = {
    'optics/projection/exact_projection.cpp': (0.9, 'optics_tests', 45, 'ExactProjection*', 'ExactPose*:Pose*'),
    'optics/maps/wide_angle_map.cpp': (0.9, 'optics_tests', 45, 'WideAngleMap*', 'ExactProjection*:Skew*'),
    'optics/pose/pose.cpp': (0.9, 'optics_tests', 45, 'Pose.*', 'Pose*:ExactPose*:ObjectPose*'),
    'vision/level_set.cpp': (0.9, 'vision_tests', 45, 'LevelSet*:CycleThree*', 'ShapeModel*:ColorTracker.*'),
    'vision/ellipse_fit.cpp': (0.9, 'vision_tests', 45, 'FitEllipse*:Ellipse*', 'MaskOutline*:BlobTracker.*'),
    'vision/focus_peak.cpp': (0.9, 'vision_tests', 45, 'FocusPeak*', 'Autofocus*:FocusMeasure*'),
    'control/box_allocation.cpp': (0.95, 'control_tests', 45, 'AllocateWithin*:Box*:AllocateFive*:Condition*:AllocationR*'),
    'control/estimator.cpp': (0.95, 'control_tests', 45, 'PositionEstimator*:CommandHistory*', 'ServoLaw*:Loop*'),
    'control/trajectory.cpp': (0.9, 'control_tests', 45, 'Trajectory*', 'Velocity*:Robots*'),
    'control/multipole_field.cpp': (0.9, 'control_tests', 45, 'MultipoleField*:FieldModel*', 'FitMultipoles*:Field*'),
    'control/motion_watch.cpp': (0.9, 'control_tests', 45, 'MotionWatch*'),
    'control/standstill.cpp': (0.9, 'control_tests', 45, 'Standstill*'),
    'control/coil_watch.cpp': (0.9, 'control_tests', 45, 'CoilWatch*'),
    'control/coil_lack.cpp': (0.9, 'control_tests', 45, 'LostForce*:MostProbableLack*', 'CoilWatch*'),
    'devices/instruments/usb3103/driver.cpp': (0.95, 'devices_tests', 45, 'Usb3103Driver*:Usb3103Settings*', 'Usb3103*'),
    'host/text/units.cpp': (0.9, 'host_tests', 45, 'Units*', 'Config.*'),
    'host/record/record_writer.cpp': (0.95, 'host_tests', 45, 'RecordWriter*:RecordFrames*', 'Recorder*:RunReader*:PowerCut*'),
    'host/servo/servo_controller.cpp': (0.95, 'host_tests', 45, 'ServoController*', 'FieldAllocator*:Servo.*'),
    'host/servo/plant_watch.cpp': (0.9, 'host_tests', 45, 'PlantWatch*', 'PlantFault*'),
    'host/servo/plant_fault.cpp': (0.9, 'host_tests', 45, 'PlantFault*', 'PlantWatch*'),
    'host/servo/wall_watch.cpp': (0.9, 'host_tests', 45, 'WallWatch*', 'Servo.*'),
}


def reasons(folder):
    """Survivors that were judged: file, the line's text, class -> why."""
    known = {}
    for line in (folder / 'survivors.tsv').read_text(encoding='utf-8').splitlines():
        if line and not line.startswith('#'):
            file, kind, text, why = line.split('\t')
            known[(file, kind, text)] = why
    return known


def run(program, parts, number):
    """How it ended, and whether the mutant was reached."""
    there = False
    for tests, patience, computing in parts:
        ending, reached, _, _ = run_part(program, tests, number, patience, computing)
        there = there or reached
        if ending != 'survived':
            break
    return ending, there


def run_part(program, tests, number, patience, computing):
    computing = int(computing) + 1
    bound = lambda: resource.setrlimit(resource.RLIMIT_CPU, (computing, computing + 1))
    with tempfile.TemporaryDirectory() as folder:
        mark, none = os.path.join(folder, 'reached'), os.path.join(folder, 'none')
        environment = dict(os.environ, VITREO_MUTANT=str(number), VITREO_MUTANT_REACHED=mark, VITREO_MUTANT_NONE=none,
                           TMPDIR=folder)
        began = time.monotonic()
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            done = subprocess.run([program, '--gtest_filter=' + tests, '--gtest_fail_fast'],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                  stdin=subprocess.DEVNULL, env=environment, timeout=patience,
                                  check=False, preexec_fn=bound)
            ending = 'survived' if done.returncode == 0 else 'killed'
        except subprocess.TimeoutExpired:
            ending = 'killed'
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        if os.path.exists(none):
            ending = 'none'
        return (ending, os.path.exists(mark), time.monotonic() - began,
                used.ru_utime + used.ru_stime - spent.ru_utime - spent.ru_stime)


def judge(name, goal, program, count, tests, options, known):
    """Prints a file's line; killed, counted, and the survivors without a reason."""
    listing = options.folder / (name.replace('/', '_') + '.tsv')
    mutants = [line.split('\t') for line in listing.read_text(encoding='utf-8').splitlines()]
    drawn = mutants
    if not options.all and len(mutants) > count:
        drawn = random.Random(name).sample(mutants, count)
    parts = []  # each with its own patience: one that hangs in short tests is not waited for long
    for part in tests:
        ending, _, alone, used = run_part(program, part, 0, 300, 600)
        if ending != 'survived':
            sys.exit(f'{name}: its tests {part} fail without a mutant')
        parts.append((part, max(5.0, 4 * alone * options.jobs), max(2.0, 4 * used)))
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        endings = list(pool.map(lambda one: run(program, parts, int(one[0])), drawn))
    killed = excused = none = 0
    survivors = []
    for mutant, (ending, reached) in zip(drawn, endings):
        number, file, line, kind, text = mutant
        if ending == 'killed':
            killed += 1
        elif ending == 'none':
            none += 1
        elif (file, kind, text) in known:
            excused += 1
        else:
            survivors.append(f'{number}\t{file}:{line}\t{kind}\t'
                             f'{"" if reached else "never reached: "}{text}')
    counted = len(drawn) - none - excused
    print(f'{name:40} {len(mutants):5} {len(drawn) - none:5} {killed:6} {excused:7} '
          f'{100 * killed / max(counted, 1):9.0f} % {100 * goal:4.0f} %', flush=True)
    return killed, counted, survivors


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--numeric', action='store_true')
    parser.add_argument('--all', action='store_true')
    parser.add_argument('--jobs', type=int, default=os.cpu_count())
    parser.add_argument('--file', default='')
    options = parser.parse_args()
    known = reasons(pathlib.Path(__file__).parent)
    chosen = NUMERIC if options.numeric else {name: (GOAL, '', *rest) for name, rest in FILES.items()}
    print(f'{"file":40} {"made":>5} {"drawn":>5} {"killed":>6} {"excused":>7} {"of the rest":>11}   goal')
    killed_of_all = counted_of_all = 0
    survivors, short = [], []
    for name, (goal, program, count, *tests) in chosen.items():
        if options.file not in name:
            continue
        path = str(options.folder / (program + '_mutants' if program else 'mutants'))
        killed, counted, alive = judge(name, goal, path, count, tests, options, known)
        killed_of_all += killed
        counted_of_all += counted
        survivors += alive
        if killed < goal * counted:
            short.append(name)
    print(f'{killed_of_all} of {counted_of_all} killed: '
          f'{100 * killed_of_all / max(counted_of_all, 1):.1f} %')
    for survivor in survivors:
        print(survivor)
    for name in short:
        print(f'below its goal: {name}')
    return 1 if short else 0


if __name__ == '__main__':
    sys.exit(main())
