"""Vitreo's records as tables and arrays, and its runs from Python: start, follow, answer, pause, stop.

    import vitreo
    runs = vitreo.runs("runs")            # a row a run: parameters, results, outcome
    run = vitreo.open_run("last", "runs")
    run.servo.plot(y=["x", "y", "z"])     # a stream with units in attrs; run.frames("top_camera") are arrays

docs/python.md has the whole. SPDX-License-Identifier: Apache-2.0
"""

from .catalog import open_run, runs
from .errors import RecordError, RunError, VitreoError
from .frames import Frames
from .live import Live, attach, going_on, start
from .record import NEWEST_VERSION, Run
from .units import si_unit

__version__ = "0.1.0"
__all__ = ["Frames", "Live", "NEWEST_VERSION", "RecordError", "Run", "RunError", "VitreoError", "attach", "going_on", "open_run",
           "runs", "si_unit", "start"]
