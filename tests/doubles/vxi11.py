"""A VXI-11 instrument server: ONC RPC on TCP, a port mapper, the core channel and the abort channel.

Sources, named by their letters at the lines below:
  VXI   VXI-11 TCP/IP Instrument Protocol 1.0 (VXIbus Consortium 1995), chapter B (procedures, errors, flags) as repeated
        in github python-ivi/python-vxi11 vxi11/vxi11.py
  RPC   RFC 5531 (calls, replies, record marking), RFC 4506 (XDR), RFC 1833 (port mapper), and rpc.py of the same
SPDX-License-Identifier: Apache-2.0
"""

import struct

PMAP, CORE, ASYNC = 100000, 0x0607AF, 0x0607B0  # RPC, VXI
VERSIONS = {PMAP: 2, CORE: 1, ASYNC: 1}
END, TERMCHAR, WAIT_LOCK = 8, 128, 1  # VXI B.5.3: flags
REQCNT, CHR, READ_END = 1, 2, 4  # VXI B.6.4: reasons
NOT_ACCESSIBLE, INVALID_LINK, PARAMETER, NOT_SUPPORTED, LOCKED, NO_LOCK, TIMEOUT, ABORT = 3, 4, 5, 8, 11, 12, 15, 23  # VXI B.5.2
MOST = 1024  # bytes of one device_write; VXI rule B.6.3: at least 1024
SUCCESS, PROG_UNAVAIL, PROG_MISMATCH, PROC_UNAVAIL, GARBAGE = 0, 1, 2, 3, 4  # RPC


class Garbage(Exception):
    """Arguments that cannot be taken apart."""


