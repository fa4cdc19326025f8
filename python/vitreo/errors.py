"""Errors of the package; each message names the folder, the file or the run.
SPDX-License-Identifier: Apache-2.0
"""


class VitreoError(RuntimeError):
    """Base of the package's errors."""


class RecordError(VitreoError):
    """A folder that is no run's, or a record that is damaged, half-written or of a later version."""


class RunError(VitreoError):
    """A run that did not begin, does not answer, or refuses a command."""
