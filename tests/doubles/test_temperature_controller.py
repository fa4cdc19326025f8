"""The doubles of Modbus controllers against the frames of the TC038D's manual and the rules of the standard.

SPDX-License-Identifier: Apache-2.0
"""

import os
import select
import socket
import struct
import time
import unittest

from double import Refused
from modbus import crc
from temperature_controller import TemperatureController
from test_serve import PATIENCE, Served, receive_exactly


class Line:
    def __init__(self, **options):
        self.oven = TemperatureController(**options)
        self.now = 0.0

    def raw(self, data=b"", seconds=0.05):
        self.oven.receive(data, self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.oven.say(self.now))

    def ask(self, body, unit=1, **more):
        frame = bytes([unit]) + body
        told = self.raw(frame + crc(frame), **more)
        if told:
            assert crc(told[:-2]) == told[-2:], told
        return told[1:-2]

    def read(self, address, count, function=3):
        told = self.ask(struct.pack(">BHH", function, address, count))
        if told[0] & 0x80:
            return -told[1]
        return list(struct.unpack(f">{count}h", told[2:]))


class Tc038dTest(unittest.TestCase):
    def test_the_frames_of_the_manual(self):
        line = Line()
        line.oven.arrange(0.0, temperature=100.0, ambient=100.0)
        self.assertEqual(line.raw(b"\x01\x03\x00\x00\x00\x02\xC4\x0B"), b"\x01\x03\x04\x00\x00\x03\xE8\xFA\x8D")
        self.assertEqual(line.raw(b"\x01\x10\x01\x06\x00\x02\x04\x00\x00\x01A\xbf\xb5"), b"\x01\x10\x01\x06\x00\x02\xa0\x35")
        self.assertEqual(line.oven.setpoint, 32.1)
        self.assertEqual(line.raw(b"\x01\x10\x01\x0A\x00\x04\x08\x00\x00\x03\xE8\xFF\xFF\xFC\x18\x8D\xE9"),
                         b"\x01\x10\x01\x0A\x00\x04\xE0\x34")
        self.assertEqual(line.raw(b"\x01\x08\x00\x00\x12\x34\xed\x7c"), b"\x01\x08\x00\x00\x12\x34\xed\x7c")
        line.raw(b"\x01\x10\x01\x06\x00\x02\x04\x00\x00\x00\x99" + crc(b"\x01\x10\x01\x06\x00\x02\x04\x00\x00\x00\x99"))
        self.assertEqual(line.raw(b"\x01\x03\x01\x06\x00\x02\x25\xf6"), b"\x01\x03\x04\x00\x00\x00\x99:Y")

    def test_exceptions(self):
        line = Line()
        self.assertEqual(line.ask(b"\x03\x02\x00\x00\x02"), b"\x83\x02")
        self.assertEqual(line.raw(b"\x01\x03\x02\x00\x00\x02" + crc(b"\x01\x03\x02\x00\x00\x02")), b"\x01\x83\x02\xc0\xf1")
        self.assertEqual(line.ask(b"\x01\x00\x00\x00\x02"), b"\x81\x01")
        self.assertEqual(line.ask(b"\x04\x00\x00\x00\x02"), b"\x84\x01")
        self.assertEqual(line.ask(b"\x03\x00\x00\x00\x00"), b"\x83\x03")
        self.assertEqual(line.ask(b"\x03\x00\x00\x00\x01"), b"\x83\x03")  # half a value
        self.assertEqual(Line(strict=False).ask(b"\x03\x00\x01\x00\x01"), b"\x03\x02\x00\xdc")
        self.assertEqual(line.ask(b"\x10\x00\x00\x00\x02\x04\x00\x00\x00\x01"), b"\x90\x02")  # the temperature
        self.assertEqual(line.ask(b"\x10\x01\x06\x00\x02\x04\x00\x0f\x00\x00"), b"\x90\x03")
        self.assertEqual(line.ask(b"\x10\x01\x06\x00\x02\x05\x00\x00\x00\x01\x00"), b"\x90\x03")

    def test_silence_ends_a_frame(self):
        frame = b"\x01\x03\x00\x00\x00\x02\xC4\x0B"
        line = Line(work=0.0)
        self.assertEqual(line.raw(frame, seconds=0.0039), b"")  # 3.5 characters at 9600 baud: 4.01 ms
        self.assertEqual(len(line.raw(seconds=0.0002)), 9)
        line = Line(work=0.0, baud=115200)
        self.assertEqual(line.raw(frame, seconds=0.0017), b"")
        self.assertEqual(len(line.raw(seconds=0.0001)), 9)

    def test_two_frames_without_silence_are_none(self):
        frame = b"\x01\x03\x00\x00\x00\x02\xC4\x0B"
        line = Line()
        self.assertEqual(line.raw(frame + frame), b"")
        self.assertEqual(line.oven.dropped, 1)

    def test_a_gap_within_a_frame_spoils_it(self):
        frame = b"\x01\x03\x00\x00\x00\x02\xC4\x0B"
        for strict, size in ((True, 0), (False, 9)):
            line = Line(strict=strict)
            line.raw(frame[:4], seconds=0.003)  # 1.5 characters are 1.7 ms, 3.5 are 4.0
            self.assertEqual(len(line.raw(frame[4:])), size)
            self.assertEqual(len(line.raw(frame)), 9)  # the next one is whole
        line = Line()
        line.raw(frame[:4], seconds=0.01)
        self.assertEqual((line.raw(frame[4:]), line.oven.dropped), (b"", 2))

    def test_a_wrong_crc_another_unit_and_a_broadcast(self):
        line = Line()
        self.assertEqual(line.raw(b"\x01\x03\x00\x00\x00\x02\xC4\x0C"), b"")
        self.assertEqual(line.ask(b"\x03\x00\x00\x00\x02", unit=2), b"")
        self.assertEqual(line.ask(b"\x10\x01\x06\x00\x02\x04\x00\x00\x01\x00", unit=0), b"")
        self.assertEqual(line.oven.setpoint, 25.6)

    def test_it_heats_in_time(self):
        line = Line(tau=60.0)
        line.ask(b"\x10\x01\x06\x00\x02\x04\x00\x00\x03\xE8")
        line.raw(seconds=60.0)
        self.assertAlmostEqual(line.read(0, 2)[1] / 10, 100 - 78 / 2.71828, delta=0.2)
        line.raw(seconds=600.0)
        self.assertEqual(line.read(0, 2), [0, 1000])

    def test_a_late_answer_does_not_say_what_it_answers(self):
        line = Line(late=1.0)
        self.assertEqual(line.ask(b"\x03\x00\x00\x00\x02", seconds=0.5), b"")
        told = line.raw(b"\x01\x03\x01\x06\x00\x02\x25\xf6", seconds=0.6)
        self.assertEqual(told, b"\x01\x03\x04\x00\x00\x00\xdc" + crc(b"\x01\x03\x04\x00\x00\x00\xdc"))  # the first one's

    def test_an_echo_and_pieces(self):
        frame = b"\x01\x03\x00\x00\x00\x02\xC4\x0B"
        told = Line(chatty=True, pieces=3, gap=0.01).raw(frame, seconds=1.0)
        self.assertEqual((told[:9], told[9:12], len(told)), (frame + b"\0", b"\x01\x03\x04", 18))

    def test_an_unknown_model(self):
        with self.assertRaises(Refused):
            TemperatureController(model="toaster")


