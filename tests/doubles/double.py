"""The frame that every double of an instrument stands in: options, physical state, history, delayed answers.

A double has no I/O and no clock of its own: every call brings the time in seconds.
SPDX-License-Identifier: Apache-2.0
"""

import errno


class Refused(ValueError):
    """A name or value that a test asked for and the double does not have."""


def of_type(text, example, name):
    """Returns the text of an option as a value of the example's type."""
    if not isinstance(text, str) or isinstance(example, str):
        return text
    if isinstance(example, bool):
        if text.lower() not in ("0", "1", "false", "true", "off", "on", "no", "yes"):
            raise Refused(f"{name}: '{text}' is not a truth value")
        return text.lower() in ("1", "true", "on", "yes")
    try:
        return type(example)(text)
    except ValueError as error:
        raise Refused(f"{name}: '{text}' is not of type {type(example).__name__}") from error


class Double:
    """The part that all doubles share: options, state, history."""

    # What the maker lets one switch or what a test may vary: name -> default.
    OPTIONS = {"late": 0.0}
    # Names of attributes that are the physical state; they are told by `state` and may be set by a test.
    STATE = ()

    def __init__(self, **options):
        self.history = []
        self.now = 0.0
        for name, default in self.OPTIONS.items():
            setattr(self, name, default)
        self.mode(**options)
        self.start(0.0)

    def start(self, now):
        """Gives every attribute of STATE the value it has after power-up."""

    def power_cycle(self, now):
        """Takes the power away and gives it back: only lasting settings survive."""
        self.tell(now, "power", "cycled")
        self.start(now)

    def mode(self, **options):
        """Changes options; raises Refused for a name the double does not have."""
        for name, value in options.items():
            if name not in self.OPTIONS:
                raise Refused(f"no option '{name}'; there are {', '.join(sorted(self.OPTIONS))}")
            setattr(self, name, of_type(value, self.OPTIONS[name], name))

    def tell(self, now, name, value):
        """Adds one line to the history."""
        if isinstance(value, (bytes, bytearray)):
            value = value.hex(" ")
        if isinstance(value, (list, tuple)):
            value = list(value)
        if isinstance(value, dict):
            value = dict(value)
        self.history.append([now, name, value])

    def put(self, now, **changes):
        """Sets attributes and writes those that changed into the history."""
        for name, value in changes.items():
            if not hasattr(self, name) or getattr(self, name) != value:
                setattr(self, name, value)
                self.tell(now, name, value)

    def arrange(self, now, **changes):
        """What a test does to the instrument from outside: turns a knob, changes the load, pulls a wire."""
        self.advance(now)
        for name, value in changes.items():
            if name in self.OPTIONS:
                self.mode(**{name: value})
            elif name in self.STATE and isinstance(getattr(type(self), name, None), property):
                raise Refused(f"'{name}' can be asked for but not set")
            elif name in self.STATE:
                self.put(now, **{name: value})
            else:
                raise Refused(f"nothing named '{name}' to set; there are {', '.join(sorted(self.STATE))}")
        self.arranged(now)

    def arranged(self, now):
        """What follows at once from a change made from outside."""

    def advance(self, now):
        """Brings the physical state to this time."""
        self.now = max(self.now, now)

    def next_event(self):
        """The time at which the state changes or something is said without being asked, or None."""
        return None

    def state(self, now):
        """The physical state as plain data."""
        self.advance(now)
        return {name: plain(getattr(self, name)) for name in self.STATE}


def plain(value):
    """Turns bytes, tuples and sets into what JSON can carry."""
    if isinstance(value, (bytes, bytearray)):
        return value.hex(" ")
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    return value


class ByteDouble(Double):
    """A double at the end of a serial line or a TCP connection."""

    OPTIONS = {
        **Double.OPTIONS,
        "strict": True,
        "nulls": 0,  # bytes of zero on the line at power-up, as many line drivers make
        "banner": "",  # a text at power-up
        "pieces": 0,  # bytes at a time of what is said, as a USB converter or a network cuts it; 0: whole
        "gap": 0.005,  # s between two pieces
    }

    def __init__(self, **options):
        self._out = []
        super().__init__(**options)
        self.greet(0.0)

    def greet(self, now):
        """What stands on the line after power-up before anything was asked."""
        noise = b"\0" * self.nulls + self.banner.encode("latin-1")
        if noise:
            self.answer(noise, now)

    def power_cycle(self, now):
        """Also forgets what it was about to say."""
        self._out.clear()
        super().power_cycle(now)
        self.greet(now)

    def receive(self, data, now):
        """Takes bytes from the line."""
        for byte in data:
            self.advance(now)
            self.take(byte, now)

    def take(self, byte, now):
        """Takes one byte; the instrument's parser."""
        raise NotImplementedError

    def answer(self, data, now, after=0.0):
        """Puts bytes on the line `late` + `after` seconds from now, behind what is already waiting."""
        due = now + self.late + after
        if self._out:
            due = max(due, self._out[-1][0])
        step = self.pieces or len(data) or 1
        for number, start in enumerate(range(0, len(data) or 1, step)):
            self._out.append((due + number * self.gap, bytes(data[start:start + step])))

    def say(self, now):
        """What the instrument has sent up to now, as a list of (time, bytes), each told once."""
        self.advance(now)
        due = [each for each in self._out if each[0] <= now]
        self._out = [each for each in self._out if each[0] > now]
        return due

    def next(self):
        """The time of the next thing that will happen by itself, or None."""
        times = [each[0] for each in self._out[:1]]
        event = self.next_event()
        if event is not None:
            times.append(event)
        return min(times, default=None)


