"""Units as the records name them: each symbol with that of its dimension, as host/text/units.cpp has them.
SPDX-License-Identifier: Apache-2.0
"""

import functools

_SYMBOLS = {
    "m": "m cm mm um nm",
    "s": "s ms us ns min h",
    "m/s": "m/s cm/s mm/s um/s",
    "m/s^2": "m/s^2 mm/s^2",
    "rad": "rad mrad deg arcmin",
    "rad/s": "rad/s deg/s",
    "Hz": "Hz kHz MHz 1/s",
    "1/s^2": "1/s^2",
    "T": "T mT uT",
    "T/m": "T/m mT/m",
    "A": "A mA uA",
    "A/s": "A/s",
    "A/m": "A/m kA/m",
    "V": "V mV uV",
    "ohm": "ohm",
    "N": "N mN uN nN",
    "N/m": "N/m",
    "kg": "kg g mg ug",
    "K": "K mK degC",
    "m^2": "m^2 mm^2 um^2",
    "m^3": "m^3 L mL uL",
    "m^3/s": "m^3/s mL/min uL/min mL/h uL/h",
    "Pa": "Pa kPa mbar bar",
    "W": "W mW",
    "m^2/s": "m^2/s mm^2/s cSt",
    "kg/m^3": "kg/m^3 g/cm^3",
    "1/m": "1/m D",
    "": "%",
}
SI_UNIT = {symbol: si for si, symbols in _SYMBOLS.items() for symbol in symbols.split()}
# Symbols with a space in them.
SI_UNIT.update({f"{prefix}N m": "N m" for prefix in ("", "m", "u", "n")})
SI_UNIT.update({"N s/m": "N s/m", "A m^2": "A m^2", "Pa s": "Pa s", "mPa s": "Pa s"})

_SPELLINGS = {"\u2103": "degC", "\u00b5": "u", "\u03bc": "u", "\u00b0": "deg", "\u00b2": "^2", "\u00b3": "^3",
              "\u03a9": "ohm", "\u00b7": " "}


@functools.lru_cache(maxsize=1024)
def si_unit(symbol):
    """The SI unit of a symbol's dimension: "mm/s" gives "m/s", "%" gives ""; an unknown one stays as it is.

    Values in a record are SI in whatever unit they are shown.
    """
    plain = symbol
    for written, meant in _SPELLINGS.items():
        plain = plain.replace(written, meant)
    return SI_UNIT.get(plain, symbol)