class Atr142Test(unittest.TestCase):
    def setUp(self):
        self.line = Line(model="atr142", unit=5)
        self.oven = self.line.oven

    def ask(self, body, **more):
        return self.line.ask(body, unit=5, **more)

    def words(self, address, count, function=3):
        told = self.ask(struct.pack(">BHH", function, address, count))
        return list(struct.unpack(f">{count}h", told[2:]))

    def test_process_value_and_set_point_in_tenths(self):
        self.assertEqual(self.words(1000, 2), [220, 0])
        self.assertEqual(self.words(1000, 1, function=4), [220])
        self.assertEqual(self.ask(b"\x06\x03\xE9\x01\xF4"), b"\x06\x03\xE9\x01\xF4")
        self.assertEqual((self.oven.setpoint, self.words(1007, 1)), (50.0, [500]))
        self.ask(b"\x06\x03\xE9\xFF\x9C")
        self.assertEqual(self.words(1001, 1), [-100])

    def test_refusals(self):
        self.assertEqual(self.ask(b"\x03\x03\xE8\x00\x15"), b"\x83\x03")  # 21 words
        self.assertEqual(self.ask(b"\x03\x00\x14\x00\x01"), b"\x83\x02")
        self.assertEqual(self.ask(b"\x06\x03\xE8\x00\x01"), b"\x86\x02")  # read only
        self.assertEqual(self.ask(b"\x08\x00\x00\x12\x34"), b"\x88\x01")
        self.assertEqual(self.ask(b"\x06\x03\xE9\x7F\xFF"), b"\x86\x03")

    def test_set_points_are_stored_after_ten_seconds_of_rest(self):
        for tenths in (300, 310, 320):
            self.ask(b"\x06\x03\xE9" + struct.pack(">H", tenths), seconds=9.0)
        self.assertEqual(self.oven.eeprom_writes, 0)
        self.oven.power_cycle(self.line.now)
        self.assertEqual(self.words(1001, 1), [0])
        self.ask(b"\x06\x03\xE9\x01\x40", seconds=10.1)
        self.assertEqual(self.oven.eeprom_writes, 1)
        self.oven.power_cycle(self.line.now)
        self.assertEqual(self.words(1001, 1), [320])

    def test_a_broken_sensor(self):
        self.oven.arrange(0.0, broken=True)
        self.assertEqual(self.words(1000, 1), [32767])
        self.assertEqual(self.words(1013, 1), [8])
        self.oven.mode(broken_reads="exception")
        self.assertEqual(self.ask(b"\x03\x03\xE8\x00\x01"), b"\x83\x04")

    def test_stop_lets_it_cool(self):
        self.oven.arrange(0.0, temperature=80.0)
        self.ask(b"\x06\x03\xE9\x03\x20")
        self.assertEqual(self.ask(b"\x06\x03\xF7\x00\x00", seconds=600.0), b"\x06\x03\xF7\x00\x00")
        self.assertEqual(self.words(1000, 1), [220])


