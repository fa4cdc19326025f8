"""A Sutter MPC-200 controller with up to four manipulators, behind its USB serial converter.

Sources, named by their letters at the lines below:
  A    github acq4/acq4 acq4/drivers/SutterMPC200/mpc200.py (runs on the hardware)
  F    the project's fact sheet sutter_mp285, last chapter (the same and pages of the MPC-200 manual)
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import ByteDouble

INTERRUPT = 0x03
LENGTHS = {"K": 1, "U": 1, "I": 2, "C": 1, "M": 13, "S": 14, "N": 1, "H": 1, "Y": 1, "L": 2, "O": 1, "F": 1}  # A, F
MICROSTEPS = 16.0  # a micrometre; A scale 0.0625e-6
TRAVEL = 25000.0  # um; A moveTo: 0 <= x < 25e-3
# um/s; A speedTable
SPEEDS = (337.9, 360.6, 383.0, 412.0, 440.8, 478.2, 523.3, 572.6, 638.1, 718.0, 814.6, 957.5, 1139.0, 1404.0, 1890.0,
          2767.0)
FAST = 4650.0  # A speedTable['fast']


class SutterMpc200(ByteDouble):
    """The controller and its manipulators."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "drives": "1",  # those that are connected
        "firmware": "2.64",  # no source for a number that exists; F: two BCD bytes
        "pause": 0.030,  # A moveTo: the sleep between S and its data is mandatory
    }
    STATE = (
        "drive", "positions", "moving", "hung", "interrupts", "moves", "hurried", "unanswered",
    )

    def __init__(self, **options):
        self.positions = [[12500.0] * 3 for _ in range(4)]  # um
        self.interrupts = self.moves = self.hurried = self.unanswered = 0
        super().__init__(**options)

    def start(self, now):
        """Power-up. no source: positions are kept, drive 1 is active."""
        self._buffer = bytearray()
        self._said_s = None
        self._ends = None
        self._was_interrupted = False
        self._quiet_since = None
        self.put(now, drive=1, hung=False)

    moving = property(lambda self: self._ends is not None)

    @property
    def connected(self):
        """Numbers of the drives that are there."""
        return [int(each) for each in str(self.drives).replace(",", " ").split()]

    def next_event(self):
        """The end of the move."""
        return self._ends

    def advance(self, now):
        """Carries the manipulator along its way."""
        super().advance(now)
        if self._ends is None:
            return
        at = self.positions[self.drive - 1]
        if now >= self._ends:
            ended, self._ends = self._ends, None
            at[:] = self._to
            self.tell(ended, "arrived", at)
            self._reply(b"", ended)  # A moveTo: reads one CR when the move is complete
            return
        share = (now - self._begun) / (self._ends - self._begun)
        at[:] = [a + (b - a) * share for a, b in zip(self._from, self._to)]

    # -- the line ------------------------------------------------------------------------------------------

    def _reply(self, data, now):
        # A getPos: if an interrupt occurred, there is an extra 'I' at the beginning
        head = b"I" if self._was_interrupted else b""
        self._was_interrupted = False
        self.answer(head + bytes(data) + b"\r", now)
        self._quiet_since = now + self.late

    def take(self, byte, now):
        """One byte of the host; commands have no terminator (F)."""
        if self.hung:
            return
        if byte == INTERRUPT and not self._buffer:
            self._interrupt(now)
            return
        if self.moving:
            self.tell(now, "ignored while moving", bytes([byte]))  # no source for a command within a move
            return
        if not self._buffer:
            if self._quiet_since is not None and now < self._quiet_since + 0.002 - 1e-9:
                self.put(now, hurried=self.hurried + 1)  # F: 2 ms between commands
            if chr(byte) not in LENGTHS:
                self.tell(now, "unknown", bytes([byte]))  # no source for its answer: none
                return
            if byte == ord("S"):
                self._said_s = now
        elif len(self._buffer) == 1 and self._buffer[0] == ord("S") and now < self._said_s + self.pause - 1e-9:
            # A: "MPC200 crashes if the entire packet is written at once"
            self.put(now, hung=True)
            return
        self._buffer.append(byte)
        command = chr(self._buffer[0])
        if len(self._buffer) == LENGTHS[command]:
            arguments = bytes(self._buffer[1:])
            self._buffer.clear()
            self.tell(now, "command", command + arguments.hex(" "))
            self._command(command, arguments, now)

    def _interrupt(self, now):
        self.put(now, interrupts=self.interrupts + 1)
        if self.moving:
            self._ends = None
            self.tell(now, "interrupted", self.positions[self.drive - 1])
            self.answer(b"\r", now)  # A stop(): one CR
            self._was_interrupted = True
            self._quiet_since = now
        else:
            self._reply(b"", now)

    def _command(self, command, arguments, now):
        at = self.positions[self.drive - 1]
        if command == "K":
            major, minor = (int(each, 16) for each in self.firmware.split("."))
            self._reply(bytes([self.drive, minor, major]), now)  # F: drive, minor BCD, major BCD
        elif command == "U":
            self._reply(bytes([len(self.connected)] + [int(n in self.connected) for n in range(1, 5)]), now)  # A
        elif command == "I":
            there = arguments[0] in self.connected
            if there:
                self.put(now, drive=arguments[0])
            self._reply(arguments if there else b"E", now)  # F; A setDrive
        elif command == "C":
            self._reply(struct.pack("<B3i", self.drive, *(round(each * MICROSTEPS) for each in at)), now)  # A
        elif command == "M":
            self._move(struct.unpack("<3i", arguments), FAST, now)
        elif command == "S":
            speed, *target = struct.unpack("<B3i", arguments)  # A: '<B3i'
            if speed > 15:
                self.tell(now, "refused speed", speed)  # no source for its answer: none
                return
            self._move(target, SPEEDS[speed], now)
        elif command == "N":
            at[:] = [0.0, 0.0, 0.0]  # F: calibrate; no source for its time
            self._reply(b"", now)
        else:
            self._reply(b"", now)

    def _move(self, target, speed, now):
        at = self.positions[self.drive - 1]
        if all(abs(each - round(here * MICROSTEPS)) < 16 for each, here in zip(target, at)):
            self.put(now, unanswered=self.unanswered + 1)
            return  # A moveTo: too small a step is ignored and gets no CR
        goal = [each / MICROSTEPS for each in target]
        held = [min(max(each, 0.0), TRAVEL) for each in goal]
        if held != goal:
            self.tell(now, "beyond the travel", goal)  # no source for what the controller does
        way = max(abs(b - a) for a, b in zip(at, held))  # A: the speed is that of the fastest moving axis
        self._from, self._to, self._begun = list(at), held, now
        self._ends = now + way / speed
        self.put(now, moves=self.moves + 1)
        self.tell(now, "move", held)


DOUBLE = SutterMpc200
