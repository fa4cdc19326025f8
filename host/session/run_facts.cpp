// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_facts.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace vitreo {

const std::vector<std::string>& RunFacts::kinds() {
  // Both are events that the host writes itself, whatever the script does with the error.
  static const std::vector<std::string> kKinds{"interlock", "servo failed"};
  return kKinds;
}

std::vector<std::string> RunFacts::texts(const std::string& kind) const {
  std::vector<std::string> texts;
  for (const Event& event : recorder_.events())
    if (event.kind == kind) texts.push_back(event.text);
  return texts;
}

void RunFacts::accept(Time now, const std::string& kind, const std::string& reason) {
  if (std::find(kinds().begin(), kinds().end(), kind) == kinds().end())
    throw std::invalid_argument(
        fmt::format("'{}' is none of the facts that a run is not completed "
                    "with: {}",
                    kind, fmt::join(kinds(), ", ")));
  if (reason.empty()) throw std::invalid_argument("reason: wants a text, got an empty one");
  // What is accepted is what has happened: nothing is accepted in advance.
  const std::vector<std::string> known = texts(kind);
  if (known.size() == accepted_[kind])
    throw std::invalid_argument("'" + kind + "' has not happened, so it cannot be accepted");
  // By their number: an event of the same words that comes later is another one.
  accepted_[kind] = known.size();
  recorder_.event(now, "accepted", kind + ": " + reason);
}

void RunFacts::check() const {
  for (const std::string& kind : kinds()) {
    const std::vector<std::string> known = texts(kind);
    const auto accepted = accepted_.find(kind);
    const std::size_t first = accepted == accepted_.end() ? 0 : accepted->second;
    // The first of them is the reason: later ones mostly follow from it.
    if (first < known.size()) throw UnacceptedFact(kind + ": " + known[first]);
  }
}

}  // namespace vitreo
