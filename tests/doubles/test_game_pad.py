"""The double of a game pad against Linux' headers and the table of a real one.

SPDX-License-Identifier: Apache-2.0
"""

import os
import pathlib
import select
import struct
import subprocess
import sys
import tempfile
import time
import unittest

import serve
from double import Refused
from game_pad import EVENT, GamePad, defuzzed
from test_serve import PATIENCE, SERVER, Served


class Hands:
    def __init__(self, **options):
        self.pad = GamePad(**options)
        self.now = 0.0

    def move(self, seconds=0.01, **changes):
        self.pad.arrange(self.now, **changes)
        self.now += seconds
        data = b"".join(each[1] for each in self.pad.say(self.now))
        return [EVENT.unpack_from(data, at)[2:] for at in range(0, len(data), 24)]


class GamePadTest(unittest.TestCase):
    def test_the_table_of_a_real_one(self):
        table = GamePad().capabilities
        self.assertEqual((table["bus"], table["vendor"], table["product"], table["version"]), (3, 0x045E, 0x028E, 0x0114))
        self.assertEqual(table["keys"], [0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x13A, 0x13B, 0x13C, 0x13D, 0x13E])
        self.assertEqual(sorted(int(each) for each in table["abs"]), [0, 1, 2, 3, 4, 5, 16, 17])
        self.assertEqual(table["abs"]["0"], {"minimum": -32768, "maximum": 32767, "fuzz": 16, "flat": 128})
        self.assertEqual(table["abs"]["2"], {"minimum": 0, "maximum": 255, "fuzz": 0, "flat": 0})
        self.assertEqual(GamePad(model="xpadneo").capabilities["abs"]["5"]["maximum"], 1023)
        with self.assertRaises(Refused):
            GamePad(model="joystick")

    def test_an_event_is_24_bytes_with_its_time(self):
        pad = GamePad(epoch=1000.0)
        pad.arrange(1.5, buttons=["south"])
        ((_, data),) = pad.say(1.5)
        self.assertEqual(data[:24], struct.pack("<qqHHi", 1001, 500000, 1, 0x130, 1))
        self.assertEqual(data[24:], struct.pack("<qqHHi", 1001, 500000, 0, 0, 0))

    def test_only_changes_are_reported_and_together(self):
        hands = Hands()
        self.assertEqual(hands.move(left_x=1.0, left_y=-1.0, right_trigger=0.5, hat_x=-1),
                         [(3, 0, 32767), (3, 1, -32768), (3, 5, 128), (3, 0x10, -1), (0, 0, 0)])
        self.assertEqual(hands.move(left_x=1.0), [])
        self.assertEqual(hands.move(buttons=["tl", "mode"]), [(1, 0x136, 1), (1, 0x13C, 1), (0, 0, 0)])
        self.assertEqual(hands.move(buttons=["mode"], left_x=0), [(1, 0x136, 0), (3, 0, 0), (0, 0, 0)])
        with self.assertRaises(Refused):
            hands.move(buttons=["fire"])

    def test_fuzz_is_the_kernels(self):
        self.assertEqual([defuzzed(each, 0, 16) for each in (5, 7, 8, 12, 15, 16, 20, 31, 32, -12)],
                         [0, 0, 2, 3, 3, 8, 10, 15, 32, -3])
        hands = Hands()
        self.assertEqual(hands.move(left_x=5 / 32767), [])
        self.assertEqual(hands.move(left_x=12 / 32767), [(3, 0, 3), (0, 0, 0)])

    def test_a_reader_that_was_too_slow_is_told(self):
        hands = Hands()
        self.assertEqual(hands.move(drop=2), [])
        self.assertEqual(hands.move(buttons=["east"]), [])
        self.assertEqual(hands.move(buttons=[]), [])
        self.assertEqual(hands.move(buttons=["west"]), [(0, 3, 0), (1, 0x134, 1), (0, 0, 0)])

    def test_a_worn_stick_wanders_by_itself(self):
        hands = Hands(tremor=0.01)
        told = hands.move(seconds=1.0)
        values = {each[2] for each in told if each[:2] == (3, 0)}
        self.assertTrue(values and max(map(abs, values)) <= 328, values)
        self.assertEqual(Hands().move(seconds=1.0), [])

    def test_pieces_lateness_and_unknown_kinds(self):
        hands = Hands(pieces=10, gap=0.01, late=0.1, chatty=True)
        hands.pad.arrange(0.0, buttons=["start"])
        self.assertEqual(len(b"".join(each[1] for each in hands.pad.say(0.115))), 20)
        rest = b"".join(each[1] for each in hands.pad.say(5.0))
        self.assertEqual(len(rest), 72 - 20)
        self.assertEqual(Hands(chatty=True).move(hat_y=1)[0], (4, 4, 0x90001))

    def test_a_fifo(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "pad")
            with Served("game_pad", "--fifo", path) as served:
                self.assertEqual(served.order(set={"buttons": ["south"]}), {"ok": True})  # nothing reads: lost
                time.sleep(0.05)
                reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
                try:
                    self.assertEqual(served.order(set={"left_x": -0.5}), {"ok": True})
                    data, until = b"", time.monotonic() + PATIENCE
                    while len(data) < 48 and time.monotonic() < until:
                        if select.select([reader], [], [], 0.1)[0]:
                            data += os.read(reader, 1000)
                    self.assertEqual([EVENT.unpack_from(data, at)[2:] for at in (0, 24)], [(3, 0, -16384), (0, 0, 0)])
                    self.assertEqual(served.order(get="capabilities")["capabilities"]["vendor"], 0x045E)
                    served.order(unplug=True)
                    self.assertEqual(os.read(reader, 1), b"")
                    self.assertFalse(os.path.exists(path))
                finally:
                    os.close(reader)

    def test_what_uinput_is_given(self):
        # as strace shows them of other programs; the headers give their parts
        self.assertEqual((serve.UI_DEV_CREATE, serve.UI_DEV_SETUP, serve.UI_ABS_SETUP, serve.UI_SET_EVBIT),
                         (0x5501, 0x405C5503, 0x401C5504, 0x40045564))
        table = GamePad().capabilities
        self.assertEqual(serve.abs_setup(0, table["abs"]["0"]), struct.pack("<HHiiiiii", 0, 0, 0, -32768, 32767, 16, 128, 0))
        whole = serve.device_setup(table)
        self.assertEqual((len(whole), whole[:8]), (92, b"\x03\x00\x5e\x04\x8e\x02\x14\x01"))

    @unittest.skipUnless(os.access("/dev/uinput", os.W_OK), "no /dev/uinput here")
    def test_the_kernels_own_device(self):
        with Served("game_pad", "--uinput") as served:
            node = pathlib.Path("/sys/class/input", pathlib.Path(served.where).name, "device", "name")
            self.assertEqual(node.read_text().strip(), "Microsoft X-Box 360 pad")
            with open(served.where, "rb", buffering=0) as reader:
                served.order(set={"buttons": ["south"]})
                self.assertEqual(EVENT.unpack(reader.read(24))[2:], (1, 0x130, 1))

    def test_without_uinput_and_with_another_instrument_it_is_said_in_words(self):
        for arguments in (["zaber", "--uinput"],) + (() if os.path.exists("/dev/uinput") else (["game_pad", "--uinput"],)):
            done = subprocess.run([sys.executable, str(SERVER), *arguments], capture_output=True, text=True,
                                  stdin=subprocess.DEVNULL, timeout=PATIENCE)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    unittest.main()
