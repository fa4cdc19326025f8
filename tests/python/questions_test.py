"""Twelve questions about a run, answered from its folder alone, by SQL and by what is in its files.

The questions were written before the record could answer them. The reader is a stranger: it knows SQLite, JSON and
SHA-256, has a copy of the folder under another name, and neither the program, nor its docs, nor the package `vitreo`.
SPDX-License-Identifier: Apache-2.0
"""

import hashlib
import json
import os
import pathlib
import re
import shutil
import sqlite3
import unittest

import support


class Stranger:
    """A folder that was passed on."""

    def __init__(self, source, name):
        self.folder = support.PLACE / "passed_on" / name
        self.folder.parent.mkdir(exist_ok=True)
        shutil.copytree(source, self.folder)
        self.database = sqlite3.connect(f"file:{self.folder}/run.sqlite?mode=ro", uri=True)

    def one(self, query, *values):
        rows = self.database.execute(query, values).fetchall()
        assert len(rows) == 1, f"{query}: {len(rows)} rows"
        return rows[0] if len(rows[0]) > 1 else rows[0][0]

    def channel(self, stream, name):
        """unit, help, axes of a channel."""
        return self.one("SELECT c.unit, c.help, c.axes FROM channel c JOIN stream s ON c.stream = s.id WHERE s.name = ? AND c.name = ?",
                        stream, name)

    def meaning(self, kind, name):
        return self.one("SELECT text FROM meaning WHERE kind = ? AND name = ?", kind, name)


