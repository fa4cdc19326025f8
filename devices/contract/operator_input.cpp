// The duties of an OperatorInput.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/operator_input.h"

#include <algorithm>

namespace vitreo::contract {
namespace {

constexpr int kLooks = 50;
constexpr Time kBetween = std::chrono::milliseconds(20);
constexpr Time kAtOnce =
    std::chrono::milliseconds(100);  // it does not wait; this much the system may take

void note(std::vector<std::string>& findings, bool good, const std::string& finding) {
  if (!good && std::find(findings.begin(), findings.end(), finding) == findings.end())
    findings.push_back(finding);
}

}  // namespace

std::vector<std::string> check(OperatorInput& input, Clock& clock) {
  std::vector<std::string> findings;
  try {
    note(findings, !input.identity().empty(), "identity is empty");
    std::vector<Time> took;
    for (int i = 0; i < kLooks; ++i) {
      const Time asked = clock.now();
      const OperatorState state = input.state();
      took.push_back(clock.now() - asked);
      for (const Eigen::Vector3d& part : {state.translation, state.rotation})
        note(findings, part.allFinite() && part.cwiseAbs().maxCoeff() <= 1,
             "a deflection is beyond full deflection");
      note(findings, is_held(&input, state.pressed) == (state.pressed != 0),
           "is_held() and state() differ");
      clock.sleep_for(kBetween);
    }
    std::nth_element(took.begin(), took.begin() + kLooks / 2, took.end());
    note(findings, took[kLooks / 2] < kAtOnce, "it waits where it should tell what is");
  } catch (const Stopped&) {
    throw;
  } catch (const std::exception& error) {
    findings.push_back(std::string("tell what the operator does: threw ") + error.what());
  }
  return findings;
}

}  // namespace vitreo::contract
