// The Tic's transfers, byte by byte (the user's guide, sections 7 and 11), and addresses of USB
// devices.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/wire.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo::pololu_tic {
namespace VITREO_TEST_FILE {

void expect_setup(const UsbSetup& setup, int type, int request, int value, int index) {
  EXPECT_EQ(setup.type, type);
  EXPECT_EQ(setup.request, request);
  EXPECT_EQ(setup.value, value);
  EXPECT_EQ(setup.index, index);
}

TEST(TicWire, EncodesCommandsAsTheGuideShowsThem) {
  expect_setup(encode(Command{Code::set_target_position, 1234567890}), 0x40, 0xE0, 0x02D2, 0x4996);
  expect_setup(encode(Command{Code::set_target_velocity, -1}), 0x40, 0xE3, 0xFFFF, 0xFFFF);
  expect_setup(encode(Command{Code::go_home, 1}), 0x40, 0x97, 1, 0);
  expect_setup(encode(Command{Code::set_step_mode, 3}), 0x40, 0x94, 3, 0);
  expect_setup(encode(Command{Code::reset_command_timeout}), 0x40, 0x8C, 0, 0);
  expect_setup(encode(Command{Code::set_setting, 2, 0x53}), 0x40, 0x13, 2, 0x53);
  expect_setup(encode(Read{Code::get_variable, 0x22, 4}), 0xC0, 0xA1, 0, 0x22);
}

TEST(TicWire, DecodesWhatItEncodes) {
  for (const Command& command :
       {Command{Code::set_target_position, -77}, Command{Code::halt_and_set_position, 1 << 30},
        Command{Code::go_home, 1}, Command{Code::energize}, Command{Code::de_energize},
        Command{Code::exit_safe_start}, Command{Code::set_current_limit, 15},
        Command{Code::set_setting, 0xE8, 0x09}, Command{Code::reinitialize}}) {
    const auto decoded = decode_command(encode(command));
    ASSERT_TRUE(decoded);
    EXPECT_EQ(decoded->code, command.code);
    EXPECT_EQ(decoded->argument, command.argument);
    EXPECT_EQ(decoded->setting, command.setting);
  }
  EXPECT_FALSE(decode_command({0x40, 0xFF, 0, 0}));  // the boot loader's door
  EXPECT_FALSE(decode_command({0xC0, 0x85, 0, 0}));
  EXPECT_FALSE(decode_read({0xC0, 0x85, 0, 0}, 4));
  EXPECT_FALSE(decode_read({0x40, 0xA1, 0, 0}, 4));
}

TEST(TicWire, FindsTheVariablesWhereTheGuideHasThem) {
  std::vector<std::uint8_t> bytes(kVariablesSize, 0);
  bytes[0x00] = 10;
  bytes[0x01] = 0x03;  // energized, position uncertain
  bytes[0x02] = 0xC0;  // command timeout, safe start violation
  bytes[0x22] = 0xFE;  // -2
  bytes[0x23] = bytes[0x24] = bytes[0x25] = 0xFF;
  bytes[0x33] = 0xE0;  // 12000 mV
  bytes[0x34] = 0x2E;
  bytes[0x49] = 3;
  const auto v = decode_variables(bytes);
  ASSERT_TRUE(v);
  EXPECT_EQ(v->state, OperationState::normal);
  EXPECT_TRUE(v->energized && v->position_uncertain);
  EXPECT_FALSE(v->homing || v->forward_limit || v->reverse_limit);
  EXPECT_EQ(v->error_status, kCommandTimeout | kSafeStartViolation);
  EXPECT_EQ(v->current_position, -2);
  EXPECT_EQ(v->vin_millivolts, 12000);
  EXPECT_EQ(v->step_mode, 3);
  EXPECT_EQ(encode_variables(*v), bytes);
}

TEST(TicWire, DecodesNoNonsense) {
  std::vector<std::uint8_t> bytes(kVariablesSize, 0);
  EXPECT_TRUE(decode_variables(bytes));
  bytes[0] = 3;  // no such state
  EXPECT_FALSE(decode_variables(bytes));
  bytes[0] = 12;
  EXPECT_FALSE(decode_variables(bytes));
  bytes[0] = 10;
  bytes.pop_back();
  EXPECT_FALSE(decode_variables(bytes));
  EXPECT_FALSE(decode_variables({}));
}

TEST(TicWire, KnowsTheCurrentsOfEachModel) {
  EXPECT_EQ(code_from_current(0x00B3, 0.48), 15);  // T825: 32 mA each
  EXPECT_EQ(code_from_current(0x00B3, 1.1), 34);   // 35 exists not: only even codes above 32
  EXPECT_EQ(code_from_current(0x00B3, 100), 124);
  EXPECT_EQ(code_from_current(0x00C9, 0.48), 12);  // T249: 40 mA each
  EXPECT_EQ(code_from_current(0x00BD, 0.5), 4);    // T500: 495 mA
  EXPECT_EQ(code_from_current(0x00CB, 0.5), 6);    // 36v4: 71.6 mA each
  EXPECT_EQ(code_from_current(0x00B3, 0.01), 0);
  for (const std::uint16_t product : kProducts)
    EXPECT_LE(current_from_code(product, code_from_current(product, 1)), 1 + 1e-9);
}

TEST(UsbAddress, IsReadAndWritten) {
  const UsbAddress tic = parse_usb_address("usb", "usb:1ffb:00b3");
  EXPECT_EQ(tic.vendor, 0x1FFB);
  EXPECT_EQ(tic.product, 0x00B3);
  EXPECT_EQ(tic.serial, "");
  EXPECT_EQ(parse_usb_address("hid", "hid:09DB:009C:01A:7").serial, "01A:7");
  EXPECT_EQ(to_string("hid", parse_usb_address("hid", "hid:09DB:009C:01")), "hid:09db:009c:01");
  for (const char* wrong :
       {"", "usb", "usb:", "usb:1ffb", "usb:1ffb:b3", "usb:1ffb:00b3:", "usb:1ffb:00b3x",
        "hid:1ffb:00b3", "usb:1ffg:00b3", "usb:+ffb:00b3", "usb:1ffb-00b3", "usb:0x1f:00b3"})
    EXPECT_THROW(parse_usb_address("usb", wrong), std::invalid_argument) << wrong;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::pololu_tic