class Questions(unittest.TestCase):
    """Each test is one question."""

    @classmethod
    def setUpClass(cls):
        if hasattr(cls, "servo"):  # the classes below ask for the same folders
            return
        cls.servo = Stranger(support.servoed().folder, "servo")
        cls.asking = Stranger(support.recorded().folder, "asking")
        cls.sheet = (cls.servo.folder / "DATA.md").read_text(encoding="utf-8")

    def test_1_in_what_unit_is_each_number_of_each_stream(self):
        rows = self.servo.database.execute("SELECT s.name, c.name, c.unit FROM channel c JOIN stream s ON c.stream = s.id").fetchall()
        units = {f"{stream}.{channel}": unit for stream, channel, unit in rows}
        self.assertEqual((units["servo.x"], units["currents.i1"], units["truth.z"]), ("m", "A", "m"))
        self.assertEqual((units["servo.u_px"], units["servo.limited"]), ("px", "1"), "no empty unit")
        self.assertEqual([name for name, unit in units.items() if not unit], [])
        table, column = "frame", "t_ns"
        self.assertEqual(self.servo.one("SELECT unit FROM meaning WHERE kind = 'column' AND name = ?", f"{table}.{column}"), "ns")

    def test_2_what_are_limited_and_rim_seen_and_headroom_and_residual_px(self):
        for name, words in (("limited", "limit"), ("rim_seen", "ellipse"), ("headroom", "current"), ("residual_px", "ellipse")):
            self.assertIn(words, self.servo.channel("servo", name)[1])
            self.assertIn(self.servo.channel("servo", name)[1], self.sheet.replace("\n", " "))

    def test_3_to_which_instant_does_a_row_of_servo_and_of_currents_belong(self):
        clocks = dict(self.servo.database.execute("SELECT name, clock FROM stream"))
        self.assertEqual((clocks["servo"], clocks["currents"]), ("exposure", "set point"))
        self.assertRegex(self.servo.meaning("clock", "exposure"), "middle of the exposure")
        self.assertRegex(self.servo.meaning("clock", "set point"), "set.point.*sent")
        for clock in clocks.values():
            self.assertTrue(self.servo.meaning("clock", clock))

    def test_4_at_which_utc_was_the_first_frame_taken_and_is_that_a_time_of_the_world(self):
        zero, kind = self.asking.one("SELECT t0_utc_ns, clock FROM run")
        first = zero + self.asking.one("SELECT min(t_ns) FROM frame")
        started = os.stat(support.recorded().folder / "script").st_mtime_ns
        self.assertLess(abs(first - started), 600e9, "of the day on which it was made")
        self.assertEqual(kind, "virtual")
        self.assertRegex(self.asking.meaning("time", "virtual"), "simulat.*not.*wall clock")
        self.assertRegex(self.asking.meaning("time", "real"), "wall clock|UTC")

    def test_5_where_is_the_origin_of_x_y_z_and_which_way_is_z(self):
        for name in ("x", "y", "z", "target_z", "cov_xz"):
            self.assertEqual(self.servo.channel("servo", name)[2], "world")
        self.assertRegex(self.servo.meaning("axes", "world"), "origin.*z.*up.*retina")

    def test_6_where_is_the_pixel_0_0_and_which_way_does_v_go(self):
        unit, _, axes = self.servo.channel("servo", "v_px")
        self.assertEqual((unit, axes), ("px", "top image"))
        self.assertRegex(self.servo.meaning("axes", "top image"), r"first pixel.*\(0, 0\).*down")

    def test_7_what_was_run_exactly(self):
        text, digest = self.asking.one("SELECT script, script_hash FROM run")
        self.assertEqual(hashlib.sha256(text.encode()).hexdigest(), digest)
        self.assertEqual((self.asking.folder / "script" / "asking.lua").read_text(encoding="utf-8"), text)
        for _, digest, module in self.servo.database.execute("SELECT name, hash, text FROM module"):
            self.assertEqual(hashlib.sha256(module.encode()).hexdigest(), digest)
        rig, digest = self.asking.one("SELECT rig, rig_hash FROM run")
        self.assertEqual(hashlib.sha256(rig.encode()).hexdigest(), digest)
        self.assertIn("return {", json.loads(rig)["text"])

    def test_8_by_which_program_on_which_instruments_with_which_seed(self):
        versions, devices, seed = self.asking.one("SELECT versions, devices, seed FROM run")
        self.assertTrue({"vitreo", "commit", "sqlite"} <= set(json.loads(versions)))
        self.assertIn("top_camera", json.loads(devices))
        self.assertEqual(seed, "18446744073709551615")
        for line in (self.servo.folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines():
            digest, name = line.split(None, 1)
            self.assertEqual(hashlib.sha256((self.servo.folder / name.lstrip("*")).read_bytes()).hexdigest(), digest, name)

    def test_9_what_was_asked_for_and_how_is_the_speed_meant(self):
        parameters, units = map(json.loads, self.asking.one("SELECT parameters, parameter_units FROM run"))
        self.assertEqual((parameters["speed"], units["speed"]), (0.3e-3, "mm/s"))
        self.assertRegex(self.asking.meaning("column", "run.parameters"), "SI")
        self.assertRegex(self.asking.meaning("column", "run.parameter_units"), "shown|declare")

    def test_10_was_anything_lost_and_by_whom(self):
        dropped, lost = map(json.loads, self.asking.one("SELECT dropped, lost FROM stop"))
        self.assertEqual((set(dropped), set(lost)), ({"top_camera", "side_camera"},) * 2)
        for camera, every in self.asking.database.execute("SELECT name, every FROM camera"):
            numbers = [number for (number,) in self.asking.database.execute("SELECT number FROM frame WHERE camera = ? ORDER BY seq", (camera,))]
            missing = sum((b - a) // every - 1 for a, b in zip(numbers, numbers[1:]))
            self.assertGreaterEqual(dropped[camera] + lost[camera], missing)
        self.assertRegex(self.asking.meaning("column", "frame.dropped_before"), "record")
        self.assertRegex(self.asking.meaning("column", "frame.lost_before"), "camera")

    def test_11_who_ended_it_and_how(self):
        status, kind = self.asking.one("SELECT exit_status, ended_by FROM stop")
        self.assertEqual((status, kind), ("completed", "protocol"))
        for name in ("ended_by", "ended_name", "ended_face", "ended_signal"):
            self.assertTrue(self.asking.meaning("column", "stop." + name))

    def test_12_whose_eye_and_which_robot_was_it_and_to_what_does_the_run_belong(self):
        person, sample, tags = self.asking.one("SELECT operator, sample, tags FROM run")
        self.assertEqual(person, "Ann")
        self.assertEqual(json.loads(sample), {"eye": "pig 7 left", "species": "Sus scrofa", "age": "6 months",
                                              "removed": "2026-11-24T06:10:00Z", "robot": "CoNi 12"})
        self.assertEqual(json.loads(tags), {"batch": "a 1", "paper": "fig 3"})
        self.assertRegex(self.asking.meaning("column", "run.sample"), "eye")


class Sheet(unittest.TestCase):
    setUpClass = classmethod(lambda cls: Questions.setUpClass())

    def test_it_names_every_file_stream_channel_and_column(self):
        for stranger in (Questions.servo, Questions.asking):
            sheet = (stranger.folder / "DATA.md").read_text(encoding="utf-8")
            for name, clock in stranger.database.execute("SELECT name, clock FROM stream"):
                self.assertIn(f"`sample_{name}`", sheet)
                self.assertIn(clock, sheet)
            for name, text in stranger.database.execute("SELECT name, help FROM channel"):
                self.assertTrue(text, name)
                self.assertIn(f"`{name}`", sheet)
            for (table,) in stranger.database.execute("SELECT name FROM sqlite_master WHERE type='table' AND name NOT LIKE 'sqlite%'"):
                for column in stranger.database.execute(f'SELECT name FROM pragma_table_info("{table}")'):
                    if not table.startswith("sample_"):
                        self.assertIn(f"`{column[0]}`", sheet, table)
                        self.assertTrue(stranger.meaning("column", f"{table}.{column[0]}"))
            for file in stranger.folder.rglob("*"):
                if file.is_file():
                    first = file.relative_to(stranger.folder).parts[0]
                    self.assertIn(f"`{first}", sheet, file)


class Privacy(unittest.TestCase):
    setUpClass = Sheet.setUpClass

    def test_nothing_that_is_passed_on_names_a_folder_of_this_machine(self):
        """Every byte of the folder and of its exports: no path of the tests' place, of the sources, of the home."""
        folder = Stranger(support.servoed().folder, "private").folder
        support.program("export", folder, "--csv", json_of=False)
        private = {str(support.PLACE), str(support.ROOT), os.path.expanduser("~") + "/"}
        private.discard("//")
        for file in sorted(folder.rglob("*")):
            data = file.read_bytes() if file.is_file() else b""
            for path in private:
                self.assertNotIn(path.encode(), data, file)
        text = "\n".join(Questions.servo.database.iterdump())
        self.assertEqual(re.findall(r"[\"' ]/(?:home|root|tmp|work)/[^\"' ]*", text), [])


if __name__ == "__main__":
    unittest.main()
