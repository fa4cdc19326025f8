// The line's settings of a rig file: through the readers of serial drivers, and to the guardian, by
// which an amplifier must be reached as the host reached it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/byte_script.h"
#include "host/rig/rig_settings.h"
#include "host/safety/guardian/wire.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

ConfigValue text(const char* value) { return {std::string(value)}; }

struct ReadRig {
  explicit ReadRig(const ConfigTable& roles, const std::string& file = "rig.lua") {
    description.file = file;
    description.table = roles;
    reader.emplace(description);
    settings = read_rig_settings(*reader);
  }
  RigDescription description;
  std::optional<ConfigReader> reader;
  RigSettings settings;
};

std::string problem_of(const ConfigTable& roles) {
  try {
    const ReadRig rig(roles);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(LineSettings, OfAnAmplifierReachTheGuardianAsTheHostHasThem) {
  const ReadRig rig({{"coils",
                      {ConfigTable{{"driver", text("kepco_bop")},
                                   {"address", text("serial:/dev/ttyS7")},
                                   {"baud_rate", {19200.0}},
                                   {"data_bits", {7.0}},
                                   {"stop_bits", {2.0}},
                                   {"parity", text("even")},
                                   {"flow", text("none")}}}}});
  ASSERT_EQ(rig.settings.guarded.size(), 1U);
  const guardian::Output& output = rig.settings.guarded[0];
  EXPECT_EQ(output.settings.at("baud_rate"), 19200);
  EXPECT_EQ(output.settings.at("data_bits"), 7);
  EXPECT_EQ(output.settings.at("stop_bits"), 2);
  // Choices go by their place: none, odd, even; none, rts_cts, xon_xoff.
  EXPECT_EQ(output.settings.at("parity"), 2);
  EXPECT_EQ(output.settings.at("flow"), 0);
  EXPECT_EQ(guardian::decode(guardian::encode({output})).front(), output) << "as it is sent";
}

TEST(LineSettings, OfAnAmplifierThatDoesNotStateThemAreTheDriversOwn) {
  const ReadRig rig(
      {{"coils",
        {ConfigTable{{"driver", text("kepco_bop")}, {"address", text("serial:/dev/ttyS7")}}}}});
  const guardian::Output& output = rig.settings.guarded.at(0);
  EXPECT_EQ(output.settings.at("baud_rate"), 9600);
  EXPECT_EQ(output.settings.at("flow"), 2) << "XON/XOFF, as from the factory";
}

TEST(LineSettings, ThatCannotBeAreNamedWithTheirKey) {
  const auto zaber = [](const char* key, ConfigValue value) {
    return ConfigTable{{"stage",
                        {ConfigTable{{"driver", text("zaber")},
                                     {"address", text("serial:/dev/ttyS7")},
                                     {"x", {ConfigTable{}}},
                                     {key, std::move(value)}}}}};
  };
  EXPECT_NE(problem_of(zaber("stop_bits", {3.0})).find("stage.stop_bits"), std::string::npos);
  EXPECT_NE(problem_of(zaber("data_bits", {9.0})).find("stage.data_bits"), std::string::npos);
  EXPECT_NE(problem_of(zaber("parity", text("odds"))).find("odd"), std::string::npos);
  EXPECT_NE(problem_of(zaber("flow", text("dtr"))).find("stage.flow"), std::string::npos);
}

/// A folder with one instrument's file, gone with its object.
struct Folder {
  Folder() { std::filesystem::create_directories(path); }
  ~Folder() { std::filesystem::remove_all(path); }
  std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("vitreo_line_" + std::to_string(getpid()));
};

constexpr const char* kCoils = R"(
return {
  title = "Bench supply", kind = "coils", channels = 8, current_limit = 5,
  link = { baud_rate = 57600, data_bits = 7, parity = "odd", terminator = "\r\n" },
  identity = "*IDN?",
  set_currents = function(io, list) io:send("CURR " .. table.concat(list, ",")) end,
  make_safe = { "CURR 0" },
  rescue = { identify = { "*IDN?", "BENCH" }, send = { "CURR 0", "OUTP 0" }, check = { "OUTP?", "0" } },
}
)";

TEST(LineSettings, OfAnAmplifierOfOneLuaFileReachTheGuardianWithItsMessages) {
  const Folder folder;
  std::ofstream(folder.path / "bench.lua") << kCoils;
  const ReadRig rig({{"coils",
                      {ConfigTable{{"driver", text("bench")},
                                   {"address", text("serial:/dev/ttyS7")},
                                   {"baud_rate", {115200.0}}}}}},
                    (folder.path / "rig.lua").string());
  const guardian::Output& output = rig.settings.guarded.at(0);
  const guardian::Output sent = guardian::decode(guardian::encode({output})).front();
  EXPECT_EQ(sent, output);
  EXPECT_EQ(sent.settings.at("baud_rate"), 115200) << "the rig file's, not the declared one";
  EXPECT_EQ(sent.settings.at("parity"), 1);
  const ByteScript script = parse_byte_script(sent.script);
  EXPECT_EQ(script.question, "*IDN?\r\n");
  EXPECT_EQ(script.identity, "BENCH");
  EXPECT_EQ(script.zero, (std::vector<std::string>{"CURR 0\r\n", "OUTP 0\r\n"}));
  ASSERT_EQ(script.check.size(), 1U);
  EXPECT_EQ(script.check[0].second, "0");
}

TEST(LineSettings, AnAmplifierOfOneLuaFileWithoutARescueIsNotEnergizedUnguardedByDefault) {
  const Folder folder;
  std::string file = kCoils;
  const std::size_t begin = file.find("  rescue"), end = file.find('\n', begin);
  file.erase(begin, end - begin);
  std::ofstream(folder.path / "bench.lua") << file;
  RigDescription description;
  description.file = (folder.path / "rig.lua").string();
  description.table = {
      {"coils", {ConfigTable{{"driver", text("bench")}, {"address", text("serial:/dev/ttyS7")}}}}};
  ConfigReader reader(description);
  EXPECT_THROW(read_rig_settings(reader), ConfigError);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
