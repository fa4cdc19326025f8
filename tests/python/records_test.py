"""Records read by the package against what the program says of the same ones, to the bit.
SPDX-License-Identifier: Apache-2.0
"""

import csv
import decimal
import importlib.util
import math
import re
import sqlite3
import unittest
import zlib

import numpy as np
import support
import vitreo


class Records(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.record = support.recorded()
        cls.shown = support.program("show", cls.record.folder, "--json")

    def test_results_and_their_units_are_those_of_show(self):
        results = self.record.results
        self.assertEqual(set(results.index), set(self.shown["results"]))
        for name, value in self.shown["results"].items():
            self.assertEqual(results[name], value, name)
        self.assertEqual(results.attrs["units"], self.shown["result_units"])
        self.assertEqual(results.attrs["units"]["width"], "m", "stated in mm: the value is SI")
        self.assertEqual(results["width"], 3e-3)
        self.assertEqual((results["share"], results.attrs["units"]["share"]), (1 / 3, ""), "stated in %")

    def test_parameters_start_and_end_are_those_of_show(self):
        self.assertEqual(self.record.parameters, self.shown["parameters"])
        self.assertEqual(self.record.parameters["speed"], 0.3e-3)
        self.assertEqual({k: v for k, v in self.record.parameter_units.items() if v}, {k: v for k, v in self.shown["parameter_units"].items() if v})
        start = self.record.start
        for name in ("protocol", "title", "operator", "seed", "versions", "devices", "files", "time"):
            self.assertEqual(start[name], self.shown[name], name)
        self.assertEqual(start["seed"], 2**64 - 1)
        self.assertEqual(start["script"], support.ASKING)
        self.assertEqual(self.record.outcome, self.shown["outcome"])
        self.assertEqual(self.record.end["experiment_time"], self.shown["experiment_time"])
        self.assertEqual({name: len(self.record.stream(name)) for name in self.record.streams}, self.shown["samples"])
        self.assertEqual([(e.kind, e.text) for e in self.record.events.itertuples()], [(e["kind"], e["text"]) for e in self.shown["events"]])
        self.assertEqual(list(self.record.events.t_ns / 1e9), list(self.record.events.index))
        self.assertEqual(dict(self.record.modules.hash), self.shown["modules"])
        self.assertIn("done µ", list(self.record.events.text))

    def test_streams_are_those_of_the_csv_export_to_the_bit(self):
        for run in (self.record, support.servoed()):
            folder = support.copied(run, run.name, "exported")
            support.program("export", folder, "--csv", json_of=False)
            for name, info in run.streams.items():
                table = run.stream(name)
                self.assertEqual(table.attrs["source"], info["source"])
                with open(next(folder.glob(f"export/**/{name}.csv")), newline="", encoding="utf-8") as file:
                    head, *rows = csv.reader(file)
                self.assertEqual(len(rows), len(table), name)
                units = dict(re.fullmatch(r"(.*?)(?: \((.*)\))?", cell).groups("") for cell in head)
                expected = table.attrs["units"]
                self.assertEqual(units, {"t": "s", **{channel: expected[channel] for channel in table.columns[1:]}})
                self.assertEqual([decimal.Decimal(row[0]) * 10**9 for row in rows], list(table.t_ns))
                self.assertEqual([float(row[0]) for row in rows], list(table.index))
                for column, cells in zip(table.columns[1:], list(zip(*rows))[1:]):
                    for cell, value in zip(cells, table[column]):
                        self.assertTrue(math.isnan(value) if cell == "" else float(cell) == value, (name, column, cell, value))
        self.assertTrue(np.isnan(self.record.laps.odd[1::2]).all() and len(self.record.laps) == 8)
        self.assertEqual(self.record.laps.attrs["units"], {"t_ns": "ns", "lap": "1", "exposed": "s", "odd": "1"})
        self.assertIn("target_x", support.servoed().servo.columns)

    def test_a_stream_from_a_time_on_is_the_rest_of_the_whole(self):
        whole = self.record.laps
        rest = self.record.stream("laps", since=whole.index[3])
        self.assertTrue(rest.equals(whole.iloc[3:]))
        with self.assertRaisesRegex(AttributeError, "has no stream 'lapse'; it has .*laps"):
            self.record.lapse
        with self.assertRaisesRegex(vitreo.RecordError, re.escape(str(self.record.folder))):
            self.record.stream("lapse")

    def test_frames_have_the_crc_of_the_image_that_the_camera_gave(self):
        for camera, every in (("top_camera", 2), ("side_camera", 1)):
            frames = self.record.frames(camera)
            self.assertEqual(len(frames), self.shown["frames"][camera]["recorded"])
            self.assertGreater(len(frames), 3)
            self.assertEqual(set(np.diff(frames.table.number)), {every})
            for i, row in enumerate(frames.table.itertuples()):
                self.assertEqual(zlib.crc32(frames[i].tobytes()), row.crc32)
                self.assertEqual(frames[i].shape, (row.height_px, row.width_px))
                self.assertFalse(frames[i].flags.owndata, "mapped, not copied")
                self.assertFalse(frames[i].flags.writeable)
            self.assertTrue((np.asarray(frames[1:3])[1] == frames[2]).all())
            self.assertEqual(frames.table.index[1], frames.table.t_ns.iloc[1] / 1e9)
        self.assertEqual(self.record.cameras.loc["top_camera", "every"], 2)
        with self.assertRaisesRegex(vitreo.RecordError, "no frames of 'rear'; it has top_camera"):
            self.record.frames("rear")

    @unittest.skipUnless(importlib.util.find_spec("PIL"), "python3-pil is not there: frames are not compared with its reader's")
    def test_frames_are_those_that_pillow_reads_from_the_stack(self):
        from PIL import Image
        for run, camera in ((self.record, "top_camera"), (self.color(), "top_camera")):
            frames = run.frames(camera)
            with Image.open(run.folder / frames.table.file.iloc[0]) as stack:
                for i, frame in enumerate(frames):
                    stack.seek(i)
                    self.assertTrue((np.asarray(stack) == frame).all(), (camera, i))

    def color(self):
        if not hasattr(Records, "color_run"):
            Records.color_run = vitreo.start("hello_rig", {"frames": 2}, rig="color_eye", frames="top_camera", out=support.PLACE / "color",
                                             cwd=support.PLACE).wait(240)
        return Records.color_run

    def test_color_frames_are_red_first(self):
        frames = self.color().frames("top_camera")
        self.assertEqual((frames[0].shape[2], frames[0].dtype), (3, np.uint8))
        self.assertNotEqual(int(frames[0][..., 0].sum()), int(frames[0][..., 2].sum()))
        # The row's CRC is of the image in memory, blue first.
        for i, row in enumerate(frames.table.itertuples()):
            self.assertEqual(zlib.crc32(frames[i][..., ::-1].tobytes()), row.crc32)

    def test_frames_of_16_bits_are_little_endian(self):
        """No camera of the simulated rig has more than 8 bits: two pixels of a real frame are taken for one."""
        folder = support.copied(self.record, "deep")
        with sqlite3.connect(folder / "run.sqlite") as database:
            database.execute("UPDATE frame SET pixel_type=1, width_px=width_px/2")
        database.close()
        for gray, deep in zip(self.record.frames("top_camera"), vitreo.open_run(folder).frames("top_camera")):
            self.assertEqual((deep.dtype, deep.shape), (np.uint16, (gray.shape[0], gray.shape[1] // 2)))
            self.assertTrue((deep == gray[:, ::2] + 256 * gray[:, 1::2].astype(int)).all())

    def test_tables_plots_pictures_and_links(self):
        table, = self.record.tables
        self.assertEqual((table.attrs["title"], list(table.columns), table.values.tolist()), ("Laps", ["lap", "µm"], [["1", "2.5"], ["2", "-"]]))
        plot, = self.record.plots
        self.assertEqual((plot["y"], plot["series"][0]["y"]), ({"label": "way", "unit": "um"}, [0, 1e-6]))
        picture, = self.record.pictures
        self.assertEqual(picture.file.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        self.assertIn(f"pictures/{picture.file.name}", (self.record.folder / "SHA256SUMS").read_text())
        links = support.program("show", self.record.folder, "--links", "--json")
        self.assertGreater(len(self.record.links), 0)
        rows = links["links"] if isinstance(links, dict) else links
        self.assertEqual(len(self.record.links), len(rows))
        self.assertEqual(list(self.record.links.role), [row["role"] for row in rows])

    def test_the_manifest_names_what_changed_as_verify_does(self):
        self.assertEqual(self.record.verify(), [])
        folder = support.copied(self.record, "changed")
        with open(folder / "report.html", "a", encoding="utf-8") as report:
            report.write(" ")
        (folder / "summary.json").unlink()
        (folder / "added.txt").write_text("x")
        (folder / "export").mkdir()
        (folder / "export" / "laps.csv").write_text("x")
        (folder / "script" / "link").symlink_to("/etc/hostname")
        svg = next((folder / "plots").glob("*.svg"))
        svg.rename(support.PLACE / "outside.svg")
        svg.symlink_to(support.PLACE / "outside.svg")
        found = vitreo.open_run(folder).verify()
        linked, = [line for line in found if line.startswith(f"plots/{svg.name}: cannot be read: ")]
        found.remove(linked)
        self.assertEqual(sorted(found), ["added.txt: was not there when the run was closed", "report.html: has changed since the run was closed",
                                         "script/link: was not there when the run was closed", "summary.json: is missing"])

    def test_units_are_those_of_the_program(self):
        text = (support.ROOT / "host/text/units.cpp").read_text(encoding="utf-8")
        rows = re.findall(r'\{"([^"]+)", "([^"]*)", [^,]+, "an? ', text)
        self.assertGreater(len(rows), 80)
        for symbol, dimension in rows:
            self.assertEqual(vitreo.si_unit(symbol), dimension, symbol)
        self.assertEqual(set(vitreo.units.SI_UNIT) - {"degC"}, {symbol for symbol, _ in rows} - {"degC"})
        self.assertEqual([vitreo.si_unit(u) for u in ("µm", "°C", "°", "turns", "")], ["m", "K", "rad", "turns", ""])


if __name__ == "__main__":
    unittest.main()
