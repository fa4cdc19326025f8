// Draft of a rig file: typed answers as values, and the text that reads back as the same rig.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/rig_draft.h"

#include "host/lua/engine/library.h"
#include "host/lua/script/reading.h"

#include <gtest/gtest.h>

#include <limits>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Kind = KnownSetting::Kind;

KnownSetting setting(Kind kind, const std::string& unit, double min, double max,
                     std::size_t count = 0) {
  KnownSetting one{"role.key", kind, 0.01};
  one.unit = unit;
  one.min = min;
  one.max = max;
  one.count = count;
  return one;
}

const KnownSetting kCurrent = setting(Kind::number, "A", 0.1, 20);
const KnownSetting kLength = setting(Kind::number, "m", -1, 1);
const KnownSetting kPlace = setting(Kind::numbers, "m", -1, 1, 3);

double number(const KnownSetting& of, const std::string& typed) {
  return std::get<double>(read_setting(of, typed).value.value);
}

std::string refusal(const KnownSetting& of, const std::string& typed) {
  try {
    read_setting(of, typed);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "taken";
}

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(RigDraftAnswer, AQuantityIsReadInItsUnitAndWrittenInIt) {
  EXPECT_DOUBLE_EQ(number(kCurrent, "3 A"), 3);
  EXPECT_DOUBLE_EQ(number(kCurrent, " 350mA "), 0.35);
  EXPECT_DOUBLE_EQ(number(kLength, "-12.5 * mm"), -12.5e-3);
  EXPECT_DOUBLE_EQ(number(kLength, "5 µm"), 5e-6);
  EXPECT_DOUBLE_EQ(number(kLength, "1e-3 m"), 1e-3);
  EXPECT_EQ(read_setting(kCurrent, "350 mA").lua, "350 * mA");
  EXPECT_EQ(read_setting(kLength, "5 µm").lua, "5 * um");
  const WrittenValue speed = read_setting(setting(Kind::number, "m/s", 0, 1), "0.5 mm/s");
  EXPECT_EQ(speed.lua, "0.5 * mm / s");
  EXPECT_EQ(speed.units, (std::vector<std::string>{"mm", "s"}));
}

TEST(RigDraftAnswer, WithoutAUnitOnlyZeroAndPlainNumbersAreClear) {
  EXPECT_TRUE(has(refusal(kCurrent, "3"), "'3' needs its unit, such as 3 "))
      << refusal(kCurrent, "3");
  EXPECT_EQ(number(kLength, "0"), 0);
  EXPECT_EQ(number(setting(Kind::number, "", 0, 10), "2"), 2);
  EXPECT_TRUE(has(refusal(kCurrent, "3 V"), "is a voltage: it wants a current, 0.1 to 20 A"))
      << refusal(kCurrent, "3 V");
  EXPECT_TRUE(has(refusal(setting(Kind::integer, "", 0, 7), "3 mm"), "is a length"));
}

TEST(RigDraftAnswer, WhatIsNoValueIsRefusedAndShown) {
  for (const char* typed : {"", "x", "3 apples", "A", "1,5 A", "--3 A", "nan", "inf A", "3 A 4"})
    EXPECT_TRUE(has(refusal(kCurrent, typed), "is not understood: it wants a current, 0.1 to 20 A"))
        << typed << ": " << refusal(kCurrent, typed);
  EXPECT_TRUE(has(refusal(setting(Kind::flag, "", 0, 0), "perhaps"), "yes or no"));
  KnownSetting choice{"role.key", Kind::choice, "x"};
  choice.choices = {"reverse", "forward"};
  EXPECT_TRUE(has(refusal(choice, "forwrad"), "did you mean forward?"));
}

TEST(RigDraftAnswer, AListSharesItsLastUnitAndHasItsCount) {
  const WrittenValue place = read_setting(kPlace, "-12, -11,-10 mm");
  const auto& list = std::get<ConfigList>(place.value.value);
  ASSERT_EQ(list.size(), 3U);
  EXPECT_DOUBLE_EQ(std::get<double>(list[0].value), -12e-3);
  EXPECT_DOUBLE_EQ(std::get<double>(list[2].value), -10e-3);
  EXPECT_EQ(place.lua, "{ -12 * mm, -11 * mm, -10 * mm }");
  EXPECT_TRUE(has(refusal(kPlace, "1, 2 mm"), "has 2 where 3 are wanted"));
  EXPECT_TRUE(has(refusal(kPlace, "1, 2, 3"), "needs its unit"));
  EXPECT_TRUE(has(refusal(kPlace, "1 mm, 2 mm, 3 A"), "is a current"));
  EXPECT_EQ(read_setting(setting(Kind::numbers, "", 1, 32), "none").lua, "{}");
}

TEST(RigDraftAnswer, ADefaultCanBeTypedBack) {
  KnownSetting limit = kCurrent;
  limit.fallback = 12.0;
  EXPECT_EQ(typed_default(limit), "12 A");
  EXPECT_EQ(number(limit, typed_default(limit)), 12);
  KnownSetting place = kPlace;
  place.fallback = {-12e-3, 0, 5e-6};
  EXPECT_EQ(typed_default(place), "-12 mm, 0 mm, 5 um");
  EXPECT_EQ(std::get<ConfigList>(read_setting(place, typed_default(place)).value.value).size(), 3U);
  EXPECT_EQ(as_typed(setting(Kind::number, "Hz", 0, 100), "15"), "15 Hz");
  EXPECT_EQ(as_typed(setting(Kind::integer, "", 0, 4096), "1384"), "1384");
}

RigDraft a_draft() {
  RigDraft draft{"lab.lua", "A \"title\"\nos.exit()", "2026-11-24", {}};
  DraftTable& coils = draft.table("coils");
  coils.comments = {"The coils'\nos.exit() -- no second line"};
  coils.set({"driver", written_text("usb3103"), "an answer\nos.exit()"});
  coils.set({"address", written_text("hid:09db:009c:\x01\xff\"\\")});
  coils.set({"current_limit", read_setting(kCurrent, "12 A"), std::string(300, 'x')});
  DraftTable& stage = draft.table("stage");
  stage.set({"driver", written_text("zaber")});
  stage.set({"z.device", written_number(1)});
  stage.set({"z.travel_max", read_setting(kLength, "25.4 mm"), "highest"});
  stage.set({"z.speed", read_setting(setting(Kind::number, "m/s", 0, 1), "0.3 mm/s")});
  stage.set({"travel_min", read_setting(kPlace, "-1, -2, -3 mm")});
  return draft;
}

void expect_same(const ConfigValue& a, const ConfigValue& b, const std::string& where) {
  if (const auto* const table = std::get_if<ConfigTable>(&a.value)) {
    const auto* const other = std::get_if<ConfigTable>(&b.value);
    ASSERT_NE(other, nullptr) << where;
    EXPECT_EQ(table->size(), other->size()) << where;
    for (const auto& [key, value] : *table) {
      ASSERT_TRUE(other->contains(key)) << where << "." << key;
      expect_same(value, other->at(key), where + "." + key);
    }
  } else if (const auto* const list = std::get_if<ConfigList>(&a.value)) {
    const auto& other = std::get<ConfigList>(b.value);
    ASSERT_EQ(list->size(), other.size()) << where;
    for (std::size_t i = 0; i < list->size(); ++i) expect_same((*list)[i], other[i], where);
  } else if (const auto* const one = std::get_if<double>(&a.value)) {
    EXPECT_NEAR(*one, std::get<double>(b.value),
                std::abs(*one) * 4 * std::numeric_limits<double>::epsilon())
        << where;
  } else {
    EXPECT_EQ(std::get<std::string>(a.value), std::get<std::string>(b.value)) << where;
  }
}

// Titles, answers of instruments and addresses are another's texts: none of them ends a comment or
// a string.
TEST(RigDraft, ItsTextReadsBackAsTheSameTables) {
  const RigDraft draft = a_draft();
  const std::string lua = to_lua(draft);
  const RigDescription read = lua::read_recorded_rig(lua::library(), {"lab.lua", lua}, {});
  expect_same({description_of(draft).table}, {read.table}, "rig");
  for (std::size_t at = 0; (at = lua.find("os.exit", at)) != std::string::npos; ++at) {
    const std::size_t begin = lua.rfind('\n', at) + 1;
    const std::string line = lua.substr(begin, lua.find('\n', at) - begin);
    EXPECT_TRUE(has(line, "--") || has(line, "title = ")) << line;
  }
}

TEST(RigDraft, AnAnswerThatIsGivenAnewTakesItsOldPlace) {
  RigDraft draft = a_draft();
  draft.table("coils").set({"driver", written_text("kepco_bop")});
  ASSERT_EQ(draft.find("coils")->settings.size(), 3U);
  EXPECT_EQ(draft.find("coils")->settings.front().value.lua, "\"kepco_bop\"");
  EXPECT_EQ(draft.find("lamp"), nullptr);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
