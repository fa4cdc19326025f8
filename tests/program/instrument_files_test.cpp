// Instruments of one Lua file at the command line: docs/how-to/write_an_instrument.md followed to
// the letter, `vitreo new instrument` of every kind, the pages of those that ship, and questions to
// an address.
// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/doubles/double_process.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct Block {
  std::string head, text;  // "lua file=heater.lua"
};

std::vector<Block> blocks_of(const std::string& page) {
  std::vector<Block> blocks;
  std::istringstream in(page);
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("```")) {
      if (!inside) blocks.push_back({line.substr(3), ""});
      inside = !inside;
    } else if (inside) {
      blocks.back().text += line + "\n";
    }
  }
  return blocks;
}

std::string page_text(const std::string& page) {
  std::ostringstream text;
  text << std::ifstream(VITREO_SOURCE_DIR "/docs/" + page).rdbuf();
  return text.str();
}

/// Each `lua file=` block is written, each line of a `sh` block must succeed, of `sh fails` it must
/// fail with the text of the next block.
int follow(const Workplace& place, const std::string& page) {
  int lines = 0;
  std::string said;
  for (const Block& block : blocks_of(page_text(page))) {
    if (block.head.starts_with("lua file=")) {
      place.write(block.head.substr(9), block.text);
    } else if (block.head == "sh" || block.head == "sh fails") {
      std::istringstream in(block.text);
      for (std::string line; std::getline(in, line); ++lines) {
        EXPECT_TRUE(line.starts_with("vitreo ")) << line;
        const Spoken spoken = place.vitreo(line.substr(7));
        EXPECT_EQ(spoken.exit_code == 0, block.head == "sh") << line << "\n"
                                                             << spoken.out << spoken.err;
        said = spoken.out + spoken.err;
      }
    } else if (block.head == "text") {
      std::string wanted = block.text;
      wanted.pop_back();
      EXPECT_NE(said.find(wanted), std::string::npos) << said;
    }
  }
  return lines;
}

TEST(InstrumentHowTo, WorksAsItStands) {
  const Workplace place;
  EXPECT_GE(follow(place, "how-to/write_an_instrument.md"), 12);
}

TEST(InstrumentReference, ItsExamplesWorkAsTheyStand) {
  const Workplace place;
  EXPECT_GE(follow(place, "instruments_in_lua.md"), 3);
}

// New

struct Beginning {
  std::string kind, link;
};
class NewInstrument : public testing::TestWithParam<Beginning> {};
TEST_P(NewInstrument, HoldsAsItIsWritten) {
  const auto& [kind, link] = GetParam();
  const Workplace place;
  const Spoken made = place.vitreo("new instrument acme --role " + kind + " --link " + link);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_NE(made.out.find("acme.lua\nacme_rig.lua\n"), std::string::npos) << made.out;
  const std::size_t at = made.out.find("--test ");
  ASSERT_NE(at, std::string::npos) << made.out;
  const std::string role = made.out.substr(at + 7, made.out.find(' ', at + 7) - at - 7);
  const Spoken tested = place.vitreo("devices --rig acme_rig.lua --test " + role);
  EXPECT_EQ(tested.exit_code, 0) << tested.out << tested.err;
  const Spoken seen = place.vitreo("devices --rig acme_rig.lua");
  EXPECT_EQ(seen.exit_code, 0) << seen.out << seen.err;
  place.write("none.lua", "return { title = 'None', needs = { '" + role +
                              "' }, run = function(rig, p, run) run:result('a', 1) end }");
  const Spoken checked = place.vitreo("check none.lua --rig acme_rig.lua");
  EXPECT_EQ(checked.exit_code, 0) << checked.out << checked.err;
  const Spoken run = place.vitreo("run none.lua --rig acme_rig.lua");
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_EQ(place.vitreo("docs instrument acme.lua").exit_code, 0);
  EXPECT_EQ(place.vitreo("new instrument acme --role " + kind).exit_code, 2) << "it is there";
}
INSTANTIATE_TEST_SUITE_P(
    Kinds, NewInstrument,
    testing::Values(Beginning{"stage", "serial"}, Beginning{"rotation_stage", "serial"},
                    Beginning{"lens_mover", "serial"}, Beginning{"field_probe", "usbtmc"},
                    Beginning{"current_sensor", "tcp"}, Beginning{"coils", "tcp"},
                    Beginning{"lamp", "serial"}, Beginning{"sensor", "udp"},
                    Beginning{"sensor", "modbus"}, Beginning{"actuator", "serial"},
                    Beginning{"actuator", "modbus"}, Beginning{"pump", "serial"},
                    Beginning{"switch", "vxi11"}, Beginning{"interlock_input", "serial"},
                    Beginning{"instrument", "hislip"}),
    [](const auto& made) { return made.param.kind + "_" + made.param.link; });

