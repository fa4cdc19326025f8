"""Manifest of a closed run, SHA256SUMS, against the files that are there.
SPDX-License-Identifier: Apache-2.0
"""

import hashlib
import os
import stat

from .errors import RecordError

NAME = "SHA256SUMS"
# Not part of the record: the manifest itself, what is there only while a run is recorded, and readers' marks in the write-ahead log.
_APART = {NAME, "recording.lock", "reserve.room", "run.sqlite-shm"}


def _hash_of(file):
    """SHA-256 in hexadecimal digits; links are not followed, they could name a file outside of the run."""
    descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as stream:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(f"{file}: is no regular file")
        digest = hashlib.sha256()
        for part in iter(lambda: stream.read(1 << 20), b""):
            digest.update(part)
    return digest.hexdigest()


def _files(folder):
    found = []
    for place, _, names in os.walk(folder):
        for name in names:
            below = os.path.relpath(os.path.join(place, name), folder)
            if below not in _APART and not below.startswith("export" + os.sep):
                found.append(below)
    return sorted(found)


def _expected(folder):
    hashes = {}
    file = os.path.join(folder, NAME)
    with open(file, encoding="utf-8", errors="surrogateescape") as lines:
        for line in lines:
            line = line.rstrip("\n")
            if len(line) < 67 or line[64:66] != "  ":
                raise RecordError(f"{file}: has a line that is no hash and name")
            if line[66:] not in _APART:
                hashes[line[66:]] = line[:64]
    return hashes


def check(folder):
    """What differs from the manifest, a line each: changed, missing, and files that it does not know."""
    if not os.path.exists(os.path.join(folder, NAME)):
        return [NAME + ": is missing"]
    expected = _expected(folder)
    problems = []
    for name in _files(folder):
        if name not in expected:
            problems.append(name + ": was not there when the run was closed")
            continue
        try:
            if _hash_of(os.path.join(folder, name)) != expected[name]:
                problems.append(name + ": has changed since the run was closed")
        except OSError as error:
            problems.append(f"{name}: cannot be read: {error.strerror or error}")
        del expected[name]
    return problems + [name + ": is missing" for name in expected]
