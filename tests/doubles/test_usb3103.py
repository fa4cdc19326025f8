"""The double of the USB-3103 against the reports that wjasper's programs exchange with the device.

SPDX-License-Identifier: Apache-2.0
"""

import errno
import math
import struct
import unittest

from one_shot import OneShot, width
from usb3103 import Usb3103


class Usb3103Test(unittest.TestCase):
    def setUp(self):
        self.device = Usb3103(host="libusb")

    def write(self, *report, now=0.0):
        return self.device.output(bytes(report), now)

    def read_memory(self, address, count):
        self.write(0x30, address & 0xFF, address >> 8, 0, count)
        return self.device.input(0.0)[1:1 + count]

    def volts_to_counts(self, volts):
        """volts_USB31XX for +-10 V, as C truncates."""
        return 0xFFFF if volts >= 10 else 0 if volts <= -10 else int(volts * 32768.0 / 10.0 + 32768)

    def set_volts(self, channel, volts, update=0):
        """usbAOut_USB31XX with the calibration read by usbAOutConfig_USB31XX."""
        slope, = struct.unpack("<f", self.read_memory(0x108 + 0x10 * channel, 4))
        offset, = struct.unpack("<f", self.read_memory(0x10C + 0x10 * channel, 4))
        value = min(max(int(slope * self.volts_to_counts(volts) + offset), 0), 0xFFFF)
        self.write(0x14, channel, value & 0xFF, value >> 8, update)

    def test_a_calibrated_channel_gives_the_voltage(self):
        for channel in range(8):
            self.write(0x1C, channel, 1)
            self.assertLess(abs(self.device.volts[channel]), 1e-3)
            for volts in (-9.5, -1.0, 0.0, 2.5, 9.5):
                self.set_volts(channel, volts)
                self.assertLess(abs(self.device.volts[channel] - volts), 2.2 * 20 / 65536)  # two truncations

    def test_an_uncalibrated_count_is_off(self):
        self.write(0x1C, 0, 1)
        self.write(0x14, 0, 0x00, 0x80, 0)
        self.assertGreater(abs(self.device.volts[0]), 5e-3)

    def test_latched_values_wait_for_the_sync(self):
        for channel in range(8):
            self.write(0x1C, channel, 1)
            self.set_volts(channel, 1.0, update=1)
        self.assertLess(max(map(abs, self.device.volts)), 1e-3)
        self.write(0x15)
        self.assertGreater(min(self.device.volts), 0.99)
        self.assertEqual(self.device.updates, 1)

    def test_a_slave_waits_for_its_pin(self):
        self.write(0x43, 1)
        self.write(0x44)
        self.assertEqual(self.device.input(0.0), b"\x44\x00")
        self.write(0x1C, 2, 1)
        self.set_volts(2, 3.0, update=1)
        self.write(0x15)
        self.assertLess(self.device.volts[2], 1e-3)
        self.device.arrange(0.0, sync_input=True)
        self.assertGreater(self.device.volts[2], 2.99)
        self.write(0x43, 0)
        self.write(0x44)
        self.assertEqual(self.device.input(0.0), b"\x44\x01")

    def test_hidraw_never_carries_one_byte(self):
        device = Usb3103()
        self.assertEqual(device.output(b"\x44", 0.0), -errno.EINVAL)
        self.assertIsNone(device.input(0.0))
        self.assertEqual(device.output(b"\x44\x00", 0.0), 2)
        self.assertEqual(device.input(0.0), b"\x44\x01")
        strict = Usb3103(padding=False)
        self.assertEqual(strict.output(b"\x44\x00", 0.0), 2)
        self.assertIsNone(strict.input(0.0))

    def test_what_is_out_of_range_changes_nothing(self):
        before = self.device.state(0.0)
        for report in ((0x14, 8, 0, 0x80, 0), (0x14, 0, 0, 0x80, 2), (0x14, 0, 0, 0x80), (0x1C, 0, 2), (0x1C, 9, 1),
                       (0x43, 7), (0x50, 0xAD), (0x51,), (0x53,) + (0x30,) * 8, (0x31, 0, 1, 4, 1, 2, 3, 4), (0x02, 8, 0)):
            self.write(*report)
        self.assertEqual(self.device.state(0.0), before)
        self.assertEqual(sum(each[1].startswith("refused") for each in self.device.history), 11)
        self.write(0x30, 0, 0, 0, 63)
        self.assertIsNone(self.device.input(0.0))

    def test_the_digital_port(self):
        self.device.arrange(0.0, port_wires=0xA5)
        self.write(0x03)
        self.assertEqual(self.device.input(0.0), b"\x03\xa5")
        self.write(0x02, 0, 0)
        self.write(0x06, 0, 0)
        self.write(0x03)
        self.assertEqual(self.device.input(0.0), b"\x03\xa4")
        self.write(0x01, 0)
        self.write(0x04, 0x0F)
        self.write(0x05, 3)
        self.assertEqual(self.device.input(0.0), b"\x05\x01")
        self.assertEqual(self.device.port_pins, 0x0F)

    def test_the_counter(self):
        self.device.arrange(0.0, counter=0x01020304)
        self.write(0x21)
        self.assertEqual(self.device.input(0.0), b"\x21\x04\x03\x02\x01")
        self.write(0x20)
        self.write(0x21)
        self.assertEqual(self.device.input(0.0), b"\x21\0\0\0\0")

    def test_user_memory_lasts_and_calibration_is_locked(self):
        self.write(0x31, 0x10, 0x00, 3, 7, 8, 9)
        self.device.power_cycle(1.0)
        self.assertEqual(self.read_memory(0x10, 3), bytes((7, 8, 9)))
        block = bytes(range(32))
        self.write(0x31, 0x00, 0x01, 32, *block)
        self.assertNotEqual(self.read_memory(0x100, 32), block)
        self.write(0x31, 0x00, 0x05, 2, 0xAA, 0x55)
        self.write(0x31, 0x00, 0x01, 32, *block)
        self.assertEqual(self.read_memory(0x100, 32), block)
        self.assertEqual(self.read_memory(0x120, 32), b"\xff" * 32)

    def test_an_erased_calibration_is_no_number(self):
        device = Usb3103(host="libusb", blank_calibration=True)
        device.output(bytes((0x30, 0x08, 0x01, 0, 4)), 0.0)
        self.assertTrue(math.isnan(struct.unpack("<f", device.input(0.0)[1:5])[0]))

    def test_a_memory_reply_has_63_bytes_and_padding_is_a_setting(self):
        self.write(0x30, 0, 1, 0, 4)
        self.assertEqual(len(self.device.input(0.0)), 63)
        self.device.mode(reply_size=64)
        self.write(0x44)
        self.assertEqual(self.device.input(0.0), b"\x44\x01" + bytes(62))

    def test_a_reset_takes_the_device_away(self):
        self.write(0x1C, 0, 1)
        self.set_volts(0, 5.0)
        self.assertEqual(self.write(0x41), 1)
        self.assertEqual(self.write(0x44, now=0.5), -errno.ENODEV)
        self.assertEqual(self.write(0x44, now=1.5), 1)
        self.assertEqual(self.device.ranges[0], 0)
        self.assertLess(self.device.volts[0], 1e-3)


