"""What VXI-11 and HiSLIP have in common: an instrument of text messages, its answers and who has locked it.

SPDX-License-Identifier: Apache-2.0
"""

from double import ByteDouble, Refused


class LanInstrument:
    """A byte double taken message by message: a message ends with a line feed, or with END."""

    def __init__(self, double):
        if not isinstance(double, ByteDouble):
            raise Refused("only an instrument of text messages can be on VXI-11 or HiSLIP")
        self.double = double
        self.waiting = bytearray()  # answers that are not read yet
        self._asserted = False

    def write(self, data, end, now):
        """Bytes of a program message."""
        self.double.receive(data + (b"\n" if end and not data.endswith(b"\n") else b""), now)
        self.poll(now)

    def poll(self, now):
        """Collects the answers that are due."""
        for _, data in self.double.say(now):
            self.waiting += data

    def read(self, most, terminator=None):
        """(bytes, whether they end a response, whether they end with the terminator), or None when there are none."""
        if not self.waiting:
            return None
        size = min(most, len(self.waiting))
        line = self.waiting.find(b"\n")
        if line >= 0:
            size = min(size, line + 1)
        if terminator is not None and terminator in self.waiting[:size]:
            size = self.waiting.index(terminator) + 1
        data = bytes(self.waiting[:size])
        del self.waiting[:size]
        return data, data.endswith(b"\n"), terminator is not None and data.endswith(terminator)

    def status(self, now):
        """The status byte; the answers that wait here are not read either: MAV."""
        bits = self.double.status_byte(now) if hasattr(self.double, "status_byte") else 0
        return bits | (16 if self.waiting else 0)

    def asks_for_service(self, now):
        """The status byte when bit 6 has just come, or None."""
        bits = self.status(now)
        was, self._asserted = self._asserted, bool(bits & 64)
        return bits if self._asserted and not was else None

    def interrupt(self, now):
        """IEEE 488.2 6.3.2.3: a message before the response was read."""
        self.waiting.clear()
        if hasattr(self.double, "interrupted"):
            self.double.interrupted(now)

    def clear(self, now):
        """Device clear."""
        self.waiting.clear()
        if hasattr(self.double, "clear_input"):
            self.double.clear_input(now)

    def trigger(self, now):
        """Group execute trigger."""
        if hasattr(self.double, "trigger"):
            self.double.trigger(now)
