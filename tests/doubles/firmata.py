"""An Arduino Uno that runs StandardFirmata.

Sources, named by their letters at the lines below:
  PRO  github firmata/protocol protocol.md (2.8; the Uno's firmware speaks 2.5)
  INO  github firmata/arduino examples/StandardFirmata/StandardFirmata.ino
  LIB  the same, FirmataParser.cpp, Firmata.cpp, FirmataConstants.h, Boards.h (ATmega328P)
SPDX-License-Identifier: Apache-2.0
"""

from double import ByteDouble

INPUT, OUTPUT, ANALOG, PWM, SERVO, I2C, PULLUP = 0, 1, 2, 3, 4, 6, 11  # PRO, supported modes
PINS, FIRST_ANALOG, ANALOGS = 20, 14, 6  # LIB Boards.h: 14 digital and 6 analog
PWM_PINS = (3, 5, 6, 9, 10, 11)  # Arduino's digitalPinHasPWM of an Uno
PORTS = (PINS + 7) // 8
START, END = 0xF0, 0xF7
MOST_DATA = 64  # LIB MAX_DATA_BYTES
# LIB blinkVersion: each flash 40 + 210 ms, 2 and 5 of them, 250 and 125 ms between. no source for the bootloader's second
BOOT = 1.0 + 2 * 0.25 + 0.25 + 5 * 0.25 + 0.125


def digital(pin):
    """LIB IS_PIN_DIGITAL: not the serial line's."""
    return 2 <= pin <= 19


def analog(pin):
    """LIB IS_PIN_ANALOG."""
    return FIRST_ANALOG <= pin < FIRST_ANALOG + ANALOGS


def pairs(text):
    """PRO: each character as two bytes of seven bits."""
    return bytes(part for each in text.encode("latin-1") for part in (each & 0x7F, each >> 7))


