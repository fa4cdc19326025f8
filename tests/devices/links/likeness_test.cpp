// Likeness of answers to those of known instruments, and echoes, judged from the bytes alone.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/likeness.h"

#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::string_literals;

std::string like(const std::string& text) { return likeness(bytes(text)).value_or("nothing"); }

TEST(Likeness, KnowsAZaberByTheHeadOfItsReplies) {
  EXPECT_EQ(like("@01 0 RJ IDLE -- BADCOMMAND\r\n"), "a Zaber device");
  EXPECT_EQ(like("@12 1 07 OK BUSY WR 0:5F\r\n"), "a Zaber device");
  EXPECT_EQ(like("!03 1 IDLE FS\r\n"), "a Zaber device");
  EXPECT_EQ(like("#01 0 Visit www.zaber.com\r\n"), "a Zaber device");
  EXPECT_EQ(like("\xFF\x00 0\r\n@01 0 OK IDLE -- 0"s), "a Zaber device") << "on a later line";
}

TEST(Likeness, KnowsASCPIInstrumentByItsIdentityOrItsErrors) {
  EXPECT_EQ(like("KEPCO,BOP 36-12MG,A123456,1.74\r\n"), "the SCPI instrument KEPCO BOP 36-12MG");
  EXPECT_EQ(like("\x13LSCI,MODEL475,1,1\r\n\x11"), "the SCPI instrument LSCI MODEL475");
  EXPECT_EQ(like("-113,\"Undefined header\"\n"), "a SCPI instrument");
}

TEST(Likeness, KnowsAnMp285ByItsErrorLetters) {
  EXPECT_EQ(like("4\r"), "a Sutter MP-285 that has not understood");
  EXPECT_EQ(like("=\r4\r"), "a Sutter MP-285 that has not understood");
}

// Status 2 of TMCL is "invalid command"; the ninth byte is the sum of the others.
TEST(Likeness, KnowsATrinamicModuleByItsChecksum) {
  EXPECT_EQ(like("\x02\x01\x02\x0A\x00\x00\x00\x00\x0F"s), "a Trinamic module (TMCL)");
  EXPECT_EQ(like("\x02\x01\x02\x0A\x00\x00\x00\x00\x10"s), "nothing");
}

TEST(Likeness, IsNoneOfWhatManyInstrumentsMaySay) {
  for (const char* text : {"", "\r", "\r\n", "OK\r\n", "1.5\r\n", "5\r", "4", "1,2,3,4\r\n?",
                           "@01 hello", "V,3", "0,1", "\xF8\xFE\xE0"})
    EXPECT_EQ(like(text), "nothing") << text;
}

TEST(Echo, IsWhatWasSentFromItsFirstByteOnButForLineEnds) {
  const auto echo = [](const std::string& sent, const std::string& heard) {
    return is_echo(bytes(sent), bytes(heard));
  };
  EXPECT_TRUE(echo("*IDN?\n", "*IDN?\n"));
  EXPECT_TRUE(echo("*IDN?\n", "*IDN?\r\nKEPCO"));
  EXPECT_TRUE(echo("\x03V12\r", "\x03V"));
  EXPECT_FALSE(echo("*IDN?\n", "KEPCO"));
  EXPECT_FALSE(echo("*IDN?\n", "*")) << "one byte may be chance";
  EXPECT_FALSE(echo("\r\n", "\r\n"));
  EXPECT_FALSE(echo("", "ab"));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
