"""The double of the Tic against the examples and sentences of its user's guide.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from double import GONE, STALL
from pololu_tic import PololuTic


class Host:
    """libpololu-tic's calls, in a time of its own."""

    def __init__(self, **options):
        self.tic = PololuTic(**options)
        self.now = 0.0

    def command(self, code, number=0):
        return self.tic.control(0x40, code, number & 0xFFFF, number >> 16 & 0xFFFF, b"", self.now)

    def setting(self, offset, byte):
        return self.tic.control(0x40, 0x13, byte, offset, b"", self.now)

    def read(self, offset, length, code=0xA1):
        result, data = self.tic.control(0xC0, code, 0, offset, length, self.now)
        assert result == length == len(data)
        return data

    def wait(self, seconds, keep_alive=True):
        until = self.now + seconds
        while self.now < until - 1e-9:
            self.now = min(self.now + 0.1, until)
            if keep_alive:
                self.command(0x8C)
        return self

    @property
    def state(self):
        return self.read(0, 1)[0]

    @property
    def errors(self):
        return struct.unpack("<H", self.read(2, 2))[0]

    @property
    def flags(self):
        return self.read(1, 1)[0]

    @property
    def position(self):
        return struct.unpack("<i", self.read(0x22, 4))[0]

    @property
    def velocity(self):
        return struct.unpack("<i", self.read(0x26, 4))[0]

    def resume(self):
        self.command(0x85)
        self.command(0x83)
        self.wait(0.02)


