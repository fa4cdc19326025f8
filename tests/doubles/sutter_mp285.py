"""A Sutter MP-285 (or MP-285A) three-axis manipulator controller on its serial line.

Sources, named by their letters at the lines below:
  A    github acq4/acq4 acq4/drivers/SutterMP285/mp285.py (runs on the hardware), its doc SutterMP285Device.rst
  N    github TheDeanLab/navigate src/navigate/model/devices/APIs/sutter/MP285.py, which quotes the maker's manual
  F    the project's fact sheet sutter_mp285 (Micro-Manager, M. Hopcroft's sutterMP285.m, T. Lemaire's class)
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import ByteDouble

CR, LF, INTERRUPT = 0x0D, 0x0A, 0x03
# N docstrings, A: bytes that follow the command byte before the CR.
ARGUMENTS = {"c": 0, "m": 12, "V": 2, "o": 0, "a": 0, "b": 0, "n": 0, "e": 0, "r": 0, "s": 0}
OVERRUN, FRAME, BUFFER, BAD, INTERRUPTED = 1, 2, 2, 4, 8  # A ErrorVals; F: ASCII 0x30 + bits
MICROSTEPS = 25.0  # a micrometre, F, N: 0.04 um a microstep
TRAVEL = 12500.0  # um, F


class SutterMp285(ByteDouble):
    """The controller and its stage."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "needs_velocity": True,  # F: after power-on a V must be sent before anything works; no source for how it fails
        "step_mul": 40,  # F: 40, one source has 400
        "reset_reply": "null",  # A reset(): a 00 byte; or none, or error
        "roe_hangs": True,  # A doc: it crashes if the rotary control is used while it is talked to
        "hurry_hangs": True,  # N: commands must complete, or the MP-285A locks up
    }
    STATE = (
        "position", "rail", "origin", "speed", "high_resolution", "absolute", "moving", "hung", "roe_turning", "woken",
        "interrupts", "moves", "hurried",
    )

    def __init__(self, **options):
        self.rail = [0.0, 0.0, 0.0]  # um from the middle of the travel
        self.interrupts = self.moves = self.hurried = 0
        super().__init__(**options)

    def start(self, now):
        """Power-up. no source: position zero where the stage stands, absolute mode, the speed."""
        self._buffer = bytearray()
        self._from, self._to, self._begun, self._ends = list(self.rail), list(self.rail), now, None
        self._quiet_since = now
        self.put(now, origin=list(self.rail), speed=1000, high_resolution=False, absolute=True, hung=False,
                 roe_turning=False, woken=not self.needs_velocity)

    # Told to a test.
    moving = property(lambda self: self._ends is not None)

    @property
    def position(self):
        """What 'c' tells, in microsteps."""
        return [round((at - zero) * MICROSTEPS) for at, zero in zip(self.rail, self.origin)]

    def next_event(self):
        """The end of the move."""
        return self._ends

    def advance(self, now):
        """Carries the stage along its way."""
        super().advance(now)
        if self._ends is None:
            return
        if now >= self._ends:
            ended, self._ends = self._ends, None
            self.put(now, rail=list(self._to))
            self.tell(ended, "arrived", self.position)
            self._reply(b"", ended)  # N move: one byte after the move is complete
            return
        share = (now - self._begun) / (self._ends - self._begun)
        self.rail = [a + (b - a) * share for a, b in zip(self._from, self._to)]

    # -- the line ------------------------------------------------------------------------------------------

    def _reply(self, data, now):
        self.answer(bytes(data) + b"\r", now)  # N: if a command returns data, the last byte is the CR
        self._quiet_since = now + self.late

    def _error(self, bits, now):
        self.tell(now, "error", bits)
        self._reply(bytes([0x30 + bits]), now)  # F, A readPacket: one error byte, then CR

    def take(self, byte, now):
        """One byte of the host."""
        if self.hung:
            return
        if self.roe_turning and self.roe_hangs:
            self.put(now, hung=True)  # A doc: only a power cycle helps
            return
        if self._out and self._out[-1][0] > now and not self.moving and self.hurry_hangs:
            self.put(now, hung=True)  # N: "serial commands must complete or the MP-285A completely locks up"
            return
        if self.moving:
            self._interrupt(byte, now)
            return
        if byte == INTERRUPT and not self._buffer:
            self.put(now, interrupts=self.interrupts + 1)
            self._reply(b"", now)  # N interrupt_move: one byte if movement is not in progress
            return
        if not self._buffer:
            if byte in (CR, LF):  # F: Micro-Manager sends an LF behind each CR, and works
                return
            if now < self._quiet_since + 0.002 - 1e-9 and self._quiet_since > 0:
                self.put(now, hurried=self.hurried + 1)  # F: 2 ms between commands; no source for what it does to it
        self._buffer.append(byte)
        command = chr(self._buffer[0])
        needed = 1 + ARGUMENTS.get(command, 0)
        if len(self._buffer) <= needed:
            if byte == CR and command not in ARGUMENTS:
                self._buffer.clear()
                self._error(BAD, now)
            return
        line = bytes(self._buffer)
        if byte != CR:
            if len(line) > 32:  # no source for the size of its buffer
                self._buffer.clear()
                self._error(BUFFER, now)  # A: the input buffer is filled and CR has not been received
            return
        self._buffer.clear()
        if command not in ARGUMENTS or len(line) != needed + 1:
            self._error(BAD, now)
            return
        self._command(command, line[1:-1], now)

    def _interrupt(self, byte, now):
        """A byte within a move ends it (A ErrorVals: "a requested move was interrupted by input on the serial port")."""
        self._ends = None
        self._to = list(self.rail)
        self._out.clear()
        self.put(now, interrupts=self.interrupts + 1)
        self.tell(now, "interrupted", self.position)
        if byte == INTERRUPT:
            self._reply(b"=", now)  # N interrupt_move: '=' and the task-complete indicator; F: no further CR for m
        else:
            self._error(BAD | INTERRUPTED, now)  # F: '<' = 8|4 is what an interrupted move gives (Micro-Manager)

    def _command(self, command, arguments, now):
        self.tell(now, "command", command + arguments.hex(" "))
        if command == "V":
            word = struct.unpack("<H", arguments)[0]  # A, N: little-endian; bit 15 is the resolution
            self.put(now, speed=word & 0x7FFF, high_resolution=bool(word & 0x8000), woken=True)
            self._reply(b"", now)
            return
        if not self.woken:
            self.tell(now, "not woken", command)
            return
        if command == "m":
            self._move(struct.unpack("<3i", arguments), now)
        elif command == "c":
            self._reply(struct.pack("<3i", *self.position), now)  # N: 12 bytes and the CR
        elif command == "s":
            self._reply(self._status(), now)
        elif command == "o":
            self.put(now, origin=list(self.rail))
            self._reply(b"", now)
        elif command in "ab":
            self.put(now, absolute=command == "a")
            self._reply(b"", now)
        elif command in "ne":
            self._reply(b"", now)
        else:
            self._reset(now)

    def _reset(self, now):
        self.put(now, woken=not self.needs_velocity, absolute=True)
        if self.reset_reply == "null":
            self.answer(b"\0", now)
        elif self.reset_reply == "error":
            self._error(BAD, now)

    def _move(self, target, now):
        """N: absolute positions from the origin, or relative to the current position, in microsteps."""
        zero = self.origin if self.absolute else self.rail
        goal = [base + each / MICROSTEPS for base, each in zip(zero, target)]
        held = [min(max(each, -TRAVEL), TRAVEL) for each in goal]
        if held != goal:
            self.tell(now, "beyond the travel", goal)  # no source for what the controller does; it stops at the end here
        speed = min(self.speed, 1310 if self.high_resolution else 3000)  # N; A allows 6550 in low resolution
        # no source: that the axis with the longest way keeps the speed
        way = max(abs(b - a) for a, b in zip(self.rail, held))
        self._from, self._to, self._begun = list(self.rail), held, now
        self._ends = now + way / max(speed, 1)
        self.put(now, moves=self.moves + 1)
        self.tell(now, "move", held)
        if way == 0:
            self.advance(now)

    def _status(self):
        """A stat(): names, order and widths; F for the bits."""
        flags = 0x20 if self.absolute else 0
        flags2 = 0x04 if self.high_resolution else 0
        xspeed = self.speed | (0x8000 if self.high_resolution else 0)
        # FLAGS UDIRX UDIRY UDIRZ, ROE_VARI UOFFSET URANGE PULSE USPEED, INDEVICE FLAGS_2,
        # JUMPSPD HIGHSPD DEAD WATCH_DOG STEP_DIV STEP_MUL XSPEED VERSION; no source for the values of most
        return struct.pack("<4B5H2B8H", flags, 0, 2, 4, 4, 7, 200, 10, 1000, 0, flags2, 5000, 200, 10, 128,
                           int(MICROSTEPS), self.step_mul, xspeed, 322)

    def arranged(self, now):
        """A hand may move the stage by the rotary control."""
        if not self.moving:
            self._from = self._to = list(self.rail)


DOUBLE = SutterMp285
