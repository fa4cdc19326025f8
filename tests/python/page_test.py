"""What the page of the live view shows is in the record, and scripts can read it while the run goes on.

The page's values are taken from the messages that it is sent (docs/live_view.md has the protocol), by a WebSocket client
written from RFC 6455.
SPDX-License-Identifier: Apache-2.0
"""

import base64
import json
import os
import re
import socket
import sqlite3
import struct
import subprocess
import unittest

import support

PAGE = """-- page: a servo with a pose sensor for four seconds, then everything that was recorded, read again.
local units = require "units"
local mm, s = units.mm, units.s
return {
  title = "What the page shows",
  needs = { "coils", "sample" },
  run = function(rig, p, run)
    rig.sample:insert_robot(vector(0, 0, 0))
    local servo <close> = rig:servo { feedback = "pose_sensor" }
    servo:hold(vector(0.3 * mm, 0, 0))
    run:wait(4 * s)
    for _, name in ipairs { "servo", "currents", "command", "coil_temperature" } do
      local samples = run:samples(name)
      for channel, values in pairs(samples) do
        run:note(("read %s.%s %d %.17g"):format(name, channel, #values, values[#values]))
      end
    end
  end,
}
"""


class Page:
    """A browser's connection: invited by the token, then the WebSocket /live."""

    def __init__(self, address):
        host, token = re.fullmatch(r"http://([^/]+)/\?token=(\S+)", address).groups()
        name, port = host.split(":")
        with socket.create_connection((name, int(port)), timeout=20) as visit:
            visit.sendall(f"GET /?token={token} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
            heard = b""
            while more := visit.recv(65536):
                heard += more
        cookie = re.search(rb"(vitreo=[^;]+);", heard)[1].decode()
        self.socket = socket.create_connection((name, int(port)), timeout=20)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\nCookie: {cookie}\r\n\r\n").encode())
        self.bytes = b""
        self._until(lambda: b"\r\n\r\n" in self.bytes)
        self.bytes = self.bytes.split(b"\r\n\r\n", 1)[1]

    def _until(self, there):
        while not there():
            more = self.socket.recv(1 << 16)
            if not more:
                raise EOFError
            self.bytes += more

    def _take(self, count):
        self._until(lambda: len(self.bytes) >= count)
        taken, self.bytes = self.bytes[:count], self.bytes[count:]
        return taken

    def messages(self):
        """The text messages, as JSON, until the server closes."""
        try:
            while True:
                first, second = self._take(2)
                size = second & 0x7F
                if size >= 126:
                    size = struct.unpack(">H" if size == 126 else ">Q", self._take(2 if size == 126 else 8))[0]
                payload = self._take(size)
                if first & 0x0F == 9:  # ping: a pong with the same payload, masked by zeros
                    self.socket.sendall(bytes([0x8A, 0x80 | len(payload), 0, 0, 0, 0]) + payload)
                elif first & 0x0F == 1:
                    yield json.loads(payload)
        except (EOFError, OSError):
            return


class WhatThePageShows(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        file = support.PLACE / "page.lua"
        file.write_text(PAGE, encoding="utf-8")
        # By run and not by view, which would stay for whoever wants the report.
        program = subprocess.Popen([os.environ["VITREO"], "run", file, "--view", "--real-time", "--out", support.PLACE / "page_runs", "--seed", "5"],
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True, cwd=support.PLACE)
        cls.shown = []
        for line in program.stdout:
            if found := re.search(r"http://\S+token=\S+", line):
                cls.shown = list(Page(found[0]).messages())
                break
        program.stdout.read()
        assert program.wait(60) == 0
        cls.folder = next((support.PLACE / "page_runs").iterdir())
        cls.database = sqlite3.connect(cls.folder / "run.sqlite")

    def rows(self, stream):
        """The channels by name, by t_ns; the page has t in s."""
        cursor = self.database.execute(f"SELECT * FROM sample_{stream} ORDER BY seq")
        names = [one[0] for one in cursor.description]
        return {row["t_ns"]: row for row in (dict(zip(names, values)) for values in cursor)}

    def test_every_number_of_every_stream_is_a_row_of_the_record(self):
        streams = set()
        for message in self.shown:
            for name, sent in message.get("streams", {}).items():
                streams.add(name)
                recorded = self.rows(name)
                for row in sent["rows"]:
                    self.assertIn(round(row[0] * 1e9), recorded, name)
                    for channel, value in zip(sent["channels"], row[1:]):
                        self.assertEqual(recorded[round(row[0] * 1e9)][channel], value, f"{name}.{channel} at {row[0]} s")
        self.assertLessEqual({"servo", "currents", "command", "coil_temperature"}, streams)

    def test_every_value_of_the_status_is_recorded_too(self):
        """The list of them: what is not a measured or commanded value is named here."""
        interface = {"phase", "tier", "waiting_for", "note", "text", "progress", "doing", "remaining", "control", "takes_targets", "viewers",
                     "question", "instruments"}  # an instrument's value is of its stream panel_ROLE, and read where a hand wants it
        servo, command = list(self.rows("servo").values()), list(self.rows("command").values())
        seen = set()
        for message in self.shown:
            for name, value in message.get("status", {}).items():
                if name in interface or value in (None, []):
                    continue
                seen.add(name)
                if name == "target_px":
                    self.assertIn(tuple(value), [(row["target_u_px"], row["target_v_px"]) for row in servo])
                elif name == "field":
                    fields = [tuple(row[f"field_{axis}"] for axis in "xyz") for row in command if row["field_x"] is not None]
                    shown = [value["tesla"] * part for part in value["direction"]]
                    near = min(max(abs(a - b) for a, b in zip(shown, field)) for field in fields)
                    self.assertLess(near, 1e-12, "T: the product of what is shown, rounded")
                elif name == "alarms":
                    texts = [text for (text,) in self.database.execute("SELECT text FROM event WHERE kind='alarm'")]
                    for alarm in value:
                        self.assertTrue(any(alarm["text"] in text for text in texts))
                else:
                    self.fail(f"status.{name} is shown and not known to be recorded")
        self.assertLessEqual({"target_px", "field"}, seen)

    def test_what_was_read_back_after_the_end_is_recorded(self):
        rests = [message["rest"] for message in self.shown if message.get("rest")]
        if not rests:
            self.skipTest("the page was closed before the end was sent")
        events = [(t, text) for t, text in self.database.execute("SELECT t_ns, text FROM event WHERE kind='coils'")]
        for rest in rests:
            self.assertIn((round(rest["t"] * 1e9), rest["text"]), events)

    def test_every_event_in_the_log_is_one_of_the_record(self):
        events = {(t, kind, text) for t, kind, text in self.database.execute("SELECT t_ns, kind, text FROM event")}
        lines = [(round(line["t"] * 1e9), line["kind"], line["text"]) for message in self.shown for line in message.get("lines", [])]
        self.assertTrue(lines)
        for line in lines:
            # A message to the terminal is shown beside: the page's own address, and notes, which are events.
            if line[1] != "message":
                self.assertIn(line, events)

    def test_the_limits_that_it_draws_are_in_the_rig_as_it_was_used(self):
        geometry = next(message["hello"]["geometry"] for message in self.shown if "hello" in message)
        rig = json.loads(self.database.execute("SELECT rig FROM run").fetchone()[0])["resolved"]
        self.assertEqual(geometry["current_limit"], rig["coils"]["current_limit"])
        self.assertEqual(geometry["retina"]["z"], rig["model"]["eye_in_world"][2])

    def test_a_script_reads_each_channel_by_run_samples(self):
        read = {}
        for (text,) in self.database.execute("SELECT text FROM event WHERE kind='note' AND text LIKE 'read %'"):
            _, name, count, last = text.split()
            read[name] = (int(count), float(last))
        for stream in ("servo", "currents", "command", "coil_temperature"):
            recorded = list(self.rows(stream).values())
            for channel in recorded[0]:
                if channel in ("seq", "t_ns"):
                    continue
                count, last = read.pop(f"{stream}.{channel}")
                self.assertLessEqual(count, len(recorded))
                value = recorded[count - 1][channel]
                self.assertTrue(last != last if value is None else last == value, f"{stream}.{channel}")
            read.pop(f"{stream}.time")
        self.assertEqual(read, {})

    def test_covariance_field_and_axis_agree_with_each_other(self):
        for row in self.rows("servo").values():
            if row["x"] is None:
                continue
            for axis in "xyz":
                self.assertAlmostEqual(row[f"cov_{axis}{axis}"], row[f"sigma_{axis}"] ** 2, delta=1e-9 * row[f"cov_{axis}{axis}"])
        for row in list(self.rows("command").values())[20:]:
            field = [row[f"field_{axis}"] for axis in "xyz"]
            size = sum(part * part for part in field) ** 0.5
            self.assertAlmostEqual(size, row["field_wanted"], delta=0.05 * row["field_wanted"], msg="within what limits and motion cost")
            self.assertAlmostEqual(sum(row[f"axis_{axis}"] ** 2 for axis in "xyz"), 1, delta=1e-12)


if __name__ == "__main__":
    unittest.main()
