"""One run's record: run.sqlite, frames and manifest of its folder.
SPDX-License-Identifier: Apache-2.0
"""

import collections
import contextlib
import fcntl
import json
import os
import pathlib
import sqlite3
import urllib.parse

import numpy as np
import pandas as pd

from . import manifest
from .errors import RecordError
from .frames import Frames
from .units import si_unit

# SQLite's user_version; host/record/record_schema.h. 0: before versions were written, without frames. 2: the results' table is `figure`; 3: it is `result`; 4: bits and offset of a camera;
# 5: meaning, tags, sample, time zero, who ended the run, losses of the cameras.
NEWEST_VERSION = 5

Picture = collections.namedtuple("Picture", "name caption file")
Drawing = collections.namedtuple("Drawing", "title svg")


def is_recording(folder):
    """Whether a program records into the folder: it holds a lock on recording.lock, which ends with it."""
    try:
        descriptor = os.open(os.path.join(folder, "recording.lock"), os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def _quoted(name):
    return '"' + name.replace('"', '""') + '"'


def _object(text):
    """A JSON object of the record; a broken text must not hide the samples: it reads as nothing known."""
    try:
        value = json.loads(text or "{}")
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


class Database:
    """run.sqlite, opened read-only for the time of a `with`; every error of SQLite's names the folder."""

    def __init__(self, folder):
        self.folder = os.fspath(folder)
        self._connection = None

    def __enter__(self):
        file = os.path.join(self.folder, "run.sqlite")
        if not os.path.isdir(self.folder):
            raise RecordError(f"{self.folder}: there is no such folder")
        if not os.path.isfile(file):
            raise RecordError(f"{self.folder}: is no run: it has no run.sqlite")
        with self._named():
            self._connection = sqlite3.connect(self._uri(file), uri=True, timeout=5)
            self._connection.text_factory = lambda text: text.decode("utf-8", "replace")
            self.version = self._connection.execute("PRAGMA user_version").fetchone()[0]
            names = self._connection.execute("SELECT name FROM sqlite_master WHERE type='table'")
            self.tables = {name for name, in names}
        try:
            self._check()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self._connection.close()

    def _uri(self, file):
        """`immutable` where nothing is in the write-ahead log and no program records: then no file beside it is made."""
        log = file + "-wal"
        closed = not (os.path.exists(log) and os.path.getsize(log)) and not is_recording(self.folder)
        return f"file:{urllib.parse.quote(os.path.abspath(file))}?mode=ro" + ("&immutable=1" if closed else "")

    def _check(self):
        if self.version > NEWEST_VERSION:
            raise RecordError(f"{self.folder}: has record version {self.version}, this package reads up to {NEWEST_VERSION}: "
                              "it wants a newer one")
        missing = {"run", "stream", "channel", "event", "stop"} - self.tables
        if missing:
            raise RecordError(f"{self.folder}: its run.sqlite is no run's record, or was cut: it has no table "
                              + ", ".join(sorted(missing)))

    @contextlib.contextmanager
    def _named(self):
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            if self._connection is not None:
                self._connection.close()
            raise RecordError(f"{self.folder}: run.sqlite cannot be read: {error}") from error

    def rows(self, query, *values):
        with self._named():
            return self._connection.execute(query, values).fetchall()

    def dicts(self, table, order="rowid"):
        """Rows as dicts by the columns that this version has; none where it has no such table."""
        if table not in self.tables:
            return []
        with self._named():
            cursor = self._connection.execute(f"SELECT * FROM {_quoted(table)} ORDER BY {order}")
            names = [one[0] for one in cursor.description]
            return [dict(zip(names, row)) for row in cursor]

    def start(self):
        """The start record; nested data parsed, units of parameters in SI."""
        return self._start("*")

    def columns(self, table):
        with self._named():
            return {row[0] for row in self._connection.execute("SELECT name FROM pragma_table_info(?)", (table,))}

    def head(self):
        """Of the start record what a list of runs shows."""
        wanted = ["time", "protocol", "title", "operator", "seed", "parameters", "parameter_units", "t0_utc_ns", "tags", "sample"]
        there = self.columns("run")
        head = self._start(", ".join([name for name in wanted if name in there] + ["json_extract(rig, '$.file') AS rig_file"]))
        return {name: head.get(name) for name in [*wanted, "rig_file"]}

    def _start(self, columns):
        with self._named():
            cursor = self._connection.execute(f"SELECT {columns} FROM run")
            row = cursor.fetchone()
        if row is None:
            raise RecordError(f"{self.folder}: its start record is missing")
        start = {one[0]: value for one, value in zip(cursor.description, row)}
        for name in ("parameters", "parameter_units", "versions", "rig", "devices", "files", "tags", "sample"):
            if name in start:
                start[name] = _object(start[name])
        start["parameter_units"] = {name: si_unit(str(unit)) for name, unit in start["parameter_units"].items()}
        with contextlib.suppress(ValueError, TypeError):
            start["seed"] = int(start["seed"])
        return start

    def end(self):
        rows = self.dicts("stop")
        if not rows:
            return None
        return {**rows[0], **{name: _object(rows[0].get(name)) for name in ("counts", "dropped", "lost")}}

    def results(self):
        """(name, SI value, SI unit) each."""
        rows = self.dicts("result" if "result" in self.tables else "figure")
        return [(row["name"], np.nan if row["value"] is None else row["value"], si_unit(row["unit"])) for row in rows]

    def outcome(self, end):
        if end is not None:
            return end["exit_status"]
        return "running" if is_recording(self.folder) else "lost"


class Run:
    """A run by its folder. Everything is read when it is asked for, also while the run goes on. Throws RecordError."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.name = self.folder.resolve().name
        with self._open() as database:
            self.version = database.version
            self.start = database.start()

    def __repr__(self):
        return f"<run {self.name}, {self.outcome}>"

    def __getattr__(self, name):
        """run.servo is the stream "servo"."""
        if not name.startswith("_"):
            if name in self.streams:
                return self.stream(name)
            raise AttributeError(f"{self.folder}: has no stream '{name}'; it has {', '.join(self.streams) or 'none'}")
        raise AttributeError(name)

    def __dir__(self):
        return [*super().__dir__(), *self.streams]

    def _open(self):
        return Database(self.folder)

    @property
    def parameters(self):
        """Name: value, SI."""
        return self.start["parameters"]

    @property
    def parameter_units(self):
        """Name: SI unit of each number; "" or missing for plain ones."""
        return self.start["parameter_units"]

    @property
    def tags(self):
        """Key: text, as given with --tag or by the script; empty in records before version 5."""
        with self._open() as database:
            return database.start().get("tags") or {}

    @property
    def sample(self):
        """What is known of the sample: eye, species, age, removed (UTC), robot; what is not known is missing."""
        with self._open() as database:
            return database.start().get("sample") or {}

    @property
    def t0(self):
        """UTC at which the run's clock was 0, to the nanosecond; NaT in records before version 5.

        Where run.start["clock"] is "virtual" it says when the simulation began: run.meaning("time", "virtual").
        """
        zero = self.start.get("t0_utc_ns")
        return pd.NaT if zero is None else pd.to_datetime(zero, unit="ns", utc=True)

    def utc(self, table):
        """UTC of each row of a stream, of the frames' table or of the events, as a Series: t0 plus its t_ns."""
        zero = self.start.get("t0_utc_ns")
        if zero is None:
            raise RecordError(f"{self.folder}: does not say when its clock was 0: its version is {self.version}")
        return pd.to_datetime(table["t_ns"] + zero, unit="ns", utc=True)

    def meaning(self, kind, name):
        """What a name in the record means, as the record says it: meaning("column", "frame.lost_before"),
        meaning("clock", "exposure"), meaning("axes", "world"), meaning("file", "frames/"). KeyError for one that it has not.
        """
        with self._open() as database:
            rows = database.rows("SELECT text FROM meaning WHERE kind = ? AND name = ?", kind, name) if "meaning" in database.tables else []
        if not rows:
            raise KeyError(f"{kind} {name}")
        return rows[0][0]

    @property
    def end(self):
        """The end record: exit_status, reason, ended_by, experiment_time and wall_time in s, counts, ...; None before it."""
        with self._open() as database:
            return database.end()

    @property
    def outcome(self):
        """completed, failed, stopped, aborted or lost; running while a program records it."""
        with self._open() as database:
            return database.outcome(database.end())

    @property
    def results(self):
        """Series of SI values by name; attrs["units"] has their SI units."""
        with self._open() as database:
            found = database.results()
        series = pd.Series({name: value for name, value, _ in found}, dtype=float, name=self.name)
        series.attrs = {"run": self.name, "units": {name: unit for name, _, unit in found}}
        return series

    @property
    def streams(self):
        """Name: {"source": text, "clock": to which instant a row belongs, and by channel "units" (SI), "help" and "axes"},
        in the order of the record. Records before version 5 have neither clock, help nor axes.
        """
        with self._open() as database:
            return self._streams(database)

    @staticmethod
    def _streams(database):
        channels = collections.defaultdict(lambda: {"units": {}, "help": {}, "axes": {}})
        for row in database.dicts("channel", "stream, position"):
            for key, column in (("units", "unit"), ("help", "help"), ("axes", "axes")):
                channels[row["stream"]][key][row["name"]] = row.get(column) or ""
        return {row["name"]: {"source": row["source"], "clock": row.get("clock") or "", "table": row["sample_table"], **channels[row["id"]]}
                for row in database.dicts("stream", "id")}

    def stream(self, name, since=None):
        """A stream as a table: index t in s, column t_ns (exact, the run's clock), a column a channel, NaN where there
        was no value. attrs has "units" by column, "source", "stream", "run". since: only samples from that time on, s.
        """
        if since is None:
            return self._samples(name, "1", 0)[0]
        return self._samples(name, "t_ns >= ?", int(np.ceil(since * 1e9)))[0]

    def _samples(self, name, condition, bound):
        """The samples that fit, and the largest number of a row among them (`seq`)."""
        with self._open() as database:
            streams = self._streams(database)
            if name not in streams:
                raise RecordError(f"{self.folder}: has no stream '{name}'; it has {', '.join(streams) or 'none'}")
            units = streams[name]["units"]
            columns = ", ".join(["seq", "t_ns", *map(_quoted, units)])
            values = (bound,) if "?" in condition else ()
            rows = database.rows(f"SELECT {columns} FROM {_quoted(streams[name]['table'])} WHERE {condition} ORDER BY seq", *values)
        try:
            times = np.array([row[1] for row in rows], dtype=np.int64)
            samples = np.array([row[2:] for row in rows], dtype=float).reshape(len(rows), len(units))
        except (TypeError, ValueError) as error:
            raise RecordError(f"{self.folder}: a sample of '{name}' is broken: {error}") from error
        table = pd.DataFrame(samples, columns=list(units), index=pd.Index(times / 1e9, name="t"))
        table.insert(0, "t_ns", times)
        table.attrs = {"run": self.name, "stream": name, "source": streams[name]["source"], "clock": streams[name]["clock"],
                       "units": {"t_ns": "ns", **units}, "help": streams[name]["help"], "axes": streams[name]["axes"]}
        return table, rows[-1][0] if rows else None

    @property
    def cameras(self):
        """A row a recorded camera: identity, every, frame_period in s, effective_pixel in m, bits, offset on the sensor."""
        with self._open() as database:
            rows = database.dicts("camera")
        table = pd.DataFrame(rows, columns=["name", "identity", "every", "frame_period", "effective_pixel", "bits",
                                            "offset_x_px", "offset_y_px"]).set_index("name")
        table.attrs = {"run": self.name, "units": {"frame_period": "s", "effective_pixel": "m", "offset_x_px": "px", "offset_y_px": "px"}}
        return table

    def frames(self, camera):
        """The recorded frames of a camera (Frames): a sequence of arrays that are mapped, not copied."""
        with self._open() as database:
            known = [row["name"] for row in database.dicts("camera")]
            if camera not in known:
                raise RecordError(f"{self.folder}: has no frames of '{camera}'; it has {', '.join(known) or 'none'}")
            lost = "lost_before" if "lost_before" in database.columns("frame") else "NULL"  # before version 5
            rows = database.rows(f"SELECT number, t_ns, t_received_ns, t_device_ns, dropped_before, {lost}, width_px, height_px, "
                                 "pixel_type, file, offset, bytes, crc32 FROM frame WHERE camera=? ORDER BY seq", camera)
        table = pd.DataFrame(rows, columns=["number", "t_ns", "t_received_ns", "t_device_ns", "dropped_before", "lost_before", "width_px",
                                            "height_px", "pixel_type", "file", "offset", "bytes", "crc32"])
        # Absent where the camera has no clock of its own, and exact where it has.
        table["t_device_ns"] = pd.array([row[3] for row in rows], dtype="Int64")
        table.index = pd.Index(table["t_ns"].to_numpy(dtype=np.int64) / 1e9, name="t")
        return Frames(self.folder, camera, table)

    @property
    def events(self):
        """Notes, checkpoints, alarms, errors ...: index t in s; t_ns, kind, text."""
        return self._timed("event", ["t_ns", "kind", "text"])

    @property
    def links(self):
        """What passed between the host and its instruments, of a run with --trace-links: role, address, event, bytes."""
        return self._timed("link", ["t_ns", "role", "address", "event", "bytes"])

    def _timed(self, name, columns):
        with self._open() as database:
            table = pd.DataFrame(database.dicts(name, "seq"), columns=columns)
        table["t_ns"] = table["t_ns"].astype(np.int64)
        table.index = pd.Index(table["t_ns"].to_numpy() / 1e9, name="t")
        table.attrs = {"run": self.name, "units": {"t_ns": "ns"}}
        return table

    @property
    def tables(self):
        """The tables that the run stated, as they are shown: texts. attrs["title"] names each."""
        found = []
        with self._open() as database:
            rows = database.dicts("result_table", "seq")
        for row in rows:
            try:
                table = pd.DataFrame(json.loads(row["rows"]), columns=json.loads(row["header"]))
            except ValueError as error:
                raise RecordError(f"{self.folder}: the table '{row['title']}' is broken: {error}") from error
            table.attrs = {"run": self.name, "title": row["title"]}
            found.append(table)
        return found

    @property
    def plots(self):
        """The plots as data: title, x and y with label and unit, series with label, x, y and mark."""
        with self._open() as database:
            return [_object(row["content"]) for row in database.dicts("plot", "seq")]

    @property
    def drawings(self):
        """Drawing(title, svg) each."""
        with self._open() as database:
            return [Drawing(row["title"], row["svg"]) for row in database.dicts("drawing", "seq")]

    @property
    def pictures(self):
        """Picture(name, caption, file) each; file is a path, and may be gone."""
        with self._open() as database:
            rows = database.dicts("picture", "seq")
        for row in rows:
            if not row["file"] or os.path.isabs(row["file"]) or ".." in row["file"].split("/"):
                raise RecordError(f"{self.folder}: names a file outside itself: {row['file']}")
        return [Picture(row["name"], row["caption"], self.folder / row["file"]) for row in rows]

    @property
    def modules(self):
        """Each Lua file that was required: name, file, hash, text."""
        with self._open() as database:
            return pd.DataFrame(database.dicts("module"), columns=["name", "file", "hash", "text"]).set_index("name")

    def verify(self):
        """What differs from the manifest, a line each; empty where every file is as it was closed.

        `vitreo verify` checks more: SQLite's own check, counts, order of times, the CRC of each frame.
        """
        return manifest.check(self.folder)
