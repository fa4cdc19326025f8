"""`vitreo runs` finds: its expressions, columns and order, its errors with their places, and an index that only costs time.
SPDX-License-Identifier: Apache-2.0
"""

import csv
import json
import os
import shutil
import sqlite3
import subprocess
import unittest

import support
import vitreo

RUNS = [  # name, speed m/s, error m, mode, tags, sample, operator, outcome, time
    ("2026-11-20T090000_square_0001", 0.2e-3, 180e-6, "calm", {"batch": "a1"}, {"eye": "pig 7 left"}, "Ann", "completed", "2026-11-20T09:00:00+0000"),
    ("2026-11-21T090000_square_0002", 0.4e-3, 120e-6, "calm", {"batch": "a1", "paper": "fig 3"}, {"eye": "pig 7 right"}, "Ann", "completed",
     "2026-11-21T09:00:00+0000"),
    ("2026-11-21T100000_square_0003", 0.5e-3, 140e-6, "brisk", {"batch": "a2"}, {"eye": "pig 8 left", "species": "Sus scrofa"}, "Ben", "stopped",
     "2026-11-21T10:00:00+0000"),
    ("2026-11-22T090000_drift_0004", None, None, None, {}, {}, "Ben", "failed", "2026-11-22T09:00:00+0000"),
]


def make_runs(folder):
    """Folders of closed runs by SQL: the record's own tables, taken from one that the program wrote."""
    for name, speed, error, mode, tags, sample, person, outcome, when in RUNS:
        target = folder / name
        target.mkdir(parents=True)
        shutil.copy(support.recorded().folder / "run.sqlite", target)
        with sqlite3.connect(target / "run.sqlite") as database:
            parameters = {} if speed is None else {"speed": speed, "mode": mode, "careful": speed < 0.45e-3, "laps": 3}
            database.execute("UPDATE run SET parameters=?, parameter_units=?, tags=?, sample=?, operator=?, time=?, title=?, protocol=?",
                             (json.dumps(parameters), json.dumps({"speed": "mm/s"}), json.dumps(tags), json.dumps(sample), person, when,
                              "Drift" if speed is None else "Square", "protocols/drift.lua" if speed is None else "protocols/square.lua"))
            database.execute("DELETE FROM result")
            if error is not None:
                database.execute("INSERT INTO result VALUES('path_error_rms', ?, 'um')", (error,))
            database.execute("UPDATE stop SET exit_status=?, reason=?", (outcome, "" if outcome == "completed" else "no gel left"))
        database.close()


