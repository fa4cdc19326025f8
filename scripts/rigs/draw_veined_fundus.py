#!/usr/bin/env python3
"""Draws veined_fundus.jpg, the retina of the rig veined_eye: a fundus under weak red light with many dark red vessels. Wants
python3-numpy and python3-opencv; no part of the build. draw_veined_fundus.py FILE"""
import sys

import cv2
import numpy as np

SIDE = 1024  # px, for 30 mm of retina
GROUND = np.array([48, 31, 112], np.float32) * 1.75  # blue, green, red
VESSEL = np.array([0.49, 0.45, 0.65], np.float32)  # share of each that a vessel leaves: blood takes most of the green


def main():
    rng = np.random.default_rng(83)
    light = np.ones((SIDE, SIDE, 3), np.float32) * GROUND
    for pitch, weight in ((170, 1), (75, 0.6), (30, 0.4)):
        n = SIDE // pitch + 4
        coarse = rng.standard_normal((n, n)).astype(np.float32)
        light *= (1 + 0.07 * weight * cv2.resize(coarse, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC))[..., None]
    share = np.zeros((SIDE, SIDE), np.float32)
    for _ in range(90):
        at, heading, width = rng.uniform(0, SIDE, 2), rng.uniform(0, 2 * np.pi), rng.uniform(4, 13)
        for _ in range(120):
            heading += rng.normal(0, 0.1)
            to = at + 9 * np.array([np.cos(heading), np.sin(heading)])
            cv2.line(share, tuple(int(x * 8) for x in at), tuple(int(x * 8) for x in to), 1.0, max(1, round(width)), cv2.LINE_AA, 3)
            at, width = to, max(width * 0.99, 2)
    share = cv2.GaussianBlur(share, (0, 0), 1.5)[..., None]
    light *= 1 - share * (1 - VESSEL)
    cv2.imwrite(sys.argv[1], np.clip(light, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 90])


if __name__ == "__main__":
    main()
