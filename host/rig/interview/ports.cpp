// Questions of the interview about what is plugged in, each with the risk of asking it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/rig/interview/steps.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

using Json = nlohmann::json;

std::string found_text(const std::string& address, const AskingResult& result) {
  if (result.found.empty()) return to_text(result);
  std::string text;
  for (const FoundInstrument& one : result.found) {
    std::vector<std::string> roles;
    for (const ProposedRole& role : one.roles) roles.push_back(role.role);
    text += fmt::format("{}: {} ({}; may be {})\n", address, one.answer, one.driver,
                        fmt::join(roles, ", "));
  }
  return text;
}

/// What was known of the address before is put aside. What does not answer is told and is no error:
/// the person can switch it on, go back, and ask again.
std::string ask_now(const InterviewWorld& world, InterviewState& state,
                    const std::string& address) {
  try {
    const AskingResult result = world.ask(address);
    for (const FoundInstrument& one : result.found) {
      std::erase_if(state.found, [&](const FoundInstrument& other) {
        return other.address == one.address && other.driver == one.driver;
      });
      state.found.push_back(one);
    }
    return found_text(address, result);
  } catch (const DeviceError& error) {
    return std::string(error.what()) + "\n";
  }
}

std::string drivers_text(const AskingPlan& plan) {
  std::vector<std::string> names;
  for (const AskingStep& step : plan.steps)
    for (const IdentifiedDriver& driver : step.drivers)
      if (std::find(names.begin(), names.end(), driver.name) == names.end())
        names.push_back(driver.name);
  const std::string last = names.back();
  names.pop_back();
  return fmt::format("{}{}{}", fmt::join(names, ", "), names.empty() ? "" : " or ", last);
}

/// Whose questions would be sent, how long that may take, and what it risks.
std::string risk_text(const AskingPlan& plan) {
  if (plan.steps.empty())
    return "\n" + plan.address +
           ": nothing is moved or set; a camera is opened for a moment, and tells its size.\n";
  std::string risks;
  for (const std::string& caution : plan.cautions) risks += "  - " + caution + "\n";
  return wrapped(fmt::format(
      "\n{} can be asked whether {} is there. It takes {} s at most, a few where something "
      "answers. It moves and energizes none of these instruments, but\n{}  - of other instruments "
      "nothing is known.\n",
      plan.address, drivers_text(plan), static_cast<int>(std::ceil(longest_time(plan))), risks));
}

AskedQuestion ask_question(const InterviewWorld& world, const std::string& address,
                           const std::vector<std::string>& rest) {
  const AskingPlan plan = world.plan(address);
  AskedQuestion asked;
  asked.question = {
      .key = "ask " + address,
      .before = risk_text(plan),
      .text = "Ask what is at " + address + "?",
      .help =
          "Only what answers can be recognized; without it you name driver and address yourself. "
          "Say no where something is moving, or where the port belongs to another program.\n" +
          (plan.steps.empty() ? "" : to_text(plan)),
      .options = {{"yes", "send it"}, {"no", "leave this port alone"}},
      .fallback = "no"};
  if (!rest.empty()) {
    asked.question.options.push_back(
        {"all", fmt::format("this one and the {} ports after it", rest.size())});
    asked.question.options.push_back({"none", "none of the ports"});
  }
  asked.accept = [&world, address, rest](InterviewState& state, const std::string& word) {
    state.asked_all = state.asked_all || word == "all" || word == "none";
    std::string told = word == "yes" || word == "all" ? ask_now(world, state, address) : "";
    if (word == "all")
      for (const std::string& other : rest) told += ask_now(world, state, other);
    return told;
  };
  return asked;
}

/// Devices on USB are known by their numbers: nothing is sent to them.
void take_known(const InterviewWorld& world, InterviewState& state) {
  for (const Json& row : world.plugged_in) {
    const std::string bus = row.value("bus", "");
    if ((bus == "hid" || bus == "usb") && !row.value("driver", "").empty())
      ask_now(world, state, row["address"]);
  }
}

