"""A HiSLIP instrument server in synchronized mode.

Sources, named by their letters at the lines below:
  IVI  IVI-6.1: High-Speed LAN Instrument Protocol 1.1 and 2.0, tables 2 to 5 and chapters 3 and 6, as repeated in the
       clients of pyvisa-py (protocols/hislip.py, which quotes it) and MSL and in Wireshark's packet-hislip.c
SPDX-License-Identifier: Apache-2.0
"""

import struct

(INITIALIZE, INITIALIZE_RESPONSE, FATAL, ERROR, LOCK, LOCK_RESPONSE, DATA, DATA_END, CLEAR_COMPLETE, CLEAR_ACKNOWLEDGE,
 REMOTE, REMOTE_RESPONSE, TRIGGER, INTERRUPTED, ASYNC_INTERRUPTED, MOST_SIZE, MOST_SIZE_RESPONSE, ASYNC_INITIALIZE,
 ASYNC_INITIALIZE_RESPONSE, ASYNC_CLEAR, SERVICE_REQUEST, STATUS_QUERY, STATUS_RESPONSE, ASYNC_CLEAR_ACKNOWLEDGE, LOCK_INFO,
 LOCK_INFO_RESPONSE) = range(26)  # IVI table 4
HEADER = struct.Struct(">2sBBIQ")  # IVI table 2: HS, type, control code, parameter, length of the payload
POOR_HEADER, NOT_BOTH, WRONG_START, TOO_MANY = 1, 2, 3, 4  # IVI: fatal errors
BAD_TYPE, BAD_CONTROL, TOO_LARGE = 1, 2, 4  # IVI: errors
VERSION = 0x0100
VENDOR = 0x5644  # two letters; no source: any that is not taken
MOST = 1 << 20


class Session:
    """One client: its two channels."""

    def __init__(self, number, sync):
        self.number, self.sync, self.other = number, sync, None
        self.most = MOST  # what the client takes
        self.last = 0xFFFFFF00 - 2  # its last message's number
        self.unread = False  # a whole response went out and its end has not been told as delivered
        self.clearing = False
        self.locks = False


