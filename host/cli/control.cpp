// `vitreo control`: one command to a run that is going on, through its control socket.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/config/rights.h"
#include "host/text/units.h"
#include "host/view/control_client.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <thread>
#include <vector>

namespace vitreo::cli {
namespace {

struct Control {
  std::string word;
  std::string text;
  std::string run;
  std::string by;
  bool json = false;
  bool force = false;
};

/// The status in a line, and the alarms that stand, the most urgent first.
/// "remaining" is absent while no estimate is known (OperatorDesk::status), so -1 stands for that
/// here.
void show(const nlohmann::json& status) {
  fmt::print("{}\n", status["text"].get<std::string>());
  const std::string doing = status.value("doing", "");
  if (!doing.empty()) {
    const double left = status.value("remaining", -1.0);
    fmt::print("{:.0f} %  {}{}\n", 100 * status.value("progress", 0.0), doing,
               left >= 0 ? fmt::format(", {:.0f} s left", left) : "");
  }
  for (const auto& alarm : status.value("alarms", nlohmann::json::array())) {
    const std::string by = alarm.value("acknowledged_by", "");
    fmt::print("ALARM {}: {}: {}{}{}\n", alarm["priority"].get<std::string>(),
               alarm["name"].get<std::string>(), alarm["text"].get<std::string>(),
               alarm["active"].get<bool>() ? "" : " (gone)",
               by.empty() ? "" : " (acknowledged: " + by + ")");
  }
}

// Without "target": positions of a microrobot are sent by programs, as JSON on the socket itself.
// With "status", which the desk does not have, since it only reads.
const std::vector<std::string>& words() {
  static const std::vector<std::string> known{"status",    "pause",  "resume", "stop",  "abort",
                                              "emergency", "answer", "ack",    "adjust"};
  return known;
}

/// "stage z=3mm" into "instrument" and "to", SI; without a text all instruments are read. Their
/// units are the run's to know: a quantity of another kind is refused here, before anything moves.
void add_adjustment(const Control& wanted, nlohmann::json& request) {
  if (wanted.text.empty()) return;
  const std::size_t equals = wanted.text.find('=');
  const std::string name = wanted.text.substr(0, equals);
  const auto to =
      equals == std::string::npos ? std::nullopt : parse_quantity(wanted.text.substr(equals + 1));
  if (!to) throw ConfigError("'" + wanted.text + "': wants INSTRUMENT=VALUE, as \"stage z=3mm\"");
  const nlohmann::json known = control_run(wanted.run, {{"do", "status"}});
  for (const auto& one : known["status"].value("instruments", nlohmann::json::array())) {
    const std::string unit = si_unit(one["unit"].get<std::string>());
    if (one["name"] != name || to->dimension == unit) continue;
    // Decibels are no unit of the table.
    if (to->bare && unit == "dB") continue;
    throw ConfigError(fmt::format("'{}': {} is {}", wanted.text, name,
                                  unit.empty() ? "a part of one, as 50 %" : "in " + unit));
  }
  request["instrument"] = name;
  request["to"] = to->value;
}

void show_instruments(const nlohmann::json& status) {
  for (const auto& one : status.value("instruments", nlohmann::json::array())) {
    const std::string unit = one["unit"];
    const auto shown = [&unit](const nlohmann::json& value) {
      if (!value.is_number()) return std::string("?");
      return unit == "dB" ? fmt::format("{:.3g} dB", value.get<double>())
                          : format_quantity(value, unit);
    };
    const std::string refused = one["refused"];
    fmt::print("{:<22} {:>10}  {} to {}{}{}\n", one["name"].get<std::string>(), shown(one["value"]),
               shown(one["min"]), shown(one["max"]), one["busy"].get<bool>() ? "  on its way" : "",
               refused.empty() ? "" : "  refused: " + refused);
  }
}

/// The script acts upon it at its next turn, and an instrument is read at the panel's: the status
/// is asked for again until it says something else, for 300 ms at most.
nlohmann::json settled(const Control& wanted, nlohmann::json reply) {
  static const std::vector<std::string> kActs = {"resume", "answer", "adjust"};
  if (std::find(kActs.begin(), kActs.end(), wanted.word) == kActs.end()) return reply;
  const nlohmann::json before = reply["status"];
  const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(300);
  while (std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    reply = control_run(wanted.run, {{"do", "status"}});
    const bool instruments = wanted.word == "adjust";
    const char* const what = instruments ? "instruments" : "text";
    if (!reply["ok"] ||
        reply["status"].value(what, nlohmann::json()) != before.value(what, nlohmann::json()))
      break;
  }
  return reply;
}

/// The request in the socket's own JSON: {"do": word, ...}; refused here where a slip can be named.
/// A misspelt word is named here with a suggestion; all that depends on the run, such as whether a
/// question is open or a checkpoint exists, is for the run to judge. Its refusal is exit code 2.
int control(const Control& wanted) {
  if (std::find(words().begin(), words().end(), wanted.word) == words().end()) {
    const std::string near = nearest(wanted.word, words());
    throw ConfigError(fmt::format("'{}' is not understood{}: {}", wanted.word,
                                  near.empty() ? "" : "; did you mean " + near + "?",
                                  fmt::join(words(), ", ")));
  }
  const bool takes_text = wanted.word == "answer" || wanted.word == "pause" ||
                          wanted.word == "ack" || wanted.word == "adjust";
  if (!takes_text && !wanted.text.empty())
    throw ConfigError("'" + wanted.text + "': " + wanted.word + " takes no text");
  nlohmann::json request = {{"do", wanted.word}};
  if (wanted.word == "answer") request["text"] = wanted.text;
  if (wanted.word == "pause" && !wanted.text.empty()) request["at"] = wanted.text;
  if (wanted.word == "ack" && !wanted.text.empty()) request["alarm"] = wanted.text;
  if (wanted.word == "adjust") add_adjustment(wanted, request);
  if (wanted.force) request["override"] = true;
  // For the record: who stopped or answered. The socket's folder admits this account alone, so the
  // name is a courtesy, not a proof.
  request["by"] = wanted.by.empty() ? account_name() : wanted.by;
  nlohmann::json reply = control_run(wanted.run, request);
  if (reply["ok"]) reply = settled(wanted, std::move(reply));
  if (wanted.json)
    std::cout << reply.dump() << "\n";
  else if (reply["ok"] && wanted.word == "adjust")
    show_instruments(reply["status"]);
  else if (reply["ok"])
    show(reply["status"]);
  else
    fmt::print(stderr, "vitreo: {}\n", reply["error"].get<std::string>());
  return reply["ok"] ? 0 : static_cast<int>(ExitCode::usage);
}

}  // namespace

void add_control(CommandLine& line, Program&) {
  const auto wanted = std::make_shared<Control>();
  Command command = line.command("control", "speaks to a run that is going on",
                                 [wanted] { return control(*wanted); });
  command
      .option("word", wanted->word,
              "status, pause, resume, stop, abort, emergency, answer, ack or adjust")
      .required();
  command.option("text", wanted->text,
                 "the answer, the checkpoint at which to pause, the alarm to acknowledge (all), or "
                 "what to adjust, as \"stage z=3mm\" (reads all)");
  command.option("--operator", wanted->by, "who says it (default: whose account it is)");
  command.flag("--override", wanted->force,
               "with resume: although it is still suspended (a researcher's right)");
  command.option("--run", wanted->run,
                 "the run's name, or its beginning, where several are going on");
  command.flag("--json", wanted->json, "the reply as JSON");
  command.examples({"vitreo control status", "vitreo control pause \"after focus\"",
                    "vitreo control answer 3mm", "vitreo control stop --run 2026-11-21T1830"});
}

}  // namespace vitreo::cli
