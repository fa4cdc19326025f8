// The contract of an operator's input, with an operator who presses and releases meanwhile.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/operator_input.h"

#include <gtest/gtest.h>

#include <functional>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Findings = std::vector<std::string>;

/// Its state at each reading, by the number of the reading.
struct ScriptedInput final : OperatorInput {
  explicit ScriptedInput(std::function<OperatorState(int)> its_states)
      : states(std::move(its_states)) {}
  std::string identity() const override { return "scripted"; }
  OperatorState state() override { return states(reading++); }
  std::function<OperatorState(int)> states;
  int reading = 0;
};

Findings findings_of(std::function<OperatorState(int)> states) {
  const auto clock = virtual_clock();
  ScriptedInput input(std::move(states));
  return contract::check(input, *clock);
}

OperatorState pressed(std::uint32_t mask) {
  OperatorState state;
  state.pressed = mask;
  return state;
}

// Pressed in every second, third, ... reading: releases fall between any two that belong together.
TEST(OperatorInputContract, AButtonMayBeReleasedAtAnyMoment) {
  for (int period = 1; period <= 5; ++period)
    EXPECT_EQ(findings_of([&](int reading) { return pressed(reading % period == 0 ? 1 : 0); }),
              Findings{})
        << period;
}

TEST(OperatorInputContract, NoDeflectionIsBeyondTheFullOne) {
  const Findings findings = findings_of([](int) {
    OperatorState state;
    state.rotation.z() = -1.01;
    return state;
  });
  EXPECT_EQ(findings, Findings{"a deflection is beyond full deflection"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
