// Quantities that are Modbus registers: their bytes, and an instrument of one file with them over
// its emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/registers.h"

#include "devices/scripted/emulator.h"
#include "devices/scripted/instrument.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>

namespace vitreo::scripted {
namespace VITREO_TEST_FILE {

std::string bytes(std::initializer_list<int> all) {
  std::string text;
  for (const int one : all) text.push_back(static_cast<char>(one));
  return text;
}

// The frames of PyMeasure's tests of the TC038D, without unit and CRC: 00 00 asks for the
// temperature, 01 06 sets 25.0 degC.
TEST(Registers, SpeakTheFramesOfATemperatureController) {
  const RegisterDeclaration temperature{0x0000, RegisterTable::holding, RegisterFormat::i32, false,
                                        0.1};
  EXPECT_EQ(read_request(temperature), bytes({3, 0, 0, 0, 2}));
  EXPECT_NEAR(std::get<double>(*value_in(temperature, bytes({3, 4, 0, 0, 0, 0xDD}))), 22.1, 1e-12);
  EXPECT_NEAR(std::get<double>(*value_in(temperature, bytes({3, 4, 0xFF, 0xFF, 0xFF, 0xF6}))), -1,
              1e-12);
  RegisterDeclaration set_point = temperature;
  set_point.address = 0x0106;
  const std::string request = write_request(set_point, 25.0);
  EXPECT_EQ(request, bytes({0x10, 1, 6, 0, 2, 4, 0, 0, 0, 0xFA}));
  EXPECT_TRUE(confirms(request, bytes({0x10, 1, 6, 0, 2})));
  EXPECT_FALSE(confirms(request, bytes({0x10, 1, 7, 0, 2})));
}

TEST(Registers, EachFormatComesBackAndWhatHasNoPlaceIsRefused) {
  const std::pair<RegisterFormat, double> formats[] = {{RegisterFormat::u16, 65535},
                                                       {RegisterFormat::i16, -32768},
                                                       {RegisterFormat::u32, 4294967295.0},
                                                       {RegisterFormat::i32, -2147483648.0},
                                                       {RegisterFormat::f32, -0.375}};
  for (const auto& [format, number] : formats)
    for (const bool low_first : {false, true}) {
      const RegisterDeclaration declared{7, RegisterTable::holding, format, low_first, 1};
      const auto words = words_of(declared, number);
      EXPECT_EQ(std::get<double>(*value_of_words(declared, words)), number);
    }
  const RegisterDeclaration small{7, RegisterTable::holding, RegisterFormat::i16, false, 0.1};
  EXPECT_THROW(write_request(small, 3276.9), std::out_of_range);
  EXPECT_THROW(write_request(small, -3277.0), std::out_of_range);
}

TEST(Registers, AnAnswerOfAnotherLengthOrFunctionIsNone) {
  const RegisterDeclaration one{0, RegisterTable::input, RegisterFormat::u16, false, 1};
  EXPECT_EQ(read_request(one), bytes({4, 0, 0, 0, 1}));
  EXPECT_FALSE(value_in(one, bytes({4, 4, 0, 0, 0, 1})).has_value());
  EXPECT_FALSE(value_in(one, bytes({3, 2, 0, 1})).has_value());
  EXPECT_FALSE(value_in(one, "").has_value());
}

// An instrument of one file

constexpr const char* kFile = R"(
return {
  title = "Oven", kind = "actuator",
  link = { modbus = { unit = 3, framing = FRAMING } },
  identity = { ask = "\3\0\0\0\2", match = "^\3\4" },
  make_safe = { set_point = 20, on = false },
  properties = {
    temperature = { register = 0, type = "i32", scale = 0.1 },
    set_point = { register = 2, type = "f32", words = "low_first", set = true, min = 0, max = 90 },
    on = { register = 5, table = "coil", set = true },
    counted = { register = 9, type = "u16", set = true, min = 0, max = 100000 },
    absent = { register = 77, type = "u16" },
  },
  emulator = { registers = {
    set_point = 20, on = false, counted = 4, temperature = function(e) return e.on and e.set_point or 20 end } },
})";

Loaded oven(const std::string& framing) {
  std::string text = kFile;
  text.replace(text.find("FRAMING"), 7, '"' + framing + '"');
  return load("oven.lua", text, [](std::string_view) { return std::nullopt; });
}

class ModbusFile : public testing::TestWithParam<const char*> {};
TEST_P(ModbusFile, IsReadSetAndMadeSafe) {
  const auto clock = virtual_clock();
  const auto peer = make_emulator(oven(GetParam()), {});
  auto heater =
      open_instrument({oven(GetParam()), memory_byte_link(*peer, *clock), "oven", *clock});
  const auto& all = heater->info().quantities;
  const auto index = [&](const std::string& name) {
    std::size_t at = 0;
    while (all[at].name != name) ++at;
    return at;
  };
  const auto read = [&](const std::string& name) {
    return heater->read(index(name), std::chrono::seconds(1)).value;
  };
  heater->set(index("set_point"), 61.5);
  EXPECT_EQ(std::get<double>(read("set_point")), 61.5);
  EXPECT_EQ(std::get<double>(read("temperature")), 20);
  heater->set(index("on"), true);
  EXPECT_EQ(std::get<bool>(read("on")), true);
  EXPECT_NEAR(std::get<double>(read("temperature")), 61.5, 1e-9);
  try {
    heater->set(index("counted"), 70000.0);
    ADD_FAILURE() << "a register of 16 bits took 70000";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::out_of_range);
  }
  try {
    read("absent");
    ADD_FAILURE() << "there is no such register";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(std::string(error.what()).find("illegal data address"), std::string::npos)
        << error.what();
  }
  heater->make_safe();
  EXPECT_EQ(std::get<bool>(read("on")), false);
  EXPECT_EQ(std::get<double>(read("set_point")), 20);
}
INSTANTIATE_TEST_SUITE_P(Framings, ModbusFile, testing::Values("rtu", "tcp"));

TEST(ModbusFile, WhatIsWrongInItIsToldByItsKey) {
  const auto fault = [](const std::string& link, const std::string& property) {
    try {
      load("x.lua",
           "return { title = 'x', kind = 'instrument', identity = 'a', link = {" + link +
               "}, properties = { p = {" + property + "} } }",
           [](std::string_view) { return std::nullopt; });
    } catch (const ScriptFault& error) {
      return std::string(error.what());
    }
    return std::string("no fault");
  };
  EXPECT_NE(fault("", "register = 1").find("properties.p.register: is of Modbus"),
            std::string::npos);
  EXPECT_NE(
      fault("modbus = {}", "register = 1, type = 'i64'").find("properties.p.type: must be one"),
      std::string::npos);
  EXPECT_NE(fault("modbus = {}", "register = 1, table = 'input', set = true, min = 0, max = 1")
                .find("properties.p.set: cannot be"),
            std::string::npos);
  EXPECT_NE(fault("modbus = { unit = 300 }", "register = 1").find("link.modbus.unit: must be"),
            std::string::npos);
  EXPECT_NE(
      fault("modbus = {}, terminator = 'a'", "register = 1").find("link.terminator: is not of"),
      std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scripted
