// Facts that a run is not completed with: a trip of the interlock, a servo loop that failed. They
// are events of its record; a script that means to go on after one accepts it by name.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"

#include <cstddef>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// A fact that was not accepted: the run is aborted, whatever its script returned.
class UnacceptedFact : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// On the script's thread.
class RunFacts {
 public:
  explicit RunFacts(Recorder& recorder) : recorder_(recorder) {}
  /// The kinds of events that are such facts.
  static const std::vector<std::string>& kinds();
  /// Those of `kind` until now do not count against the run; `reason` goes into the record. Throws
  /// std::invalid_argument where there is none of that kind, or no reason.
  void accept(Time now, const std::string& kind, const std::string& reason);
  /// Throws UnacceptedFact with the first one that was not accepted.
  void check() const;

 private:
  std::vector<std::string> texts(const std::string& kind) const;
  Recorder& recorder_;
  std::map<std::string, std::size_t> accepted_;  // how many, by kind
};

}  // namespace vitreo
