"""Real records for the tests, made by the program `vitreo` on the simulated rig, once for all of them.
SPDX-License-Identifier: Apache-2.0
"""

import atexit
import functools
import json
import os
import pathlib
import shutil
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
PLACE = pathlib.Path(tempfile.mkdtemp(prefix="vitreo_python_"))
atexit.register(shutil.rmtree, PLACE, ignore_errors=True)

# Sockets and index of these tests alone.
(PLACE / "runtime").mkdir(mode=0o700)
os.environ["XDG_RUNTIME_DIR"] = str(PLACE / "runtime")
os.environ["XDG_CACHE_HOME"] = str(PLACE / "cache")
os.environ["XDG_STATE_HOME"] = str(PLACE / "state")

ASKING = """-- asking: a question, then laps with a checkpoint, a frame and a sample each.
local units = require "units"
return {
  title = "A question, then laps",
  needs = { "top_camera" },
  parameters = {
    laps = { default = 3, min = 1, max = 1000000, integer = true, help = "how often" },
    speed = { unit = "mm/s", default = 0.5 * units.mm / units.s, min = 0, max = 1, help = "stated as a result" },
    mode = { default = "calm", choices = { "calm", "brisk" }, help = "kept in the start record" },
    careful = { default = true, help = "kept in the start record" },
  },
  run = function(rig, p, run)
    local width = run:ask("how wide?", { unit = "mm", min = 0, max = 10 * units.mm, name = "width" })
    run:result("width", width, "mm")
    run:result("share", 1 / 3, "%")
    run:result("speed", p.speed, "m/s")
    run:table { title = "Laps", header = { "lap", "µm" }, rows = { { "1", "2.5" }, { "2", "-" } } }
    run:plot { title = "A line", x = { "time", "s" }, y = { "way", "um" }, series = { { label = "a", x = { 0, 1 }, y = { 0, 1e-6 } } } }
    for lap in run:each(p.laps, "lap") do
      run:checkpoint("lap " .. lap)
      local frame = rig.top_camera:grab()
      if lap == 1 then run:picture { title = "first", image = frame.image } end
      run:record("laps", { lap = lap, exposed = frame.time, odd = lap % 2 == 1 and lap / 3 or 0 / 0 }, { exposed = "s" })
    end
    run:note("done µ")
  end,
}
"""

# A servo with its streams in little time: without optics, a square of 0.2 mm.
HOLD = {"hold": 1.0, "settle": "0.5s", "width": "0.2mm", "depth": "0.2mm", "speed": "2mm/s", "feedback": "pose_sensor",
        "compare": False}


def program(*words, json_of=True):
    """What the program says to these words; its JSON, or its text."""
    said = subprocess.run([os.environ["VITREO"], *map(str, words)], capture_output=True, text=True, check=False, cwd=PLACE)
    if said.returncode != 0:
        raise AssertionError(f"vitreo {' '.join(map(str, words))}: {said.returncode}: {said.stderr}")
    return json.loads(said.stdout) if json_of else said.stdout


def asking():
    file = PLACE / "asking.lua"
    file.write_text(ASKING, encoding="utf-8")
    return file


@functools.lru_cache(maxsize=None)
def recorded():
    """A run of `asking` with gray frames, the whole record closed. Not to be changed: copy it (copied())."""
    import vitreo
    run = vitreo.start(asking(), {"laps": 8, "speed": 0.3e-3}, answers={"width": "3mm"}, seed=18446744073709551615, operator="Ann",
                       frames=["top_camera/2", "side_camera"], out=PLACE / "runs", cwd=PLACE, tags={"batch": "a 1", "paper": "fig 3"},
                       sample={"eye": "pig 7 left", "species": "Sus scrofa", "age": "6 months", "removed": "2026-11-24T08:10+02:00",
                               "robot": "CoNi 12"},
                       options=["--trace-links"]).wait(240)
    assert run.outcome == "completed", run.end
    return run


@functools.lru_cache(maxsize=None)
def servoed():
    """A run of the protocol `hold`, with the streams of a servo."""
    import vitreo
    run = vitreo.start("hold", HOLD, out=PLACE / "runs", cwd=PLACE).wait(240)
    assert run.outcome == "completed", run.end
    return run


def copied(run, name, below="copies"):
    """The folder of a copy of the run's, to be damaged."""
    target = PLACE / below / name
    target.parent.mkdir(exist_ok=True)
    shutil.copytree(run.folder, target)
    return target
