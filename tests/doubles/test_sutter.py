"""The doubles of the Sutter controllers against what acq4 and navigate exchange with them.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from sutter_mp285 import SutterMp285
from sutter_mpc200 import SutterMpc200


class Line:
    def __init__(self, double):
        self.double = double
        self.now = 0.0

    def say(self, data=b""):
        self.double.receive(data, self.now)
        return b"".join(each[1] for each in self.double.say(self.now))

    def wait(self, seconds):
        self.now += seconds
        return self.say()


class Mp285Test(unittest.TestCase):
    def setUp(self):
        self.stage = SutterMp285()
        self.line = Line(self.stage)
        self.assertEqual(self.line.say(b"V" + struct.pack("<H", 777 | 0x8000) + b"\r"), b"\r")  # acq4: 777, fine

    def position(self):
        self.line.now += 0.01
        reply = self.line.say(b"c\r")
        self.assertEqual((len(reply), reply[-1:]), (13, b"\r"))
        return struct.unpack("<3i", reply[:12])

    def test_nothing_is_answered_before_the_velocity(self):
        line = Line(SutterMp285())
        self.assertEqual(line.say(b"c\r"), b"")
        self.assertEqual(line.say(b"V\x09\x83\r"), b"\r")
        self.assertEqual(len(line.say(b"c\r")), 13)

    def test_status_has_the_fields_of_acq4(self):
        reply = self.line.say(b"s\r")
        self.assertEqual((len(reply), reply[-1:]), (33, b"\r"))
        fields = struct.unpack("=4B5H2B8H", reply[:32])
        self.assertEqual(fields[15], 25)  # step_div
        self.assertEqual(fields[17], 777 | 0x8000)  # xspeed
        self.assertEqual(fields[0] & 0x20, 0x20)  # absolute

    def test_the_reply_to_a_move_comes_after_the_move(self):
        self.assertEqual(self.line.say(b"m" + struct.pack("<3i", 777 * 25, 0, -100) + b"\r"), b"")
        self.assertEqual(self.line.wait(0.999), b"")
        self.assertEqual(self.line.wait(0.001), b"\r")
        self.assertEqual(self.position(), (777 * 25, 0, -100))

    def test_data_may_contain_a_carriage_return(self):
        self.line.say(b"m" + struct.pack("<3i", 13, 0x0D0D, 0) + b"\r")
        self.line.wait(10.0)
        self.assertEqual(self.position(), (13, 0x0D0D, 0))

    def test_an_interrupt_of_a_move_is_answered_by_two_bytes(self):
        # navigate: '=' and the task-complete indicator; one byte if movement is not in progress
        self.line.say(b"m" + struct.pack("<3i", 25000, 0, 0) + b"\r")
        self.line.wait(0.5)
        self.assertEqual(self.line.say(b"\x03"), b"=\r")
        self.assertEqual(self.line.wait(10.0), b"")
        self.assertAlmostEqual(self.position()[0], 0.5 * 777 * 25, delta=2)
        self.assertEqual(self.line.say(b"\x03"), b"\r")

    def test_any_other_byte_interrupts_a_move(self):
        self.line.say(b"m" + struct.pack("<3i", 25000, 0, 0) + b"\r")
        self.line.wait(0.5)
        self.assertEqual(self.line.say(b"c\r"), b"<\r")
        self.assertEqual(self.line.wait(10.0), b"")

    def test_relative_mode_and_origin(self):
        self.line.say(b"b\r")
        for _ in range(2):
            self.line.say(b"m" + struct.pack("<3i", 50, 0, 0) + b"\r")
            self.line.wait(1.0)
        self.assertEqual(self.position(), (100, 0, 0))
        self.line.say(b"o\r")
        self.assertEqual(self.position(), (0, 0, 0))
        self.line.say(b"a\r")
        self.line.say(b"m" + struct.pack("<3i", 10, 0, 0) + b"\r")
        self.line.wait(1.0)
        self.assertEqual(self.position(), (10, 0, 0))

    def test_errors_are_one_byte_and_a_carriage_return(self):
        self.assertEqual(self.line.say(b"x\r"), b"4\r")
        self.assertEqual(self.line.say(b"V\x01\r"), b"")  # its CR is the second byte of the word
        self.assertEqual(self.line.say(b"\r"), b"\r")
        self.assertEqual(self.line.say(b"cc\r"), b"4\r")
        self.assertEqual(self.line.say(b"c" * 33), b"2\r")

    def test_a_line_feed_behind_a_command_does_no_harm(self):
        self.assertEqual(self.line.say(b"n\r\n"), b"\r")
        self.assertEqual(self.line.say(b"n\r"), b"\r")

    def test_talking_while_the_rotary_control_turns_hangs_it(self):
        self.stage.arrange(0.0, roe_turning=True)
        self.assertEqual(self.line.say(b"c\r"), b"")
        self.stage.arrange(0.0, roe_turning=False)
        self.assertEqual(self.line.say(b"c\r"), b"")
        self.stage.power_cycle(1.0)
        self.line.now = 1.0
        self.assertEqual(self.line.say(b"V\x00\x04\r"), b"\r")

    def test_an_interrupt_while_an_answer_is_due_locks_it_up(self):
        self.stage.mode(late=2.0)
        self.line.say(b"c\r")
        self.line.wait(0.5)
        self.line.say(b"\x03")
        self.assertTrue(self.stage.hung)

    def test_a_reset_is_answered_by_junk(self):
        self.assertEqual(self.line.say(b"r\r"), b"\0")

    def test_low_resolution_is_faster(self):
        self.line.say(b"V" + struct.pack("<H", 3000) + b"\r")
        self.line.say(b"m" + struct.pack("<3i", 3000 * 25, 0, 0) + b"\r")
        self.assertEqual(self.line.wait(1.0), b"\r")

    def test_commands_without_a_pause_are_counted(self):
        self.line.now += 1.0
        self.line.say(b"n\r")
        self.line.say(b"n\r")
        self.assertEqual(self.stage.hurried, 1)


class Mpc200Test(unittest.TestCase):
    def setUp(self):
        self.device = SutterMpc200(drives="1,3")
        self.line = Line(self.device)

    def ask(self, data):
        self.line.now += 0.01
        return self.line.say(data)

    def test_questions_of_acq4(self):
        self.assertEqual(self.ask(b"U"), bytes([2, 1, 0, 1, 0]) + b"\r")
        self.assertEqual(self.ask(b"K"), bytes([1, 0x64, 0x02]) + b"\r")
        self.assertEqual(self.ask(b"I\x03"), b"\x03\r")
        self.assertEqual(self.ask(b"I\x02"), b"E\r")
        self.assertEqual(self.ask(b"C"), struct.pack("<B3i", 3, 200000, 200000, 200000) + b"\r")

    def test_a_fast_move_is_answered_at_its_end(self):
        self.assertEqual(self.ask(b"M" + struct.pack("<3i", 200000 + 4650 * 16, 200000, 200000)), b"")
        self.assertEqual(self.line.wait(0.99), b"")
        self.assertEqual(self.line.wait(0.02), b"\r")
        self.assertEqual(self.ask(b"C")[1:5], struct.pack("<i", 200000 + 4650 * 16))

    def test_a_move_below_16_microsteps_is_not_answered(self):
        self.assertEqual(self.ask(b"M" + struct.pack("<3i", 200015, 200000, 199985)), b"")
        self.assertEqual(self.line.wait(10.0), b"")
        self.assertEqual(self.device.unanswered, 1)

    def test_a_slow_move_in_one_write_crashes_it(self):
        self.ask(b"S" + struct.pack("<B3i", 5, 0, 0, 0))
        self.assertEqual(self.ask(b"K"), b"")
        self.assertTrue(self.device.hung)

    def test_a_slow_move_in_two_writes(self):
        self.ask(b"S")
        self.line.now += 0.03
        self.assertEqual(self.line.say(struct.pack("<B3i", 15, 200000 - 2767 * 16, 200000, 200000)), b"")
        self.assertEqual(self.line.wait(0.99), b"")
        self.assertEqual(self.line.wait(0.02), b"\r")

    def test_an_interrupted_move_marks_the_next_reply(self):
        self.ask(b"M" + struct.pack("<3i", 0, 200000, 200000))
        self.line.wait(0.5)
        self.assertEqual(self.line.say(b"\x03"), b"\r")
        reply = self.ask(b"C")
        self.assertEqual((reply[:1], len(reply)), (b"I", 15))
        self.assertEqual(len(self.ask(b"C")), 14)
        self.assertEqual(self.ask(b"\x03"), b"\r")


if __name__ == "__main__":
    unittest.main()