class PololuTicTest(unittest.TestCase):
    def setUp(self):
        self.host = Host()
        self.tic = self.host.tic

    def test_examples_of_the_usb_encoding(self):
        # G 147, 148: set target position 1,234,567,890 = 40 E0 02D2 4996; it reads back; set setting step mode 1/8
        self.host.resume()
        self.assertEqual(self.tic.control(0x40, 0xE0, 0x02D2, 0x4996, b"", 0.02), 0)
        self.assertEqual(struct.unpack("<i", self.host.read(0x0A, 4))[0], 1234567890)
        self.assertEqual(self.tic.control(0x40, 0x13, 0x0003, 0x0041, b"", 0.02), 0)
        self.assertEqual(self.host.read(0x41, 1, 0xA8), b"\x03")
        self.assertEqual(self.host.read(0x49, 1), b"\x00")
        self.host.command(0x10)
        self.assertEqual(self.host.read(0x49, 1), b"\x03")

    def test_after_power_up_it_waits_in_safe_start(self):
        self.host.now = 0.5
        self.assertEqual((self.host.state, self.host.errors, self.host.flags), (4, 0x80, 0x02))
        self.host.now = 1.5
        self.assertEqual(self.host.errors, 0xC0)  # the command timeout is one second by default (G 71)

    def test_exit_safe_start_lasts_200_ms_only(self):
        self.host.command(0x86)
        self.host.command(0x83)
        self.host.now = 0.19
        self.assertEqual(self.host.errors, 0x01)
        self.host.now = 0.21
        self.host.command(0x85)
        self.assertEqual((self.host.state, self.host.errors), (4, 0x80))
        self.host.command(0x83)
        self.host.wait(0.3)
        self.assertEqual((self.host.state, self.host.errors, self.host.flags & 1), (10, 0, 1))

    def test_starting_up_takes_10_ms_after_the_driver_was_reset(self):
        self.host.command(0xB0)
        self.host.command(0x83)
        self.assertEqual(self.host.state, 8)
        self.host.now = 0.011
        self.assertEqual(self.host.state, 10)

    def test_a_trapezoid_is_as_long_as_it_should_be(self):
        # 2000000 per 10000 s = 200/s, 40000 per 100 s = 400/s^2: 0.5 s of acceleration over 50, then 200/s
        self.host.resume()
        self.host.command(0xEC, 0)
        self.host.command(0xE0, 1000)
        self.host.wait(0.5)
        self.assertAlmostEqual(self.host.position, 50, delta=2)
        self.assertEqual(self.host.velocity, 2000000)
        self.host.wait(5.0)
        self.assertEqual((self.host.position, self.host.velocity), (1000, 0))  # 5.5 s in all
        self.host.command(0xE0, -1000 & 0xFFFFFFFF)
        self.host.wait(11.0)
        self.assertEqual(self.host.position, -1000)
        self.assertEqual(self.host.flags, 1)

    def test_silence_stops_the_motor_and_reading_is_silence(self):
        self.host.resume()
        self.host.command(0xE3, 1000000)
        self.host.wait(0.9, keep_alive=False)
        self.assertEqual(self.host.velocity, 1000000)
        self.host.wait(0.2, keep_alive=False)
        self.assertEqual(self.host.errors, 0xC0)
        self.assertEqual(self.host.state, 4)
        self.host.wait(1.0, keep_alive=False)
        self.assertEqual(self.host.velocity, 0)
        self.assertEqual(self.host.flags & 3, 3)  # decelerate to hold: energized; uncertain since power-up

    def test_the_keep_alive_clears_the_timeout_but_not_safe_start(self):
        self.host.wait(2.0, keep_alive=False)
        self.assertEqual(self.host.errors, 0xC0)
        self.host.command(0x8C)
        self.assertEqual(self.host.errors, 0x80)

    def test_what_was_asked_before_an_error_is_obeyed_after_it(self):
        # G 75: input state and input after scaling do not get reset when an error happens
        self.host.resume()
        self.host.command(0xE3, 1000000)
        self.host.wait(3.0, keep_alive=False)
        self.assertEqual(self.host.velocity, 0)
        self.host.command(0x83)
        self.host.wait(1.0)
        self.assertEqual(self.host.velocity, 1000000)

    def test_halting_and_the_uncertain_flag(self):
        self.host.resume()
        self.host.command(0xEC, 77)
        self.assertEqual((self.host.position, self.host.flags), (77, 1))
        self.host.command(0xE3, 1000000)
        self.host.wait(0.5)
        self.host.command(0x89)
        self.assertEqual((self.host.velocity, self.host.flags, self.host.read(0x4C, 1)[0]), (0, 3, 2))
        self.host.command(0xEC, 0)
        self.host.command(0x86)
        self.assertEqual((self.host.state, self.host.flags, self.host.errors), (2, 2, 0x81))

    def test_the_four_answers_to_a_soft_error(self):
        for response, flags, planning in ((0, 2, 0), (1, 3, 0), (2, 1, 2), (3, 1, 1)):
            host = Host()
            host.setting(0x53, response)
            host.command(0x10)
            host.resume()
            host.command(0xEC, 0)
            host.command(0xE3, 1000000)
            host.wait(0.5)
            host.wait(1.1, keep_alive=False)
            self.assertEqual((host.flags, host.read(9, 1)[0]), (flags, planning), response)

    def test_homing_without_a_switch_runs_on(self):
        self.host.resume()
        self.host.command(0x97, 0)
        self.host.wait(60.0)
        self.assertLess(self.host.position, -5000)
        self.assertEqual(self.host.flags, 0x13)

    def test_homing_on_a_switch_makes_it_zero(self):
        self.tic.arrange(0.0, reverse_switch_at=-300.0)
        self.host.setting(0x60, 1)
        self.host.command(0x10)
        self.host.resume()
        self.host.command(0x97, 0)
        self.host.wait(0.5)
        self.assertEqual(self.host.flags, 0x13)
        self.host.wait(6.0)
        self.assertEqual((self.host.position, self.host.flags, self.host.velocity), (0, 1, 0))
        self.assertAlmostEqual(self.tic.carriage, -300.0, delta=2)
        self.host.command(0xE0, -50 & 0xFFFFFFFF)
        self.host.wait(2.0)
        self.assertGreater(self.host.position, -5)
        self.assertEqual(self.host.flags & 8, 8)

    def test_homing_needs_firmware_1_06(self):
        self.assertEqual(Host(firmware=0x0105).command(0x97, 0), STALL)

    def test_limits_of_speeds_and_accelerations(self):
        self.host.command(0xEA, 50)
        self.host.command(0xE9, 0)
        self.host.command(0xE6, 600000000)
        self.assertEqual(struct.unpack("<III", self.host.read(0x16, 12)), (500000000, 100, 100))

    def test_low_supply_and_driver_fault_reset_the_driver(self):
        self.host.resume()
        self.host.wait(0.3)  # the 200 ms of the exit command are over
        self.tic.arrange(self.host.now, vin_mv=3000)
        self.assertEqual((self.host.state, self.host.errors), (0, 0x84))
        self.tic.arrange(self.host.now, vin_mv=12000, driver_fault=True)
        self.assertEqual((self.host.state, self.host.errors), (0, 0x82))

    def test_errors_occurred_are_kept_until_read_and_cleared(self):
        self.host.resume()
        self.assertEqual(struct.unpack("<I", self.host.read(4, 4, 0xA2))[0], 0x80)
        self.assertEqual(struct.unpack("<I", self.host.read(4, 4))[0], 0)

    def test_what_it_does_not_know_is_stalled(self):
        self.assertEqual(self.host.command(0x77), STALL)
        self.assertEqual(self.tic.control(0xC0, 0xA1, 0, 0, 129, 0.0), (STALL, b""))
        self.assertEqual(self.tic.control(0xC0, 0x99, 0, 0, 1, 0.0), (STALL, b""))

    def test_descriptors(self):
        result, data = self.tic.control(0x80, 6, 0x0303, 0x0409, 255, 0.0)
        self.assertEqual(data[2:result].decode("utf-16-le"), "00123456")
        result, data = self.tic.control(0x80, 6, 0x0100, 0, 18, 0.0)
        self.assertEqual(struct.unpack("<HHH", data[8:14]), (0x1FFB, 0x00B3, 0x0109))

    def test_settings_last_and_motion_does_not(self):
        self.host.setting(0x09, 0xD0)
        self.host.setting(0x0A, 0x07)
        self.host.command(0xE6, 12345)
        self.tic.power_cycle(5.0)
        self.host.now = 5.0
        self.assertEqual(self.host.read(0x09, 2, 0xA8), b"\xd0\x07")
        self.assertEqual(struct.unpack("<I", self.host.read(0x16, 4))[0], 2000000)
        self.host.now = 6.5
        self.assertEqual(self.host.errors, 0x80)

    def test_the_bootloader_takes_it_off_the_bus(self):
        self.host.command(0xFF)
        self.assertEqual(self.host.command(0x8C), GONE)

    def test_everything_in_one_block(self):
        block = self.host.read(0, 0x55)
        self.assertEqual(struct.unpack_from("<H", block, 0x33)[0], 12000)


if __name__ == "__main__":
    unittest.main()
