"""Runs that go on: started with the program `vitreo`, followed and steered by their control socket.

The socket is that of `vitreo control`: JSON lines over a Unix socket that only this user can enter. Streams of a run
that goes on are read from its record, which is a tenth of a second behind.
SPDX-License-Identifier: Apache-2.0
"""

import getpass
import glob
import json
import math
import numbers
import os
import pathlib
import shutil
import socket
import stat
import struct
import subprocess
import tempfile
import time

import numpy as np

from .errors import RecordError, RunError
from .record import Run, is_recording
from .units import si_unit

_PATIENCE = 5  # s, for a reply
_LOOK = 0.02  # s, between looks at a program that is starting


def _socket_folder():
    """The folder of the sockets; None where there is none yet. Throws RunError where others could enter it."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    temporary = next((os.environ[name] for name in ("TMPDIR", "TMP", "TEMP", "TEMPDIR") if os.environ.get(name)), "/tmp")
    folder = os.path.join(runtime, "vitreo") if runtime else os.path.join(temporary, f"vitreo-{os.getuid()}")
    try:
        there = os.lstat(folder)
    except FileNotFoundError:
        return None
    if not stat.S_ISDIR(there.st_mode) or there.st_uid != os.getuid() or there.st_mode & 0o077:
        raise RunError(f"{folder}: is not a folder that only this user can enter")
    return folder


def _connected(path):
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(_PATIENCE)
    try:
        connection.connect(path)
    except OSError:
        connection.close()
        return None
    return connection


def going_on():
    """The names of this user's runs that go on and can be steered, sorted."""
    folder = _socket_folder()
    names = []
    for path in glob.glob(os.path.join(glob.escape(folder), "*.sock")) if folder else []:
        connection = _connected(path)  # a socket without a listener was left by a program that was killed
        if connection is not None:
            connection.close()
            names.append(os.path.basename(path)[: -len(".sock")])
    return sorted(names)


def _record_of(process, name=None):
    """The folder of the run that a process records, by the files that it has open; None where it has no such."""
    for link in glob.glob(f"/proc/{process}/fd/*"):
        try:
            file = pathlib.Path(os.readlink(link))
        except OSError:
            continue
        if file.name == "run.sqlite" and name in (None, file.parent.name):
            return file.parent
    return None


