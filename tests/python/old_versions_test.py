"""Records of every version of the schema that was ever written are read for good: by the package and by the program.

schemas/vN.sql: the schema as it stood in the commit that wrote that version, with a few rows. A version that is raised
gets a file here; none is ever changed or removed.
SPDX-License-Identifier: Apache-2.0
"""

import csv
import json
import re
import sqlite3
import subprocess
import unittest

import support
import vitreo

SCHEMAS = support.ROOT / "tests" / "python" / "schemas"
VERSIONS = (0, 2, 3, 4)


def made(version, name=None, more=""):
    """The folder of a run of that version; `name` differs where it is to be changed."""
    folder = support.PLACE / "versions" / (name or f"2026-11-21T143005_servo_square_v{version}")
    if not folder.exists():
        folder.mkdir(parents=True)
        with sqlite3.connect(folder / "run.sqlite") as database:
            database.executescript((SCHEMAS / f"v{version}.sql").read_text(encoding="utf-8") + more)
        database.close()
        stack = folder / "frames" / "top_camera" / "top_camera_NDTiffStack.tif"
        if version:
            stack.parent.mkdir(parents=True)
            stack.write_bytes(b"II*\0" + bytes(206) + bytes([1, 2, 3, 4]))
    return folder


class OldVersions(unittest.TestCase):
    def test_the_package_reads_them(self):
        for version in VERSIONS:
            with self.subTest(version=version):
                run = vitreo.open_run(made(version))
                self.assertEqual((run.version, run.outcome, run.parameters["speed"]), (version, "completed", 0.0005))
                self.assertEqual(list(run.servo.x.fillna(-1)), [0.001, -1, 0.0012])
                self.assertEqual(dict(run.results), {"path_error_rms": 0.00012, "share": 0.5})
                self.assertEqual(run.results.attrs["units"], {"path_error_rms": "m", "share": ""})
                self.assertEqual((run.tags, run.sample, run.servo.attrs["clock"]), ({}, {}, ""))
                self.assertTrue(run.t0 is vitreo.record.pd.NaT)
                with self.assertRaisesRegex(vitreo.RecordError, "does not say when its clock was 0"):
                    run.utc(run.servo)
                self.assertEqual((len(run.tables), len(run.events), len(run.modules)), (1, 2, 1 if version else 0))

    def test_the_program_shows_them(self):
        for version in VERSIONS:
            with self.subTest(version=version):
                shown = support.program("show", made(version), "--json")
                self.assertEqual((shown["record_version"], shown["outcome"], shown["parameters"]["speed"]), (version, "completed", 0.0005))
                self.assertEqual(shown["results"], {"path_error_rms": 0.00012, "share": 0.5})
                self.assertEqual(shown["streams"][0]["samples"], 3)
                self.assertEqual(shown["tables"][0]["rows"], [["1", "0.11 mm"], ["2", "0.13 mm"]])
                text = support.program("show", made(version), json_of=False)
                self.assertIn("path error rms", text.replace("_", " "))
                self.assertRegex(text, r"table +Laps\n +lap +error\n +1 +0.11 mm\n")

    def test_the_program_exports_them(self):
        for version in VERSIONS:
            with self.subTest(version=version):
                into = support.PLACE / "versions_csv" / str(version)
                support.program("export", made(version), "--csv", "--into", into, json_of=False)
                with open(next(into.glob("*servo*.csv")), newline="", encoding="utf-8") as file:
                    rows = list(csv.reader(file))
                self.assertEqual((rows[0][1], len(rows)), ("x (m)", 4))
                self.assertEqual(rows[2][1:], ["", ""])

    def test_the_program_lists_verifies_and_reports_them(self):
        parent = support.PLACE / "versions_listed"
        for version in VERSIONS:
            made(version, f"../versions_listed/2026-11-21T14300{version}_servo_square_{version:04x}")
        listed = support.program("runs", "--runs", parent, "--json", "--columns", "path_error_rms,speed")
        self.assertEqual([row["outcome"] for row in listed], ["completed"] * len(VERSIONS))
        self.assertEqual({json.dumps(row["values"], sort_keys=True) for row in listed}, {'{"path_error_rms": 0.00012, "speed": 0.0005}'})
        table = vitreo.runs(parent)
        self.assertEqual((list(table.version), set(table["r.path_error_rms"])), (list(VERSIONS), {0.00012}))
        for version in VERSIONS:
            folder = made(version, f"report_v{version}")
            support.program("report", folder, json_of=False)
            self.assertIn(f"version {version}", (folder / "DATA.md").read_text(encoding="utf-8"))
            self.assertEqual(support.program("verify", folder, "--json")["problems"], [])

    def test_a_lost_one_of_any_version_is_recovered(self):
        for version in VERSIONS:
            with self.subTest(version=version):
                folder = made(version, f"lost_v{version}", "DELETE FROM stop; DELETE FROM picture;")
                for stack in folder.glob("frames"):
                    support.shutil.rmtree(stack)
                with sqlite3.connect(folder / "run.sqlite") as database:
                    if version:
                        database.executescript("DELETE FROM frame; DELETE FROM camera")
                database.close()
                support.program("recover", folder, json_of=False)
                self.assertEqual(vitreo.open_run(folder).outcome, "lost")
                self.assertEqual(support.program("verify", folder, "--json")["problems"], [])

    def test_a_newer_one_is_refused_with_a_word_of_what_to_do(self):
        folder = made(4, "future", "PRAGMA user_version=99;")
        for reader in ("show", "export --csv", "report"):
            words = reader.split()
            said = subprocess.run([support.os.environ["VITREO"], words[0], folder, *words[1:]], capture_output=True, text=True, check=False)
            self.assertNotEqual(said.returncode, 0)
            self.assertRegex(said.stderr, "has record version 99; this program reads up to 5: it wants a newer Vitreo")
        with self.assertRaisesRegex(vitreo.RecordError, "it wants a newer one"):
            vitreo.open_run(folder)

    def test_each_version_has_its_fixture(self):
        text = (support.ROOT / "host/record/record_schema.h").read_text(encoding="utf-8")
        newest = int(re.search(r"kRecordVersion = (\d+);", text)[1])
        # 1 was never written (docs/records.md).
        self.assertEqual({int(file.stem[1:]) for file in SCHEMAS.glob("v*.sql")} | {1}, set(range(newest)))


if __name__ == "__main__":
    unittest.main()
