"""Runs of a folder as one table, by an index that is rebuilt from the folders at any time.

The index is a file of the user's cache ($XDG_CACHE_HOME/vitreo): the folders are the truth. A row of it counts as long
as size, inode and time of change of run.sqlite are those that it was made from; without it only the time is lost.
SPDX-License-Identifier: Apache-2.0
"""

import contextlib
import hashlib
import json
import os
import pathlib
import sqlite3

import pandas as pd

from .errors import RecordError
from .record import Database, Run

_LAYOUT = 1  # of the index's rows; another one is made anew
_COLUMNS = ["time", "protocol", "title", "operator", "seed", "outcome", "reason", "experiment_time", "wall_time", "version", "folder"]


def _cache_file(folder):
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    name = hashlib.sha256(os.path.realpath(folder).encode("utf-8", "surrogateescape")).hexdigest()[:24]
    return os.path.join(home, "vitreo", f"runs-{name}.sqlite")


@contextlib.contextmanager
def _cache(folder):
    """The index's connection; None where it cannot be had (no home, full disk, locked by another program)."""
    file = _cache_file(folder)
    connection = None
    try:
        os.makedirs(os.path.dirname(file), mode=0o700, exist_ok=True)
        connection = _open_cache(file)
    except (OSError, sqlite3.Error):
        connection = None
    try:
        yield connection
    finally:
        if connection is not None:
            connection.close()


def _open_cache(file):
    for attempt in (1, 2):
        connection = sqlite3.connect(file, timeout=0.2)
        try:
            if connection.execute("PRAGMA user_version").fetchone()[0] != _LAYOUT:
                connection.executescript("BEGIN; DROP TABLE IF EXISTS head; CREATE TABLE head(name TEXT PRIMARY KEY, "
                                         f"mark TEXT, head TEXT); PRAGMA user_version={_LAYOUT}; COMMIT")
            return connection
        except sqlite3.DatabaseError as error:
            connection.close()
            # Locked is for now; anything else is a damaged file, which is only an index.
            if attempt == 2 or isinstance(error, sqlite3.OperationalError):
                raise
            os.remove(file)


def _known(cache, folder):
    """Name: (mark, head) of the index; empty where it is locked, or damaged and therefore removed."""
    try:
        rows = cache.execute("SELECT name, mark, head FROM head").fetchall()
        return {name: (mark, json.loads(head)) for name, mark, head in rows}
    except sqlite3.OperationalError:
        return {}
    except (sqlite3.DatabaseError, ValueError):
        with contextlib.suppress(OSError):
            os.remove(_cache_file(folder))
        return {}


def _remember(cache, fresh, gone):
    try:
        with cache:
            cache.executemany("INSERT OR REPLACE INTO head VALUES(?,?,?)", fresh)
            cache.executemany("DELETE FROM head WHERE name=?", [(name,) for name in gone])
    except sqlite3.Error:
        pass  # locked, or the disk is full: the next call reads these folders again


def _mark(path):
    """Of run.sqlite as it is now; None where there is none. A log beside it is newer than the file."""
    try:
        status = os.stat(os.path.join(path, "run.sqlite"))
    except OSError:
        return None
    return f"{status.st_ino} {status.st_size} {status.st_mtime_ns}"


def _head(path):
    """One run's row, and whether it may be kept: only what is closed stays as it is."""
    try:
        with Database(path) as database:
            head, end, results = database.head(), database.end(), database.results()
            outcome = database.outcome(end)
            version = database.version
    except RecordError as error:
        return {"outcome": "unreadable", "reason": str(error)}, False
    head.update(outcome=outcome, version=version, results={name: value for name, value, _ in results},
                result_units={name: unit for name, _, unit in results})
    if end is not None:
        head.update((name, end.get(name)) for name in ("reason", "experiment_time", "wall_time"))
    return head, end is not None and not os.path.exists(os.path.join(path, "run.sqlite-wal"))


