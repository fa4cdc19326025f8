// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_axes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace vitreo {
namespace VITREO_TEST_FILE {

Parameter number(const std::string& name, const std::string& unit, double min, double max) {
  Parameter made;
  made.name = name, made.unit = unit, made.min = min, made.max = max, made.fallback = min;
  return made;
}

ProtocolDescription protocol() {
  ProtocolDescription made;
  made.name = "experiment";
  made.parameters = {number("speed", "mm/s", 1e-5, 2e-3), number("field", "mT", 0, 0.05)};
  Parameter frames = number("frames", "", 1, 100);
  frames.kind = ParameterKind::integer;
  Parameter law;
  law.name = "law", law.kind = ParameterKind::choice, law.choices = {"pd", "estimator"};
  law.fallback = std::string("pd");
  Parameter target = number("target", "mm", -5e-3, 5e-3);
  target.kind = ParameterKind::vector, target.fallback = std::vector<double>{0, 0, 0};
  Parameter band = number("band", "mm/s", 0, 1);
  band.kind = ParameterKind::range, band.fallback = std::vector<double>{0, 1};
  Parameter speeds = number("speeds", "mm/s", 0, 1);
  speeds.kind = ParameterKind::list, speeds.fallback = std::vector<double>{0.1};
  for (const Parameter& one : {frames, law, target, band, speeds}) made.parameters.push_back(one);
  return made;
}

std::vector<double> values_of(const std::string& word) {
  std::vector<double> values;
  const std::vector<SweepAxis> axes = read_axes(protocol(), {word});
  for (const ArgumentValue& value : axes.at(0).values) values.push_back(std::get<double>(value));
  return values;
}

std::string refusal_of(const std::vector<std::string>& words, const SweepDraws& draws = {}) {
  try {
    make_settings(read_axes(protocol(), words), draws);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

TEST(SweepAxes, AGridHasItsEndsToTheBitAndNoTailsBetween) {
  EXPECT_EQ(values_of("speed=0.1..1mm/s:10"),
            (std::vector<double>{1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4, 7e-4, 8e-4, 9e-4, 1e-3}));
  EXPECT_EQ(values_of("frames=1..10:4"), (std::vector<double>{1, 4, 7, 10}));
}

TEST(SweepAxes, ALogarithmicGridHasEvenFactors) {
  const std::vector<double> values = values_of("speed=20um/s..2mm/s:3:log");
  ASSERT_EQ(values.size(), 3U);
  EXPECT_DOUBLE_EQ(values[0], 20e-6);
  EXPECT_DOUBLE_EQ(values[1], 200e-6);
  EXPECT_EQ(values[2], 2e-3);
}

TEST(SweepAxes, TheLastUnitHoldsForTheNumbersBeforeIt) {
  EXPECT_EQ(values_of("speed=0.1,0.5,1mm/s"), (std::vector<double>{1e-4, 5e-4, 1e-3}));
  EXPECT_EQ(values_of("speed=50um/s,0.5,1mm/s").at(1), 5e-4);
  EXPECT_EQ(values_of("speed=0.1..0.3mm/s:3,1mm/s"), (std::vector<double>{1e-4, 2e-4, 3e-4, 1e-3}));
}

TEST(SweepAxes, ValuesAreReadByTheCodeThatReadsThoseOfARun) {
  EXPECT_EQ(refusal_of({"speed=0.1..5mm/s:3"}), "speed: wants 10 to 2000 \u00b5m/s; got 5mm/s");
  EXPECT_NE(refusal_of({"speed=1,2"}).find("has no unit: write"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=1mT"}).find("is a magnetic field"), std::string::npos);
  EXPECT_NE(refusal_of({"frames=1..10:3"}).find("whole number"), std::string::npos);
  EXPECT_NE(refusal_of({"law=pd,estimater"}).find("did you mean estimator?"), std::string::npos);
  EXPECT_NE(refusal_of({"sped=1mm/s"}).find("did you mean speed?"), std::string::npos);
}

TEST(SweepAxes, WhatCannotBeMeantIsRefused) {
  EXPECT_NE(refusal_of({"speed=1mm/s,1000um/s"}).find("is given twice"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=..1mm/s:3"}).find("two ends"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=0.1..1mm/s:1"}).find("divided into 2"), std::string::npos);
  EXPECT_NE(refusal_of({"field=0..10mT:3:log"}).find("above zero"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=0.1..1mm/s:3:lin"}).find("got ':lin'"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=0.1..1mm/s"}).find("without a number of values"), std::string::npos);
  EXPECT_NE(refusal_of({"speed=1mm/s"}, {Draw::random, 5, 1}).find("there is none"),
            std::string::npos);
  EXPECT_NE(refusal_of({"speed=0.1..1mm/s", "speed=2mm/s"}).find("stands alone"),
            std::string::npos);
}

TEST(SweepAxes, VectorsListsAndRangesAreOneValueAWord) {
  const auto axes = read_axes(protocol(), {"target=0,0,-3mm..2,0,-3mm:3", "band=0.1..2mm/s",
                                           "speeds=0.1,0.2mm/s", "speeds=0.5mm/s"});
  ASSERT_EQ(axes.size(), 3U);
  ASSERT_EQ(axes[0].values.size(), 3U);
  EXPECT_EQ(std::get<std::vector<double>>(axes[0].values[1]),
            (std::vector<double>{1e-3, 0, -3e-3}));
  ASSERT_EQ(axes[1].values.size(), 1U);
  EXPECT_EQ(std::get<std::vector<double>>(axes[1].values[0]), (std::vector<double>{1e-4, 2e-3}));
  ASSERT_EQ(axes[2].values.size(), 2U);
  EXPECT_EQ(std::get<std::vector<double>>(axes[2].values[0]), (std::vector<double>{1e-4, 2e-4}));
  EXPECT_NE(refusal_of({"target=0,0mm"}).find("three numbers"), std::string::npos);
  EXPECT_NE(refusal_of({"band=2..1mm/s"}).find("least first"), std::string::npos);
  EXPECT_NE(refusal_of({"target=0,0,9mm"}).find("got 9mm"), std::string::npos);
}

TEST(SweepAxes, SettingsAreAllCombinationsTheFirstParameterSlowest) {
  const auto settings =
      make_settings(read_axes(protocol(), {"speed=1,2mm/s", "law=pd,estimator"}), {});
  ASSERT_EQ(settings.size(), 4U);
  EXPECT_EQ(std::get<double>(settings[1].at("speed")), 1e-3);
  EXPECT_EQ(std::get<std::string>(settings[1].at("law")), "estimator");
  EXPECT_EQ(std::get<double>(settings[2].at("speed")), 2e-3);
}

TEST(SweepAxes, ALatinHypercubeMeetsEachStratumOfEachParameterOnce) {
  constexpr std::size_t kDraws = 40;
  const auto axes = read_axes(protocol(), {"speed=0.1..2mm/s:log", "field=10..20mT"});
  const auto settings = make_settings(axes, {Draw::latin, kDraws, 7});
  ASSERT_EQ(settings.size(), kDraws);
  std::set<int> fields;
  std::set<int> speeds;
  for (const SweepSetting& one : settings) {
    fields.insert(static_cast<int>((std::get<double>(one.at("field")) - 10e-3) / 10e-3 * kDraws));
    speeds.insert(static_cast<int>(std::log(std::get<double>(one.at("speed")) / 1e-4) /
                                   std::log(20.0) * kDraws));
  }
  EXPECT_EQ(fields.size(), kDraws);
  EXPECT_EQ(speeds.size(), kDraws);
}

TEST(SweepAxes, DrawsComeAgainWithTheirSeedAndAreEvenlySpread) {
  const auto axes = read_axes(protocol(), {"frames=1..10"});
  const auto draw = [&axes](std::uint64_t seed) {
    return make_settings(axes, {Draw::random, 10'000, seed});
  };
  const auto settings = draw(3);
  EXPECT_EQ(settings, draw(3));
  EXPECT_NE(settings, draw(4));
  for (int frames = 1; frames <= 10; ++frames) {
    const auto count = std::count_if(settings.begin(), settings.end(), [&](const auto& one) {
      return std::get<double>(one.at("frames")) == frames;
    });
    EXPECT_NEAR(static_cast<double>(count), 1000, 150)
        << frames;  // five standard deviations of a binomial count
  }
}

TEST(SweepAxes, TheNumberOfSettingsIsKnownBeforeTheyAreMade) {
  const auto axes = read_axes(protocol(), {"speed=0.1..2mm/s:1000", "field=1..50mT:1000",
                                           "frames=1..100:100", "target=0,0,0mm..1,1,1mm:1000"});
  EXPECT_EQ(count_settings(axes, {}), 1e11);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
