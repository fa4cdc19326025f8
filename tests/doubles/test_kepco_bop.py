"""The double of the Kepco BOP against its manual's printed examples.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from kepco_bop import KepcoBop


class Line:
    """A host at the other end, in a time of its own."""

    def __init__(self, **options):
        self.bop = KepcoBop(**options)
        self.now = 0.0

    def raw(self, data):
        self.bop.receive(data, self.now)
        return b"".join(each[1] for each in self.bop.say(self.now))

    def ask(self, text):
        return self.raw(text.encode() + b"\n").replace(b"\x13", b"").replace(b"\x11", b"").decode().strip("\r\n")


class KepcoBopTest(unittest.TestCase):
    def setUp(self):
        self.line = Line()
        self.bop = self.line.bop
        self.line.ask("*CLS;SYST:REM 1")

    def errors(self):
        told = []
        while (text := self.line.ask("SYST:ERR?")) != '0,"No error"':
            told.append(int(text.split(",")[0]))
        return told

    def test_examples_of_the_root_specifier(self):
        # MG 3.6.4.7, with the values within the rating of a 50 V, 20 A unit
        self.line.ask("VOLT:LEV:IMM 16")
        self.line.ask(":CURR:LEV:IMM 4")
        self.assertEqual((self.bop.voltage_set, self.bop.current_set), (16.0, 4.0))
        self.line.ask("VOLT:LEV 6;:CURR:LEV 15")
        self.assertEqual((self.bop.voltage_set, self.bop.current_set), (6.0, 15.0))
        self.assertEqual(self.errors(), [])

    def test_a_semicolon_stays_in_the_subsystem(self):
        # MG 3.6.6: meas:volt?;curr? reads output voltage and output current; meas:volt?;:curr? the set point
        self.line.ask("FUNC:MODE CURR")
        self.line.ask("CURR 7")
        self.line.ask("OUTP OFF")
        self.assertEqual(self.line.ask("meas:volt?;curr?"), "0E0;0E0")
        self.assertEqual(self.line.ask("meas:volt?;:curr?"), "0E0;7E0")

    def test_a_keyword_of_another_subsystem_is_refused_and_so_is_the_rest(self):
        self.line.ask("CURR 3")
        self.line.ask("SYST:REM 1;CURR 0;:OUTP OFF")
        self.assertEqual(self.bop.current_set, 3.0)
        self.assertTrue(self.bop.output_on)
        self.assertEqual(self.errors(), [-113])

    def test_message_units_of_3_6_4_6(self):
        self.assertEqual(self.line.ask("VOLT 15;MEAS:VOLT?"), "1.5E1")
        self.assertEqual(self.errors(), [])

    def test_numbers_of_paragraph_b_2(self):
        self.line.ask("volt 10345.2e-1")
        self.assertEqual(self.line.ask("VOLT?"), "3.452E1")
        self.line.ask("volt 0.0000034567e6")
        self.assertEqual(self.line.ask("VOLT?"), "3.45E0")
        self.line.ask("VOLT:LIM 6")
        self.line.ask("VOLT MAX")
        self.assertEqual(self.line.ask("VOLT?"), "6E0")
        self.line.ask("CURR 2.71E1")
        self.assertEqual(self.errors(), [-222])
        self.line.ask("CURR 7000")
        self.assertEqual(self.errors(), [-120])

    def test_a_limit_is_told_as_two_numbers(self):
        self.line.ask("CURR:LIM:POS 10;NEG 0.5")  # GL 3.3.5
        self.assertEqual(self.line.ask("CURR:LIM?"), "1E1,-5E-1")
        self.assertEqual(self.line.ask("CURR:LIM:POS?"), "1E1")
        self.line.ask("CURR 10.5")
        self.line.ask("CURR -0.6")
        self.assertEqual(self.errors(), [-222, -222])

    def test_errors_of_the_table(self):
        for text, code in (("VOLT.10", -103), ("VOLT12 1", -108), ("VOLT", -109), ("VOLTAG 1", -102), ("CURR 1,2", -100),
                           ("CURR x", -120), ("HELLO", -113), ("OUTP MAYBE", -141)):
            self.line.ask(text)
            self.assertEqual(self.errors(), [code], text)

    def test_the_queue_holds_fifteen(self):
        for _ in range(20):
            self.line.ask("HELLO")
        self.assertEqual(self.errors(), [-113] * 14 + [-350])

    def test_command_errors_are_in_the_event_register(self):
        self.line.ask("HELLO")
        self.line.ask("CURR 1000")
        self.assertEqual(self.line.ask("*ESR?"), "48")
        self.assertEqual(self.line.ask("*ESR?"), "0")

    def test_local_mode_takes_no_set_point(self):
        self.line.ask("SYST:REM 0")
        self.line.ask("CURR 5")
        self.assertEqual(self.bop.current_set, 0.0)

    def test_bytes_of_the_line(self):
        self.assertEqual(self.line.raw(b"CURR 5\r\n"), b"\x13\r\n\x11")
        self.assertEqual(self.line.raw(b"CURR?\n"), b"\x135E0\r\n\x11")
        self.assertEqual(self.line.raw(b"junk\x1b"), b"\r\n")
        self.assertEqual(self.line.raw(b"CURQ\bR?\n"), b"\x135E0\r\n\x11")
        self.bop.mode(xonxoff=False, prompt=True)
        self.assertEqual(self.line.raw(b"\n"), b"\r\n>")
        self.bop.mode(prompt=False, echo=True)
        self.assertEqual(self.line.raw(b"OUTP?\n"), b"OUTP?1\r\n")
        self.bop.mode(xonxoff=True)
        self.assertEqual(self.line.raw(b"OUTP?\n"), b"OUTP?\x13\r1\r\n\x11")
        self.assertEqual(self.line.raw(b"a\b"), b"a\b \b")

    def test_an_xoff_holds_and_an_xon_lets_go(self):
        self.line.raw(b"\x13")
        self.assertEqual(self.line.raw(b"OUTP?\n"), b"")
        self.assertEqual(self.line.raw(b"\x11"), b"\x131\r\n\x11!")
        self.assertEqual(self.errors(), [-400])

    def test_a_lan_link_says_nothing_to_a_set_command(self):
        line = Line(link="lan")
        self.assertEqual(line.raw(b"CURR 5\r\n"), b"")
        self.assertEqual(line.raw(b"CURR?\r\n"), b"5E0\r\n")

    def test_the_two_identities(self):
        self.assertEqual(self.line.ask("*IDN?"), "KEPCO,BOP1KW 50-20 ,E156884, 2.01")
        self.assertEqual(Line(identity="bit232").ask("*IDN?"), "KEPCO BOP BIT232 REV. 3.1")

    def test_the_voltage_protection_clamps_a_coil(self):
        self.bop.arrange(0.0, load_ohm=2.0, load_henry=0.1)
        for text in ("FUNC:MODE CURR", "VOLT:PROT 10", "CURR 3"):
            self.line.ask(text)
        self.line.now = 0.001
        self.line.ask("*OPC?")
        self.assertAlmostEqual(self.bop.current, 5 * (1 - 2.718281828 ** -0.02), places=6)  # 10 V on 0.1 H, 2 ohm
        self.line.now = 1.0
        self.assertEqual(self.line.ask("MEAS:CURR?"), "3E0")
        self.line.ask("CURR 8")
        self.line.now = 3.0
        self.assertEqual(self.line.ask("MEAS:CURR?"), "5E0")  # 10 V / 2 ohm
        self.assertEqual(self.line.ask("MEAS:VOLT?"), "1E1")
        self.assertEqual(self.line.ask("STAT:QUES:COND?"), "1")

    def test_resistive_off_lets_a_coil_down_slowly(self):
        self.bop.arrange(0.0, load_ohm=0.01, load_henry=1.0)
        for text in ("FUNC:MODE CURR", "CURR 10", "OUTP:MODE RESISTIVE"):
            self.line.ask(text)
        self.line.now = 10.0
        self.line.ask("OUTP OFF")
        self.line.now = 11.0
        self.line.ask("*OPC?")
        self.assertGreater(self.bop.current, 9.0)  # 0.5 V on 1 H takes 0.6 A/s away

    def test_pin_2_switches_off_and_vetoes(self):
        self.line.ask("OUTP ON")
        self.bop.arrange(0.0, pin2=False)
        self.assertEqual(self.line.ask("OUTP?"), "0")
        self.line.ask("OUTP ON")
        self.assertEqual(self.line.ask("OUTP:STAT?;CONT?"), "0;STAND")
        self.line.ask("OUTP:CONT OFF;:OUTP ON")
        self.assertEqual(self.line.ask("OUTP?"), "1")

    def test_limits_last_only_when_stored(self):
        self.line.ask("VOLT:PROT 12")
        self.bop.power_cycle(1.0)
        self.assertAlmostEqual(self.bop.volt_prot_pos, 50.5)
        self.line.ask("SYST:REM 1;:VOLT:PROT 12;:MEM:UPD LIM")
        self.bop.power_cycle(2.0)
        self.assertEqual(self.bop.volt_prot_pos, 12.0)
        self.assertFalse(self.bop.remote)

    def test_a_bit_card_has_its_compliance_in_volt(self):
        line = Line(identity="bit232")
        line.bop.arrange(0.0, load_ohm=10.0)
        for text in ("SYST:REM 1", "FUNC:MODE CURR", "VOLT 20", "CURR 3", "OUTP ON"):
            line.ask(text)
        self.assertEqual(line.ask("MEAS:CURR?"), "2E0")
        line.ask("VOLT:PROT 5")
        self.assertEqual(line.ask("SYST:ERR?"), '-113,"Undefined header"')

    def test_a_late_supply_answers_late(self):
        self.bop.mode(late=0.5)
        self.assertEqual(self.line.raw(b"CURR?\n"), b"")
        self.assertEqual(self.bop.next(), 0.5)
        self.assertEqual(b"".join(each[1] for each in self.bop.say(0.5)), b"\x130E0\r\n\x11")

    def test_history_tells_what_changed_and_when(self):
        self.line.now = 2.5
        self.line.ask("CURR 4")
        self.line.ask("CURR 4")
        self.assertEqual([each for each in self.bop.history if each[1] == "current_set" and each[0] > 0],
                         [[2.5, "current_set", 4.0]])


if __name__ == "__main__":
    unittest.main()