class Live:
    """A run that goes on. Throws RunError where the run refuses, does not answer or is over."""

    def __init__(self, name, folder=None):
        self.name = name
        self._folder = folder

    def __repr__(self):
        return f"<run {self.name}, going on>" if self.is_going_on() else f"<run {self.name}, over>"

    def is_going_on(self):
        connection = self._connect()
        if connection is not None:
            connection.close()
        return connection is not None

    @property
    def folder(self):
        """The record's folder."""
        if self._folder is None:
            connection = self._connected()
            with connection:
                credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
            self._folder = _record_of(struct.unpack("3i", credentials)[0], self.name)
            if self._folder is None:
                raise RunError(f"{self.name}: the folder of its record cannot be found")
        return self._folder

    @property
    def record(self):
        """The record (Run), as far as it is written."""
        return Run(self.folder)

    def _connect(self):
        folder = _socket_folder()
        return _connected(os.path.join(folder, self.name + ".sock")) if folder else None

    def _connected(self):
        connection = self._connect()
        if connection is None:
            raise RunError(f"{self.name}: is over, or was never begun")
        return connection

    def request(self, word, **fields):
        """Sends one request, {"do": word, ...}, and returns the status in its reply."""
        with self._connected() as connection:
            lines = self._ask(connection, word, fields)
            reply = next(lines, None)
        if reply is None:
            raise RunError(f"{self.name}: does not answer")
        if not reply.get("ok"):
            raise RunError(f"{self.name}: {reply.get('error')}")
        return reply["status"]

    def _ask(self, connection, word, fields):
        """Sends a request; yields each message that comes, until the run is over or does not answer."""
        message = {"do": word, **{name: value for name, value in fields.items() if value is not None}}
        received = b""
        try:
            connection.sendall(json.dumps(message).encode() + b"\n")
            while part := connection.recv(1 << 16):
                *lines, received = (received + part).split(b"\n")
                for line in lines:
                    yield json.loads(line)
        except (OSError, ValueError):
            return

    def status(self):
        """What the run is doing now: phase, progress, doing, text, alarms; remaining in s and question where there are such."""
        return self.request("status")

    @property
    def question(self):
        """The open question to the operator: name, text, choices; None where there is none."""
        return self.status().get("question")

    def follow(self):
        """Yields the status, then again at each change, until the run is over."""
        last = None
        while (connection := self._connect()) is not None:
            with connection:
                messages = self._ask(connection, "watch", {})
                connection.settimeout(None)  # a change may take hours
                for message in messages:
                    if message.get("status") != last:
                        last = message.get("status")
                        yield last
            # A run closes the connection of a client that does not read for long: then it is still there.
            time.sleep(_LOOK)

    def wait_until(self, condition, timeout=None):
        """Waits until condition(status) holds and returns that status. Throws RunError at the run's end, or after timeout, s."""
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while True:
            status = self.status()
            if condition(status):
                return status
            if time.monotonic() > deadline:
                raise RunError(f"{self.name}: waited {timeout} s; the run is {status['text']}")
            time.sleep(0.05)

    def wait(self, timeout=None):
        """Waits until the record is closed and returns it (Run): its outcome says how it ended. Throws RunError after timeout, s."""
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while is_recording(self.folder):
            if time.monotonic() > deadline:
                raise RunError(f"{self.name}: still goes on after {timeout} s")
            time.sleep(0.05)
        return self.record

    def answer(self, text, by=None):
        """Answers the open question, as it would be typed: "3mm", "yes"."""
        return self._command("answer", by, text=str(text))

    def pause(self, at=None, by=None):
        """Pauses at the next checkpoint, or at that whose name is `at`."""
        return self._command("pause", by, at=at)

    def resume(self, override=False, by=None):
        """Goes on; override: although the condition for it does not hold (a researcher's right)."""
        return self._command("resume", by, override=bool(override))

    def stop(self, by=None):
        """Ends in order: the script cleans up."""
        return self._command("stop", by)

    def abort(self, by=None):
        """Ends at once: outputs safe, then the script's clean-up in short."""
        return self._command("abort", by)

    def emergency(self, by=None):
        """Outputs to zero first."""
        return self._command("emergency", by)

    def acknowledge(self, alarm=None, by=None):
        """Acknowledges an alarm by its name, or all."""
        return self._command("ack", by, alarm=alarm)

    def target(self, positions, by=None):
        """Positions [[x, y, z], ...] in m, world frame, for a script that takes targets."""
        return self._command("target", by, positions=np.asarray(positions, dtype=float).reshape(-1, 3).tolist())

    def adjust(self, instrument=None, to=None, by=None):
        """Moves a stage, the lens or the focus, sets the lamp or a camera: `to` in SI units, of one of `instruments`.

        Without arguments all of them are read, and the next status has the values. Only in a run at the pace of the wall clock.
        """
        if instrument is None and to is None:
            return self._command("adjust", by)
        return self._command("adjust", by, instrument=instrument, to=float(to))

    def _command(self, word, by, **fields):
        return self.request(word, by=by or getpass.getuser(), **fields)

    def stream(self, name, since=None):
        """A stream as far as it is written (Run.stream)."""
        return self.record.stream(name, since)

    def follow_stream(self, name, every=0.2):
        """Yields the new samples of a stream as tables, looking every so many s, until the run is over; none twice."""
        record, seq = self.record, 0
        while True:
            over = not is_recording(self.folder)  # looked at first: what came before the end is still to be read
            if name in record.streams:  # a stream begins with what makes it
                table, last = record._samples(name, "seq > ?", seq)
                if last is not None:
                    seq = last
                    yield table
            if over:
                return
            time.sleep(every)


class Started(Live):
    """A run that this program started; `process` is the program `vitreo`."""

    def __init__(self, process, out, err):
        super().__init__(None)
        self.process = process
        self._out, self._err = out, err

    def _begin(self):
        """Waits until the record is there and can be steered, or the program has ended."""
        while self.process.poll() is None:
            if self._folder is None:
                self._folder = _record_of(self.process.pid)
            if self._folder is not None:
                self.name = self._folder.name
                if self._connect_once() or self._has_no_socket():
                    return self
            time.sleep(_LOOK)
        self._finish()
        return self

    def _connect_once(self):
        connection = self._connect()
        if connection is not None:
            connection.close()
        return connection is not None

    def _has_no_socket(self):
        """A run goes on without a socket where it cannot be had, and its record says so."""
        try:
            events = self.record.events
        except RecordError:
            return False  # its tables are on their way
        return events.text.str.startswith("no control socket").any()

    def _finish(self):
        """Reads what the program said; throws RunError where no run came of it."""
        self._out.seek(0)
        self._err.seek(0)
        out, err = self._out.read().decode("utf-8", "replace"), self._err.read().decode("utf-8", "replace")
        try:
            said = json.loads(out.strip().splitlines()[-1])
        except (IndexError, ValueError):
            said = {}
        if "run" in said:
            self._folder = pathlib.Path(said["run"])
            self.name = self._folder.name
        if self._folder is None:
            what = said.get("error") or err.strip() or "it said nothing"
            raise RunError(f"vitreo ended with exit code {self.process.returncode}: {what}")

    def is_going_on(self):
        return self.process.poll() is None

    def wait(self, timeout=None):
        """As Live.wait, for the end of the program, too; where no record came of it, RunError with what it said."""
        try:
            self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise RunError(f"{self.name}: still goes on after {timeout} s") from None
        self._finish()
        return Run(self._folder)


