"""A Kepco BOP bipolar power supply with a coil behind it, by serial line or LAN.

Sources, named at the lines below by their letters:
  MG    Kepco BOP 1KW-MG operator manual (firmware 2.38 to 4.12, pages 3-51 to 3-63, appendices A and B)
  GL    Kepco BOP-GL 1KW operator manual 022814 (pages 3-7, 3-8, 3-30)
  MST   Kepco MST 488 programmer manual, table B-6 (the explanations of Kepco's SCPI errors)
  ABC   Kepco ABC manual 3.6.3.2 and MBT manual 3.3.3.3 (the prompt sequence, which the MG manual describes likewise)
  BIT   Kepco BIT 232 manual, figure A-5
  ISIS  github ISISComputingGroup/EPICS-kepco kepcoApp/protocol/kepco.proto
  CPP   a public C++ driver of this instrument (kepco.cpp, class kepco_bop, with both *IDN? texts it met)
  SLAB  github SchusterLab/slab instruments/KEPCOPowerSupply.py
  SCPI  SCPI-99
SPDX-License-Identifier: Apache-2.0
"""

import math
import re

from double import ByteDouble
from scpi import ScpiError, TEXTS, Tree

XON, XOFF, CR, LF, BS, ESC, CAN, NAK = 0x11, 0x13, 0x0D, 0x0A, 0x08, 0x1B, 0x18, 0x15

ERROR_TEXTS = {
    **TEXTS,
    -108: "Parameter Not Allowed Error",  # MST table B-6
    -111: "Header seperator error",  # MST table B-6, spelt so
    -350: "Too many errors",  # MST B.46
}

# *IDN? as two public drivers met it on a wire, and as a third quotes it.
IDENTITIES = {
    "bit232": "KEPCO BOP BIT232 REV. 3.1",  # CPP; BIT figure A-5 prints it as KEPCO BOP BIT 232 REV n
    "mg": "KEPCO,BOP1KW 50-20 ,E156884, 2.01",  # CPP
    "bit4886": "KEPCO, BIT4886-6 200-20, A38621 11/10/98, 1.81-1.81",  # ISIS, comment of getFirmware
}


