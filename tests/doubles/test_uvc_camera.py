"""The camera's requests and payloads as the video class has them.

SPDX-License-Identifier: Apache-2.0
"""

import struct
import unittest

from double import STALL
from uvc_camera import AE_MODE, CAMERA, COMMIT, EXPOSURE, GAIN, GET_CUR, GET_INFO, GET_RES, PROBE, PROCESSING, SET_CUR, UvcCamera


def set_cur(camera, unit, selector, data, interface=0):
    """SET_CUR of a unit's control."""
    return camera.control(0x21, SET_CUR, selector << 8, unit << 8 | interface, data, 0.0)


def get(camera, request, unit, selector, length, interface=0):
    """(bytes moved, data)."""
    return camera.control(0xA1, request, selector << 8, unit << 8 | interface, length, 0.0)


class Requests(unittest.TestCase):
    """Controls."""

    def test_an_exposure_is_taken_in_the_manual_mode_alone(self):
        camera = UvcCamera()
        self.assertEqual(set_cur(camera, CAMERA, EXPOSURE, struct.pack("<I", 100)), STALL)
        self.assertEqual(get(camera, GET_INFO, CAMERA, EXPOSURE, 1), (1, b"\x07"))
        self.assertEqual(set_cur(camera, CAMERA, AE_MODE, b"\x01"), 1)
        self.assertEqual(set_cur(camera, CAMERA, EXPOSURE, struct.pack("<I", 100)), 4)
        self.assertEqual(get(camera, GET_CUR, CAMERA, EXPOSURE, 4), (4, struct.pack("<I", 100)))

    def test_what_it_has_not_stalls(self):
        camera = UvcCamera()
        self.assertEqual(get(camera, GET_RES, CAMERA, AE_MODE, 1), (1, b"\x09"))
        self.assertEqual(set_cur(camera, CAMERA, AE_MODE, b"\x04"), STALL)  # shutter priority
        self.assertEqual(set_cur(camera, PROCESSING, GAIN, struct.pack("<H", 101)), STALL)
        self.assertEqual(get(camera, GET_CUR, PROCESSING, 0x02, 2), (STALL, b""))  # brightness

    def test_lengths_in_its_descriptors_are_what_follows_them(self):
        whole = UvcCamera().configuration
        self.assertEqual(struct.unpack_from("<H", whole, 2)[0], len(whole))
        at = 0
        while at < len(whole):
            self.assertGreater(whole[at], 1)
            at += whole[at]
        self.assertEqual(at, len(whole))


class Pictures(unittest.TestCase):
    """Payloads of one picture."""

    def test_a_picture_ends_with_the_flag_and_the_next_has_the_other_parity(self):
        camera = UvcCamera(width=40, height=60)
        self.assertIsNone(camera.bulk_in(2048, 0.0))
        size, probe = get(camera, GET_CUR, 0, PROBE, 26, interface=1)
        self.assertEqual(size, 26)
        set_cur(camera, 0, COMMIT, probe, interface=1)
        parts = []
        for at in (0.0, 0.0, 0.0, 0.05, 0.1, 0.1, 0.1):
            parts.append(camera.bulk_in(2048, at))
        self.assertIsNone(parts[3])
        first, second = parts[:3], parts[4:]
        self.assertEqual(sum(len(each) - 2 for each in first), 40 * 60 * 2)
        self.assertEqual([each[1] & 2 for each in first], [0, 0, 2])
        self.assertNotEqual(first[0][1] & 1, second[0][1] & 1)


if __name__ == "__main__":
    unittest.main()
