"""The double of the USB-3103 against the reports that wjasper's programs exchange with the device.

SPDX-License-Identifier: Apache-2.0
"""

import errno
import math
import struct
import unittest

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


if __name__ == "__main__":
    unittest.main()