class Firmata(ByteDouble):
    """The board, and what is at its pins."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "name": "StandardFirmata.ino",  # LIB setFirmwareNameAndVersion: what stands before .cpp
        "protocol": "2.5",  # or 2.8: the sampling interval can be asked for (PRO)
        "boot": BOOT,  # s; opening the port resets an Uno: a server of a pseudo-terminal cannot see that, `power_cycle` is it
        "noise": 0,  # counts that the analog inputs jitter, by a rule
        "chatty": False,  # a text message ahead of each answer
    }
    STATE = ("volts", "levels", "modes", "outputs", "duties", "interval_ms", "reported_analog", "reported_ports", "resets",
             "overflows")

    def __init__(self, **options):
        self.volts = [0.0] * ANALOGS  # at A0 to A5
        self.levels = [False] * PINS  # what is put onto each pin from outside
        self.resets = self.overflows = 0
        super().__init__(**options)

    def start(self, now):
        """The bootloader, then setup()."""
        self._ready = now + self.boot
        self._said_hello = False
        self._sysex, self._command, self._data, self._wanted = None, 0, [], 0
        self._pullup = [False] * PINS
        self._latch = [False] * PINS  # what digitalWrite has left in the port
        self.put(now, modes=[OUTPUT] * PINS, duties=[0] * PINS, interval_ms=19)
        self._states = [0] * PINS
        self._reset(now)
        self.now = now

    def _reset(self, now):
        """INO systemResetCallback."""
        self.put(now, modes=[ANALOG if analog(pin) else OUTPUT if digital(pin) else -1 for pin in range(PINS)],
                 reported_analog=0, reported_ports=[False] * PORTS)
        self._states = [0] * PINS
        self._previous = [0] * PORTS
        self._inputs = [0] * PORTS
        self._sampled = max(now, self._ready)  # previousMillis

    @property
    def outputs(self):
        """What the board drives: True, False, or None where it does not."""
        return [self._latch[pin] if mode == OUTPUT else None for pin, mode in enumerate(self.modes)]

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """The end of booting, or the next sampling."""
        if not self._said_hello:
            return self._ready
        return self._sampled + self._interval() if self.reported_analog else None

    def _interval(self):
        return self.interval_ms / 1000

    def advance(self, now):
        """Says hello, and samples."""
        while (event := self.next_event()) is not None and event <= now + 1e-9:
            super().advance(event)
            if not self._said_hello:
                self._said_hello = True
                self._version(event)  # LIB begin(): printVersion, printFirmwareVersion, unasked
                self._firmware(event)
                continue
            self._sampled = event
            for channel in range(ANALOGS):
                if self.reported_analog >> channel & 1 and self.modes[FIRST_ANALOG + channel] == ANALOG:
                    self._analog(channel, event)
        super().advance(now)
        if self._said_hello and not self.reported_analog:
            self._sampled = max(self._sampled, now - self._interval())

    def arranged(self, now):
        """INO checkDigitalInputs: a change of a port that is reported is sent."""
        for port in range(PORTS):
            if self.reported_ports[port]:
                self._port(port, now, False)

    def _read_port(self, port):
        bits = 0
        for bit in range(8):
            pin = port * 8 + bit
            if pin < PINS and self._inputs[port] >> bit & 1:
                bits |= int(bool(self.levels[pin])) << bit
        return bits

    def _port(self, port, now, forced):
        bits = self._read_port(port) & self._inputs[port]
        if forced or bits != self._previous[port]:
            self._previous[port] = bits
            self.answer(bytes([0x90 | port, bits & 0x7F, bits >> 7]), now)  # PRO: digital I/O message

    def _counts(self, channel, now):
        jitter = (int(now * 1000) * 7919 + channel) % (2 * self.noise + 1) - self.noise if self.noise else 0
        # analogRead of an Uno: ten bits of 5 V
        return max(0, min(1023, int(self.volts[channel] / 5.0 * 1024) + jitter))

    def _analog(self, channel, now):
        counts = self._counts(channel, now)
        self.answer(bytes([0xE0 | channel, counts & 0x7F, counts >> 7]), now)

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """LIB FirmataParser::parse. What comes while it boots is lost."""
        if not self._said_hello:
            return
        if self._sysex is not None:
            if byte == END:
                data, self._sysex = bytes(self._sysex), None
                self._system_exclusive(data, now)
            elif len(self._sysex) >= MOST_DATA:
                self.put(now, overflows=self.overflows + 1)  # LIB: what is beyond the buffer is left out
            else:
                self._sysex.append(byte)
        elif self._wanted and byte < 0x80:
            self._data.append(byte)
            self._wanted -= 1
            if not self._wanted:
                self._message(self._command, self._data, now)
        else:
            self._begin(byte, now)

    def _begin(self, byte, now):
        kind = byte & 0xF0 if byte < 0xF0 else byte
        self._command, self._data, self._wanted = byte, [], 0
        if kind in (0xE0, 0x90, 0xF4, 0xF5):
            self._wanted = 2
        elif kind in (0xC0, 0xD0):
            self._wanted = 1
        elif byte == START:
            self._sysex = bytearray()
        elif byte == 0xFF:
            self.put(now, resets=self.resets + 1)
            self._reset(now)
        elif byte == 0xF9:
            self._version(now)

    def _version(self, now):
        self.answer(bytes([0xF9, *(int(each) for each in self.protocol.split("."))]), now)  # LIB FirmataConstants.h: 2.5

    def _firmware(self, now):
        self._say(0x79, bytes([2, 5]) + pairs(self.name), now)  # INO: FIRMATA_FIRMWARE_MAJOR_VERSION, MINOR: 2.5

    def _say(self, kind, data, now):
        self.answer(bytes([START, kind]) + data + bytes([END]), now)

    def _text(self, text, now):
        self._say(0x71, pairs(text), now)

    def _message(self, command, data, now):
        kind, low = command & 0xF0 if command < 0xF0 else command, command & 0x0F
        self.tell(now, "message", bytes([command, *data]))
        if kind == 0xE0:
            self._analog_write(low, data[0] | data[1] << 7, now)
        elif kind == 0x90:
            self._digital_write(low, data[0] | data[1] << 7, now)
        elif kind == 0xC0:
            self._report_analog(low, bool(data[0]), now)
        elif kind == 0xD0 and low < PORTS:
            self.reported_ports = [bool(data[0]) if n == low else each for n, each in enumerate(self.reported_ports)]
            if data[0]:
                self._port(low, now, True)  # PRO: as of 2.4.0 the value is reported at once
        elif kind == 0xF4:
            self._set_mode(data[0], data[1], now)
        elif kind == 0xF5 and data[0] < PINS and self.modes[data[0]] == OUTPUT:
            self._drive(data[0], bool(data[1]), now)  # INO setPinValueCallback

    def _report_analog(self, channel, on, now):
        if channel >= ANALOGS:
            return
        was = self.reported_analog
        self.put(now, reported_analog=was | 1 << channel if on else was & ~(1 << channel))
        if on:
            self._analog(channel, now)  # INO: send pin value immediately

    def _drive(self, pin, level, now):
        self._states[pin] = int(level)
        if self._latch[pin] != level:
            self._latch[pin] = level
            self.tell(now, "pin", [pin, level])

    def _set_mode(self, pin, mode, now):
        """INO setPinModeCallback."""
        if pin >= PINS or self.modes[pin] == -1:
            return
        if analog(pin):
            self._report_analog(pin - FIRST_ANALOG, mode == ANALOG, now)
        allowed = {INPUT: digital(pin), OUTPUT: digital(pin), PULLUP: digital(pin), ANALOG: analog(pin),
                   PWM: pin in PWM_PINS, SERVO: digital(pin), I2C: pin in (18, 19)}
        port, bit = divmod(pin, 8)
        self._inputs[port] = self._inputs[port] | 1 << bit if mode in (INPUT, PULLUP) else self._inputs[port] & ~(1 << bit)
        self._states[pin] = int(mode == PULLUP)
        self._pullup[pin] = mode == PULLUP
        if mode not in allowed:
            self._text("Unknown pin mode", now)
        elif allowed[mode]:
            if mode == OUTPUT and self.modes[pin] == PWM:
                self._latch[pin] = False
            duties = list(self.duties)
            duties[pin] = 0
            self.put(now, modes=[mode if n == pin else each for n, each in enumerate(self.modes)], duties=duties)

    def _analog_write(self, pin, value, now):
        """INO analogWriteCallback."""
        if pin < PINS and self.modes[pin] in (PWM, SERVO):
            self._states[pin] = value
            # analogWrite takes eight bits of what is given
            self.put(now, duties=[(value & 0xFF if self.modes[pin] == PWM else value) if n == pin else each
                                  for n, each in enumerate(self.duties)])

    def _digital_write(self, port, bits, now):
        """INO digitalWriteCallback."""
        for bit in range(8):
            pin = port * 8 + bit
            if pin >= PINS or not digital(pin):
                continue
            if self.modes[pin] == OUTPUT:
                self._drive(pin, bool(bits >> bit & 1), now)
            elif self.modes[pin] == INPUT:
                self._pullup[pin] = self._pullup[pin] or bool(bits >> bit & 1)
                self._states[pin] = bits >> bit & 1

    # -- sysex -----------------------------------------------------------------------------------------------

    def _system_exclusive(self, data, now):
        self.tell(now, "sysex", data)
        if not data:
            return
        if self.chatty:
            self._text("I2C: Too few bytes received", now)  # INO: one of the texts that it sends
        kind, rest = data[0], data[1:]
        if kind == 0x79:
            self._firmware(now)  # LIB
        elif kind == 0x7A and len(rest) > 1:
            self.put(now, interval_ms=max(1, rest[0] | rest[1] << 7))  # INO MINIMUM_SAMPLING_INTERVAL
        elif kind == 0x7C and self.protocol == "2.8":
            self._say(0x7A, bytes([self.interval_ms & 0x7F, self.interval_ms >> 7]), now)  # PRO
        elif kind == 0x6F and len(rest) > 1:
            value = rest[1] | (rest[2] << 7 if len(rest) > 2 else 0) | (rest[3] << 14 if len(rest) > 3 else 0)
            self._analog_write(rest[0], value, now)
        elif kind == 0x6B:
            self._say(0x6C, b"".join(self._modes_of(pin) + b"\x7f" for pin in range(PINS)), now)
        elif kind == 0x69:
            self._say(0x6A, bytes(pin - FIRST_ANALOG if analog(pin) else 127 for pin in range(PINS)), now)
        elif kind == 0x6D and rest:
            self._pin_state(rest[0], now)

    @staticmethod
    def _modes_of(pin):
        """INO CAPABILITY_QUERY: in this order."""
        modes = b""
        if digital(pin):
            modes += bytes([INPUT, 1, PULLUP, 1, OUTPUT, 1])
        if analog(pin):
            modes += bytes([ANALOG, 10])
        if pin in PWM_PINS:
            modes += bytes([PWM, 8])
        if digital(pin):
            modes += bytes([SERVO, 14])
        if pin in (18, 19):
            modes += bytes([I2C, 1])
        return modes

    def _pin_state(self, pin, now):
        answer = bytes([pin])
        if pin < PINS:
            state = self._states[pin]
            answer += bytes([max(self.modes[pin], 0), state & 0x7F])
            answer += bytes([state >> 7 & 0x7F]) if state & 0xFF80 else b""
            answer += bytes([state >> 14 & 0x7F]) if state & 0xC000 else b""
        self._say(0x6E, answer, now)


DOUBLE = Firmata