def attach(run="", folder=None):
    """A run that goes on, by its name or the beginning of it; without one the only one there is. Throws RunError."""
    names = going_on()
    fitting = [run] if run in names else [name for name in names if name.startswith(run)]
    if not fitting:
        raise RunError(f"no run that is going on begins with '{run}'" if run else "no run is going on")
    if len(fitting) > 1:
        raise RunError(f"several runs are going on: {', '.join(fitting)}; say which")
    live = Live(fitting[0], folder and pathlib.Path(folder) / fitting[0])
    live.folder  # found while it goes on: its record is to be had afterwards too
    return live


def _program(program):
    found = program or os.environ.get("VITREO") or shutil.which("vitreo")
    if not found:
        raise RunError("the program vitreo is not on the PATH: give program=, or set VITREO")
    return os.fspath(found)


def _units(program, protocol, cwd):
    """Name: SI unit of each parameter that the protocol declares."""
    said = subprocess.run([program, "describe", protocol, "--json"], cwd=cwd, stdin=subprocess.DEVNULL, capture_output=True,
                          text=True, check=False)
    try:
        described = json.loads(said.stdout)
        return {one["name"]: si_unit(one["unit"]) for one in described["parameters"]}
    except (ValueError, KeyError) as error:
        raise RunError(f"vitreo describe {protocol}: {said.stderr.strip() or said.stdout.strip()}") from error


def _typed(name, value, units):
    """A parameter as it is typed: a text as it is, a number with its SI unit."""
    if isinstance(value, str):
        return f"{name}={value}"
    if isinstance(value, (bool, np.bool_)):
        return f"{name}={'true' if value else 'false'}"
    if isinstance(value, numbers.Integral):
        return f"{name}={int(value)}{units().get(name, '')}"
    if isinstance(value, numbers.Real):
        return f"{name}={float(value)!r}{units().get(name, '')}"
    raise TypeError(f"{name}: wants a text as it is typed, a number in SI units or a truth value; got {type(value).__name__}")


def start(protocol, parameters=None, *, rig=None, seed=None, out="runs", operator=None, frames=(), faults=(), answers=None,
          real_time=False, tags=None, sample=None, options=(), program=None, cwd=None):
    """Starts a run with the program `vitreo` (program, $VITREO or PATH) and returns it when its record is there (Started).

    parameters: name: a text as it is typed ("0.5mm/s"), a number in SI units, or a truth value. frames, faults: as
    --frames and --fault take them. answers: name: answer, in advance. tags: key: text; sample: eye, species, age, removed,
    robot. options: further words for `vitreo run`. The run goes on when this program ends. Throws RunError with what vitreo said where no run came of it.
    """
    program = _program(program)
    declared = {}

    def units():
        if not declared:
            declared.update(_units(program, os.fspath(protocol), cwd))
        return declared

    words = [program, "run", os.fspath(protocol)]
    words += [_typed(name, value, units) for name, value in (parameters or {}).items()]
    for option, value in (("--rig", rig), ("--seed", seed), ("--out", out), ("--operator", operator)):
        if value is not None:
            words += [option, str(value)]
    if real_time:
        words.append("--real-time")
    for option, values in (("--frames", frames), ("--fault", faults),
                           *((option, [f"{name}={text}" for name, text in (given or {}).items()])
                             for option, given in (("--answer", answers), ("--tag", tags), ("--sample", sample)))):
        for value in [values] if isinstance(values, str) else values:
            words += [option, value]
    # Files and no pipes: nothing waits for this program to read.
    out_file, err_file = tempfile.TemporaryFile(), tempfile.TemporaryFile()
    try:
        process = subprocess.Popen([*words, *options, "--json", "--quiet"], cwd=cwd, stdin=subprocess.DEVNULL, stdout=out_file,
                                   stderr=err_file, start_new_session=True)
    except OSError as error:
        raise RunError(f"{program}: cannot be started: {error.strerror}") from error
    return Started(process, out_file, err_file)._begin()
