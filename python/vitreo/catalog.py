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

_LAYOUT = 2  # SQLite's user_version: host/runs/catalog.cpp makes the same tables in the same file
_TABLES = """
CREATE TABLE run(id INTEGER PRIMARY KEY, name TEXT UNIQUE, mark TEXT, time TEXT, t0_utc_ns INTEGER,
  protocol TEXT, title TEXT, operator TEXT, seed TEXT, outcome TEXT, reason TEXT, ended_by TEXT,
  experiment_time REAL, wall_time REAL, version INTEGER, rig TEXT, words TEXT);
CREATE TABLE value(run INTEGER, kind TEXT, name TEXT, number REAL, text TEXT, unit TEXT);
CREATE INDEX run_mark ON run(name, mark);
CREATE INDEX value_name ON value(name, kind, unit, number, run);
CREATE INDEX value_run ON value(run, name);
"""
_LONGEST_WORDS = 8192  # bytes
_COLUMNS = ["time", "protocol", "title", "operator", "seed", "outcome", "reason", "ended_by", "experiment_time", "wall_time", "version",
            "rig", "folder"]
_KINDS = {"p": "parameters", "r": "results", "t": "tags", "s": "sample"}
_PREFIXES = {"parameters": "p.", "results": "r.", "tags": "tag.", "sample": "sample."}


def _cache_file(folder):
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    name = hashlib.sha256(os.path.realpath(folder).encode("utf-8", "surrogateescape")).hexdigest()[:24]
    return os.path.join(home, "vitreo", f"catalog-{name}.sqlite")


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
            connection.execute("PRAGMA synchronous=OFF")  # after a power cut it is made anew
            if connection.execute("PRAGMA user_version").fetchone()[0] != _LAYOUT:
                if connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                    raise sqlite3.DatabaseError("is no index of this program")
                connection.executescript(f"BEGIN IMMEDIATE; {_TABLES} PRAGMA user_version={_LAYOUT}; COMMIT")
            return connection
        except sqlite3.DatabaseError as error:
            connection.close()
            # Locked is for now; anything else is a damaged or foreign file, which is only an index.
            if attempt == 2 or isinstance(error, sqlite3.OperationalError):
                raise
            os.remove(file)


def _known(cache, folder):
    """Name: (mark, head) of the index; empty where it is locked, or damaged and therefore removed."""
    try:
        cursor = cache.execute("SELECT * FROM run")
        names = [one[0] for one in cursor.description]
        rows = {row["id"]: row for row in (dict(zip(names, row)) for row in cursor)}
        for row in rows.values():
            row.update({kind: {} for kind in _KINDS.values()}, parameter_units={}, result_units={}, seed=_seed(row["seed"]))
        for number, kind, name, value, text, unit in cache.execute("SELECT run, kind, name, number, text, unit FROM value ORDER BY rowid"):
            if number in rows:
                rows[number][_KINDS[kind]][name] = _value(kind, value, text)
                if kind == "r" or kind == "p" and text is None:
                    rows[number]["result_units" if kind == "r" else "parameter_units"][name] = unit
        return {row["name"]: (row["mark"], row) for row in rows.values()}
    except sqlite3.OperationalError as error:
        if "no such" not in str(error):
            return {}
    except (sqlite3.DatabaseError, ValueError, KeyError, TypeError):
        pass
    with contextlib.suppress(OSError):
        os.remove(_cache_file(folder))
    return {}


def _seed(text):
    try:
        return int(text)
    except (TypeError, ValueError):
        return text


def _value(kind, number, text):
    """A value of the index as it was in the record: a flag has both number and text, a list is JSON."""
    if kind == "p" and number is not None and text is not None:
        return bool(number)
    if kind == "p" and text is not None and text[:1] in ("[", "{"):
        try:
            return json.loads(text)
        except ValueError:
            return text
    if kind == "r" and number is None:
        return float("nan")
    return number if text is None else text


