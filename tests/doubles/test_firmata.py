"""The double of an Arduino with StandardFirmata against the protocol's document and the sketch.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from firmata import BOOT, Firmata, pairs

HELLO = b"\xf9\x02\x05\xf0\x79\x02\x05" + pairs("StandardFirmata.ino") + b"\xf7"


class Line:
    def __init__(self, **options):
        self.board = Firmata(**options)
        self.now = 0.0
        if "boot" not in options:
            self.hello = self.say(seconds=BOOT + 0.001)

    def say(self, data=b"", seconds=0.0):
        self.board.receive(data, self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.board.say(self.now))


class FirmataTest(unittest.TestCase):
    def test_it_says_hello_when_it_has_booted_and_hears_nothing_before(self):
        line = Line(boot=3.0)
        self.assertEqual(line.say(b"\xf9", seconds=2.9), b"")
        self.assertEqual(line.say(seconds=0.2), HELLO)
        self.assertEqual(line.say(b"\xf9"), b"\xf9\x02\x05")
        line.board.power_cycle(line.now)
        self.assertEqual(line.say(seconds=3.0), HELLO)

    def test_firmware_and_mapping(self):
        line = Line()
        self.assertEqual(line.hello, HELLO)
        self.assertEqual(line.say(b"\xf0\x79\xf7"), HELLO[3:])
        self.assertEqual(line.say(b"\xf0\x69\xf7"), b"\xf0\x6a" + b"\x7f" * 14 + bytes(range(6)) + b"\xf7")

    def test_capabilities_of_an_uno(self):
        told = Line().say(b"\xf0\x6b\xf7")
        pins = told[2:-1].split(b"\x7f")[:-1]
        self.assertEqual((told[:2], len(pins)), (b"\xf0\x6c", 20))
        self.assertEqual(pins[0], b"")
        self.assertEqual(pins[2], b"\x00\x01\x0b\x01\x01\x01\x04\x0e")
        self.assertEqual(pins[3], b"\x00\x01\x0b\x01\x01\x01\x03\x08\x04\x0e")
        self.assertEqual(pins[14], b"\x00\x01\x0b\x01\x01\x01\x02\x0a\x04\x0e")
        self.assertEqual(pins[18][-2:], b"\x06\x01")

    def test_an_analog_input_is_reported_at_the_sampling_interval(self):
        line = Line()
        line.board.arrange(line.now, volts=[2.5, 5.0, 0, 0, 0, 0])
        self.assertEqual(line.say(b"\xc0\x01"), b"\xe0\x00\x04")  # 512, at once
        told = line.say(seconds=1.0)
        self.assertIn(len(told) // 3, (52, 53))  # 19 ms
        line.say(b"\xf0\x7a\x64\x00\xf7")
        self.assertIn(len(line.say(seconds=1.0)) // 3, (9, 10, 11))
        self.assertEqual(line.board.interval_ms, 100)
        line.say(b"\xc1\x01")
        self.assertIn(b"\xe1\x7f\x07", line.say(seconds=0.2))
        line.say(b"\xc0\x00\xc1\x00")
        self.assertEqual(line.say(seconds=1.0), b"")

    def test_a_pin_that_is_written_by_port_and_by_number(self):
        line = Line()
        line.say(b"\xf4\x0d\x01\x91\x20\x00")  # pin 13 to output; port 1, bit 5
        self.assertIs(line.board.outputs[13], True)
        line.say(b"\xf5\x0d\x00")
        self.assertIs(line.board.outputs[13], False)
        line.say(b"\xf4\x0c\x00\xf5\x0c\x01")  # an input is not driven
        self.assertIsNone(line.board.outputs[12])
        self.assertEqual(line.say(b"\xf0\x6d\x0d\xf7"), b"\xf0\x6e\x0d\x01\x00\xf7")
        self.assertEqual([each[2] for each in line.board.history if each[1] == "pin"], [[13, True], [13, False]])

    def test_writing_a_port_leaves_other_modes_alone(self):
        line = Line()
        line.say(b"\xf4\x03\x03\xe3\x00\x01\x90\x7f\x01")  # pin 3 PWM, 128; all of port 0 high
        self.assertEqual(line.board.duties[3], 128)
        self.assertIsNone(line.board.outputs[3])
        self.assertEqual(line.board.outputs[2:8], [True, None, True, True, True, True])
        self.assertEqual(line.board.outputs[0], None)  # the serial line's
        line.say(b"\xf0\x6f\x03\x10\xf7")
        self.assertEqual(line.board.duties[3], 16)

    def test_inputs_are_reported_when_they_change(self):
        line = Line()
        self.assertEqual(line.say(b"\xf4\x02\x00\xf4\x07\x0b\xd0\x01"), b"\x90\x00\x00")
        levels = [False] * 20
        levels[2] = levels[7] = levels[4] = True
        line.board.arrange(line.now, levels=levels)
        self.assertEqual(line.say(), b"\x90\x04\x01")  # pin 4 is an output
        line.board.arrange(line.now, levels=levels)
        self.assertEqual(line.say(), b"")
        self.assertEqual(line.say(b"\xf0\x6d\x07\xf7"), b"\xf0\x6e\x07\x0b\x01\xf7")

    def test_what_it_does_not_know(self):
        line = Line()
        self.assertEqual(line.say(b"\xf4\x02\x63"), b"\xf0\x71" + pairs("Unknown pin mode") + b"\xf7")
        self.assertEqual(line.say(b"\xf0\x7c\xf7\xf0\x55\x01\xf7\xf0\xf7\x12"), b"")  # the interval cannot be asked: 2.8
        newer = Line(protocol="2.8")
        self.assertEqual(newer.say(b"\xf9\xf0\x7a\x00\x02\xf7\xf0\x7c\xf7"), b"\xf9\x02\x08\xf0\x7a\x00\x02\xf7")
        self.assertEqual(line.say(b"\xf0\x6d\x50\xf7"), b"\xf0\x6e\x50\xf7")
        self.assertEqual(line.say(b"\xf0" + b"\x01" * 70 + b"\xf7\xf9"), b"\xf9\x02\x05")
        self.assertEqual(line.board.overflows, 6)

    def test_a_command_within_a_command_begins_anew(self):
        line = Line()
        line.say(b"\xf4\x0d\x01")
        line.say(b"\xf5\x0d\xf5\x0d\x01")
        self.assertIs(line.board.outputs[13], True)

    def test_a_reset(self):
        line = Line()
        line.say(b"\xc0\x01\xd0\x01\xf4\x02\x00\xff")
        self.assertEqual(line.say(seconds=1.0), b"")
        self.assertEqual((line.board.modes[2], line.board.modes[14], line.board.resets), (1, 2, 1))

    def test_turning_a_pin_away_from_analog_ends_its_report(self):
        line = Line()
        line.say(b"\xc0\x01")
        line.say(b"\xf4\x0e\x01", seconds=0.0)
        self.assertEqual(line.say(seconds=1.0), b"")

    def test_noise_pieces_and_texts(self):
        line = Line(noise=2)
        line.board.arrange(line.now, volts=[2.5] * 6)
        line.say(b"\xc0\x01")
        told = line.say(seconds=1.0)
        values = {told[n + 1] | told[n + 2] << 7 for n in range(0, len(told), 3)}
        self.assertTrue(values <= set(range(510, 515)) and len(values) > 2, values)
        line = Line(boot=0.0, chatty=True, pieces=1, gap=0.001)
        line.say(seconds=1.0)
        told = line.say(b"\xf0\x69\xf7", seconds=1.0)
        self.assertTrue(told.startswith(b"\xf0\x71I\x00"))
        self.assertTrue(told.endswith(b"\x05\xf7"))


if __name__ == "__main__":
    unittest.main()
