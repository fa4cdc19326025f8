"""The doubles of pedals and space mice against their makers' reports and recorded packets.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from foot_pedal import FootPedal
from spacemouse import Spacemouse


def reports(double, now):
    told = []
    while (report := double.input(now)) is not None:
        told.append(report)
    return told


class FootPedalTest(unittest.TestCase):
    def test_the_old_x_keys_report_of_the_sdk(self):
        pedal = FootPedal(model="xkeys_0268")
        pedal.arrange(0.0, left=True)
        self.assertEqual(reports(pedal, 0.0), [b"\0\x02" + bytes(15) + b"\0\x10"])
        pedal.arrange(0.1, left=False, middle=True, right=True)
        self.assertEqual(reports(pedal, 0.1)[0][:2], b"\0\x0c")
        short = FootPedal(model="xkeys_0268", constant=False)
        short.arrange(0.0, left=True)
        self.assertEqual(reports(short, 0.0), [b"\x02" + bytes(15) + b"\0\x10"])

    def test_the_unit_id_of_the_sdk_lasts(self):
        pedal = FootPedal(model="xkeys_0268")
        pedal.output(bytes((0, 137, 137, 0, 0, 0, 0, 42, 16)), 0.0)
        pedal.output(bytes((0, 0, 0, 0, 0, 0, 0, 0, 0x80)), 0.0)
        self.assertEqual((pedal.green, pedal.red), (False, True))
        pedal.power_cycle(1.0)
        pedal.arrange(1.0, right=True)
        self.assertEqual(reports(pedal, 1.0)[0][17], 42)

    def test_an_xk_3_report_as_node_hid_reads_it(self):
        pedal = FootPedal(model="xk3_0438")
        pedal.arrange(1.5, middle=True)
        (report,) = reports(pedal, 1.5)
        self.assertEqual((len(report), report[:3]), (32, b"\0\0\x04"))
        self.assertEqual(struct.unpack(">I", report[18:22])[0], 1500)
        pedal.arrange(2.0, right=True, program_switch=True)
        self.assertEqual(reports(pedal, 2.0)[0][:3], b"\0\x01\x0c")
        pedal.output(b"\0\xb1" + bytes(34), 2.0)
        self.assertEqual(reports(pedal, 2.0)[0][1], 3)

    def test_a_vec_report_has_two_bytes(self):
        pedal = FootPedal(model="vec")
        for name, value in (("left", 1), ("middle", 2), ("right", 4)):
            pedal.arrange(0.0, **{name: True})
            self.assertEqual(reports(pedal, 0.0), [bytes([value, 0])])
            pedal.arrange(0.0, **{name: False})
            self.assertEqual(reports(pedal, 0.0), [b"\0\0"])

    def test_nothing_is_said_while_nothing_changes(self):
        pedal = FootPedal(model="vec")
        pedal.arrange(0.0, left=True)
        pedal.arrange(0.5, left=True)
        self.assertEqual(len(reports(pedal, 10.0)), 1)
        pedal.mode(repeats=2)
        pedal.arrange(11.0, left=False)
        self.assertEqual(reports(pedal, 11.0), [b"\0\0"] * 3)


class SpacemouseTest(unittest.TestCase):
    def test_recorded_packets_of_a_navigator(self):
        mouse = Spacemouse()
        mouse.arrange(0.0, deflection=[0, 0, 0, 0, -30, 0])
        self.assertEqual(reports(mouse, 0.0), [bytes.fromhex("01000000000000")])
        self.assertEqual(reports(mouse, 0.008), [bytes.fromhex("020000e2ff0000")])
        mouse.arrange(0.010, keys=1)
        mouse.arrange(0.011, keys=3)
        mouse.arrange(0.012, keys=0)
        self.assertEqual([each.hex() for each in reports(mouse, 0.012)], ["030100", "030300", "030000"])

    def test_125_reports_a_second_and_three_pairs_of_zeros(self):
        mouse = Spacemouse()
        mouse.arrange(0.0, deflection=[100, 0, 0, 0, 0, 0])
        count = 0
        for tick in range(125):
            count += len(reports(mouse, tick * 0.008))
        self.assertEqual(count, 125)
        mouse.arrange(1.0, deflection=[0] * 6)
        tail = reports(mouse, 2.0)
        self.assertEqual(len([each for each in tail if each[0] == 1]), 3)
        self.assertTrue(all(not any(each[1:]) for each in tail))
        self.assertEqual(reports(mouse, 3.0), [])

    def test_lost_zeros_leave_the_last_deflection(self):
        mouse = Spacemouse(zeros=0)
        mouse.arrange(0.0, deflection=[100, 0, 0, 0, 0, 0])
        reports(mouse, 0.008)
        mouse.arrange(0.010, deflection=[0] * 6)
        self.assertEqual(reports(mouse, 1.0), [])

    def test_a_wireless_one_has_all_axes_in_one_report(self):
        mouse = Spacemouse(model="wireless")
        mouse.arrange(0.0, deflection=[1, -2, 3, -350, 350, 900])
        (report,) = reports(mouse, 0.0)
        self.assertEqual((len(report), struct.unpack("<6h", report[1:])), (13, (1, -2, 3, -350, 350, 350)))
        self.assertEqual(len(reports(mouse, 0.2)), 12)  # 12.5 packets each 200 ms
        mouse.arrange(0.2, deflection=[0] * 6)
        self.assertEqual(len(reports(mouse, 1.0)), 3)
        mouse.tell_battery(1.0)
        self.assertEqual(reports(mouse, 1.0), [b"\x17\x64\x01"])

    def test_the_light(self):
        mouse = Spacemouse()
        self.assertEqual(mouse.output(b"\x04\x01", 0.0), 2)
        self.assertTrue(mouse.led)
        mouse.output(b"\x04\x00", 0.0)
        self.assertFalse(mouse.led)

    def test_a_frozen_one_is_silent(self):
        mouse = Spacemouse()
        mouse.arrange(0.0, deflection=[100, 0, 0, 0, 0, 0])
        mouse.arrange(0.1, frozen=True)
        reports(mouse, 0.1)
        self.assertEqual(reports(mouse, 1.0), [])

    def test_the_host_keeps_64_reports(self):
        mouse = Spacemouse()
        mouse.arrange(0.0, deflection=[100, 0, 0, 0, 0, 0])
        self.assertEqual(len(reports(mouse, 10.0)), 64)


if __name__ == "__main__":
    unittest.main()