TEST(NewInstrument, WhatCannotBeIsSaidBeforeAnythingIsWritten) {
  const Workplace place;
  const std::pair<const char*, const char*> wrong[] = {
      {"acme --role stag", "did you mean stage"},
      {"acme --role stage --link serail", "did you mean serial"},
      {"acme --role stage --link modbus", "a sensor or an actuator"},
      {"coils --role pump", "is a role's name"},
      {"Acme --role pump", "is not a name"}};
  for (const auto& [words, said] : wrong) {
    const Spoken spoken = place.vitreo(std::string("new instrument ") + words);
    EXPECT_EQ(spoken.exit_code, 2) << words;
    EXPECT_NE(spoken.err.find(said), std::string::npos) << spoken.err;
  }
  EXPECT_FALSE(std::filesystem::exists(place.folder() / "acme.lua"));
}

// A name that is no role of the program's may be one of the rig's own; a slip is told all the same.
TEST(FreeRoles, AProtocolMayNeedOneByItsName) {
  const Workplace place;
  place.write("rig.lua",
              "return { title = 'r', bath = { driver = 'tc038d', address = 'emulated' } }");
  const auto check = [&](const std::string& need) {
    place.write("p.lua", "return { title = 'p', needs = { '" + need +
                             "' }, run = function(rig, p, run) run:result('t', "
                             "rig.bath:temperature(), 'K') end }");
    return place.vitreo("check p.lua --rig rig.lua");
  };
  EXPECT_EQ(check("bath").exit_code, 0);
  EXPECT_EQ(check("actuator:temperature").exit_code, 0);
  EXPECT_NE(check("oven").err.find("needs the role 'oven', and this rig has only"),
            std::string::npos);
  EXPECT_NE(check("coilz").err.find("did you mean coils"), std::string::npos);
}

// Pages

TEST(InstrumentPages, EveryShippedFileHasOneAndKeepsTheContractOfItsRole) {
  const Workplace place;
  const Spoken list = place.vitreo("docs instrument");
  ASSERT_EQ(list.exit_code, 0) << list.err;
  int count = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(VITREO_SOURCE_DIR "/scripts/instruments")) {
    const std::string name = entry.path().stem().string();
    EXPECT_NE(list.out.find(name + " "), std::string::npos) << name;
    const Spoken page = place.vitreo("docs instrument " + name);
    ASSERT_EQ(page.exit_code, 0) << page.err;
    const std::size_t at = page.out.find("Kind: ") + 6;
    const std::string kind = page.out.substr(at, page.out.find_first_of(". ", at) - at);
    const bool fixed = kind == "stage" || kind == "field_probe";
    const std::string role = fixed ? kind : "thing";
    place.write("rig.lua", "return { title = 't', " + role + " = { driver = '" + name +
                               "', address = 'emulated', baud_rate = 0 } }");
    const Spoken tested = place.vitreo("devices --rig rig.lua --test " + role);
    EXPECT_EQ(tested.exit_code, 0) << name << "\n" << tested.out << tested.err;
    ++count;
  }
  EXPECT_GE(count, 11);
  EXPECT_NE(place.vitreo("docs instrument kdc1").err.find("did you mean kdc101"),
            std::string::npos);
}

TEST(InstrumentPages, APageHasUnitsBoundsAndCommands) {
  const Workplace place;
  const std::string page = place.vitreo("docs instrument ne1000").out;
  for (const char* part :
       {"# New Era NE-1000 syringe pump", "Kind: pump", "at 19200 baud, 8N1", "| `diameter` | mm |",
        "`rate()`, `set_rate(value)`", "| mL/min | 0 to 10 |", "`infuse(volume)`", "to 200 mL"})
    EXPECT_NE(page.find(part), std::string::npos) << part << "\n" << page;
}

// Questions to an address

TEST(AskedFiles, AnInstrumentOfAFileIsFoundAtItsAddress) {
  const Workplace place;
  const DoubleProcess pump("new_era");
  const Spoken asked = place.vitreo("devices --ask " + pump.address());
  EXPECT_EQ(asked.exit_code, 0) << asked.out << asked.err;
  EXPECT_NE(asked.out.find("driver = \"ne1000\""), std::string::npos) << asked.out << asked.err;
  EXPECT_NE(asked.out.find("baud_rate = 19200"), std::string::npos) << asked.out;
  EXPECT_NE(asked.err.find("VER"), std::string::npos) << "what is sent is shown before";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