def _heads(folder):
    folders = {entry.name: entry.path for entry in os.scandir(folder) if entry.is_dir()}
    with _cache(folder) as cache:
        known = _known(cache, folder) if cache else {}
        heads, fresh = {}, []
        for name in sorted(folders):  # the names begin with the time
            mark = _mark(folders[name])
            if mark is None:
                continue
            if known.get(name, (None,))[0] == mark:
                heads[name] = known[name][1]
                continue
            heads[name], lasting = _head(folders[name])
            if lasting:
                fresh.append((name, mark, json.dumps(heads[name])))
        gone = set(known) - set(heads)
        if cache and (fresh or gone):
            _remember(cache, fresh, gone)
    return heads


def _units_of(heads):
    """SI unit of each column "p.NAME" and "r.NAME"; where runs differ all of them, with " or " between."""
    found = {"experiment_time": {"s": 1}, "wall_time": {"s": 1}}
    for head in heads.values():
        for prefix, units in (("p.", head.get("parameter_units")), ("r.", head.get("result_units"))):
            for name, unit in (units or {}).items():
                found.setdefault(prefix + name, {})[unit] = 1
    return {name: " or ".join(units) for name, units in found.items()}


def runs(folder="runs"):
    """The runs of a folder as a table, a row a run by its name, oldest first.

    Columns: time (UTC), protocol, title, operator, seed, outcome, reason, experiment_time, wall_time, version of the
    record, folder; "p.NAME" each parameter and "r.NAME" each result, SI, NaN where a run has none; attrs["units"] has
    their units. A record that cannot be read is a row with the outcome "unreadable" and the reason. Throws RecordError.
    """
    try:
        heads = _heads(os.fspath(folder))
    except OSError as error:
        raise RecordError(f"{folder}: cannot be listed: {error.strerror}") from error
    rows = []
    for name, head in heads.items():
        row = {column: head.get(column) for column in _COLUMNS}
        row["folder"] = os.path.join(os.fspath(folder), name)
        row.update(("p." + key, value) for key, value in (head.get("parameters") or {}).items())
        row.update(("r." + key, value) for key, value in (head.get("results") or {}).items())
        rows.append(row)
    table = pd.DataFrame(rows, index=pd.Index(list(heads), name="run", dtype=object), columns=None if rows else _COLUMNS)
    table["time"] = pd.to_datetime(table["time"], utc=True, errors="coerce")
    table.attrs = {"folder": os.fspath(folder), "units": _units_of(heads)}
    return table


def open_run(which="last", folder="runs"):
    """A run by its folder, by its name in `folder`, by the beginning of exactly one name, or "last". Throws RecordError."""
    if isinstance(which, os.PathLike) or os.sep in which or os.path.exists(os.path.join(which, "run.sqlite")):
        return Run(which)
    try:
        names = sorted(entry.name for entry in os.scandir(folder) if _mark(entry.path) is not None)
    except OSError as error:
        raise RecordError(f"{folder}: cannot be listed: {error.strerror}") from error
    if which == "last":
        if not names:
            raise RecordError(f"there are no runs in {folder}")
        # Names begin with the time to the second; among runs of one second the one whose scripts were stored last.
        second = [name for name in names if name[:17] == names[-1][:17]]
        return Run(pathlib.Path(folder, max(second, key=lambda name: (_stored(folder, name), name))))
    fitting = [which] if which in names else [name for name in names if which and name.startswith(which)]
    if len(fitting) != 1:
        few = ", ".join(fitting[:5]) + (", ..." if len(fitting) > 5 else "")
        raise RecordError(f"{which}: could be {len(fitting)} runs in {folder}: {few}" if fitting
                          else f"{which}: is no run's folder, and no run in {folder} begins so")
    return Run(pathlib.Path(folder, fitting[0]))


def _stored(folder, name):
    try:
        return os.stat(os.path.join(folder, name, "script")).st_mtime_ns
    except OSError:
        return 0
