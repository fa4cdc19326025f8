// `vitreo soak` as its users run it: no violation, and the same line for the same seed.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstdlib>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kHold =
    "soak hold feedback=pose_sensor compare=false settle=0.5s hold=1s width=0.3mm depth=0.3mm "
    "speed=2mm/s ";

std::string last_line(const std::string& text) {
  const std::size_t end = text.find_last_not_of('\n'), begin = text.rfind('\n', end);
  return text.substr(begin == std::string::npos ? 0 : begin + 1, end - begin);
}

TEST(Soak, OfAHoldFindsNothing) {
  const Workplace place;
  const std::string seeds = std::to_string(long_or_short(1000, 8));
  const Spoken said = place.vitreo(kHold + ("--json --seeds " + seeds));
  EXPECT_EQ(said.exit_code, 0) << said.out << said.err;
  const auto result = nlohmann::json::parse(last_line(said.out));
  EXPECT_EQ(result["seeds"], std::stoi(seeds));
  EXPECT_EQ(result["violations"], 0);
}

// A PD has no estimate: its second loop was said to be steered by no measurement, in each seed.
TEST(Soak, OfAHoldBesideAPdFindsNothingEither) {
  const Workplace place;
  const Spoken said = place.vitreo(
      "soak hold feedback=pose_sensor settle=0.5s hold=4s width=0.3mm depth=0.3mm speed=2mm/s "
      "--seeds 6");
  EXPECT_EQ(said.exit_code, 0) << said.out << said.err;
  EXPECT_NE(said.out.find("\n6 seeds, 0 violations"), std::string::npos) << said.out;
}

// A swimmer's sensor that repeats an old place: it was steered by it for 48 s.
TEST(Soak, OfASwimmerWithAnOldPlaceFindsNothing) {
  const Workplace place;
  for (const char* seed : {"559", "560"}) {
    const Spoken said = place.vitreo(std::string("soak swim_path --seed ") + seed);
    EXPECT_EQ(said.exit_code, 0) << said.out << said.err;
    EXPECT_NE(said.out.find("stale"), std::string::npos) << said.out;
  }
}

TEST(Soak, ASeedHappensAgainAsItDid) {
  const Workplace place;
  for (const char* seed : {"3", "5"}) {
    const Spoken first = place.vitreo(kHold + (std::string("--seed ") + seed)),
                 second = place.vitreo(kHold + (std::string("--seed ") + seed));
    EXPECT_EQ(first.exit_code, 0) << first.out << first.err;
    EXPECT_EQ(first.out.substr(0, first.out.find('\n')),
              second.out.substr(0, second.out.find('\n')));
    EXPECT_NE(first.out.find(std::string("seed ") + seed + ": "), std::string::npos) << first.out;
  }
}

TEST(Soak, ACampaignGoesOnWhereTheLastOneEnded) {
  const Workplace place;
  const Spoken said = place.vitreo(kHold + std::string("--first 7 --seeds 2"));
  EXPECT_EQ(said.exit_code, 0) << said.out << said.err;
  EXPECT_EQ(said.out.rfind("seed 7: ", 0), 0U) << said.out;
  EXPECT_NE(said.out.find("\nseed 8: "), std::string::npos) << said.out;
  EXPECT_NE(said.out.find("\n2 seeds, 0 violations"), std::string::npos) << said.out;
}

TEST(Soak, ARigWithRealInstrumentsIsRefused) {
  const Workplace place;
  const Spoken said = place.vitreo("soak hold --seeds 1 --rig '" VITREO_SOURCE_DIR
                                   "/scripts/rigs/octomag_lab.lua'");
  EXPECT_EQ(said.exit_code, 2);
  EXPECT_NE(said.err.find("real instruments"), std::string::npos) << said.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
