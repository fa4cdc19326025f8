"""Damaged, foreign, future, half-written and old records.
SPDX-License-Identifier: Apache-2.0
"""

import re
import shutil
import sqlite3
import unittest

import numpy as np
import support
import vitreo


def changed(name, *statements, run=None):
    """A copy of a real record after these statements."""
    folder = support.copied(run or support.recorded(), name, "damaged")
    with sqlite3.connect(folder / "run.sqlite") as database:
        for statement in statements:
            database.execute(statement)
    database.close()
    return folder


class Damaged(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(support.PLACE / "damaged", ignore_errors=True)

    def refused(self, folder, message):
        with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(folder)) + ".*" + message):
            vitreo.open_run(folder)

    def test_each_bad_folder_is_named_with_its_reason_and_listed_as_unreadable(self):
        whole = support.recorded()
        place = support.PLACE / "damaged"
        self.refused(place / "none", "there is no such folder")
        (place / "empty").mkdir(parents=True)
        self.refused(place / "empty", "it has no run.sqlite")
        bad = {}
        for name, content in (("text", b"this is no database at all" * 50), ("zero", b"")):
            (place / name).mkdir()
            (place / name / "run.sqlite").write_bytes(content)
        bad["text"] = "cannot be read: file is not a database"
        bad["zero"] = "no run's record, or was cut: it has no table channel, event, run, stop, stream"
        changed("future", "PRAGMA user_version=6")
        bad["future"] = "has record version 6, this package reads up to 5"
        changed("beginning", "DELETE FROM run")
        bad["beginning"] = "its start record is missing"
        changed("without", "DROP TABLE stop")
        bad["without"] = "it has no table stop"
        (place / "foreign").mkdir()
        with sqlite3.connect(place / "foreign" / "run.sqlite") as database:
            database.execute("CREATE TABLE song(title TEXT)")
        database.close()
        bad["foreign"] = "no run's record"
        half = support.copied(whole, "half", "damaged")
        content = (half / "run.sqlite").read_bytes()
        (half / "run.sqlite").write_bytes(content[: len(content) // 2])
        (place / "folder" / "run.sqlite").mkdir(parents=True)
        bad["folder"] = "it has no run.sqlite"
        for name, message in bad.items():
            self.refused(place / name, message)
        with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(half))):
            run = vitreo.open_run(half)
            for stream in run.streams:
                run.stream(stream)
            run.events, run.frames("top_camera")
        table = vitreo.runs(place)
        listed = table[table.outcome == "unreadable"]
        self.assertEqual(set(listed.index) | {"half"}, set(bad) | {"half"})
        for name, reason in listed.reason.items():
            self.assertIn(str(place / name), reason)

    def test_every_cut_is_a_record_error_or_the_same_numbers(self):
        whole = support.recorded()
        content = (whole.folder / "run.sqlite").read_bytes()
        folder = support.PLACE / "cut"
        folder.mkdir(exist_ok=True)
        laps, refused = whole.laps, 0
        for part in range(0, 40):
            (folder / "run.sqlite").write_bytes(content[: len(content) * part // 40])
            try:
                self.assertTrue(vitreo.open_run(folder).laps.equals(laps))
            except vitreo.RecordError as error:
                refused += 1
                self.assertIn(str(folder), str(error))
        self.assertGreater(refused, 10)

    def test_broken_rows_do_not_hide_the_rest(self):
        folder = changed("rows", "UPDATE run SET parameters='{', seed='many'", "UPDATE sample_laps SET lap='x' WHERE seq=2",
                         "UPDATE frame SET width_px=width_px+1 WHERE seq=(SELECT min(seq) FROM frame WHERE camera='top_camera')", "UPDATE picture SET file='../../etc/passwd'",
                         "UPDATE result SET value=NULL WHERE name='share'")
        run = vitreo.open_run(folder)
        self.assertEqual(run.parameters, {})
        self.assertEqual(len(run.events), len(support.recorded().events))
        self.assertTrue(np.isnan(run.results["share"]))
        for read in (lambda: run.laps, lambda: run.frames("top_camera")[0], lambda: run.pictures):
            with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(folder))):
                read()
        run.frames("top_camera")[1]

    def test_frames_that_are_not_there_and_names_outside_are_refused(self):
        folder = support.copied(support.recorded(), "frames", "damaged")
        stack = next(folder.glob("frames/top_camera/*.tif"))
        stack.write_bytes(stack.read_bytes()[:3_000_000])
        frames = vitreo.open_run(folder).frames("top_camera")
        frames[0]
        with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(stack)) + ": is shorter than its frames"):
            frames[-1]
        stack.unlink()
        with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(stack))):
            vitreo.open_run(folder).frames("top_camera")[0]
        for name in ("/etc/passwd", "frames/../../x"):
            outside = changed("out" + str(len(name)), f"UPDATE frame SET file='{name}'")
            with self.assertRaisesRegex(vitreo.RecordError, "names a file outside itself"):
                vitreo.open_run(outside).frames("top_camera")[0]

    def test_old_versions_read_alike(self):
        """A real record brought to the tables of older commits: 302fab3 (4), d47b065 (3), 0e57195 (2), bea5b8f (before versions)."""
        whole = support.recorded()
        since = {"run": ("t0_utc_ns", "clock", "tags", "sample"), "stream": ("clock",), "channel": ("help", "axes"), "frame": ("lost_before",),
                 "stop": ("lost", "ended_by", "ended_name", "ended_face", "ended_signal")}
        four = ["PRAGMA user_version=4", "DROP TABLE meaning",
                *(f"ALTER TABLE {table} DROP COLUMN {name}" for table, names in since.items() for name in names)]
        three = four + ["PRAGMA user_version=3", *(f"ALTER TABLE camera DROP COLUMN {name}" for name in ("bits", "offset_x_px", "offset_y_px"))]
        two = three + ["PRAGMA user_version=2", "ALTER TABLE result RENAME TO figure", "DROP TABLE link"]
        none = two + ["PRAGMA user_version=0", *(f"DROP TABLE {name}" for name in ("module", "camera", "frame", "plot", "drawing")),
                      *(f"ALTER TABLE run DROP COLUMN {name}" for name in ("devices", "files")),
                      *(f"ALTER TABLE stop DROP COLUMN {name}" for name in ("script_line", "dropped", "held"))]
        for version, statements in ((4, four), (3, three), (2, two), (0, none)):
            run = vitreo.open_run(changed(f"version{version}", *statements))
            self.assertEqual(run.version, version)
            for name in whole.streams:
                self.assertTrue(run.stream(name).equals(whole.stream(name)))
            self.assertEqual(dict(run.results), dict(whole.results))
            self.assertEqual(run.results.attrs["units"], whole.results.attrs["units"])
            self.assertEqual(run.parameters, whole.parameters)
            self.assertTrue(run.events.equals(whole.events))
            self.assertEqual((run.outcome, len(run.tables), len(run.pictures)), ("completed", 1, 1))
            if version:
                self.assertTrue((run.frames("top_camera")[1] == whole.frames("top_camera")[1]).all())
                self.assertTrue(version == 4 or run.cameras.bits.isna().all())
            else:
                self.assertEqual((run.plots, len(run.modules), len(run.cameras)), ([], 0, 0))

    def test_the_newest_version_is_that_of_the_program(self):
        text = (support.ROOT / "host/record/record_schema.h").read_text(encoding="utf-8")
        self.assertEqual(vitreo.NEWEST_VERSION, int(re.search(r"kRecordVersion = (\d+);", text)[1]))


if __name__ == "__main__":
    unittest.main()