class TcpTest(unittest.TestCase):
    READ = b"\x12\x34\x00\x00\x00\x06\x01\x03\x00\x00\x00\x02"

    def test_a_header_instead_of_a_crc(self):
        line = Line(wire="tcp")
        self.assertEqual(line.raw(self.READ), b"\x12\x34\x00\x00\x00\x07\x01\x03\x04\x00\x00\x00\xdc")
        self.assertEqual(line.raw(b"\x00\x01\x00\x00\x00\x06\x09\x03\x02\x00\x00\x02"), b"\x00\x01\x00\x00\x00\x03\x09\x83\x02")

    def test_frames_are_cut_by_their_length(self):
        line = Line(wire="tcp")
        told = b"".join(line.raw(bytes([each]), seconds=0.1) for each in self.READ)
        self.assertEqual(len(told), 13)
        self.assertEqual(len(line.raw(self.READ * 2)), 26)
        self.assertEqual(line.raw(b"\x00\x01\x00\x07\x00\x06\x01"), b"")
        self.assertEqual((line.oven.dropped, len(line.raw(self.READ))), (1, 13))

    def test_an_answer_to_another(self):
        told = Line(wire="tcp", chatty=True).raw(self.READ)
        self.assertEqual((told[:2], told[11:13]), (b"\x12\x33", b"\x12\x34"))


class ServedTest(unittest.TestCase):
    def test_on_a_terminal(self):
        with Served("temperature_controller", "--pty", "--baud", "9600") as served:
            line = os.open(served.where, os.O_RDWR | os.O_NOCTTY)
            try:
                os.write(line, b"\x01\x03\x00\x00\x00\x02\xC4\x0B")
                told, until = b"", time.monotonic() + PATIENCE
                while len(told) < 9 and time.monotonic() < until:
                    if select.select([line], [], [], 0.1)[0]:
                        told += os.read(line, 100)
                self.assertEqual(told, b"\x01\x03\x04\x00\x00\x00\xdc" + crc(b"\x01\x03\x04\x00\x00\x00\xdc"))
            finally:
                os.close(line)

    def test_on_a_port(self):
        with Served("temperature_controller", "--tcp", "0", "--option", "wire=tcp", "--option", "model=atr142") as served:
            host, port = served.where.split(":")
            with socket.create_connection((host, int(port)), PATIENCE) as link:
                link.sendall(b"\x00\x07\x00\x00\x00\x06\x01\x03\x03\xE8\x00\x01")
                self.assertEqual(receive_exactly(link, 11), b"\x00\x07\x00\x00\x00\x05\x01\x03\x02\x00\xdc")
                self.assertEqual(served.order(get="frames"), {"frames": 1})


if __name__ == "__main__":
    unittest.main()