class KepcoBop(ByteDouble):
    """The supply and the coil."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "link": "serial",  # or lan: no terminator after a set command, no flow control characters
        "identity": "mg",  # a key of IDENTITIES, or the text itself
        "xonxoff": True,  # MG 3.5.6: the factory setting is ENABLE
        "echo": False,  # MG 3.5.6.2.2
        "prompt": False,  # MG 3.5.6: the factory setting is DISABLE
        "rst_on": False,  # GL B.144 RO0/RO1: whether *RST leaves the output on
        "padded": False,  # no source for the number of digits: 2.71E1 (MG B.2), or 2.7100E+1
        "signed_limits": True,  # no source for the sign with which a negative limit is told: -5, or 5
        "volts": 50.0,
        "amperes": 20.0,
        "box": 0.01,  # no source: figure 1-3 (the least protection limit) is a drawing; a share of the rated value
    }
    STATE = (
        "remote", "func_mode", "current_set", "voltage_set", "output_on", "output_mode", "output_control", "pin2",
        "curr_lim_pos", "curr_lim_neg", "volt_lim_pos", "volt_lim_neg", "curr_prot_pos", "curr_prot_neg",
        "volt_prot_pos", "volt_prot_neg", "load_ohm", "load_henry", "current", "peak_current", "ampere_seconds",
        "errors", "esr", "lasting", "resets",
    )

    def __init__(self, **options):
        self.lasting = {}
        self.load_ohm, self.load_henry, self.resets = 1.0, 0.0, 0
        self.pin2 = True  # MG B.15: open is high
        self.current = self.peak_current = self.ampere_seconds = 0.0
        self._tree = Tree(self._commands())
        super().__init__(**options)

    @property
    def bit_card(self):
        """Whether this is a 400 W unit behind a BIT card: VOLT is then the compliance in current mode."""
        return self.identity.startswith("bit")

    def start(self, now):
        """MG B.12: the factory default at power-up is local mode and output on."""
        self._line = bytearray()
        self._last = 0
        self._held = None  # what is kept back after an XOFF
        self.put(now, remote=False, func_mode="VOLT", current_set=0.0, voltage_set=0.0, output_on=True,
                 output_mode="ACTIVE",  # no source for which of the three is the factory's
                 output_control="STANDBY",  # MG B.15: factory default
                 esr=128)  # IEEE 488.2 11.5.1.1.2: bit 7, power on
        self.errors = []
        self.current = 0.0  # the coil's energy is gone before the power is back
        # MG 3.3.4: defaults are the rated values, and 1.01 of them for the protection
        limits = {
            "curr_lim_pos": self.amperes, "curr_lim_neg": self.amperes, "volt_lim_pos": self.volts,
            "volt_lim_neg": self.volts, "curr_prot_pos": 1.01 * self.amperes, "curr_prot_neg": 1.01 * self.amperes,
            "volt_prot_pos": 1.01 * self.volts, "volt_prot_neg": 1.01 * self.volts,
        }
        self.put(now, **{**limits, **self.lasting})  # GL 3.3.5: MEM:UPD LIM keeps the limits over a power cycle

    # -- physics -------------------------------------------------------------------------------------------

    @property
    def flowing(self):
        """Whether the output carries its set point."""
        return self.output_on and self._pin_allows()

    def _pin_allows(self):
        if self.output_control == "HIGH":  # MG B.15
            return self.pin2
        if self.output_control == "LOW":
            return not self.pin2
        return True

    def _drive(self):
        """(wanted current, least voltage, greatest voltage) of the output stage in current mode."""
        if self.func_mode == "CURR" and self.flowing:
            if self.bit_card:  # HuangBo-Chien Kepco_BOP_Utilities.py Set_Voltage_Limit: VOLT in current mode
                return self.current_set, -abs(self.voltage_set), abs(self.voltage_set)
            return self.current_set, -self.volt_prot_neg, self.volt_prot_pos
        if self.flowing:  # voltage mode: the current that the voltage makes in the load, within CURR:PROT
            wanted = self.voltage_set / max(self.load_ohm, 1e-9)
            wanted = min(max(wanted, -self.curr_prot_neg), self.curr_prot_pos)
            return wanted, -abs(self.voltage_set), abs(self.voltage_set)
        if self.output_mode == "ACTIVE":  # MG 3.3.6 [fact sheet]: 0 A and 0 V, limits kept
            return 0.0, -self.volt_prot_neg, self.volt_prot_pos
        least = self.box * self.volts  # MG B.12: current programmed to zero, voltage protect to a low value
        return 0.0, -least, least

    def advance(self, now):
        """Lets the current of the coil run to this time: L dI/dt = V - R I, V at a limit until I is as wanted."""
        span, before = now - self.now, self.current
        super().advance(now)
        wanted, lower, upper = self._drive()
        if span > 0:
            self.current = self._after(span, before, wanted, lower, upper)
        if self.load_henry <= 0:  # a resistor follows at once
            self.current = self._after(0.0, before, wanted, lower, upper)
        self.peak_current = max(self.peak_current, abs(before), abs(self.current))

    def _after(self, span, before, wanted, lower, upper):
        """The current a span later; adds to the ampere seconds on the way (trapezoids for the curved part)."""
        ohm, henry = max(self.load_ohm, 1e-9), self.load_henry
        held = min(max(wanted, lower / ohm), upper / ohm)
        if henry <= 0:
            self.ampere_seconds += abs(held) * span
            return held
        final = (upper if wanted > before else lower) / ohm
        reached = math.inf  # seconds until the current is as wanted
        if abs(final - before) > abs(wanted - before):  # gets there in finite time
            reached = -henry / ohm * math.log((wanted - final) / (before - final)) if wanted != before else 0.0
        curved = min(span, reached)
        after = wanted if reached <= span else final + (before - final) * math.exp(-curved * ohm / henry)
        self.ampere_seconds += (abs(before) + abs(after)) / 2 * curved + abs(wanted) * max(0.0, span - reached)
        return after

    def measured_voltage(self):
        """The voltage at the terminals once the current stands still."""
        if self.func_mode == "VOLT":
            return self.current * self.load_ohm if not self.flowing else self.voltage_set
        wanted, lower, upper = self._drive()
        if abs(wanted - self.current) < 1e-9 * max(1.0, abs(wanted)):
            return self.current * self.load_ohm
        return upper if wanted > self.current else lower

    def arranged(self, now):
        """MG B.15: with STANDBY a low pin switches the output off for good."""
        if self.output_control == "STANDBY" and not self.pin2:
            self.put(now, output_on=False)
        self.advance(now)

    # -- the line ------------------------------------------------------------------------------------------

    def _tell_host(self, data, now):
        if self._held is not None:
            self._held += data  # MG 3.5.6.2: kept in the buffer while the host has sent an XOFF
        else:
            self.answer(data, now)

    def take(self, byte, now):
        """MG 3.5.6.1 and 3.5.6.2: control characters, echo, terminators."""
        serial = self.link == "serial"
        last, self._last = self._last, byte
        if byte in (CR, LF):
            if {last, byte} == {CR, LF}:  # MG 3.5.6.2: only the first of CR LF or LF CR is answered
                self._last = 0
                return
            self._terminated(byte, now)
        elif serial and byte == ESC:  # MG: resets its input buffer and returns a CR LF sequence
            self._line.clear()
            self._tell_host(b"\r\n", now)
        elif serial and byte == CAN:  # MG: resets the receive and transmit pointers and queues
            self._line.clear()
            self._out.clear()
            self._held = None if self._held is None else b""
        elif serial and byte == XOFF and self.xonxoff:
            self._error(-400, now)  # MG 3.5.6.2 caution
            self._held = b"" if self._held is None else self._held
        elif serial and byte == XON and self.xonxoff:
            if self._held is not None:  # MG caution: all data in its buffer followed by the exclamation character
                held, self._held = self._held, None
                self.answer(held + b"!", now)
        elif serial and byte == BS:
            if self._line:
                self._line.pop()
            if self.echo:
                self._tell_host(b"\b \b", now)  # MG: echoed as BS Space BS
        elif byte >= 0x20:  # MG: only seven control characters are acknowledged
            self._line.append(byte)
            if serial and self.echo:
                self._tell_host(bytes([byte]), now)
                if len(self._line) == 128:  # MG 3.5.6.2.2: not more than 127 characters between terminators
                    self._tell_host(bytes([NAK]), now)
                    self._error(-400, now)

    def _terminated(self, byte, now):
        serial = self.link == "serial"
        flow = serial and self.xonxoff
        if flow:  # MG 3.5.6.2.1: returned as XOFF CR if echo mode is on, as XOFF if echo mode is off
            self._tell_host(bytes([XOFF]) + (b"\r" if self.echo else b""), now)
        line = self._line.decode("latin-1")
        self._line.clear()
        self.tell(now, "line", line)
        reply = self._parse(line, now)
        if serial:
            # MG 3.5.6.2: when the line is parsed the BOP sends CR LF; a reply stands before it (SLAB, CPP).
            text = reply.encode("latin-1") + b"\r\n"
            if self.prompt:
                text += b">"  # ABC 3.6.3.2: the prompt sequence CR LF >
            if flow:
                text += bytes([XON])  # SLAB strips 13 and 11 around each reply
            self._tell_host(text, now)
        elif reply:
            self.answer(reply.encode("latin-1") + b"\r\n", now)  # ISIS, kepcoBOP by TCPIP: terminator CR LF

    # -- parsing -------------------------------------------------------------------------------------------

    def _error(self, code, now):
        if len(self.errors) < 15:  # MST B.46: 15 errors, the last one is -350
            self.errors.append(code)
        else:
            self.errors[-1] = -350
        bit = {1: 32, 2: 16, 3: 8, 4: 4}[abs(code) // 100]  # MG A.5
        self.put(now, esr=self.esr | bit)
        self.tell(now, "error", code)

    def _parse(self, line, now):
        replies = []
        if len(line) > 253:  # MG B.2: the largest string that can be received; no source for which error
            self._error(-223, now)
            return ""
        if self.link == "serial" and line.count("?") > 4:  # MG 3.5.6.2.2: no more than four queries on a line
            self._error(-400, now)
            return ""
        try:
            for handler, argument, query in self._tree.units(line):
                reply = handler(argument, now)
                self.advance(now)
                if query:
                    replies.append(reply)
        except ScpiError as error:
            self._error(error.code, now)  # the rest of the line is not carried out
        return ";".join(replies)  # SCPI-99 / IEEE 488.2: response units are separated by semicolons

    def _number(self, argument, least, greatest):
        """A number by MG B.2; MIN and MAX by the same paragraph."""
        if argument is None:
            raise ScpiError(-109)
        if "," in argument:
            raise ScpiError(-100)  # MST: "more information included which is not recognized"
        if argument.upper() in ("MAX", "MAXIMUM"):
            return greatest
        if argument.upper() in ("MIN", "MINIMUM"):
            return least
        form = re.fullmatch(r"([+-]?)(\d*)(?:\.(\d*))?(?:[eE]([+-]?\d+))?", argument)
        if not form or not (form[2] or form[3]):
            raise ScpiError(-120)
        # MG B.2: four digits before the point and eight behind it are recognised: 10345.2e-1 is 34.52
        text = f"{form[1]}{(form[2] or '0')[-4:]}.{(form[3] or '0')[:8]}e{form[4] or '0'}"
        value = float(text)
        if abs(value) > 6500.9999:
            raise ScpiError(-120)  # MG B.2
        if abs(value) < 0.000001:
            value = 0.0  # MG B.2: the least number that is processed
        # MG B.17: beyond Imax -222
        if self.strict and not least - 1e-9 <= value <= greatest + 1e-9:
            raise ScpiError(-222)
        return value

    def _text(self, value):
        """MG B.2: scientific notation, 2.71E1 for 27.1."""
        if value == 0:
            return "0.0000E+0" if self.padded else "0E0"
        exponent = math.floor(math.log10(abs(value)) + 1e-12)
        mantissa = value / 10**exponent
        if self.padded:
            return f"{mantissa:.4f}E{exponent:+d}"
        return f"{mantissa:.4f}".rstrip("0").rstrip(".") + f"E{exponent}"

    @staticmethod
    def _choice(argument, choices):
        if argument is None:
            raise ScpiError(-109)
        for short, full in choices.items():
            if argument.upper() in (short, full):
                return full
        raise ScpiError(-141)  # SCPI-99; Kepco's table was not found for this case

    def _plain(self, argument):
        if argument is not None:
            raise ScpiError(-100)  # MST

    def _in_remote(self):
        """Fact sheet and CPP, SLAB, ISIS: SYST:REM 1 is needed on a serial line before set commands act.

        no source: what a unit in local mode answers to a set command; here it is without effect and without error."""
        return self.remote or self.link != "serial"

    def _set(self, now, **changes):
        if self._in_remote():
            self.put(now, **changes)
        else:
            self.tell(now, "ignored in local mode", list(changes))

    def _level(self, which):
        """Handlers of CURR and VOLT, MG B.17, B.18, B.20, B.86, B.87."""
        name = {"curr": "current_set", "volt": "voltage_set"}[which]
        rated = {"curr": "amperes", "volt": "volts"}[which]

        def set_level(argument, now):
            if self.bit_card:
                greatest, least = getattr(self, rated), -getattr(self, rated)
            else:
                greatest, least = getattr(self, which + "_lim_pos"), -getattr(self, which + "_lim_neg")
            self._set(now, **{name: self._number(argument, least, greatest)})

        def tell_level(argument, now):
            if argument is None:
                return self._text(getattr(self, name))  # MG B.12: also the saved value while the output is off
            # MG B.18: MAX is the greatest current of the model, MIN the least and always negative
            return self._text(self._number(argument, -getattr(self, rated), getattr(self, rated)))

        return set_level, tell_level

    def _limit(self, which, kind):
        """Handlers of LIM and PROT: {sign: (set, tell)}; MG B.21 to B.36, B.88 to B.104."""
        rated = {"curr": "amperes", "volt": "volts"}[which]
        name = f"{which}_{kind}_"

        def bounds():
            most = getattr(self, rated)
            # MG B.21: between zero and nominal; MG B.33: between the box value and 1 % above the rated one
            return (0.0, most) if kind == "lim" else (self.box * most, 1.01 * most)

        def told(sign):
            value = getattr(self, name + sign)
            return self._text(-value if sign == "neg" and self.signed_limits else value)

        def handlers(signs):
            def set_limit(argument, now):
                value = self._number(argument, *bounds())
                self._set(now, **{name + sign: value for sign in signs})

            def tell_limit(argument, now):
                self._plain(argument)
                return ",".join(told(sign) for sign in signs)  # MG B.22: the positive limit, then the negative

            return set_limit, tell_limit

        return {"": handlers(("pos", "neg")), "pos": handlers(("pos",)), "neg": handlers(("neg",))}

    def _commands(self):
        commands = {
            "*IDN?": lambda a, now: IDENTITIES.get(self.identity, self.identity),
            "*CLS": self._clear, "*RST": self._reset, "*OPC?": lambda a, now: "1", "*OPC": self._complete,
            "*ESR?": self._tell_esr,
            "*STB?": lambda a, now: str((4 if self.errors else 0) + (32 if self.esr & 127 else 0)),
            "*WAI": lambda a, now: None,
            "SYSTem:REMote": self._remote, "SYSTem:REMote?": lambda a, now: str(int(self.remote)),
            "SYSTem:ERRor?": self._next_error,
            "[SOURce:]FUNCtion:MODE": self._function,
            "[SOURce:]FUNCtion:MODE?": lambda a, now: "1" if self.func_mode == "CURR" else "0",  # ISIS: read as %d
            "OUTPut[:STATe]": self._output, "OUTPut[:STATe]?": lambda a, now: str(int(self.output_on)),  # MG B.14
            "OUTPut:MODE": self._output_mode, "OUTPut:MODE?": lambda a, now: self.output_mode,  # MG B.16
            "OUTPut:CONTrol": self._control,
            # MG B.16 (111315): returns HIGH, LOW, STAND or OFF
            "OUTPut:CONTrol?": lambda a, now: {"STANDBY": "STAND"}.get(self.output_control, self.output_control),
            "MEASure[:SCALar]:CURRent[:DC]?": lambda a, now: self._text(self.current),
            "MEASure[:SCALar]:VOLTage[:DC]?": lambda a, now: self._text(self.measured_voltage()),
            "MEASure[:SCALar][:VOLTage][:DC]?": lambda a, now: self._text(self.measured_voltage()),
            "STATus:QUEStionable:CONDition?": lambda a, now: str(self._condition()),
            "MEMory:UPDate": self._update,
        }
        for which, word in (("curr", "CURRent"), ("volt", "VOLTage")):
            setter, teller = self._level(which)
            head = f"[SOURce:]{word}[:LEVel][:IMMediate][:AMPlitude]"
            commands[head], commands[head + "?"] = setter, teller
            for kind, mnemonic in (("lim", "LIMit"), ("prot", "PROTect")):
                handlers = self._limit(which, kind)
                for sign, tail in (("", "[:BOTH]"), ("pos", ":POSitive"), ("neg", ":NEGative")):
                    head = f"[SOURce:]{word}[:LEVel]:{mnemonic}{tail}"
                    commands[head], commands[head + "?"] = map(self._not_on_a_bit_card, handlers[sign])
        return commands

    def _not_on_a_bit_card(self, handler):
        """no source that a BIT 232 card knows LIM or PROT; its manual's index was not found."""
        def guarded(argument, now):
            if self.bit_card:
                raise ScpiError(-113)
            return handler(argument, now)
        return guarded

    # -- commands ------------------------------------------------------------------------------------------

    def _clear(self, argument, now):
        self.errors = []  # KLN manual A.2, MG A.2: also clears the error queue
        self.put(now, esr=0)

    def _reset(self, argument, now):
        self.put(now, resets=self.resets + 1)
        # no source but the KLN manual A.4 (voltage and current 0); output by GL B.144
        self.put(now, func_mode="VOLT", voltage_set=0.0, current_set=0.0, output_on=self.rst_on)

    def _complete(self, argument, now):
        self.put(now, esr=self.esr | 1)  # MG A.7

    def _tell_esr(self, argument, now):
        value, self.esr = self.esr, 0  # MG A.5: after it has been read the register is cleared
        return str(value)

    def _remote(self, argument, now):
        self.put(now, remote=self._boolean(argument))  # ISIS: SYST:REM 0|1; CPP: syst:rem on

    def _boolean(self, argument):
        return self._choice(argument, {"1": "ON", "0": "OFF"}) == "ON"  # MG B.12: 0 or OFF, 1 or ON

    def _next_error(self, argument, now):
        code = self.errors.pop(0) if self.errors else 0  # MST B.46: first in, first out, removed as it is read
        return f'{code},"{ERROR_TEXTS[code]}"'

    def _function(self, argument, now):
        self._set(now, func_mode=self._choice(argument, {"CURR": "CURRENT", "VOLT": "VOLTAGE"})[:4])

    def _output(self, argument, now):
        wanted = self._boolean(argument)
        if wanted and self.output_control == "STANDBY" and not self.pin2:
            self.tell(now, "vetoed by pin 2", True)  # MG B.15 with the fact sheet: a low pin keeps the output off
            return
        if self.output_control in ("HIGH", "LOW"):
            self.tell(now, "left to pin 2", wanted)  # MG B.15: OFF or STANDBY is required for OUTP ON and OFF
            return
        self._set(now, output_on=wanted)

    def _output_mode(self, argument, now):
        choices = {"ACT": "ACTIVE", "RES": "RESISTIVE", "BATT": "BATTERY", "RESI": "RESISTIVE"}  # MG B.15, B.17
        self._set(now, output_mode=self._choice(argument, choices))

    def _control(self, argument, now):
        choices = {"HIGH": "HIGH", "LOW": "LOW", "STAN": "STANDBY", "OFF": "OFF"}  # MG B.15 (111315)
        self._set(now, output_control=self._choice(argument, choices))
        self.arranged(now)

    def _condition(self):
        """Bit 0 voltage mode, bit 1 current mode [fact sheet]; no source: in protection the other bit is set."""
        in_current = self.func_mode == "CURR"
        wanted, lower, upper = self._drive()
        clamped = abs(wanted - self.current) > 1e-6 * max(1.0, abs(wanted))
        return 2 if in_current != clamped else 1

    def _update(self, argument, now):
        """GL 3.3.5: MEM:UPD LIM keeps the limits for the next power-up; MG B.15: INT the trigger port's."""
        kind = self._choice(argument, {"LIM": "LIM", "INT": "INT", "OUT": "OUT", "SER": "SER"})
        if kind == "LIM":
            names = [name for name in self.STATE if "_lim_" in name or "_prot_" in name]
            self.put(now, lasting={name: getattr(self, name) for name in names})


DOUBLE = KepcoBop
