// What asking found, as text for people and for a rig file.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/asking.h"
#include "host/text/lua_text.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {
namespace {

std::string commented(const std::string& lines) {
  std::string text = "-- ";
  for (const char c : lines) text += c == '\n' ? std::string("\n-- ") : std::string(1, c);
  if (text.ends_with("\n-- ")) text.resize(text.size() - 3);
  return text;
}

std::string heard_text(const HeardAnswer& heard) {
  const std::string rate = heard.baud_rate > 0 ? fmt::format("{} baud, ", heard.baud_rate) : "";
  return fmt::format("  {}to {}: {}\n", rate, heard.question,
                     heard.echo ? "its echo" : heard.answer);
}

/// Why nothing is found, and what may help.
std::string nothing_text(const AskingResult& result) {
  const std::string& address = result.plan.address;
  if (result.heard.empty())
    return address +
           ": silence, to each question at each of its rates. Is it switched on, is the "
           "cable one that it needs (crossed or straight), is its port enabled at its panel, "
           "and is its rate one of these?\n";
  if (std::all_of(result.heard.begin(), result.heard.end(),
                  [](const HeardAnswer& heard) { return heard.echo; }))
    return address +
           ": an echo: what is sent comes back, and nothing else. A plug that joins the "
           "port's own lines, or an instrument whose echo is on and that does not answer?\n";
  std::string text = address + ": something answers, and no driver knows it:\n";
  for (const HeardAnswer& heard : result.heard) text += heard_text(heard);
  return text;
}

}  // namespace

std::string rig_table(const FoundInstrument& found, const ProposedRole& role) {
  std::string text = fmt::format("{} = {{ -- {}\n  driver = {},\n  address = {},\n", role.role,
                                 found.answer, lua_quoted(found.driver), lua_quoted(found.address));
  if (!found.lasting_address.empty())
    text += fmt::format("  -- The same port, whatever is plugged in first: {}\n",
                        lua_quoted(found.lasting_address));
  if (found.baud_rate > 0) text += fmt::format("  baud_rate = {},\n", found.baud_rate);
  for (const ProposedSetting& setting : role.settings)
    text += fmt::format("  {} = {},\n", setting.key, setting.value);
  if (!role.note.empty()) text += "  -- " + role.note + "\n";
  return text + "},\n";
}

std::string to_text(const AskingResult& result) {
  if (result.found.empty()) return nothing_text(result);
  std::string text;
  bool first = true;
  for (const FoundInstrument& found : result.found) {
    for (const ProposedRole& role : found.roles) {
      const std::string table = rig_table(found, role);
      text += first ? table : "\n-- Or:\n" + commented(table);
      first = false;
    }
  }
  return text;
}

nlohmann::json to_json(const AskingResult& result) {
  nlohmann::json found = nlohmann::json::array(), heard = found, asked = found;
  for (const FoundInstrument& one : result.found) {
    nlohmann::json row{{"driver", one.driver}, {"address", one.address}, {"answer", one.answer}};
    if (one.baud_rate > 0) row["baud_rate"] = one.baud_rate;
    for (const ProposedRole& role : one.roles)
      row["tables"].push_back({{"role", role.role}, {"text", rig_table(one, role)}});
    found.push_back(row);
  }
  for (const HeardAnswer& one : result.heard) {
    heard.push_back({{"question", one.question}, {"answer", one.answer}, {"echo", one.echo}});
    if (one.baud_rate > 0) heard.back()["baud_rate"] = one.baud_rate;
  }
  for (const AskingStep& step : result.plan.steps) {
    nlohmann::json row{{"drivers", nlohmann::json::array()}};
    for (const IdentifiedDriver& driver : step.drivers) row["drivers"].push_back(driver.name);
    if (step.baud_rate > 0) row["baud_rate"] = step.baud_rate;
    asked.push_back(row);
  }
  return {{"found", found}, {"heard", heard}, {"questions", asked}};
}

}  // namespace vitreo
