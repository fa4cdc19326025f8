"""A SCPI parser that walks the command tree as the standard and the makers' manuals say.

Sources: SCPI-99 volume 1, 6.2.1 (long and short form), 6.2.4 (tree walking: a message begins at the root; after a
semicolon the path is that of the last header without its last mnemonic; a leading colon returns to the root; common
commands leave the path alone); Kepco BOP 1KW-MG operator manual 3.6.4.5 to 3.6.6, which says the same.
SPDX-License-Identifier: Apache-2.0
"""

import re


class ScpiError(Exception):
    """An error as it goes into the instrument's queue."""

    def __init__(self, code):
        super().__init__(code)
        self.code = code


# SCPI-99 volume 2, 21.8 (standard texts). A maker's deviating text replaces these in the double.
TEXTS = {
    0: "No error",
    -100: "Command error",
    -102: "Syntax error",
    -103: "Invalid separator",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -111: "Header separator error",
    -113: "Undefined header",
    -120: "Numeric data error",
    -141: "Invalid character data",
    -211: "Trigger ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -223: "Too much data",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    -400: "Query error",
    -410: "Query INTERRUPTED",
}


def forms(word):
    """Short and long form of a mnemonic written as in a manual: CURRent -> CURR, CURRENT."""
    if word.startswith("*"):
        return word, word
    short = "".join(letter for letter in word if letter.isupper() or letter.isdigit())
    return short, word.upper()


class Tree:
    """The command tree: patterns such as [SOURce:]CURRent[:LEVel]:LIMit:POSitive."""

    def __init__(self, patterns):
        self.patterns = []
        for text, handler in patterns.items():
            query = text.endswith("?")
            words = []
            for optional, word in re.findall(r"(\[)?:?([A-Za-z*]+):?\]?", text.rstrip("?")):
                words.append((forms(word), bool(optional)))
            self.patterns.append((words, query, handler))
        self.words = {form for words, _, _ in self.patterns for (both, _) in words for form in both}

    def find(self, words, query):
        """The handler for these words from the root, or None."""
        for pattern, asks, handler in self.patterns:
            if asks == query and _matches(pattern, words):
                return handler
        return None

    def units(self, line):
        """Splits a message into units and gives (handler, argument text or None, query) of each, or raises.

        A generator: what stands before a wrong unit has been carried out when the error comes."""
        path = []
        for unit in _split(line, ";"):
            unit = unit.strip()
            if not unit:
                continue
            header, argument = _header_and_argument(unit)
            query = header.endswith("?")
            header = header[:-1] if query else header
            if header.startswith("*"):
                handler = self.find([header.upper()], query)
                if handler is None:
                    raise ScpiError(-113)
                yield handler, argument, query
                continue
            if header.startswith(":"):
                path, header = [], header[1:]
            words = path + [word.upper() for word in header.split(":")]
            handler = self.find(words, query)
            if handler is None:
                raise ScpiError(self._why(words, query))
            path = words[:-1]
            yield handler, argument, query

    def _why(self, words, query):
        """Which error an unknown header is."""
        for word in words:
            if not word.isalnum():
                return -103  # Kepco MST 488 manual table B-6: "VOLT.10 received instead of VOLT:10"
        for word in words:
            bare = word.rstrip("0123456789")
            if bare != word and bare in self.words:
                return -108  # the same table: "Volt12 sequence, channel number is invalid"
            if word not in self.words and any(word.startswith(known) for known in self.words if len(known) == 4):
                return -102  # the same table: "First 4 characters recognized, subsequent characters not recognized"
        return -113  # SCPI-99: undefined header


def _matches(pattern, words):
    """Whether the words are the pattern with some of its optional words left out."""
    if not pattern:
        return not words
    (both, optional), rest = pattern[0], pattern[1:]
    if words and words[0] in both and _matches(rest, words[1:]):
        return True
    return optional and _matches(rest, words)


def _split(line, mark):
    """Splits at the mark, but not within quotes."""
    parts, quoted = [""], False
    for letter in line:
        if letter == '"':
            quoted = not quoted
        if letter == mark and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _header_and_argument(unit):
    """Header and argument; only a space separates them (Kepco 3.6.4.5: data must be separated by a space)."""
    parts = unit.split(None, 1)
    return parts[0], parts[1].strip() if len(parts) == 2 else None