class Xdr:
    """Takes XDR apart."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def uint(self):
        """32 bits, high byte first."""
        if self.at + 4 > len(self.data):
            raise Garbage
        self.at += 4
        return struct.unpack_from(">I", self.data, self.at - 4)[0]

    def opaque(self):
        """A length and bytes, padded to four."""
        size = self.uint()
        if self.at + size > len(self.data):
            raise Garbage
        data = bytes(self.data[self.at:self.at + size])
        self.at += (size + 3) // 4 * 4
        return data


def uints(*values):
    """XDR of unsigned numbers."""
    return struct.pack(f">{len(values)}I", *values)


def opaque(data):
    """XDR of bytes."""
    return uints(len(data)) + data + bytes(-len(data) % 4)


class Vxi11:
    """The server without its sockets. A channel is any hashable thing; its kind is core, abort, portmap or datagram."""

    def __init__(self, instrument, ports, strict=True):
        self.instrument, self.ports, self.strict = instrument, ports, strict
        self.kinds, self.buffers, self.records = {}, {}, {}
        self.links = {}  # number -> channel
        self.lock = None  # the link that has locked
        self.waiting = {}  # channel -> (xid, function to try again, until, what to answer then, link)
        self.calls = {}  # channel -> calls behind a waiting one
        self._last_link = 0
        self._out = []

    # -- connections ---------------------------------------------------------------------------------------

    def connected(self, channel, kind):
        """A client has come."""
        self.kinds[channel], self.buffers[channel], self.records[channel] = kind, bytearray(), bytearray()
        self.calls[channel] = []

    def closed(self, channel):
        """VXI B.4.7: links and locks of a connection that is gone are gone."""
        for link in [each for each, owner in self.links.items() if owner == channel]:
            self._destroy(link)
        for table in (self.kinds, self.buffers, self.records, self.calls, self.waiting):
            table.pop(channel, None)

    def receive(self, channel, data, now):
        """Bytes of a client: RPC records on TCP, a call each datagram."""
        if self.kinds[channel] == "datagram":
            self._call(channel, data, now)
            return
        buffer = self.buffers[channel]
        buffer += data
        while len(buffer) >= 4:
            # RPC 11: record marking: the high bit marks the last fragment
            head = struct.unpack_from(">I", buffer)[0]
            size = head & 0x7FFFFFFF
            if len(buffer) < 4 + size:
                break
            self.records[channel] += buffer[4:4 + size]
            del buffer[:4 + size]
            if head & 0x80000000:
                record, self.records[channel] = bytes(self.records[channel]), bytearray()
                if channel in self.waiting or self.calls[channel]:
                    self.calls[channel].append(record)
                else:
                    self._call(channel, record, now)
                if channel not in self.kinds:
                    return

    def say(self, now):
        """What is due: a list of (channel, bytes)."""
        self.instrument.poll(now)
        for channel in list(self.waiting):
            self._again(channel, now)
        told, self._out = self._out, []
        return told

    def next(self):
        """When something may be due."""
        times = [each[2] for each in self.waiting.values()]
        event = self.instrument.double.next()
        return min(times + ([event] if event is not None else []), default=None)

    def _again(self, channel, now):
        while (entry := self.waiting.get(channel)) is not None:
            xid, attempt, until, late, _ = entry
            answer = attempt(now)
            if self.waiting.get(channel) is not entry:
                continue  # what was waited for waits for something else now
            if answer is None and now < until:
                return
            del self.waiting[channel]
            self._reply(channel, xid, SUCCESS, late if answer is None else answer)
            if self.calls.get(channel):
                self._call(channel, self.calls[channel].pop(0), now)

    def _reply(self, channel, xid, status, body=b""):
        # RPC 9: REPLY, MSG_ACCEPTED, a verifier of none
        self._send(channel, uints(xid, 1, 0, 0, 0, status) + body)

    def _send(self, channel, record):
        mark = b"" if self.kinds.get(channel) == "datagram" else uints(0x80000000 | len(record))
        self._out.append((channel, mark + record))

    # -- calls -----------------------------------------------------------------------------------------------

    def _call(self, channel, record, now):
        xdr = Xdr(record)
        try:
            xid, kind, version = xdr.uint(), xdr.uint(), xdr.uint()
            if kind != 0:
                return
            if version != 2:
                self._send(channel, uints(xid, 1, 1, 0, 2, 2))  # RPC: MSG_DENIED, RPC_MISMATCH, 2 to 2
                return
            program, its_version, procedure = xdr.uint(), xdr.uint(), xdr.uint()
            for _ in range(2):  # credentials, verifier
                xdr.uint()
                xdr.opaque()
        except Garbage:
            return
        served = {"core": CORE, "abort": ASYNC, "portmap": PMAP, "datagram": PMAP}[self.kinds[channel]]
        if program != served:
            self._reply(channel, xid, PROG_UNAVAIL)
        elif its_version != VERSIONS[program]:
            self._reply(channel, xid, PROG_MISMATCH, uints(VERSIONS[program], VERSIONS[program]))
        elif procedure == 0:
            self._reply(channel, xid, SUCCESS)
        else:
            self._procedure(channel, xid, program, procedure, xdr, now)

    def _procedure(self, channel, xid, program, procedure, xdr, now):
        act = {PMAP: {3: self._getport, 4: self._dump}, ASYNC: {1: self._abort}, CORE: {
            10: self._create_link, 11: self._write, 12: self._read, 13: self._readstb, 14: self._trigger, 15: self._clear,
            16: self._remote, 17: self._remote, 18: self._lock, 19: self._unlock, 20: self._not_supported,
            22: self._docmd, 23: self._destroy_link, 25: self._not_supported, 26: self._not_supported}}[program].get(procedure)
        if act is None:
            self._reply(channel, xid, PROC_UNAVAIL)
            return
        try:
            answer = act(channel, xid, xdr, now)
        except Garbage:
            self._reply(channel, xid, GARBAGE)
            return
        if answer is not None:
            self._reply(channel, xid, SUCCESS, answer)

    def _getport(self, channel, xid, xdr, now):
        """RPC 1833 3: program, version, protocol (6 is TCP), 0 -> port, 0 when there is none."""
        program, version, protocol, _ = (xdr.uint() for _ in range(4))
        port = self.ports.get({CORE: "core", ASYNC: "abort", PMAP: "portmap"}.get(program), 0)
        return uints(port if version == VERSIONS.get(program) and protocol == 6 else 0)

    def _dump(self, channel, xid, xdr, now):
        rows = [(PMAP, 2, 6, self.ports["portmap"]), (PMAP, 2, 17, self.ports["portmap"]), (CORE, 1, 6, self.ports["core"])]
        return b"".join(uints(1, *row) for row in rows) + uints(0)

    def _wait(self, channel, xid, attempt, milliseconds, late, link, now):
        """Answers when it can, or when the time is over; calls behind it on the same connection wait."""
        self.waiting[channel] = (xid, attempt, now + milliseconds / 1000, late, link)
        self._again(channel, now)

    def _locked(self, link):
        return self.lock is not None and self.lock != link

    def _guarded(self, channel, xid, link, flags, lock_timeout, failed, act, now):
        """VXI B.5.4: an operation of a link; where another holds the lock it waits, or is refused."""
        if link not in self.links:
            return failed(INVALID_LINK)
        if not self._locked(link):
            return act(now)
        if flags & WAIT_LOCK:
            self._wait(channel, xid, lambda later: None if self._locked(link) else act(later), lock_timeout, failed(LOCKED),
                       link, now)
            return None
        return failed(LOCKED)

    # -- the core channel ------------------------------------------------------------------------------------

    def _create_link(self, channel, xid, xdr, now):
        xdr.uint()  # the client's number
        wants_lock, timeout, device = xdr.uint(), xdr.uint(), xdr.opaque()
        if device.lower() != b"inst0":  # VXI: the instrument itself; no source for capitals
            return uints(NOT_ACCESSIBLE, 0, self.ports["abort"], MOST)
        if wants_lock and self.lock is not None:
            if not timeout:
                return uints(LOCKED, 0, self.ports["abort"], MOST)
            self._wait(channel, xid, lambda later: None if self.lock is not None else self._new_link(channel, True), timeout,
                       uints(LOCKED, 0, self.ports["abort"], MOST), None, now)
            return None
        return self._new_link(channel, bool(wants_lock))

    def _new_link(self, channel, locks):
        self._last_link += 1
        self.links[self._last_link] = channel
        if locks:
            self.lock = self._last_link
        return uints(0, self._last_link, self.ports["abort"], MOST)

    def _destroy(self, link):
        self.links.pop(link, None)
        if self.lock == link:
            self.lock = None

    def _destroy_link(self, channel, xid, xdr, now):
        link = xdr.uint()
        if link not in self.links:
            return uints(INVALID_LINK)
        self._destroy(link)
        return uints(0)

    def _write(self, channel, xid, xdr, now):
        link, _, lock_timeout, flags, data = xdr.uint(), xdr.uint(), xdr.uint(), xdr.uint(), xdr.opaque()
        if len(data) > MOST and self.strict:
            return uints(PARAMETER, 0)  # VXI B.6.3: more than maxRecvSize

        def act(when):
            self.instrument.write(data, bool(flags & END), when)
            return uints(0, len(data))

        return self._guarded(channel, xid, link, flags, lock_timeout, lambda error: uints(error, 0), act, now)

    def _read(self, channel, xid, xdr, now):
        link, size, timeout, lock_timeout, flags, letter = (xdr.uint() for _ in range(6))
        terminator = bytes([letter & 0xFF]) if flags & TERMCHAR else None

        def failed(error):
            return uints(error, 0) + opaque(b"")

        def attempt(when):
            self.instrument.poll(when)
            got = self.instrument.read(size, terminator)
            if got is None:
                return None
            data, ended, cut = got
            reason = (REQCNT if len(data) == size else 0) | (CHR if cut else 0) | (READ_END if ended else 0)
            return uints(0, reason) + opaque(data)

        def act(when):
            self._wait(channel, xid, attempt, timeout, failed(TIMEOUT), link, when)

        return self._guarded(channel, xid, link, flags, lock_timeout, failed, act, now)

    def _generic(self, xdr):
        link, flags, lock_timeout, timeout = (xdr.uint() for _ in range(4))
        return link, flags, lock_timeout, timeout

    def _readstb(self, channel, xid, xdr, now):
        link, flags, lock_timeout, _ = self._generic(xdr)
        return self._guarded(channel, xid, link, flags, lock_timeout, lambda error: uints(error, 0),
                             lambda when: uints(0, self.instrument.status(when)), now)

    def _simple(self, channel, xid, xdr, now, act):
        link, flags, lock_timeout, _ = self._generic(xdr)

        def done(when):
            act(when)
            return uints(0)

        return self._guarded(channel, xid, link, flags, lock_timeout, uints, done, now)

    def _trigger(self, channel, xid, xdr, now):
        return self._simple(channel, xid, xdr, now, self.instrument.trigger)

    def _clear(self, channel, xid, xdr, now):
        return self._simple(channel, xid, xdr, now, self.instrument.clear)

    def _remote(self, channel, xid, xdr, now):
        return self._simple(channel, xid, xdr, now, lambda when: None)

    def _lock(self, channel, xid, xdr, now):
        link, flags, timeout = (xdr.uint() for _ in range(3))
        if self.lock == link and link in self.links:
            return uints(LOCKED)  # VXI B.6.10: a link that has the lock asks again

        def act(when):
            self.lock = link
            return uints(0)

        return self._guarded(channel, xid, link, flags, timeout, uints, act, now)

    def _unlock(self, channel, xid, xdr, now):
        link = xdr.uint()
        if link not in self.links:
            return uints(INVALID_LINK)
        if self.lock != link:
            return uints(NO_LOCK)
        self.lock = None
        return uints(0)

    def _not_supported(self, channel, xid, xdr, now):
        return uints(NOT_SUPPORTED)  # no interrupt channel here

    def _docmd(self, channel, xid, xdr, now):
        return uints(NOT_SUPPORTED) + opaque(b"")

    def _abort(self, channel, xid, xdr, now):
        """VXI B.6.15: what is in progress on the link ends with error 23."""
        link = xdr.uint()
        if link not in self.links:
            return uints(INVALID_LINK)
        for other, (number, _, _, late, its) in list(self.waiting.items()):
            if its == link:
                del self.waiting[other]
                self._reply(other, number, SUCCESS, uints(ABORT) + late[4:])
        return uints(0)
