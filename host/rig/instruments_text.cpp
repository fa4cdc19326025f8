// Tables of `vitreo devices` as text.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/instruments.h"
#include "host/text/columns.h"

#include <fmt/format.h>

namespace vitreo {
namespace {

using Json = nlohmann::json;

/// "-5 to 5 mm", "1, 0, 2.5 mm": one unit behind them all.
std::string joined_text(const std::vector<double>& in_si, const std::string& unit,
                        const char* separator) {
  const ShownColumn shown = show_column(in_si, unit);
  return with_unit({fmt::format("{}", fmt::join(shown.numbers, separator)), shown.unit});
}

/// "; at 1, 0 mm; x -5 to 5 mm up to 3 mm/s": what a role's row says about position and limits, in
/// people's units.
/// An axis a part, each with its own unit: axes of a stage may differ in travel by decades.
std::string place_and_limits(const Json& row) {
  const std::string length = row["role"] == "rotation_stage" ? "rad" : "m";
  const std::string speed = length + "/s";
  std::string text;
  const auto add = [&text](const std::string& more) { text += (text.empty() ? "" : ", ") + more; };
  if (row.contains("position") && !row["position"].empty()) {
    const Json& at = row["position"];
    add("at " + joined_text(at.is_array() ? at.get<std::vector<double>>()
                                          : std::vector<double>{at.get<double>()},
                            length, ", "));
  }
  if (!row.contains("limits")) return text;
  for (const Json& limits :
       row["limits"].is_array() ? row["limits"] : Json::array({row["limits"]})) {
    text += text.empty() ? "" : "; ";
    std::string of = limits.value("name", "");
    const auto say = [&](const std::string& more) { of += (of.empty() ? "" : " ") + more; };
    if (limits.contains("travel_min") && limits.contains("travel_max"))
      say(joined_text({limits["travel_min"].get<double>(), limits["travel_max"].get<double>()},
                      length, " to "));
    if (limits.contains("max_speed")) say("up to " + format_quantity(limits["max_speed"], speed));
    if (limits.contains("channels")) say(fmt::format("{} channels", limits["channels"].get<int>()));
    if (limits.contains("current")) say("up to " + format_quantity(limits["current"], "A"));
    if (limits.contains("range")) say("up to " + format_quantity(limits["range"], "T"));
    if (limits.contains("width_px"))
      say(fmt::format("{} x {} px, {}", limits["width_px"].get<int>(),
                      limits["height_px"].get<int>(), format_quantity(limits["frame_rate"], "Hz")));
    text += of;
  }
  return text;
}

std::string driver_text(const Json& row) {
  if (row.contains("candidates"))
    return fmt::format("driver one of {}, as the rig file says",
                       fmt::join(row["candidates"].get<std::vector<std::string>>(), ", "));
  if (row.contains("taken_as")) return "taken by its address hid:...";
  const std::string driver = row.value("driver", "");
  return driver.empty() ? "no driver" : "driver " + driver;
}

std::string with(const std::string& separator, const std::string& text) {
  return text.empty() ? "" : separator + text;
}

}  // namespace

// Three kinds of rows in one list: a bus that cannot be searched, a role of a rig, a device that
// was found.
std::string to_text(const Json& rows) {
  std::string text;
  for (const Json& row : rows) {
    const auto of = [&row](const char* key) {
      return row.contains(key) ? row[key].get<std::string>() : std::string();
    };
    if (row.contains("problem"))
      text += fmt::format("{:<8} cannot be looked at: {}\n", of("bus"), of("problem"));
    else if (row.contains("role"))
      text += fmt::format("{:<14} {:<16} {:<28} {}\n", of("role"), of("driver"), of("link"),
                          row["present"].get<bool>() ? of("identity") + with("; ", of("state")) +
                                                           with("; ", place_and_limits(row))
                                                     : "missing: " + of("why"));
    else
      text += fmt::format("{:<36} {:<36} {:<24} {}\n", of("address"), of("name"), of("place"),
                          driver_text(row));
  }
  return text.empty() ? "nothing is plugged in\n" : text;
}

}  // namespace vitreo
