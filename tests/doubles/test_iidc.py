"""The double of an IIDC camera against Basler's register tables.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from iidc import FORMAT_7, Iidc


class IidcTest(unittest.TestCase):
    def setUp(self):
        self.camera = Iidc()

    def get(self, offset, now=0.0):
        return self.camera.read(offset, now)

    def put(self, offset, value, now=0.0):
        self.camera.write(offset, value, now)

    def test_inquiries_of_the_a620f(self):
        self.assertEqual(self.get(0x520), 0x89000000 | 740)  # page 4-17
        self.assertEqual(self.get(0x500), 0x89000000 | 255)  # page 4-15
        self.assertEqual(self.get(0x51C), 0x89000000 | 1 << 12 | 4095)
        for inquiry in (0x500, 0x51C, 0x520):
            self.assertEqual(self.get(inquiry) & 0x40000000, 0, "no absolute control")
        self.assertEqual(self.get(FORMAT_7), 1280 << 16 | 1024)
        self.assertEqual(self.get(FORMAT_7 + 4), 4 << 16 | 1)

    def test_values_of_the_a620f(self):
        self.assertEqual(self.get(0x81C), 0x82000000 | 200)
        self.put(0x81C, 0x82000000 | 500)
        self.assertAlmostEqual(self.camera.exposure, 0.010)
        self.put(0x820, 4000)
        self.assertEqual(self.get(0x820) & 0xFFF, 740)
        self.put(0x81C, 0xC2000000 | 300)  # asks for absolute control
        self.assertEqual(self.get(0x81C), 0x82000000 | 300)

    def test_what_does_not_exist_reads_zero(self):
        self.put(0x828, 0x82000001)
        self.assertEqual(self.get(0x828), 0)
        self.assertEqual(self.get(0x404), 0x80000000 | 1 << 24 | 1 << 23 | 1 << 19)

    def test_free_running_images(self):
        self.put(FORMAT_7 + 0x0C, 640 << 16 | 480)
        self.put(FORMAT_7 + 0x44, 4096 << 16)
        period, = struct.unpack(">f", struct.pack(">I", self.get(FORMAT_7 + 0x50)))
        self.assertAlmostEqual(period, 75 * 125e-6, places=6)
        self.put(0x614, 0x80000000, 1.0)
        told = self.camera.images(2.0)
        self.assertAlmostEqual(len(told), 1 / period, delta=3)
        self.assertEqual([each[1] for each in told], list(range(1, len(told) + 1)))
        arrival, _, start, width, height, data = told[0]
        self.assertEqual((width, height, len(data)), (640, 480, 640 * 480))
        self.assertAlmostEqual(arrival - start, 0.004 + period, places=6)
        self.put(0x614, 0, 2.0)
        self.assertLessEqual(len(self.camera.images(3.0)), 2)

    def test_brightness_gain_and_exposure_change_the_level(self):
        self.camera.mode(pixels=False)
        levels = []
        for shutter, gain, brightness in ((200, 0, 0), (400, 0, 0), (200, 740, 0), (200, 0, 40)):
            camera = Iidc(pixels=False)
            camera.light = 5000.0
            for offset, value in ((0x81C, shutter), (0x820, gain), (0x800, brightness), (0x61C, 0x80000000)):
                camera.write(offset, value, 0.0)
            levels.append(camera.images(1.0)[0][5][0])
        self.assertEqual(levels, [20, 40, 205, 30])

    def test_one_shot_and_multi_shot_clear_themselves(self):
        self.put(0x61C, 0x80000000)
        self.assertEqual(len(self.camera.images(1.0)), 1)
        self.assertEqual(self.get(0x61C, 1.0), 0)
        self.put(0x61C, 0x40000003, 1.0)
        self.assertEqual(len(self.camera.images(2.0)), 3)

    def test_a_software_trigger_needs_source_7_mode_0_and_transmission(self):
        self.put(0x62C, 0x80000000)
        self.assertEqual(self.camera.lost_triggers, 1)
        self.put(0x830, 1 << 25 | 7 << 21)
        self.assertEqual(self.get(0x830), 0x80000000 | 1 << 25 | 7 << 21)
        self.put(0x614, 0x80000000)
        self.assertEqual(self.camera.images(1.0), [])
        self.put(0x62C, 0x80000000, 1.0)
        self.assertEqual(self.get(0x62C, 1.0), 0)
        self.assertEqual(len(self.camera.images(2.0)), 1)
        self.put(0x62C, 0x80000000, 3.0)
        self.put(0x62C, 0x80000000, 3.001)
        self.assertEqual((len(self.camera.images(4.0)), self.camera.lost_triggers), (1, 2))

    def test_an_external_trigger(self):
        self.put(0x830, 1 << 25 | 2 << 21)
        self.put(0x614, 0x80000000)
        self.camera.external_trigger(1, 0.1)
        self.camera.external_trigger(2, 0.2)
        self.assertEqual([each[2] for each in self.camera.images(1.0)], [0.2])

    def test_an_area_outside_the_sensor_is_refused(self):
        self.put(FORMAT_7 + 0x0C, 640 << 16 | 480)
        self.put(FORMAT_7 + 0x08, 700 << 16 | 0)
        self.assertEqual(self.get(FORMAT_7 + 0x08), 0)
        self.put(FORMAT_7 + 0x0C, 641 << 16 | 480)
        self.assertEqual(self.get(FORMAT_7 + 0x0C), 640 << 16 | 480)

    def test_initialize_brings_the_defaults_back(self):
        self.put(0x81C, 4000)
        self.put(0x000, 0x80000000)
        self.assertEqual(self.get(0x81C) & 0xFFF, 200)

    def test_the_handshake_clears_itself_and_tells_a_refused_area(self):
        self.put(FORMAT_7 + 0x7C, 0x40000000)
        self.assertEqual(self.get(FORMAT_7 + 0x7C), 0x80000000)
        self.put(FORMAT_7 + 0x0C, 641 << 16 | 480)
        self.assertEqual(self.get(FORMAT_7 + 0x7C), 0x80800000)
        self.put(FORMAT_7 + 0x0C, 640 << 16 | 480)
        self.assertEqual(self.get(FORMAT_7 + 0x7C), 0x80000000)

    def test_absolute_values_on_demand(self):
        def real(bits):
            return struct.unpack(">f", struct.pack(">I", bits))[0]

        self.assertEqual(self.get(0x71C), 0)
        camera = Iidc(absolute=True)
        self.assertTrue(camera.read(0x51C, 0.0) & 0x40000000)
        place = camera.read(0x71C, 0.0) * 4 - 0xF00000
        self.assertAlmostEqual(real(camera.read(place, 0.0)), 20e-6)
        self.assertAlmostEqual(real(camera.read(place + 4, 0.0)), 81.9e-3, places=6)
        wanted = struct.unpack(">I", struct.pack(">f", 5.007e-3))[0]
        camera.write(place + 8, wanted, 0.0)
        self.assertAlmostEqual(camera.exposure, 0.004)  # absolute control is off
        camera.write(0x81C, 0xC2000000, 0.0)
        camera.write(place + 8, wanted, 0.0)
        self.assertAlmostEqual(camera.exposure, 5e-3)
        gain = camera.read(0x720, 0.0) * 4 - 0xF00000
        self.assertAlmostEqual(real(camera.read(gain + 4, 0.0)), 20.2, delta=0.01)  # page 4-25

    def test_automatic_on_demand(self):
        camera = Iidc(automatic=True)
        camera.light = 6400.0
        self.assertAlmostEqual(camera.exposure, 0.02)
        camera.write(0x81C, camera.read(0x81C, 0.0) & ~0xFFF | 500, 0.0)
        self.assertAlmostEqual(camera.exposure, 0.02)
        camera.write(0x81C, 0x82000000 | 500, 0.0)
        self.assertAlmostEqual(camera.exposure, 500 * 20e-6)

    def test_the_a602f(self):
        camera = Iidc(model="a602f")
        self.assertEqual(camera.read(0x520, 0.0) & 0xFFF, 255)
        self.assertEqual(camera.read(FORMAT_7, 0.0), 656 << 16 | 491)
        self.assertEqual(camera.read(0x800, 0.0) & 0xFFF, 16)


if __name__ == "__main__":
    unittest.main()
