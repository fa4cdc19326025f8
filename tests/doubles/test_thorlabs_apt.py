"""The double of a KDC101 against the bytes that thorlabs-apt-protocol, pyLabLib and the protocol's document print.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from double import Refused
from thorlabs_apt import ENABLED, HOMED, HOMING, MOTION_ERROR, MOVING_REVERSE, REVERSE_LIMIT, ThorlabsApt

COUNTS = 34304  # a millimetre


class Line:
    """A host that takes messages apart as pyLabLib does."""

    def __init__(self, **options):
        self.unit = ThorlabsApt(**options)
        self.now = 0.0
        self.rest = b""

    def say(self, data=b"", seconds=0.0):
        if data:
            self.unit.receive(data, self.now)
        self.now += seconds
        self.rest += b"".join(each[1] for each in self.unit.say(self.now))
        messages = []
        while len(self.rest) >= 6:
            number, length, target, _ = struct.unpack_from("<HHBB", self.rest)
            size = 6 + (length if target & 0x80 else 0)
            if len(self.rest) < size:
                break
            messages.append((number, self.rest[6:size] if target & 0x80 else self.rest[2:4]))
            self.rest = self.rest[size:]
        return messages

    def short(self, number, one=0, two=0, seconds=0.0):
        return self.say(struct.pack("<HBBBB", number, one, two, 0x50, 1), seconds)

    def long(self, number, form, *values, seconds=0.0):
        data = struct.pack(form, *values)
        return self.say(struct.pack("<HHBB", number, len(data), 0xD0, 1) + data, seconds)

    def position(self):
        ((number, data),) = self.short(0x0411, 1)
        assert number == 0x0412
        return struct.unpack("<Hi", data)[1]

    def status(self):
        ((_, data),) = self.short(0x0429, 1)
        return struct.unpack("<HI", data)[1]

    def home(self):
        return self.short(0x0443, 1, seconds=60.0)


class ThorlabsAptTest(unittest.TestCase):
    def test_the_examples_of_the_readme_in_bytes(self):
        line = Line()
        self.assertEqual(line.say(b"C\x04\x01\x00P\x01"), [])  # home: no answer before it is there
        self.assertEqual(line.say(seconds=60.0), [(0x0444, b"\x01\x00")])
        self.assertEqual(line.say(b"S\x04\x06\x00\xd0\x01\x01\x00\x00\x08\x00\x00"), [])  # to 2048
        ((number, data),) = line.say(seconds=5.0)
        self.assertEqual((number, len(data), struct.unpack_from("<Hi", data)), (0x0464, 14, (1, 2048)))

    def test_info_has_serial_model_firmware_and_stage(self):
        ((number, data),) = Line().short(0x0005)
        self.assertEqual((number, len(data)), (0x0006, 84))
        self.assertEqual(struct.unpack_from("<I", data)[0], 27250001)
        self.assertEqual(data[4:12].rstrip(b"\0"), b"KDC101")
        self.assertEqual(data[14:17][::-1], b"\x01\x02\x03")
        self.assertEqual(struct.unpack_from("<H", data, 76)[0], 7)  # pyLabLib: MTS25-Z8
        self.assertEqual(struct.unpack_from("<HHH", data, 78)[2], 1)

    def test_an_answer_is_addressed_to_the_host(self):
        unit = ThorlabsApt()
        unit.receive(b"\x11\x04\x01\x00\x50\x01", 0.0)
        self.assertEqual(unit.say(0.0)[0][1], b"\x12\x04\x06\x00\x81\x50\x01\x00\x00\x00\x00\x00")

    def test_the_counter_is_zero_before_homing_and_the_rail_is_not(self):
        line = Line()
        self.assertEqual(line.position(), 0)
        self.assertGreater(line.unit.rail, 1000)
        self.assertFalse(line.status() & HOMED)
        self.assertEqual(line.home(), [(0x0444, b"\x01\x00")])
        self.assertTrue(line.status() & HOMED)
        self.assertEqual((line.position(), line.unit.rail), (0, 0.0))

    def test_homing_takes_its_time_and_says_so(self):
        line = Line()
        line.short(0x0443, 1, seconds=1.0)
        self.assertEqual(line.status() & (HOMING | MOVING_REVERSE | HOMED), HOMING | MOVING_REVERSE)
        self.assertEqual(line.say(seconds=5.0), [])
        # 10 mm at 1 mm/s
        self.assertEqual([each[0] for each in line.say(seconds=6.0)], [0x0444])

    def test_a_move_takes_the_time_of_its_velocity(self):
        line = Line()
        line.home()
        velocity = round(1.0 * COUNTS * 2048 / 6e6 * 65536)  # 1 mm/s
        acceleration = round(100.0 * COUNTS * (2048 / 6e6) ** 2 * 65536)
        line.long(0x0413, "<H3i", 1, 0, acceleration, velocity)
        self.assertEqual(struct.unpack("<H3i", line.short(0x0414, 1)[0][1])[1:], (0, acceleration, velocity))
        self.assertEqual(line.long(0x0453, "<Hi", 1, 5 * COUNTS, seconds=2.5), [])
        self.assertAlmostEqual(line.position() / COUNTS, 2.5, delta=0.02)
        self.assertEqual([each[0] for each in line.say(seconds=2.6)], [0x0464])
        self.assertEqual(line.position(), 5 * COUNTS)

    def test_a_relative_move_and_one_of_nothing(self):
        line = Line()
        line.home()
        line.long(0x0448, "<Hi", 1, 1000, seconds=5.0)
        self.assertEqual(line.position(), 1000)
        self.assertEqual([each[0] for each in line.long(0x0453, "<Hi", 1, 1000)], [0x0464])

    def test_both_stops(self):
        for mode in (1, 2):
            line = Line()
            line.home()
            line.long(0x0453, "<Hi", 1, 20 * COUNTS, seconds=2.0)
            at = line.position()
            told = line.short(0x0465, 1, mode)
            self.assertEqual([each[0] for each in told], [0x0466] if mode == 1 else [])
            told += line.say(seconds=5.0)
            self.assertEqual([each[0] for each in told], [0x0466])
            way = line.position() - at
            self.assertEqual(way > 0, mode == 2)
            self.assertFalse(line.status() & 0xF0)

    def test_updates_come_ten_times_a_second_and_end_without_a_sign_of_life(self):
        line = Line()
        line.short(0x0011)
        told = line.say(seconds=1.05)
        self.assertEqual([each[0] for each in told], [0x0491] * 10)
        told = line.say(seconds=9.0)
        self.assertEqual(len(told), 40)
        self.assertTrue(line.unit.silenced)
        line.short(0x0492)
        self.assertEqual(len(line.say(seconds=1.0)), 10)
        line.short(0x0012)
        self.assertEqual(line.say(seconds=2.0), [])
        patient = Line(alive=False)
        patient.short(0x0011)
        self.assertEqual(len(patient.say(seconds=9.95)), 99)

    def test_an_update_meets_an_answer(self):
        line = Line()
        line.home()
        line.short(0x0011)
        told = line.long(0x0453, "<Hi", 1, 2 * COUNTS, seconds=4.05)
        numbers = [each[0] for each in told]
        end = numbers.index(0x0464)
        self.assertEqual((numbers.count(0x0464), numbers.count(0x0491)), (1, 40))
        self.assertGreater(end, 5)
        places = [struct.unpack_from("<Hi", data)[1] for number, data in told if number == 0x0491]
        self.assertEqual(places, sorted(places))
        self.assertEqual(places[end], 2 * COUNTS)

    def test_end_messages_are_suspended(self):
        line = Line()
        line.home()
        line.short(0x046B)
        self.assertEqual(line.long(0x0453, "<Hi", 1, 1000, seconds=5.0), [])
        line.short(0x046C)
        self.assertEqual([each[0] for each in line.long(0x0453, "<Hi", 1, 0, seconds=5.0)], [0x0464])

    def test_a_channel_that_is_off_does_not_move(self):
        line = Line()
        line.home()
        line.short(0x0210, 1, 2)
        self.assertEqual(line.short(0x0211, 1), [(0x0212, b"\x01\x02")])
        self.assertFalse(line.status() & ENABLED)
        self.assertEqual(line.long(0x0453, "<Hi", 1, 1000, seconds=5.0), [])
        self.assertEqual(line.position(), 0)
        line.short(0x0210, 1, 1)
        self.assertEqual([each[0] for each in line.long(0x0453, "<Hi", 1, 1000, seconds=5.0)], [0x0464])

    def test_a_switch_ends_a_move_short_of_its_target(self):
        for option, number in (("stopped", [0x0466]), ("completed", [0x0464]), ("nothing", [])):
            line = Line(at_limit=option)
            line.home()
            told = line.long(0x0453, "<Hi", 1, -COUNTS, seconds=10.0)
            self.assertEqual([each[0] for each in told], number)
            self.assertEqual(line.position(), 0)
            self.assertTrue(line.status() & REVERSE_LIMIT)
        self.assertTrue(Line.status(self._swapped()) & 1)

    @staticmethod
    def _swapped():
        line = Line(swapped=True)
        line.home()
        line.long(0x0453, "<Hi", 1, -COUNTS, seconds=10.0)
        return line

    def test_soft_limits_hold(self):
        line = Line()
        line.home()
        line.long(0x0423, "<3H2iH", 1, 1, 1, 3 * COUNTS, COUNTS, 2)
        line.long(0x0453, "<Hi", 1, 10 * COUNTS, seconds=20.0)
        self.assertEqual(line.position(), 3 * COUNTS)
        self.assertTrue(line.status() & 0x4)

    def test_a_carriage_that_is_held_does_not_arrive(self):
        line = Line()
        line.home()
        line.unit.arrange(line.now, slipping=True)
        self.assertEqual(line.long(0x0453, "<Hi", 1, COUNTS, seconds=20.0), [])
        self.assertTrue(line.status() & MOTION_ERROR)

    def test_what_is_not_for_it_or_not_known_is_met_with_silence(self):
        line = Line()
        self.assertEqual(line.say(b"\x11\x04\x01\x00\x21\x01"), [])  # another unit
        self.assertEqual(line.short(0x0411, 2), [])  # another channel
        self.assertEqual(line.short(0x0999, 1), [])
        self.assertEqual(line.long(0x0453, "<Hh", 1, 5), [])  # too short
        self.assertEqual(line.unit.ignored, 4)
        self.assertEqual(line.position(), 0)

    def test_a_less_strict_one_takes_a_message_that_is_too_long(self):
        for strict, numbers in ((True, []), (False, [0x0464])):
            line = Line(strict=strict)
            line.home()
            told = line.long(0x0453, "<Hi2x", 1, 1000, seconds=5.0)
            self.assertEqual([each[0] for each in told], numbers)

    def test_it_forgets_its_place_without_power(self):
        line = Line()
        line.home()
        line.long(0x0453, "<Hi", 1, COUNTS, seconds=5.0)
        line.unit.power_cycle(line.now)
        self.assertEqual((line.position(), line.unit.rail), (0, COUNTS))
        self.assertFalse(line.status() & HOMED)

    def test_answers_in_pieces_late_and_among_others(self):
        line = Line(pieces=5, gap=0.01, late=0.2, chatty=True)
        self.assertEqual(line.short(0x0411, 1), [])
        self.assertEqual(line.say(seconds=0.19), [])
        self.assertEqual([each[0] for each in line.say(seconds=0.5)], [0x0491, 0x0080, 0x0412])

    def test_an_unknown_stage_is_refused(self):
        with self.assertRaises(Refused):
            ThorlabsApt(stage="Z9999")


if __name__ == "__main__":
    unittest.main()
