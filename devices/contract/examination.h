// Examination: base of the contract suites, with findings, and duties of which one that throws does
// not end the others.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <algorithm>
#include <exception>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::contract {

/// With which kind of error a call that is given no time fails; nothing: it does not notice. Of
/// three calls, because on the wall clock of a busy machine an answer may be there before the
/// question's own thread goes on.
template <class Call>
std::optional<DeviceErrorKind> error_without_time(const Call& call) {
  for (int attempt = 0; attempt < 3; ++attempt) try {
      call();
    } catch (const DeviceError& error) {
      return error.kind;
    }
  return std::nullopt;
}

/// `Suite` derives from it and has `void leave_safe()`, which is called when the examination is
/// stopped.
template <class Suite>
struct Examination {
  std::vector<std::string> findings{};

  /// A finding is reported once, however often it is met.
  void expect(bool good, const std::string& finding) {
    if (!good && std::find(findings.begin(), findings.end(), finding) == findings.end())
      findings.push_back(finding);
  }

  void duty(const std::string& name, void (Suite::*examine)()) {
    Suite& suite = static_cast<Suite&>(*this);
    try {
      (suite.*examine)();
    } catch (const Stopped&) {
      suite.leave_safe();
      throw;
    } catch (const std::exception& error) {
      findings.push_back(name + ": threw " + error.what());
    }
  }
};

}  // namespace vitreo::contract
