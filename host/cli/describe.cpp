// `vitreo list` and `vitreo describe`: the protocols that there are, and what each takes.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/record/record_json.h"
#include "host/session/protocol_json.h"
#include "host/session/protocol_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iostream>

namespace vitreo::cli {
namespace {

/// As it could be written on the command line: hold=5s.
/// A default is printed as "5 s", and a blank would end the word in a shell. "..." stands for a
/// text that has no default: the line then cannot be pasted unchanged, which is meant.
std::string argument_example(const ProtocolDescription& protocol) {
  if (protocol.parameters.empty()) return "";
  const Parameter& p = protocol.parameters.front();
  std::string value = p.required ? "..." : plain_value_text(p, p.fallback);
  std::erase(value, ' ');
  return " " + p.name + "=" + value;
}

void describe(const ProtocolDescription& protocol, const std::string& word, bool json) {
  std::cout << (json ? dumped(to_json(protocol)) + "\n" : describe_text(protocol, word));
}

/// A protocol that does not load is listed with its error.
/// So one broken file in the folder does not hide the others from a technician.
void list(ScriptEngine& engine, bool json) {
  nlohmann::json rows = nlohmann::json::array();
  std::size_t widest = 0;
  for (const std::string& file : Program::protocol_files()) {
    nlohmann::json row{{"name", std::filesystem::path(file).stem().string()}, {"file", file}};
    try {
      const ProtocolDescription protocol = engine.describe(file);
      row["title"] = protocol.title;
      row["simulated_only"] = protocol.simulated_only;
    } catch (const ScriptError& error) {
      row["error"] = error.what();
    }
    widest = std::max(widest, row["name"].get_ref<const std::string&>().size());
    rows.push_back(std::move(row));
  }
  if (json) {
    std::cout << dumped(rows) << "\n";
    return;
  }
  for (const auto& row : rows) {
    std::string said = row.contains("error") ? "does not load: " + row["error"].get<std::string>()
                                             : row["title"].get<std::string>();
    if (row.value("simulated_only", false)) said += " (simulated rigs only)";
    fmt::print("{:<{}}  {}\n", row["name"].get<std::string>(), widest, said);
  }
}

}  // namespace

std::string describe_text(const ProtocolDescription& protocol, const std::string& word) {
  return protocol_text(protocol) +
         fmt::format("for instance: vitreo run {}{}\n", word, argument_example(protocol));
}

void add_describe(CommandLine& line, Program& program) {
  struct Wanted {
    std::string protocol;
    bool json = false;
  };
  const auto wanted = std::make_shared<Wanted>();
  Command all = line.command("list", "the protocols there are", [&program, wanted] {
    return list(program.engine(), wanted->json), 0;
  });
  all.flag("--json", wanted->json, "as JSON");
  Command one = line.command(
      "describe", "what a protocol does and which parameters it takes", [&program, wanted] {
        describe(program.engine().describe(Program::protocol_file(wanted->protocol)),
                 wanted->protocol, wanted->json);
        return 0;
      });
  one.option("protocol", wanted->protocol, "a protocol's file or name").required();
  one.flag("--json", wanted->json, "as JSON, SI units");
  one.examples({"vitreo describe servo_square", "vitreo describe ./mine.lua --json"});
  all.examples({"vitreo list"});
}

}  // namespace vitreo::cli