class OneShotTest(unittest.TestCase):
    def test_a_pulse_is_k_r_c(self):
        self.assertAlmostEqual(width(180e3, 1e-6), 0.081)  # NX: 0.45 R C

    def test_each_rising_edge_prolongs_the_pulse(self):
        shot = OneShot(0.05)
        for k in range(10):
            shot.input(True, 0.02 * k)
            shot.input(False, 0.02 * k + 0.01)
            self.assertEqual(shot.advance(0.02 * k + 0.019), [])
            self.assertTrue(shot.closed)
        ((opened, closed),) = shot.advance(1.0)
        self.assertAlmostEqual(opened, 0.18 + 0.05)
        self.assertFalse(closed)
        self.assertEqual(shot.advance(2.0), [])

    def test_a_level_that_is_held_holds_nothing(self):
        for level in (True, False):
            shot = OneShot(0.05)
            shot.input(True, 0.0)
            shot.input(level, 0.01)
            self.assertEqual(shot.advance(10.0), [(0.05, False)])

    def test_edges_that_come_before_the_relay_has_closed_close_it(self):
        shot = OneShot(0.05, release=0.01, operate=0.06)
        self.assertEqual(shot.input(True, 0.0), [])
        shot.input(False, 0.01)
        self.assertEqual(shot.input(True, 0.04), [])
        self.assertEqual(shot.advance(0.07), [(0.06, True)])
        ((opened, _),) = shot.advance(1.0)
        self.assertAlmostEqual(opened, 0.04 + 0.05 + 0.01)

    def test_one_edge_closes_no_relay_that_is_slower_than_the_pulse(self):
        shot = OneShot(0.05, release=0.01, operate=0.06)
        shot.input(True, 0.0)
        self.assertEqual(shot.advance(1.0), [])
        self.assertIsNone(shot.next)


class HeartbeatTest(unittest.TestCase):
    """What hangs on digital line 2 of the device."""

    def setUp(self):
        self.device = Usb3103(host="libusb", one_shot=0.05, one_shot_line=2)
        self.device.output(bytes([0x02, 2, 0]), 0.0)  # WJ usbDConfigBit: output
        self.device.output(bytes([0x1C, 0, 1]), 0.0)
        self.device.output(bytes([0x14, 0, 0xFF, 0xFF, 0]), 0.0)

    def line(self, high, now):
        self.device.output(bytes([0x06, 2, int(high)]), now)

    def test_without_edges_nothing_is_driven(self):
        self.assertGreater(self.device.volts[0], 9)
        self.assertEqual(self.device.driven, 0)

    def test_a_heartbeat_drives_and_its_end_stops(self):
        for k in range(20):
            self.line(True, 0.02 * k)
            self.assertGreater(self.device.state(0.02 * k + 0.005)["driven"], 9)
            self.line(False, 0.02 * k + 0.01)
        self.assertEqual(self.device.edges, 20)
        self.assertGreater(self.device.state(0.38 + 0.049)["driven"], 9)
        self.assertEqual(self.device.state(0.38 + 0.051)["driven"], 0)
        self.assertAlmostEqual([each[0] for each in self.device.history if each[1] == "amplifiers"][-1], 0.43)

    def test_a_static_high_stops_too(self):
        self.line(True, 1.0)
        self.assertAlmostEqual(self.device.next(), 1.05)
        self.assertEqual(self.device.state(1.06)["driven"], 0)


if __name__ == "__main__":
    unittest.main()