/// One more address, until there is none. What is not listed (TCP, a pseudo-terminal) comes so.
std::optional<AskedQuestion> another_question(const InterviewWorld& world, const InterviewState&) {
  AskedQuestion asked;
  asked.question = {
      .key = "another",
      .before = "\n",
      .text = "Another address to be asked, such as tcp:10.0.0.11:5025",
      .help =
          "Instruments on the network are not found by looking: name the address that is set at "
          "the instrument. Serial ports and devices are asked as well: /dev/ttyUSB0, "
          "hid:09db:009c.",
      .options = {},
      .fallback = "none",
      .wanted = "an address, or none"};
  asked.accept = [&world](InterviewState& state, const std::string& typed) {
    if (typed == "none") return take_known(world, state), std::string();
    const std::string address = full_address(typed);
    world.plan(address);  // or it is no address
    state.next({[&world, address](const InterviewState&) {
                  return std::optional(ask_question(world, address, {}));
                },
                [&world](const InterviewState& now) { return another_question(world, now); }});
    return std::string();
  };
  return asked;
}

/// The addresses that are asked by their own questions: ports, and all cameras at once.
std::vector<std::string> askable(const Json& rows) {
  std::vector<std::string> addresses;
  for (const Json& row : rows) {
    const std::string bus = row.value("bus", "");
    if (bus == "serial" && row.contains("address")) addresses.push_back(row["address"]);
    if (bus == "genicam" && row.contains("address") &&
        std::find(addresses.begin(), addresses.end(), "genicam") == addresses.end())
      addresses.emplace_back("genicam");
  }
  return addresses;
}

/// "  hid:09db:009c:01A2B3C4  usb3103  Measurement Computing USB-3103".
std::string row_text(const Json& row, std::size_t widest) {
  if (row.contains("problem"))
    return fmt::format("  {}: cannot be looked at: {}\n", row.value("bus", ""),
                       row.value("problem", ""));
  std::string driver = row.value("driver", "");
  if (driver.empty()) driver = row.contains("candidates") ? "ask it" : "no driver";
  const std::string name = row.value("name", "");
  return fmt::format("  {:<{}}  {}{}\n", row.value("address", ""), widest, driver,
                     name.empty() ? "" : "  (" + name + ")");
}

/// Shown once, with the first of the steps that follow it. What no driver takes (hubs, keyboards, a
/// device's second address) is left out.
std::string plugged_in_text(const InterviewWorld& world) {
  std::vector<Json> rows;
  std::size_t widest = 0;
  for (const Json& row : world.plugged_in) {
    if (!row.contains("problem") && row.value("bus", "") != "serial" &&
        row.value("driver", "").empty())
      continue;
    widest = std::max(widest, row.value("address", "").size());
    rows.push_back(row);
  }
  std::string text = "\nPlugged in, with the drivers:\n";
  for (const Json& row : rows) text += row_text(row, widest);
  if (rows.empty()) text += "  nothing that a driver takes\n";
  if (rows.size() < world.plugged_in.size())
    text += fmt::format("  and {} that no driver takes: vitreo devices shows all\n",
                        world.plugged_in.size() - rows.size());
  return text;
}

}  // namespace

std::vector<InterviewStep> port_steps(const InterviewWorld& world) {
  const std::vector<std::string> addresses = askable(world.plugged_in);
  std::vector<InterviewStep> steps;
  for (std::size_t i = 0; i < addresses.size(); ++i)
    steps.push_back(
        [&world, addresses, i](const InterviewState& state) -> std::optional<AskedQuestion> {
          if (state.asked_all) return std::nullopt;
          AskedQuestion asked = ask_question(
              world, addresses[i], {addresses.begin() + static_cast<long>(i) + 1, addresses.end()});
          if (i == 0) asked.question.before = plugged_in_text(world) + asked.question.before;
          return asked;
        });
  steps.push_back([&world, first = addresses.empty()](const InterviewState& state) {
    auto asked = another_question(world, state);
    if (first) asked->question.before = plugged_in_text(world) + "\n";
    return asked;
  });
  return steps;
}

}  // namespace vitreo
