"""The table of runs, and its index: as quick as promised, and never wrong.
SPDX-License-Identifier: Apache-2.0
"""

import os
import shutil
import sqlite3
import time
import unittest

import support
import vitreo

MANY = support.PLACE / "many"


def index_file():
    return max((support.PLACE / "cache" / "vitreo").glob("catalog-*.sqlite"), key=lambda file: file.stat().st_mtime_ns)


class Catalog(unittest.TestCase):
    def setUp(self):
        self.folder = support.PLACE / ("catalog_" + self._testMethodName)
        self.folder.mkdir()
        for run in (support.recorded(), support.servoed()):
            shutil.copytree(run.folder, self.folder / run.name)

    def test_columns_are_those_of_the_program_s_list(self):
        table = vitreo.runs(self.folder)
        listed = support.program("runs", "--runs", self.folder, "--json")
        rows = listed["runs"] if isinstance(listed, dict) else listed
        self.assertEqual(len(table), len(rows))
        for row in rows:
            name = os.path.basename(row.get("folder", row.get("run", "")))
            for field in ("protocol", "title", "operator"):
                self.assertEqual(table[field][name], row[field])
            self.assertEqual(table.outcome[name], row.get("state", row.get("outcome")))
        whole = support.recorded()
        self.assertEqual(table["p.speed"][whole.name], 0.3e-3)
        self.assertEqual(table["r.width"][whole.name], whole.results["width"])
        self.assertEqual(table.seed[whole.name], 2**64 - 1)
        self.assertEqual((table.attrs["units"]["p.speed"], table.attrs["units"]["r.width"]), ("m/s", "m"))
        self.assertEqual(list(table.index), sorted(table.index))
        self.assertEqual(str(table.time.dtype), "datetime64[ns, UTC]")

    def test_a_thousand_runs_in_a_second(self):
        source = support.recorded()
        for i in range(1000):
            target = MANY / f"2026-11-24T{i // 3600:02d}{i // 60 % 60:02d}{i % 60:02d}_asking_{i:04x}"
            target.mkdir(parents=True)
            shutil.copy(source.folder / "run.sqlite", target)
        times = []
        for _ in range(4):
            begun = time.perf_counter()
            table = vitreo.runs(MANY)
            times.append(time.perf_counter() - begun)
            self.assertEqual((len(table), set(table.outcome)), (1000, {"completed"}))
        print(f"\n1000 runs: {times[0]:.2f} s without an index, then {min(times[1:]):.3f} s")
        self.assertLess(min(times[1:]), 1)

    def test_the_index_follows_the_folders(self):
        first = vitreo.runs(self.folder)
        self.assertTrue(vitreo.runs(self.folder).equals(first))
        name = support.recorded().name
        with sqlite3.connect(self.folder / name / "run.sqlite") as database:
            database.execute("UPDATE stop SET exit_status='uncertain'")
        database.close()
        self.assertEqual(vitreo.runs(self.folder).outcome[name], "uncertain")
        size = (self.folder / name / "run.sqlite").stat().st_size
        with sqlite3.connect(self.folder / name / "run.sqlite") as database:
            database.execute("UPDATE stop SET exit_status='different'")
        database.close()
        self.assertEqual((self.folder / name / "run.sqlite").stat().st_size, size)
        self.assertEqual(vitreo.runs(self.folder).outcome[name], "different", "of the same size, and the same inode")
        os.rename(self.folder / name, self.folder / "2030-renamed")
        self.assertEqual(list(vitreo.runs(self.folder).index), [support.servoed().name, "2030-renamed"])
        shutil.rmtree(self.folder / "2030-renamed")
        self.assertEqual(list(vitreo.runs(self.folder).index), [support.servoed().name])
        (self.folder / "notes").mkdir()
        self.assertEqual(len(vitreo.runs(self.folder)), 1, "a folder without run.sqlite is no run")

    def test_an_index_that_is_damaged_locked_or_impossible_costs_only_time(self):
        right = vitreo.runs(self.folder)
        file = index_file()
        for damage in (b"rubbish" * 1000, file.read_bytes()[:100] + b"\xff" * (file.stat().st_size - 100), b""):
            file.write_bytes(damage)
            self.assertTrue(vitreo.runs(self.folder).equals(right))
            vitreo.runs(self.folder)
            self.assertTrue(vitreo.runs(self.folder).equals(right))
        with sqlite3.connect(file) as database:
            self.assertEqual(database.execute("SELECT count(*) FROM run").fetchone()[0], 2, "it is made anew")
            database.execute("UPDATE value SET kind='?'")
        database.close()
        self.assertTrue(vitreo.runs(self.folder).equals(right))
        locked = sqlite3.connect(index_file() if file.exists() else file)
        locked.execute("BEGIN EXCLUSIVE")
        self.assertTrue(vitreo.runs(self.folder).equals(right))
        locked.close()
        os.environ["XDG_CACHE_HOME"] = "/proc/nowhere"
        self.addCleanup(os.environ.__setitem__, "XDG_CACHE_HOME", str(support.PLACE / "cache"))
        self.assertTrue(vitreo.runs(self.folder).equals(right))

    def test_runs_are_found_as_the_program_finds_them(self):
        whole = support.recorded()
        for which in (whole.name, whole.name[:-2], self.folder / whole.name, str(self.folder / whole.name)):
            self.assertEqual(vitreo.open_run(which, self.folder).name, whole.name)
        self.assertEqual(vitreo.open_run("last", self.folder).name, support.program("show", "last", "--runs", self.folder, "--json")["run"])
        for which, message in (("1999", "is no run's folder, and no run in .* begins so"), ("2", "could be 2 runs"), ("", "begins so")):
            with self.assertRaisesRegex(vitreo.RecordError, message):
                vitreo.open_run(which, self.folder)
        (self.folder / "none").mkdir()
        self.assertEqual(len(vitreo.runs(self.folder / "none")), 0)
        with self.assertRaisesRegex(vitreo.RecordError, "there are no runs in"):
            vitreo.open_run("last", self.folder / "none")
        with self.assertRaisesRegex(vitreo.RecordError, "/no/such: cannot be listed: No such file or directory"):
            vitreo.runs("/no/such")


if __name__ == "__main__":
    unittest.main()