class HidDouble(Double):
    """A double at the end of a HID connection. Byte 0 of a report is its id, or 0 where the device has no ids."""

    OPTIONS = {
        **Double.OPTIONS,
        "strict": True,
        # Which layer of the host writes: Linux hidraw refuses writes of fewer than two bytes, libusb does not.
        "host": "hidraw",
    }
    VENDOR = 0
    PRODUCT = 0

    def __init__(self, **options):
        self._in = []
        super().__init__(**options)

    def power_cycle(self, now):
        """Also forgets what it was about to report."""
        self._in.clear()
        super().power_cycle(now)

    def output(self, report, now):
        """Takes one write of the host; returns the bytes taken, or a negative errno of the host's layer."""
        self.advance(now)
        # Linux drivers/hid/hidraw.c hidraw_send_report(): count < 2 -> EINVAL "passed too short report"
        if self.host == "hidraw" and len(report) < 2:
            self.tell(now, "refused by hidraw", bytes(report))
            return -errno.EINVAL
        if not report:
            return -errno.EINVAL
        return self.report_out(bytes(report), now)

    def report_out(self, report, now):
        """Takes one output report; returns the bytes taken or a negative errno."""
        self.tell(now, "refused", report)
        return -errno.EPIPE  # no source: an interrupt OUT endpoint that is not there gives EPIPE in usbhid

    def feature(self, report, now):
        """Takes one feature report; returns the bytes taken or a negative errno."""
        self.tell(now, "refused feature", bytes(report))
        return -errno.EPIPE  # kernel: a stalled SET_REPORT is EPIPE (facts/kernel_guest.md)

    def get_feature(self, report_id, now):
        """Returns a feature report, or a negative errno."""
        return -errno.EPIPE  # as above

    def report(self, data, now, after=0.0):
        """Queues one input report."""
        if len(self._in) >= 64:  # Linux include/linux/hidraw.h HIDRAW_BUFFER_SIZE: what comes then is lost
            self.tell(now, "lost report", bytes(data))
            return
        due = now + self.late + after
        if self._in:
            due = max(due, self._in[-1][0])
        self._in.append((due, bytes(data)))

    def input(self, now):
        """The next input report that is due, or None."""
        self.advance(now)
        if self._in and self._in[0][0] <= now:
            return self._in.pop(0)[1]
        return None

    def next(self):
        """The time of the next input report or change, or None."""
        times = [each[0] for each in self._in[:1]]
        event = self.next_event()
        if event is not None:
            times.append(event)
        return min(times, default=None)


STALL = -errno.EPIPE  # libusb: a stalled control transfer is LIBUSB_ERROR_PIPE, in the kernel EPIPE
TIMED_OUT = -errno.ETIMEDOUT
GONE = -errno.ENODEV


class UsbDouble(Double):
    """A double that is asked by control transfers."""

    OPTIONS = {**Double.OPTIONS, "strict": True}
    VENDOR = 0
    PRODUCT = 0

    def control(self, request_type, request, value, index, length_or_data, now):
        """One control transfer: for IN a length is given and (result, data) returned, for OUT the data is given.

        The result is the number of bytes moved or a negative errno (STALL, TIMED_OUT, GONE)."""
        raise NotImplementedError

    def delay(self):
        """Seconds that the last transfer takes before it is answered."""
        return self.late

    def next(self):
        """The time of the next change, or None."""
        return self.next_event()


class RegisterDouble(Double):
    """A double that is a map of 32-bit registers and gives images: an IIDC camera."""

    OPTIONS = {**Double.OPTIONS, "strict": True}

    def read(self, offset, now):
        """The register at that offset in bytes."""
        raise NotImplementedError

    def write(self, offset, value, now):
        """Writes the register at that offset in bytes."""
        raise NotImplementedError

    def images(self, now):
        """The images that have arrived by now, each told once: (time, number, start of exposure, width, height, bytes)."""
        raise NotImplementedError

    def next(self):
        """The time of the next image, or None."""
        return self.next_event()
