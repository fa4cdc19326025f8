"""What every server of doubles has at its ends: orders on standard input, a book of what went over the line, an end.

SPDX-License-Identifier: Apache-2.0
"""

import contextlib
import json
import os
import signal
import sys


class OrderInput:
    """Standard input: one JSON order a line, answered by one line."""

    def __init__(self, seconds):
        self.seconds = seconds  # how long the server serves; None: until its input ends
        self.open, self.pending = True, b""

    def readable(self):
        """Descriptors to wait for."""
        return [0] if self.open else []

    def take(self, obey):
        """Reads what has come and has it obeyed; False when the server is to end."""
        data = os.read(0, 65536)
        if not data:
            self.open = False
            return self.seconds is not None
        *lines, self.pending = (self.pending + data).split(b"\n")
        for line in lines:
            if line.strip():
                print(json.dumps(obey(line)), flush=True)
        return True


def book(file, shown):
    """log(when, side, data) into a file of JSON lines, or into nothing; `shown` makes text of the data."""
    if not file:
        return lambda *_: None
    lines = open(file, "w", encoding="utf-8")  # until the end of the process
    return lambda when, side, data: print(json.dumps([round(when, 6), side, shown(data)]), file=lines, flush=True)


@contextlib.contextmanager
def serving(link):
    """SIGTERM and Ctrl-C end it in order: the link is taken away, and nothing is said of it."""

    def end(*_):
        sys.exit(0)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one comes while Python is on its way out
        if link is not None:
            link.unplug()
