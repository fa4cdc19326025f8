// Zaber's ASCII protocol against the examples of its manual, both directions.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/wire.h"

#include <gtest/gtest.h>

namespace vitreo::zaber {
namespace VITREO_TEST_FILE {

TEST(ZaberWire, EncodesACommandWithItsChecksum) {
  EXPECT_EQ(encode(Command{1, 0, std::nullopt, "tools echo"}),
            "/1 0 tools echo:" + detail::checksum("1 0 tools echo") + "\n");
  EXPECT_EQ(encode(Command{1, 1, 7, "move abs 10000"}).substr(0, 20), "/1 1 7 move abs 1000");
  EXPECT_EQ(encode(Command{1, 1, std::nullopt, ""}).substr(0, 5), "/1 1:");
}

TEST(ZaberWire, ChecksumIsTheTwosComplementOfTheLowByteOfTheSum) {
  EXPECT_EQ(detail::checksum(""), "00");
  EXPECT_EQ(detail::checksum("0"), "D0");                  // 0x30 + 0xD0 = 0x100
  EXPECT_EQ(detail::checksum("01 0 OK IDLE -- 0"), "8D");  // sum 0x373
}

TEST(ZaberWire, DecodesTheManualsReplies) {
  const auto moving = decode_message("@01 1 OK BUSY -- 0\r\n");
  ASSERT_TRUE(moving);
  EXPECT_EQ(moving->kind, Kind::reply);
  EXPECT_EQ(moving->device, 1);
  EXPECT_EQ(moving->axis, 1);
  EXPECT_TRUE(moving->accepted);
  EXPECT_TRUE(moving->busy);
  EXPECT_EQ(moving->warning, "--");
  EXPECT_EQ(moving->data, "0");
  EXPECT_FALSE(moving->id);
  EXPECT_FALSE(moving->checked);
  const auto idle = decode_message("@01 1 OK IDLE -- 0");
  ASSERT_TRUE(idle);
  EXPECT_FALSE(idle->busy);
  const auto refused = decode_message("@12 0 07 RJ IDLE WR BADDATA");
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->device, 12);
  EXPECT_EQ(refused->id, 7);
  EXPECT_FALSE(refused->accepted);
  EXPECT_EQ(refused->warning, "WR");
  EXPECT_EQ(refused->data, "BADDATA");
}

TEST(ZaberWire, DecodesAlertsAndInformations) {
  const auto alert = decode_message("!01 1 IDLE --");
  ASSERT_TRUE(alert);
  EXPECT_EQ(alert->kind, Kind::alert);
  const auto info = decode_message("#01 0 Visit www.zaber.com for help");
  ASSERT_TRUE(info);
  EXPECT_EQ(info->kind, Kind::info);
  EXPECT_EQ(info->data, "Visit www.zaber.com for help");
}

TEST(ZaberWire, TakesAReplyBackAsItWasEncoded) {
  for (const bool with_checksum : {false, true}) {
    Message message{Kind::reply, 3, 2, 42, false, true, "FS", "STATUSBUSY"};
    const auto back = decode_message(encode(message, with_checksum));
    ASSERT_TRUE(back);
    EXPECT_EQ(back->device, 3);
    EXPECT_EQ(back->axis, 2);
    EXPECT_EQ(back->id, 42);
    EXPECT_FALSE(back->accepted);
    EXPECT_TRUE(back->busy);
    EXPECT_EQ(back->warning, "FS");
    EXPECT_EQ(back->data, "STATUSBUSY");
    EXPECT_EQ(back->checked, with_checksum);
  }
}

TEST(ZaberWire, TakesACommandBackWithWhateverIsLeftOutOfIt) {
  const auto whole = decode_command("/1 2 3 move abs 10000");
  ASSERT_TRUE(whole);
  EXPECT_EQ(whole->device, 1);
  EXPECT_EQ(whole->axis, 2);
  EXPECT_EQ(whole->id, 3);
  EXPECT_EQ(whole->data, "move abs 10000");
  const auto home = decode_command("/home");
  ASSERT_TRUE(home);
  EXPECT_EQ(home->device, 0);
  EXPECT_EQ(home->data, "home");
  const auto poll = decode_command("/1 1");
  ASSERT_TRUE(poll);
  EXPECT_EQ(poll->axis, 1);
  EXPECT_EQ(poll->data, "");
  const std::string line = encode(Command{99, 9, 99, "get pos"});
  const auto checked = decode_command(line.substr(0, line.size() - 1));
  ASSERT_TRUE(checked);
  EXPECT_EQ(checked->device, 99);
  EXPECT_EQ(checked->data, "get pos");
}

TEST(ZaberWire, IgnoresWhatHasAWrongChecksumOrIsNoPacket) {
  EXPECT_FALSE(decode_command("/1 1 home:00"));
  EXPECT_FALSE(decode_command("1 1 home"));
  EXPECT_FALSE(decode_command(""));
  EXPECT_FALSE(decode_command("/" + std::string(80, 'x')));
  for (const char* bad :
       {"", "@", "@01 1 OK BUSY -- 0:00", "01 1 OK IDLE -- 0", "@01 1 OK", "@01 1 YES IDLE -- 0",
        "@01 1 OK MOVE -- 0", "@01 1 OK IDLE - 0", "@1x 1 OK IDLE -- 0", "@01 11 OK IDLE -- 0",
        "@01 1 OK IDLE --\x01 0", "@-1 1 OK IDLE -- 0"})
    EXPECT_FALSE(decode_message(bad)) << bad;
}

TEST(ZaberWire, ReadsNumbersAndNothingElse) {
  EXPECT_EQ(decode_numbers("10 -20 3.5"), (std::vector<double>{10, -20, 3.5}));
  EXPECT_EQ(decode_numbers(""), std::vector<double>{});
  for (const char* bad : {"x", "1 x", "1,2", "nan", "inf", "0x10"})
    EXPECT_FALSE(decode_numbers(bad)) << bad;
}

TEST(ZaberWire, GivesSpeedsInMicrostepsPerSecondTimes1Point6384) {
  EXPECT_EQ(speed_data(10000), 16384);
  EXPECT_DOUBLE_EQ(usteps_per_second(16384), 10000);
}

TEST(ZaberWire, ExplainsAFlag) {
  EXPECT_EQ(meaning("FS"), "stalled and stopped (FS)");
  EXPECT_EQ(meaning("QQ"), "QQ");
  EXPECT_TRUE(is_fault("FS"));
  EXPECT_FALSE(is_fault("WR"));
  EXPECT_FALSE(is_fault("--"));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::zaber
