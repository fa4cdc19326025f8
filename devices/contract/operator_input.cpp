// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/operator_input.h"

#include <algorithm>

namespace vitreo::contract {
namespace {

/// 50 readings in one second.
constexpr int kReadings = 50;
constexpr Time kBetween = std::chrono::milliseconds(20);
/// state() does not wait; the median of the calls may take this long on a loaded system.
constexpr Time kAtOnce = std::chrono::milliseconds(100);

/// A finding is reported once, however often it is met.
void note(std::vector<std::string>& findings, bool good, const std::string& finding) {
  if (!good && std::find(findings.begin(), findings.end(), finding) == findings.end())
    findings.push_back(finding);
}

}  // namespace

// Whether anything is pressed does not matter: what is reported must be possible, and told at once.
std::vector<std::string> check(OperatorInput& input, Clock& clock) {
  std::vector<std::string> findings;
  try {
    note(findings, !input.identity().empty(), "identity is empty");
    std::vector<Time> took;
    for (int i = 0; i < kReadings; ++i) {
      const Time asked = clock.now();
      const OperatorState state = input.state();
      took.push_back(clock.now() - asked);
      for (const Eigen::Vector3d& part : {state.translation, state.rotation})
        note(findings, part.allFinite() && part.cwiseAbs().maxCoeff() <= 1,
             "a deflection is beyond full deflection");
      clock.sleep_for(kBetween);
    }
    std::nth_element(took.begin(), took.begin() + kReadings / 2, took.end());
    note(findings, took[kReadings / 2] < kAtOnce, "it waits where it should tell what is");
  } catch (const Stopped&) {
    throw;
  } catch (const std::exception& error) {
    findings.push_back(std::string("tell what the operator does: threw ") + error.what());
  }
  return findings;
}

}  // namespace vitreo::contract
