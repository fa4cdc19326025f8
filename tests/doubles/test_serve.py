"""The server: a double on a pseudo-terminal, a port and a socket, asked and told by JSON.

SPDX-License-Identifier: Apache-2.0
"""

import json
import os
import pathlib
import select
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import time
import unittest

import serve
from double import ByteDouble

SERVER = pathlib.Path(__file__).resolve().parent / "serve.py"
PATIENCE = 20.0  # seconds; only a broken server needs them


class Served:
    """A running server."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen([sys.executable, str(SERVER), *arguments], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.where = self.process.stdout.readline().strip()

    def order(self, **order):
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        self.code = self.process.wait(PATIENCE)


def read_until(descriptor, end):
    data, until = b"", time.monotonic() + PATIENCE
    while not data.endswith(end) and time.monotonic() < until:
        if select.select([descriptor], [], [], 0.1)[0]:
            data += os.read(descriptor, 4096)
    return data


def receive_exactly(link, count):
    data = b""
    while len(data) < count:
        data += link.recv(count - len(data))
    return data


def exchange(link, frame):
    link.sendall(struct.pack("<I", len(frame)) + frame)
    return next_frame(link)


def next_frame(link):
    (size,) = struct.unpack("<I", receive_exactly(link, 4))
    return receive_exactly(link, size)


class ServeTest(unittest.TestCase):
    def test_a_pseudo_terminal_carries_bytes_both_ways(self):
        with Served("kepco_bop", "--pty") as served:
            line = os.open(served.where, os.O_RDWR | os.O_NOCTTY)
            try:
                os.write(line, b"*IDN?\n")
                self.assertEqual(read_until(line, b"\x11"), b"\x13KEPCO,BOP1KW 50-20 ,E156884, 2.01\r\n\x11")
            finally:
                os.close(line)
        self.assertEqual(served.code, 0)

    def test_serial_instruments_answer_on_a_terminal(self):
        for instrument, options, asked, told in (
                ("thorlabs_apt", [], b"\x11\x04\x01\x00\x50\x01", b"\x12\x04\x06\x00\x81\x50\x01\x00\x00\x00\x00\x00"),
                ("new_era", ["alarm_at_power_up=0"], b"VER\r", b"\x0200SNE1000V3.928\x03"),
                ("harvard_pump11", [], b"00VER\r", b"\r\n    11 1.0\r\n00:"),
                ("newport_conex", [], b"1TS\r\n", b"1TS00000A\r\n"),
                ("lakeshore_monitor", ["pieces=5"], b"KRDG? 1\r\n", b"+295.00\r\n"),
                ("scpi_probe", ["model=475"], b"UNIT?\n", b"1\r\n"),
                ("firmata", ["boot=0.01"], b"", b"o\x00\xf7")):
            arguments = [each for option in options for each in ("--option", option)]
            with Served(instrument, "--pty", *arguments) as served:
                line = os.open(served.where, os.O_RDWR | os.O_NOCTTY)
                try:
                    os.write(line, asked)
                    self.assertTrue(read_until(line, told).endswith(told), instrument)
                finally:
                    os.close(line)

    def test_a_port_and_the_orders(self):
        with Served("kepco_bop", "--tcp", "0", "--option", "link=lan", "--option", "amperes=5") as served:
            host, port = served.where.split(":")
            with socket.create_connection((host, int(port)), PATIENCE) as link:
                self.assertEqual(served.order(set={"load_ohm": 4.0}), {"ok": True})
                link.sendall(b"FUNC:MODE CURR;:CURR 2\nMEAS:VOLT?\n")
                self.assertEqual(receive_exactly(link, 5), b"8E0\r\n")
                self.assertEqual(served.order(get="current"), {"current": 2.0})
                self.assertEqual(served.order(get="state")["func_mode"], "CURR")
                changes = served.order(history=True)["history"]
                self.assertIn(["current_set", 2.0], [each[1:] for each in changes])
                self.assertEqual(served.order(power_cycle=True), {"ok": True})
                self.assertEqual(served.order(get="current_set"), {"current_set": 0.0})
                self.assertIn("error", served.order(set={"nothing": 1}))
                self.assertIn("error", served.order(mode={"nothing": 1}))
                self.assertEqual(served.order(mode={"late": 0.2}), {"ok": True})
                begun = time.monotonic()
                link.sendall(b"CURR?\n")
                receive_exactly(link, 5)
                self.assertGreaterEqual(time.monotonic() - begun, 0.2)
                self.assertEqual(served.order(unplug=True), {"ok": True})
                self.assertEqual(link.recv(1), b"")
            with self.assertRaises(OSError):
                socket.create_connection((host, int(port)), PATIENCE)
            self.assertEqual(served.order(plug=True), {"link": served.where})
            socket.create_connection((host, int(port)), PATIENCE).close()

    def test_a_slow_line_takes_its_time(self):
        with Served("kepco_bop", "--pty", "--baud", "1200") as served:
            line = os.open(served.where, os.O_RDWR | os.O_NOCTTY)
            try:
                begun = time.monotonic()
                os.write(line, b"OUTP?\n")
                read_until(line, b"\x11")
                # 6 bytes out and 5 back, 10 bits each, the XOFF while the reply is made up
                self.assertGreaterEqual(time.monotonic() - begun, 11 * 10 / 1200)
            finally:
                os.close(line)

    def test_a_terminal_that_is_pulled_gives_an_error(self):
        with Served("kepco_bop", "--pty") as served:
            line = os.open(served.where, os.O_RDWR | os.O_NOCTTY)
            try:
                termios.tcgetattr(line)
                served.order(unplug=True)
                self.assertEqual(os.read(line, 1), b"")  # kernel_guest.md: an unplugged tty reads 0
            finally:
                os.close(line)

    def test_hid_reports_go_through_the_socket(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "hid")
            with Served("usb3103", "--socket", path) as served, socket.socket(socket.AF_UNIX) as link:
                self.assertEqual(served.where, path)
                link.settimeout(PATIENCE)
                link.connect(path)
                self.assertEqual(exchange(link, b"O\x44"), b"A" + struct.pack("<i", -22))
                self.assertEqual(exchange(link, b"O\x44\x00"), b"A" + struct.pack("<i", 2))
                self.assertEqual(next_frame(link), b"I\x44\x01")
                self.assertEqual(exchange(link, b"G\x01"), b"A" + struct.pack("<i", -32))
                self.assertEqual(exchange(link, b"C\x01"), b"A" + struct.pack("<i", -22))
                self.assertEqual(served.order(unplug=True), {"ok": True})
                self.assertEqual(link.recv(1), b"")
                self.assertFalse(os.path.exists(path))
                self.assertEqual(served.order(plug=True), {"link": path})
                with socket.socket(socket.AF_UNIX) as again:
                    again.settimeout(PATIENCE)
                    again.connect(path)
                    self.assertEqual(exchange(again, b"O\x14\x08\0\0\0"), b"A" + struct.pack("<i", 5))

    def test_control_transfers_go_through_the_socket(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "usb")
            with Served("pololu_tic", "--socket", path) as served, socket.socket(socket.AF_UNIX) as link:
                link.settimeout(PATIENCE)
                link.connect(path)
                out = struct.pack("<BBHHH", 0x40, 0xEC, 0x1234, 0x0056, 0)
                self.assertEqual(exchange(link, b"C" + out), b"A" + struct.pack("<i", 0))
                read = struct.pack("<BBHHH", 0xC0, 0xA1, 0, 0x22, 4)
                self.assertEqual(exchange(link, b"C" + read), b"A" + struct.pack("<ii", 4, 0x561234))
                wrong = struct.pack("<BBHHH", 0x40, 0x77, 0, 0, 0)
                self.assertEqual(exchange(link, b"C" + wrong), b"A" + struct.pack("<i", -32))
                self.assertEqual(served.order(get="position"), {"position": 0x561234})

    def test_registers_and_images_go_through_the_socket(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "camera")
            arguments = ("iidc", "--socket", path, "--option", "pixels=0")
            with Served(*arguments) as served, socket.socket(socket.AF_UNIX) as link:
                link.settimeout(PATIENCE)
                link.connect(path)
                self.assertEqual(exchange(link, b"Q" + struct.pack("<I", 0x51C)), b"A" + struct.pack("<iI", 4, 0x89001FFF))
                self.assertEqual(exchange(link, b"W" + struct.pack("<II", 0x61C, 1 << 31)), b"A" + struct.pack("<i", 4))
                image = next_frame(link)
                self.assertEqual((image[:1], struct.unpack("<HH", image[13:17]), len(image)), (b"P", (1280, 1024), 18))
                self.assertEqual(served.order(get="exposures"), {"exposures": 1})

    def test_a_server_never_waits_for_what_is_past(self):
        # else it would spin: what is due at a time has to be done by a step at that time
        class NoLink:
            client = None

            def write(self, data):
                pass

        arranged = {"zaber": {"knobs": [1000.0]}, "spacemouse": {"deflection": [9] * 6}, "foot_pedal": {"left": True},
                    "game_pad": {"left_x": 1.0}}
        heard = {  # what sets them going
            "thorlabs_apt": b"\x11\0\0\0\x50\1\x43\4\1\0\x50\1", "newport_conex": b"1OR\r\n", "firmata": b"\xc0\1",
            "new_era": b"SAF1\rRAT5MM\rVOL.01\rRUN\r", "harvard_pump11": b"ULM600\rMLT10\rRUN\r",
            "temperature_controller": b"\1\3\0\0\0\2\xc4\x0b", "scpi_supply": b"VOLT 9;OUTP ON;:MEAS:VOLT?\n",
            "lakeshore_monitor": b"KRDG?\r\n",
        }
        for instrument in ("kepco_bop", "usb3103", "pololu_tic", "zaber", "sutter_mp285", "sutter_mpc200", "scpi_probe",
                           "foot_pedal", "spacemouse", "iidc", "game_pad", "metrolab_thm1176", *heard):
            double = serve.make(instrument, [])
            double.arrange(0.0, **arranged.get(instrument, {}))
            if isinstance(double, ByteDouble):
                # an MP-285 moves at the default, others shrug
                double.receive(heard.get(instrument, b"V\0\4\rm" + bytes(10) + b"\1\0\r"), 0.0)
                server = serve.ByteServer(double, NoLink(), 9600, lambda *_: None)
            else:
                server = serve.FrameServer(double, NoLink(), lambda *_: None)
            now = 0.0
            while now < 3.0:
                server.step(now, [])
                due = server.next()
                self.assertTrue(due is None or due > now, (instrument, now, due))
                now = min(3.0, due if due is not None else 3.0)

    def test_what_only_can_be_asked_for_cannot_be_set(self):
        with Served("sutter_mp285", "--pty") as served:
            self.assertIn("error", served.order(set={"position": [1, 2, 3]}))
            self.assertEqual(served.order(set={"rail": [1.0, 0.0, 0.0]}), {"ok": True})
            self.assertEqual(served.order(get="position"), {"position": [25, 0, 0]})

    def test_an_unknown_instrument_or_option_is_an_error_in_words(self):
        for arguments in (["nothing", "--pty"], ["kepco_bop", "--pty", "--option", "nothing=1"],
                          ["kepco_bop", "--socket", "nowhere"], ["kepco_bop", "--pty", "--option", "late=soon"]):
            done = subprocess.run([sys.executable, str(SERVER), *arguments], capture_output=True, text=True,
                                  stdin=subprocess.DEVNULL, timeout=PATIENCE)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertNotIn("Traceback", done.stderr)

    def test_the_log_has_both_sides(self):
        with tempfile.TemporaryDirectory() as folder:
            log = os.path.join(folder, "log")
            with Served("kepco_bop", "--tcp", "0", "--option", "link=lan", "--log", log) as served:
                host, port = served.where.split(":")
                with socket.create_connection((host, int(port)), PATIENCE) as link:
                    link.sendall(b"OUTP?\n")
                    receive_exactly(link, 3)
            with open(log, encoding="utf-8") as book:
                lines = [json.loads(each)[1:] for each in book]
            self.assertEqual(lines, [["host", b"OUTP?\n".hex(" ")], ["instrument", b"1\r\n".hex(" ")]])


if __name__ == "__main__":
    unittest.main()