def _rows_of(number, head):
    """The rows of `value` that have a head's parameters, results, tags and sample."""
    for name, value in (head.get("parameters") or {}).items():
        unit = (head.get("parameter_units") or {}).get(name, "")
        if isinstance(value, bool):
            yield number, "p", name, float(value), "true" if value else "false", ""
        elif isinstance(value, (int, float)):
            yield number, "p", name, float(value), None, unit
        elif isinstance(value, str):
            yield number, "p", name, None, value, ""
        else:
            yield number, "p", name, None, json.dumps(value, separators=(",", ":"), ensure_ascii=False), unit if isinstance(value, list) else ""
    for kind, field in (("t", "tags"), ("s", "sample")):
        for name, value in (head.get(field) or {}).items():
            yield number, kind, name, None, str(value), ""
    for name, value in (head.get("results") or {}).items():
        yield number, "r", name, None if value != value else value, None, (head.get("result_units") or {}).get(name, "")


def _words(head, notes):
    """All texts of a run, for a search: as run_summary.cpp gathers them."""
    lines = [head.get(name) or "" for name in ("title", "protocol", "operator", "rig", "reason")]
    lines += [f"{name} {value}" for field in ("tags", "sample") for name, value in (head.get(field) or {}).items()]
    text = "".join(line + "\n" for line in [*lines, *notes])
    return text.encode("utf-8", "replace")[:_LONGEST_WORDS].decode("utf-8", "ignore")


def _remember(cache, fresh, gone):
    try:
        with cache:
            cache.execute("BEGIN IMMEDIATE")
            for name in gone:
                cache.execute("DELETE FROM value WHERE run IN (SELECT id FROM run WHERE name=?)", (name,))
                cache.execute("DELETE FROM run WHERE name=?", (name,))
            number = cache.execute("SELECT coalesce(max(id), 0) FROM run").fetchone()[0]
            for name, mark, head in fresh:
                number += 1
                cache.execute("DELETE FROM value WHERE run IN (SELECT id FROM run WHERE name=?)", (name,))
                cache.execute("INSERT OR REPLACE INTO run VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)", (
                    number, name, mark, *(head.get(field) for field in ("time", "t0_utc_ns", "protocol", "title", "operator")),
                    str(head.get("seed")), *(head.get(field) for field in ("outcome", "reason", "ended_by", "experiment_time", "wall_time",
                                                                          "version", "rig", "words"))))
                cache.executemany("INSERT INTO value VALUES(?,?,?,?,?,?)", _rows_of(number, head))
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
            notes = [text for (text,) in database.rows("SELECT text FROM event WHERE kind IN ('note', 'alarm')")]
    except RecordError as error:
        return {"outcome": "unreadable", "reason": str(error)}, False
    # As the index has them: numbers are float, and only numbers have a unit.
    numbers = {name: float(value) for name, value in head["parameters"].items()
               if isinstance(value, (int, float)) and not isinstance(value, bool)}
    head["parameter_units"] = {name: (head["parameter_units"] or {}).get(name, "") for name in numbers}
    head.update(parameters={**head["parameters"], **numbers}, tags=head["tags"] or {}, sample=head["sample"] or {})
    head.update(outcome=outcome, version=version, rig=head.get("rig_file") or "", results={name: value for name, value, _ in results},
                result_units={name: unit for name, _, unit in results})
    if end is not None:
        head.update((name, end.get(name)) for name in ("reason", "experiment_time", "wall_time"))
        head["ended_by"] = end.get("ended_by") or ""
    head["words"] = _words(head, notes)
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
                fresh.append((name, mark, heads[name]))
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

    Columns: time (UTC), protocol, title, operator, seed, outcome, reason, ended_by, experiment_time, wall_time, version of
    the record, rig, folder; "p.NAME" each parameter and "r.NAME" each result, SI, NaN where a run has none, "tag.NAME" each
    tag and "sample.NAME" each field of the sample; attrs["units"] has the units. A record that cannot be read is a row with the outcome "unreadable" and the reason. Throws RecordError.
    """
    try:
        heads = _heads(os.fspath(folder))
    except OSError as error:
        raise RecordError(f"{folder}: cannot be listed: {error.strerror}") from error
    rows = []
    for name, head in heads.items():
        row = {column: head.get(column) for column in _COLUMNS}
        row["folder"] = os.path.join(os.fspath(folder), name)
        for field, prefix in _PREFIXES.items():
            row.update((prefix + key, value) for key, value in (head.get(field) or {}).items())
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
