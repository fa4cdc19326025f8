// SPDX-License-Identifier: Apache-2.0
#include "host/record/run_data.h"

#include <algorithm>
#include <array>
#include <cctype>

namespace vitreo {
namespace {

// By Outcome.
constexpr std::array kOutcomes = {"completed", "failed", "stopped", "aborted", "lost"};

}  // namespace

const char* to_string(Outcome outcome) { return kOutcomes[static_cast<std::size_t>(outcome)]; }

// These words are in records and in scripts: they are part of the formats.
const char* to_string(AlarmPriority priority) {
  switch (priority) {
    case AlarmPriority::low:
      return "low";
    case AlarmPriority::medium:
      return "medium";
    case AlarmPriority::high:
      return "high";
  }
  return "?";
}

std::optional<AlarmPriority> alarm_priority_named(const std::string& name) {
  for (const AlarmPriority priority :
       {AlarmPriority::low, AlarmPriority::medium, AlarmPriority::high})
    if (name == to_string(priority)) return priority;
  return std::nullopt;
}

std::string alarm_text(AlarmPriority priority, const std::string& name, const std::string& text) {
  return std::string(to_string(priority)) + ": " + name + ": " + text;
}

std::optional<Outcome> outcome_named(const std::string& name) {
  const auto found = std::find(kOutcomes.begin(), kOutcomes.end(), name);
  if (found == kOutcomes.end()) return {};
  return static_cast<Outcome>(found - kOutcomes.begin());
}

// A Lua error begins with "FILE.lua:LINE:"; a blank before the ending means that the name stands
// somewhere in the text.
std::string script_line(const std::string& reason) {
  const std::size_t name_end = reason.find(".lua:");
  if (name_end == std::string::npos || reason.find_first_of(" \n") < name_end) return "";
  std::size_t at = name_end + 5;
  while (at < reason.size() && std::isdigit(static_cast<unsigned char>(reason[at]))) ++at;
  return at == name_end + 5 ? "" : reason.substr(0, at);
}

std::string cause_text(const EndCause& cause) {
  std::string text = cause.by;
  if (!cause.name.empty()) text += " " + cause.name;
  if (!cause.face.empty()) text += " at " + cause.face;
  if (!cause.signal.empty()) text += " (" + cause.signal + ")";
  return text;
}

std::string coil_rest_text(const RunData& data) {
  const auto last = std::find_if(data.events.rbegin(), data.events.rend(),
                                 [](const Event& event) { return event.kind == kCoilRest; });
  return last == data.events.rend() ? "" : last->text;
}

const Stream* RunData::stream(const std::string& name) const {
  const auto found = std::find_if(streams.begin(), streams.end(),
                                  [&](const auto& one) { return one.info.name == name; });
  return found == streams.end() ? nullptr : &*found;
}

}  // namespace vitreo
