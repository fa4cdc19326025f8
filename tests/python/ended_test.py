"""Who ended a run, and what was lost by whom: as the end record says it.
SPDX-License-Identifier: Apache-2.0
"""

import os
import pathlib
import signal
import subprocess
import time
import unittest

import support
import vitreo


def ended(name, end, environment=None):
    """The end record of a run in real time that `end(process, live run)` ends."""
    out = support.PLACE / "ended" / name
    process = subprocess.Popen([os.environ["VITREO"], "run", "hold", "hold=60s", "feedback=pose_sensor", "compare=false", "--real-time", "-q",
                                "--out", out], cwd=support.PLACE, env={**os.environ, **(environment or {})}, stdin=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        for _ in range(600):
            folders = list(out.iterdir()) if out.exists() else []
            if folders and folders[0].name in vitreo.going_on():
                break
            time.sleep(0.05)
        live = vitreo.attach(folders[0].name)
        live.wait_until(lambda status: status["phase"] == "running", 30)
        end(process, live)
        process.wait(60)
    finally:
        process.kill()
        process.wait()
    return vitreo.open_run(folders[0]).end


class Ended(unittest.TestCase):
    def test_by_a_person_at_the_control_socket(self):
        end = ended("person", lambda _, live: live.stop(by="Ann"))
        self.assertEqual((end["exit_status"], end["ended_by"], end["ended_name"], end["ended_face"]),
                         ("stopped", "person", "Ann", "the control socket"))

    def test_by_ctrl_c(self):
        end = ended("interrupt", lambda process, _: process.send_signal(signal.SIGINT))
        self.assertEqual((end["exit_status"], end["reason"]), ("stopped", "stopped by the operator"))
        self.assertEqual((end["ended_by"], end["ended_face"], end["ended_signal"]), ("person", "the terminal", "SIGINT"))

    def test_by_a_signal_whose_sender_is_named(self):
        end = ended("terminated", lambda process, _: process.send_signal(signal.SIGTERM), {"SLURM_JOB_ID": ""})
        if end["ended_by"] == "scheduler":
            self.fail("an empty job is none")
        name = pathlib.Path("/proc/self/comm").read_text(encoding="utf-8").strip()
        self.assertEqual((end["ended_by"], end["ended_signal"], end["ended_name"]), ("signal", "SIGTERM", name))
        self.assertEqual(end["reason"], f"stopped by SIGTERM of {name}")

    def test_by_a_scheduler_within_its_job(self):
        end = ended("scheduled", lambda process, _: process.send_signal(signal.SIGTERM), {"SLURM_JOB_ID": "17"})
        self.assertEqual((end["ended_by"], end["ended_name"], end["ended_signal"]), ("scheduler", "Slurm, job 17", "SIGTERM"))
        self.assertEqual(end["reason"], "stopped by the scheduler (Slurm, job 17)")

    def test_by_the_script_itself_or_its_error(self):
        for name, statement, expected in (("stops", "run:stop('enough')", ("stopped", "script")), ("fails", "error('no')", ("failed", "protocol"))):
            file = support.PLACE / f"{name}.lua"
            file.write_text(f"return {{ title = '{name}', needs = {{}}, run = function(rig, p, run) {statement} end }}\n", encoding="utf-8")
            end = vitreo.start(file, out=support.PLACE / "ended" / name, cwd=support.PLACE).wait(120).end
            self.assertEqual((end["exit_status"], end["ended_by"]), expected)

    def test_losses_of_the_camera_are_counted_apart_from_the_recorder_s(self):
        run = vitreo.start("hold", {**support.HOLD, "hold": "6s"}, frames="top_camera", out=support.PLACE / "ended" / "lossy", cwd=support.PLACE,
                           faults=["top_camera:drops:after=1s,lasting=4s,by=4"], seed=2).wait(300)
        table = run.frames("top_camera").table
        holes = table.number.iloc[-1] - table.number.iloc[0] + 1 - len(table)
        self.assertGreater(holes, 3, "the fault drops frames")
        self.assertEqual(table.lost_before.iloc[1:].sum() + table.dropped_before.iloc[1:].sum(), holes)
        self.assertEqual(run.end["dropped"], {"top_camera": 0})
        self.assertEqual(run.end["lost"]["top_camera"], table.lost_before.sum())
        counts = support.program("show", run.folder, "--json")["frames"]["top_camera"]
        self.assertEqual((counts["recorded"], counts["dropped"], counts["lost"]), (len(table), 0, table.lost_before.sum()))


if __name__ == "__main__":
    unittest.main()
