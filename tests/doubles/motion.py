"""A motor on a rail: trapezoidal moves in a time that is given.

SPDX-License-Identifier: Apache-2.0
"""

import math

STEP = 1e-3  # seconds of one step of integration


class Motor:
    """One axis in its own units; speeds in units/s."""

    def __init__(self, position, speed, accel):
        self.position, self.velocity = position, 0.0
        self.speed, self.accel = speed, accel
        self.target = None  # where to, or None
        self.drift = None  # velocity wanted for good, or None
        self.now = 0.0

    @property
    def busy(self):
        """Whether it moves or is about to."""
        return self.target is not None or bool(self.drift) or self.velocity != 0

    def go(self, target):
        """Starts a move to a position."""
        self.target, self.drift = target, None

    def turn(self, velocity):
        """Keeps a velocity until told otherwise; 0 decelerates to rest."""
        self.target, self.drift = None, velocity

    def halt(self):
        """Stands at once."""
        self.target = self.drift = None
        self.velocity = 0.0

    def run(self, until, least=-math.inf, greatest=math.inf):
        """Moves on to that time; returns True when it ran against an end of its rail."""
        while self.now < until - 1e-12:
            if not self.busy:
                break
            span = min(STEP, until - self.now)
            self.now += span
            if self._step(span, least, greatest):
                self.now = max(self.now, until)
                return True
        self.now = max(self.now, until)
        return False

    def _step(self, span, least, greatest):
        left = None
        if self.target is not None:
            left = self.target - self.position
            wanted = math.copysign(min(self.speed, math.sqrt(2 * self.accel * abs(left))), left) if left else 0.0
        else:
            wanted = self.drift or 0.0
        change = self.accel * span
        if abs(wanted - self.velocity) <= change:
            self.velocity = wanted
        else:
            self.velocity += math.copysign(change, wanted - self.velocity)
        move = self.velocity * span
        if left is not None and (abs(left) < 0.5 or (move * left >= 0 and abs(move) >= abs(left))):
            move = left
            self.velocity, self.target = 0.0, None
        self.position += move
        if self.target is None and self.drift == 0 and self.velocity == 0:
            self.drift = None
        if not least <= self.position <= greatest:
            self.position = min(max(self.position, least), greatest)
            self.halt()
            return True
        return False
