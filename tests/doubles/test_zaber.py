"""The double of a Zaber device against messages that its maker's and other people's programs expect.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from zaber import Zaber, checksum


class ZaberTest(unittest.TestCase):
    def setUp(self):
        self.device = Zaber()
        self.now = 0.0

    def say(self):
        return b"".join(each[1] for each in self.device.say(self.now)).decode()

    def ask(self, text, end="\n"):
        self.device.receive((text + end).encode(), self.now)
        return self.say()

    def wait(self, seconds):
        self.now += seconds
        return self.say()

    def home(self):
        self.ask("/1 1 home")
        self.wait(20.0)

    def test_checksums_of_zproto(self):
        self.assertEqual(int(checksum("01 tools echo"), 16), 143)  # zproto checksum.rs

    def test_replies_of_the_matlab_toolbox(self):
        self.home()
        self.assertEqual(self.ask("/1 0", "\r\n"), "@01 0 OK IDLE -- 0\r\n")
        self.assertEqual(self.ask("/1 0 foo", "\r\n"), "@01 0 RJ IDLE -- BADCOMMAND\r\n")
        self.assertEqual(self.ask("/1 0 set maxspeed abc", "\r\n"), "@01 0 RJ IDLE -- BADDATA\r\n")
        self.assertEqual(self.ask("/1 0 get peripheralid", "\r\n"), "@01 0 RJ IDLE -- BADCOMMAND\r\n")
        self.assertEqual(self.ask("/1 0 get resolution", "\r\n"), "@01 0 OK IDLE -- 64\r\n")
        self.assertEqual(self.ask("/1 0 move abs 10000", "\r\n"), "@01 0 OK BUSY -- 0\r\n")
        self.wait(5.0)
        self.assertEqual(self.ask("/1 0 get pos", "\r\n"), "@01 0 OK IDLE -- 10000\r\n")
        two = Zaber(axes=2)
        two.receive(b"/1 0 get pos\n", 0.0)
        self.assertEqual(two.say(0.0)[0][1], b"@01 0 OK IDLE WR 1066667 1066667\r\n")

    def test_forms_of_the_header(self):
        for text, head in (("/", "@01 0 OK"), ("/1", "@01 0 OK"), ("/1 1", "@01 1 OK"), ("/1 1 3", "@01 1 03 OK"),
                           ("/1  1\t3", ""), ("/1 1 3get pos", "@01 1 03 OK"), ("/01 1 get pos", "@01 1 OK"),
                           ("/get pos", "@01 0 OK"), ("/1 2", "@01 2 RJ IDLE WR BADAXIS"), ("/2 1", ""), ("1 1", "")):
            reply = self.ask(text)
            self.assertTrue(reply.startswith(head), (text, reply))
            self.assertEqual(bool(head), bool(reply), text)

    def test_it_is_unhomed_after_power_up_and_says_so(self):
        self.assertEqual(self.ask("/1 1"), "@01 1 OK IDLE WR 0\r\n")
        self.assertEqual(self.ask("/1 1 warnings"), "@01 1 OK IDLE WR 01 WR\r\n")
        self.assertEqual(self.ask("/1 1 warnings clear"), "@01 1 OK IDLE WR 01 WR\r\n")
        self.assertEqual(self.ask("/1 1 home"), "@01 1 OK BUSY WR 0\r\n")
        self.wait(20.0)
        self.assertEqual(self.ask("/1 1 get pos"), "@01 1 OK IDLE -- 0\r\n")

    def test_a_stop_within_a_move_is_answered_with_ni(self):
        self.home()
        self.ask("/1 1 move max")
        self.wait(1.0)
        self.assertEqual(self.ask("/1 1 stop"), "@01 1 OK BUSY NI 0\r\n")  # zproto README
        self.wait(1.0)
        self.assertEqual(self.ask("/1 1"), "@01 1 OK IDLE NI 0\r\n")
        self.ask("/1 1 move rel 10")
        self.assertEqual(self.wait(1.0) + self.ask("/1 1"), "@01 1 OK IDLE -- 0\r\n")

    def test_speed_and_acceleration_have_the_units_of_the_manual(self):
        self.home()
        self.ask("/1 1 set maxspeed 163840")  # 100000 microsteps/s
        self.ask("/1 1 set accel 16384")  # 1e8 microsteps/s^2
        self.ask("/1 1 move abs 500000")
        self.wait(2.0)
        self.assertAlmostEqual(self.device.positions[0], 200000, delta=300)
        self.wait(3.1)
        self.assertEqual(self.ask("/1 1 get pos"), "@01 1 OK IDLE -- 500000\r\n")

    def test_targets_beyond_the_limits_are_rejected(self):
        self.home()
        for text in ("move abs 1066668", "move abs -1", "move rel -1", "move abs 1.5", "move abs", "move abs 1 2"):
            self.assertEqual(self.ask("/1 1 " + text), "@01 1 RJ IDLE -- BADDATA\r\n", text)
        self.assertEqual(self.ask("/1 1 move to 5"), "@01 1 RJ IDLE -- BADCOMMAND\r\n")

    def test_firmware_7_takes_a_speed_with_a_move(self):
        self.device = Zaber(firmware="7.11")
        self.home()
        self.ask("/1 1 move abs 100000 16384")
        self.wait(5.0)
        self.assertAlmostEqual(self.device.positions[0], 50000, delta=300)
        self.assertEqual(self.ask("/1 1 get maxspeed"), "@01 1 OK BUSY -- 153600\r\n")
        self.ask("/1 1 driver disable")
        self.assertEqual(self.ask("/1 1 move abs 0"), "@01 1 RJ IDLE FO DRIVERDISABLED\r\n")

    def test_the_knob_moves_it_and_shows_nc(self):
        self.home()
        self.device.arrange(self.now, knobs=[5000.0])
        self.wait(1.0)
        self.assertEqual(self.ask("/1 1"), "@01 1 OK BUSY NC 0\r\n")
        self.device.arrange(self.now, knobs=[0.0])
        self.wait(0.1)
        self.assertEqual(self.ask("/1 1"), "@01 1 OK IDLE -- 0\r\n")
        self.assertGreater(self.device.positions[0], 4900)

    def test_the_knob_interrupts_a_move(self):
        self.home()
        self.ask("/1 1 move abs 400000")
        self.wait(1.0)
        self.device.arrange(self.now, knobs=[-100.0])
        self.wait(0.5)
        self.assertEqual(self.ask("/1 1 warnings"), "@01 1 OK BUSY NC 02 NC NI\r\n")
        self.device.arrange(self.now, knobs=[0.0])
        self.wait(5.0)
        self.assertLess(self.device.positions[0], 120000)
        self.ask("/1 1 set knob.enable 0")
        before = self.device.positions[0]
        self.device.arrange(self.now, knobs=[5000.0])
        self.wait(1.0)
        self.assertEqual(self.device.positions[0], before)

    def test_alerts_come_unasked_when_they_are_on(self):
        self.home()
        self.ask("/1 set comm.alert 1")
        self.ask("/1 1 move abs 1000")
        self.assertEqual(self.wait(1.0), "!01 1 IDLE --\r\n")

    def test_checksums_go_both_ways_and_a_wrong_one_is_not_answered(self):
        self.home()
        self.assertEqual(self.ask("/1 1:" + checksum("1 1")), "@01 1 OK IDLE -- 0\r\n")
        self.assertEqual(self.ask("/1 1:00"), "")
        body = "01 0 OK IDLE -- 0"
        self.assertEqual(self.ask("/1 set comm.checksum 1"), "@" + body + ":" + checksum(body) + "\r\n")

    def test_settings_last_over_a_power_cycle(self):
        self.home()
        for text in ("set comm.alert 1", "set maxspeed 1000", "set knob.enable 0"):
            self.ask("/1 0 " + text)
        self.device.power_cycle(self.now)
        self.assertEqual(self.ask("/1 get comm.alert"), "@01 0 OK IDLE WR 1\r\n")
        self.assertEqual(self.ask("/1 get maxspeed"), "@01 0 OK IDLE WR 1000\r\n")
        self.ask("/1 system restore")
        self.assertEqual(self.ask("/1 get maxspeed"), "@01 0 OK IDLE WR 153600\r\n")

    def test_a_parked_axis_keeps_its_place(self):
        self.home()
        self.ask("/1 1 move abs 5000")
        self.wait(2.0)
        self.ask("/1 1 tools parking park")
        self.device.power_cycle(self.now)
        self.assertEqual(self.ask("/1 1 get pos"), "@01 1 OK IDLE -- 5000\r\n")
        self.assertEqual(self.ask("/1 1 home"), "@01 1 RJ IDLE -- PARKED\r\n")

    def test_an_unhomed_axis_runs_into_the_end_and_stalls(self):
        self.ask("/1 1 move abs 0")  # it believes it is at the far end and is not
        self.wait(20.0)
        self.assertEqual(self.ask("/1 1"), "@01 1 OK IDLE FS 0\r\n")
        self.assertEqual(self.ask("/1 1 warnings"), "@01 1 OK IDLE FS 02 FS WR\r\n")

    def test_the_worst_flag_is_shown(self):
        self.home()
        self.device.arrange(self.now, forced_flags=["NU", "FD", "WT"])
        self.assertEqual(self.ask("/1 1 warnings"), "@01 1 OK IDLE FD 03 FD WT NU\r\n")

    def test_characters_of_the_line(self):
        self.assertEqual(self.ask("/1 1 gex\bt pos"), "@01 1 OK IDLE WR 1066667\r\n")
        self.assertEqual(self.ask("/1 1 get pos\x7f"), "")
        self.assertEqual(self.ask("\n\r\n"), "")
        self.assertEqual(self.ask("/1 1 get pos" + "x" * 80), "")

    def test_device_settings_of_an_axis_are_rejected(self):
        self.assertEqual(self.ask("/1 1 get version"), "@01 1 RJ IDLE WR DEVICEONLY\r\n")
        self.assertEqual(self.ask("/1 1 set comm.alert 1"), "@01 1 RJ IDLE WR DEVICEONLY\r\n")

    def test_a_renumbered_device_has_a_new_address(self):
        self.assertEqual(self.ask("/renumber 7"), "@07 0 OK IDLE WR 0\r\n")
        self.assertEqual(self.ask("/1 1"), "")
        self.assertEqual(self.ask("/7 1"), "@07 1 OK IDLE WR 0\r\n")


if __name__ == "__main__":
    unittest.main()