class Hislip:
    """The server without its sockets; a channel is any hashable thing."""

    def __init__(self, instrument, clients=2, chatty=False):
        self.instrument, self.clients, self.chatty = instrument, clients, chatty
        self.buffers, self.sessions = {}, {}
        self.roles = {}  # channel -> (session, "sync" or "async")
        self._asking = None  # the session whose query is being answered
        self._waits = []  # (session, until): locks
        self._last = 0
        self._out = []

    # -- connections ---------------------------------------------------------------------------------------

    def connected(self, channel, kind):
        """A client has come."""
        self.buffers[channel] = bytearray()

    def closed(self, channel):
        """A channel is gone: so is its session, with its locks (IVI 3.2)."""
        self.buffers.pop(channel, None)
        session, _ = self.roles.pop(channel, (None, None))
        if session is None:
            return
        self.sessions.pop(session.number, None)
        session.locks = False
        self._waits = [each for each in self._waits if each[0] is not session]
        other = session.other if channel == session.sync else session.sync
        if other in self.roles:
            del self.roles[other]
            self._out.append((other, None))

    def receive(self, channel, data, now):
        """Bytes of a client."""
        buffer = self.buffers[channel]
        buffer += data
        while channel in self.buffers and len(buffer) >= HEADER.size:
            mark, kind, control, parameter, length = HEADER.unpack_from(buffer)
            if mark != b"HS":
                self._fatal(channel, POOR_HEADER)
                return
            if length > 4 * MOST:
                self._fatal(channel, POOR_HEADER)
                return
            if len(buffer) < HEADER.size + length:
                return
            payload = bytes(buffer[HEADER.size:HEADER.size + length])
            del buffer[:HEADER.size + length]
            self._message(channel, kind, control, parameter, payload, now)

    def say(self, now):
        """What is due: a list of (channel, bytes); None instead of bytes closes the channel."""
        self.instrument.poll(now)
        self._answers()
        for each in [each for each in self._waits if each[1] <= now]:
            self._waits.remove(each)
            self._send(each[0].other, LOCK_RESPONSE, 0, 0)  # IVI: failure: the time is over
        bits = self.instrument.asks_for_service(now)
        if bits is not None:
            for session in self.sessions.values():
                if session.other is not None:
                    self._send(session.other, SERVICE_REQUEST, bits, 0)
        told, self._out = self._out, []
        return told

    def next(self):
        """When something may be due."""
        times = [each[1] for each in self._waits]
        event = self.instrument.double.next()
        return min(times + ([event] if event is not None else []), default=None)

    def _send(self, channel, kind, control, parameter, payload=b""):
        self._out.append((channel, HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload))

    def _fatal(self, channel, code):
        self._send(channel, FATAL, code, 0, b"fatal")  # no source for the text
        self._out.append((channel, None))
        self.closed(channel)

    # -- messages --------------------------------------------------------------------------------------------

    def _message(self, channel, kind, control, parameter, payload, now):
        if channel not in self.roles:
            self._first(channel, kind, parameter, payload)
            return
        session, role = self.roles[channel]
        if session.other is None:
            self._fatal(channel, NOT_BOTH)
            return
        act = {"sync": {DATA: self._data, DATA_END: self._data, TRIGGER: self._trigger, CLEAR_COMPLETE: self._cleared},
               "async": {LOCK: self._lock, REMOTE: self._remote, MOST_SIZE: self._most, ASYNC_CLEAR: self._clear,
                         STATUS_QUERY: self._status, LOCK_INFO: self._lock_info}}[role].get(kind)
        if kind in (ERROR, FATAL):
            if kind == FATAL:
                self._out.append((channel, None))
                self.closed(channel)
        elif act is None:
            self._send(channel, ERROR, BAD_TYPE, 0, b"unrecognized message type")
        else:
            act(session, kind, control, parameter, payload, now)

    def _first(self, channel, kind, parameter, payload):
        """IVI 6.1: Initialize on the first connection, AsyncInitialize with its session's number on the second."""
        if kind == INITIALIZE:
            if payload not in (b"", b"hislip0"):
                self._fatal(channel, WRONG_START)  # no source for the code
            elif len(self.sessions) >= self.clients:
                self._fatal(channel, TOO_MANY)
            else:
                self._last = self._last % 0xFFFF + 1
                session = Session(self._last, channel)
                self.sessions[session.number], self.roles[channel] = session, (session, "sync")
                version = min(VERSION, parameter >> 16)
                self._send(channel, INITIALIZE_RESPONSE, 0, version << 16 | session.number)  # 0: synchronized mode
        elif kind == ASYNC_INITIALIZE and parameter in self.sessions and self.sessions[parameter].other is None:
            session = self.sessions[parameter]
            session.other, self.roles[channel] = channel, (session, "async")
            self._send(channel, ASYNC_INITIALIZE_RESPONSE, 0, VENDOR)
        else:
            self._fatal(channel, WRONG_START)

    # -- the synchronous channel -------------------------------------------------------------------------------

    def _interrupts(self, session, control, parameter, now):
        """IVI 3.1.1: a message before the response was delivered: the response is gone, and the client is told."""
        if control & 1:
            session.unread = False
        if self.instrument.waiting or session.unread:
            self.instrument.interrupt(now)
            session.unread = False
            self._send(session.sync, INTERRUPTED, 0, parameter)
            self._send(session.other, ASYNC_INTERRUPTED, 0, parameter)

    def _data(self, session, kind, control, parameter, payload, now):
        if session.clearing:
            return  # IVI 3.1.3: discarded until DeviceClearComplete
        if len(payload) > MOST:
            self._send(session.sync, ERROR, TOO_LARGE, 0, b"message too large")
            return
        self._interrupts(session, control, parameter, now)
        session.last, self._asking = parameter, session
        if any(each.locks for each in self.sessions.values()) and not session.locks:
            self._send(session.sync, ERROR, 0, 0, b"locked")  # no source: a client without the lock waits in truth
            return
        self.instrument.write(payload, kind == DATA_END, now)

    def _answers(self):
        """IVI 6.3: Data and DataEND with the number of the message that asked."""
        session = self._asking
        if session is None or session.number not in self.sessions:
            return
        while (got := self.instrument.read(max(1, session.most - HEADER.size))) is not None:
            data, ended, _ = got
            if self.chatty and ended:
                # an answer to an earlier message: a client has to discard it (IVI 3.1.2 rule 4)
                self._send(session.sync, DATA_END, 0, session.last - 2 & 0xFFFFFFFF, b"stale\n")
            self._send(session.sync, DATA_END if ended else DATA, 0, session.last, data)
            session.unread = session.unread or ended

    def _trigger(self, session, kind, control, parameter, payload, now):
        self._interrupts(session, control, parameter, now)
        session.last = parameter
        self.instrument.trigger(now)

    def _cleared(self, session, kind, control, parameter, payload, now):
        session.clearing, session.unread = False, False
        self._send(session.sync, CLEAR_ACKNOWLEDGE, 0, 0)

    # -- the asynchronous channel ------------------------------------------------------------------------------

    def _clear(self, session, kind, control, parameter, payload, now):
        session.clearing = True
        self.instrument.clear(now)
        self._send(session.other, ASYNC_CLEAR_ACKNOWLEDGE, 0, 0)

    def _most(self, session, kind, control, parameter, payload, now):
        if len(payload) != 8:
            self._send(session.other, ERROR, 0, 0, b"eight bytes")
            return
        session.most = max(HEADER.size + 1, struct.unpack(">Q", payload)[0])
        self._send(session.other, MOST_SIZE_RESPONSE, 0, 0, struct.pack(">Q", MOST))

    def _status(self, session, kind, control, parameter, payload, now):
        """IVI 6.14: MAV is off once the client says that the end of the response was delivered."""
        if control & 1:
            session.unread = False
        bits = self.instrument.status(now) & ~16 | (16 if session.unread else 0)
        self._send(session.other, STATUS_RESPONSE, bits, 0)

    def _remote(self, session, kind, control, parameter, payload, now):
        if control > 6:
            self._send(session.other, ERROR, BAD_CONTROL, 0, b"unrecognized control code")
        else:
            self._send(session.other, REMOTE_RESPONSE, 0, 0)

    def _lock(self, session, kind, control, parameter, payload, now):
        """IVI 6.5: request (1) with a time in ms, release (0); exclusive locks only."""
        if control == 0:
            told = 1 if session.locks else 3  # success, or error: nothing was locked
            session.locks = False
            self._send(session.other, LOCK_RESPONSE, told, 0)
            if told == 1 and self._waits:
                self._grant(self._waits.pop(0)[0])
        elif session.locks or control != 1:
            self._send(session.other, LOCK_RESPONSE, 3, 0)
        elif any(each.locks for each in self.sessions.values()):
            self._waits.append((session, now + parameter / 1000))
        else:
            self._grant(session)

    def _grant(self, session):
        session.locks = True
        self._send(session.other, LOCK_RESPONSE, 1, 0)

    def _lock_info(self, session, kind, control, parameter, payload, now):
        holders = sum(each.locks for each in self.sessions.values())
        self._send(session.other, LOCK_INFO_RESPONSE, int(holders > 0), holders)