class Where(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = support.PLACE / "where"
        make_runs(cls.folder)

    def found(self, *words):
        return [int(row["run"][-4:]) for row in support.program("runs", "--runs", self.folder, "--json", *words)]

    def test_expressions_find_what_they_say(self):
        for expression, expected in {
                "speed > 0.3mm/s and path_error_rms < 150um": [2, 3],
                "speed > 300 um/s and path_error_rms < 0.13 mm": [2],
                "speed>0.3mm/s and not path_error_rms>=130um": [2],
                "p.speed = 0.4mm/s": [2],
                "speed != 0.4 mm/s": [1, 3],
                "r.path_error_rms <= 140um or outcome = failed": [2, 3, 4],
                "(speed < 0.3mm/s or speed > 0.45mm/s) and outcome = completed": [1],
                "mode = brisk": [3], "mode != brisk": [1, 2], "careful = true": [1, 2], "laps = 3": [1, 2, 3],
                "tag.batch = a1": [1, 2], "batch = a2": [3], "tag.paper": [2], "not tag.paper": [1, 3, 4],
                "sample.eye ~ LEFT": [1, 3], "sample.species = 'Sus scrofa'": [3], 'eye = "pig 7 right"': [2],
                "operator = Ben": [3, 4], "protocol = square": [1, 2, 3], "protocol != square": [4], "protocol ~ drift": [4],
                "rig ~ simulated": [1, 2, 3, 4], "time >= 2026-11-21 and time < 2026-11-22": [2, 3], "date = 2026-11-21": [2, 3],
                "time = 2026-11": [1, 2, 3, 4], "text ~ 'no GEL'": [3, 4], "title = Square and reason ~ gel": [3],
                "run ~ drift": [4], "path_error_rms": [1, 2, 3], "not speed": [4], "ended_by = protocol": [1, 2, 3, 4],
                "not (speed > 0.3mm/s)": [1, 4]}.items():
            self.assertEqual(self.found("--where", expression), expected, expression)

    def test_the_options_and_an_expression_hold_together(self):
        self.assertEqual(self.found("--where", "speed > 0.1mm/s", "--operator", "Ann", "--since", "2026-11-21"), [2])
        self.assertEqual(self.found("--protocol", "quar", "--outcome", "completed", "--newest", "1"), [2])

    def test_they_are_sorted_as_is_asked(self):
        self.assertEqual(self.found("--sort", "path_error_rms"), [2, 3, 1, 4])
        self.assertEqual(self.found("--sort=-speed"), [3, 2, 1, 4])
        self.assertEqual(self.found("--sort", "operator,-time"), [2, 1, 4, 3])
        self.assertEqual(self.found("--sort=-path_error_rms", "--newest", "3"), [3, 2, 4], "the newest are chosen before they are sorted")

    def test_columns_are_shown_in_one_unit_and_given_to_programs_in_si(self):
        rows = support.program("runs", "--runs", self.folder, "--json", "--columns", "speed,mode,batch,careful,path_error_rms")
        self.assertEqual(rows[1]["values"], {"speed": 0.4e-3, "mode": "calm", "batch": "a1", "careful": True, "path_error_rms": 120e-6})
        self.assertEqual(set(rows[3]["values"].values()), {None})
        text = support.program("runs", "--runs", self.folder, "--columns", "speed,path_error_rms", json_of=False)
        self.assertRegex(text, r"run +outcome +time +speed +path_error_rms +title\n")
        self.assertRegex(text, r"0002 +completed .* 0\.4 mm/s +120 µm +Square")
        self.assertRegex(text, r"0004 +failed .* - +- +Drift: no gel left")
        table = list(csv.reader(support.program("runs", "--runs", self.folder, "--as-csv", "--columns", "speed,tag.batch", json_of=False).splitlines()))
        self.assertEqual(table[0][-2:], ["speed (m/s)", "tag.batch"])
        self.assertEqual([row[-2:] for row in table[1:]], [["0.0002", "a1"], ["0.0004", "a1"], ["0.0005", "a2"], ["", ""]])

    def test_quantities_of_several_kinds_under_one_name_keep_their_units(self):
        folder = support.PLACE / "mixed"
        make_runs(folder)
        for name, value, unit in ((RUNS[0][0], 0.012, "T"), (RUNS[1][0], None, "um")):
            with sqlite3.connect(folder / name / "run.sqlite") as database:
                database.execute("UPDATE result SET value=?, unit=?", (value, unit))
            database.close()
        words = ("runs", "--runs", folder, "--columns", "path_error_rms")
        lines = support.program(*words, json_of=False).splitlines()
        for line, value in zip(lines[1:], ("12 mT", "-", "140 µm", "-")):
            self.assertRegex(line, f" {value}  (Square|Drift)")
        self.assertEqual([row["values"]["path_error_rms"] for row in support.program(*words, "--json")], [0.012, None, 140e-6, None])
        # What was not finite in one run does not make texts of the others.
        found = support.program("runs", "--runs", folder, "--json", "--where", "path_error_rms < 150um or path_error_rms = 12mT")
        self.assertEqual([row["run"][-4:] for row in found], ["0001", "0003"])
        said = subprocess.run([os.environ["VITREO"], "runs", "--runs", folder, "--where", "path_error_rms = big"], capture_output=True, text=True,
                              check=False)
        self.assertRegex(said.stderr, "'big' is no number")

    def test_a_mistake_is_told_with_its_place(self):
        for expression, place, words in (
                ("speed > 0.3", 9, r"speed: wants a speed; 0\.3 has no unit: write 0\.3m/s"),
                ("speed > 0.3mm", 9, r"speed: wants a speed; 0\.3mm is a length"),
                ("speed > fast", 9, "'fast' is no number with a unit that is known"),
                ("sped > 1mm/s", 1, "sped: no run has .* of that name; did you mean speed\\?"),
                ("speed >", 8, "wants a value"),
                ("speed > 1mm/s and", 18, "a condition is missing"),
                ("speed > 1mm/s mode = calm", 15, "wants and, or, or the end"),
                ("(speed > 1mm/s", 1, r"this \( is not closed"),
                ("speed > 1mm/s)", 14, r"there is no \( for this"),
                ("mode < calm", 8, "mode is a text: compare it by =, != or ~"),
                ("title = 'Squ", 9, "the quotation is not closed"),
                ("outcome < completed", 11, "is a text: compare it by =, != or ~"),
                ("& = 3", 1, "'&' is not understood"),
                ("not " * 200 + "speed", None, "is nested too deeply"),
                ("mode ! calm", 6, "wants one of")):
            said = subprocess.run([os.environ["VITREO"], "runs", "--runs", self.folder, "--where", expression], capture_output=True, text=True,
                                  check=False)
            self.assertEqual(said.returncode, 2, expression)
            self.assertRegex(said.stderr, words, expression)
            if place:
                self.assertIn(f"at character {place}:", said.stderr)
                self.assertTrue(said.stderr.rstrip("\n").endswith("\n  " + " " * (place - 1) + "^"), said.stderr)
        said = subprocess.run([os.environ["VITREO"], "runs", "--runs", self.folder, "--sort", "sped"], capture_output=True, text=True, check=False)
        self.assertRegex(said.stderr, r"--sort: sped: no run has .*; did you mean speed\?")

    def test_what_is_typed_cannot_reach_the_index(self):
        self.assertEqual(self.found("--where", "title = \"x' OR 1=1 --\""), [])
        self.assertEqual(self.found("--where", "sample.eye = 'a\";DROP TABLE run;'"), [])
        self.assertEqual(len(self.found()), 4)


class SharedIndex(unittest.TestCase):
    """The program and the package keep one index: whichever made it, the other finds the same in it."""

    def setUp(self):
        self.folder = support.PLACE / ("shared_" + self._testMethodName)
        make_runs(self.folder)
        self.files = set((support.PLACE / "cache" / "vitreo").glob("catalog-*")) if (support.PLACE / "cache" / "vitreo").exists() else set()

    def index(self):
        (file,) = set((support.PLACE / "cache" / "vitreo").glob("catalog-*.sqlite")) - self.files
        return file

    def content(self):
        with sqlite3.connect(self.index()) as database:
            tables = sorted(row[0] for row in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"))
            runs = sorted(database.execute("SELECT name, mark, time, t0_utc_ns, protocol, title, operator, seed, outcome, reason, ended_by, "
                                           "experiment_time, wall_time, version, rig, words FROM run"))
            values = sorted(database.execute("SELECT r.name, v.kind, v.name, v.number, v.text, v.unit FROM value v JOIN run r ON r.id = v.run"), key=str)
        database.close()
        return tables, runs, values

    def listed(self, *words):
        return support.program("runs", "--runs", self.folder, "--json", *words)

    def test_both_make_the_same(self):
        vitreo.runs(self.folder)
        by_package = self.content()
        self.index().unlink()
        self.listed()
        by_program = self.content()
        self.assertEqual(by_package[0], by_program[0])
        self.assertEqual(by_package[1], by_program[1])
        self.assertEqual(by_package[2], by_program[2])
        self.assertEqual((len(by_program[1]), len(by_program[2]) > 20), (4, True))

    def test_a_locked_damaged_or_foreign_index_costs_only_time(self):
        right = self.listed("--where", "speed > 0.3mm/s")
        self.assertEqual(len(right), 2)
        file = self.index()
        whole = file.read_bytes()
        foreign = support.PLACE / "foreign.sqlite"
        with sqlite3.connect(foreign) as database:
            database.executescript("CREATE TABLE IF NOT EXISTS stamps(price); PRAGMA user_version=2")
        database.close()
        for damage in (b"rubbish" * 1000, whole[:100] + b"\xff" * (len(whole) - 100), whole[: len(whole) // 2], b"", foreign.read_bytes()):
            file.write_bytes(damage)
            self.assertEqual(self.listed("--where", "speed > 0.3mm/s"), right)
            self.assertEqual(self.listed("--where", "speed > 0.3mm/s"), right)
            self.assertEqual(len(self.content()[1]), 4, "it is made anew")
        locked = sqlite3.connect(file)
        locked.execute("BEGIN EXCLUSIVE")
        self.assertEqual(self.listed("--where", "speed > 0.3mm/s"), right)
        locked.close()
        writing = sqlite3.connect(file)
        writing.execute("BEGIN IMMEDIATE")
        shutil.rmtree(self.folder / RUNS[2][0])
        self.assertEqual([row["run"] for row in self.listed("--where", "speed > 0.3mm/s")], [RUNS[1][0]], "gone, though the index knows it still")
        writing.close()
        file.unlink()
        file.mkdir()
        self.assertEqual(len(self.listed()), 3)

    def test_the_folders_are_the_truth(self):
        self.assertEqual(len(self.listed()), 4)
        first = self.folder / RUNS[0][0]
        with sqlite3.connect(first / "run.sqlite") as database:
            database.execute("UPDATE stop SET exit_status='aborted'")
        database.close()
        self.assertEqual(self.listed()[0]["outcome"], "aborted")
        os.rename(first, self.folder / "2026-11-25T000000_square_0001")
        self.assertEqual([row["run"][-4:] for row in self.listed()], ["0002", "0003", "0004", "0001"])

    def test_bad_folders_are_listed_with_their_reason_and_stop_nothing(self):
        for name, content in (("2026-11-23T000000_cut_0005", (self.folder / RUNS[0][0] / "run.sqlite").read_bytes()[:5000]),
                              ("2026-11-23T000001_text_0006", b"no database"), ("2026-11-23T000002_empty_0007", b"")):
            (self.folder / name).mkdir()
            (self.folder / name / "run.sqlite").write_bytes(content)
        future = self.folder / "2026-11-23T000003_future_0008"
        shutil.copytree(self.folder / RUNS[0][0], future)
        with sqlite3.connect(future / "run.sqlite") as database:
            database.execute("PRAGMA user_version=99")
        database.close()
        (self.folder / "notes").mkdir()
        (self.folder / "a file").write_text("x", encoding="utf-8")
        rows = {row["run"][-4:]: row for row in self.listed()}
        self.assertEqual({name for name, row in rows.items() if row["outcome"] == "unreadable"}, {"0005", "0006", "0007", "0008"})
        self.assertEqual(len(rows), 8)
        self.assertIn("wants a newer Vitreo", rows["0008"]["reason"])
        self.assertEqual(len(self.listed("--where", "outcome = unreadable")), 4)

    def test_without_a_place_for_the_index_it_lists_all_the_same(self):
        environment = {**os.environ, "XDG_CACHE_HOME": "/proc/nowhere"}
        said = subprocess.run([os.environ["VITREO"], "runs", "--runs", self.folder, "--json"], capture_output=True, text=True, check=True, env=environment)
        self.assertEqual(len(json.loads(said.stdout)), 4)
        for name in ("HOME", "XDG_CACHE_HOME"):
            environment.pop(name)
        said = subprocess.run([os.environ["VITREO"], "runs", "--runs", self.folder, "--json"], capture_output=True, text=True, check=True, env=environment)
        self.assertEqual(len(json.loads(said.stdout)), 4)

    def test_a_full_disk_costs_only_time(self):
        full = support.PLACE / "full_cache"
        (full / "vitreo").mkdir(parents=True)
        said = subprocess.run(["sh", "-c", 'ulimit -f 8; trap "" XFSZ; exec "$VITREO" runs --runs "$1" --json', "sh", self.folder],
                              capture_output=True, text=True, check=False, env={**os.environ, "XDG_CACHE_HOME": str(full)})
        self.assertEqual((said.returncode, len(json.loads(said.stdout))), (0, 4), said.stderr)


if __name__ == "__main__":
    unittest.main()
