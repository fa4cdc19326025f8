// `vitreo list` and `vitreo describe`: the protocols that there are, and what each takes.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/protocol_text.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <iostream>

namespace vitreo::cli {
namespace {

const char* kind_name(ParameterKind kind) {
  switch (kind) {
    case ParameterKind::number:
      return "number";
    case ParameterKind::integer:
      return "integer";
    case ParameterKind::flag:
      return "flag";
    case ParameterKind::choice:
      return "choice";
    case ParameterKind::text:
      return "text";
  }
  return "?";
}

nlohmann::json describe_json(const ProtocolDescription& protocol) {
  nlohmann::json parameters = nlohmann::json::array();
  for (const Parameter& p : protocol.parameters) {
    nlohmann::json row = {{"name", p.name}, {"kind", kind_name(p.kind)}, {"unit", p.unit}, {"help", p.help}};
    std::visit([&row](const auto& held) { row["default"] = held; }, p.fallback);
    if (std::isfinite(p.min)) row["min"] = p.min;
    if (std::isfinite(p.max)) row["max"] = p.max;
    if (p.required) row["required"] = true;
    if (!p.choices.empty()) row["choices"] = p.choices;
    parameters.push_back(row);
  }
  return {{"name", protocol.name},   {"file", protocol.file}, {"title", protocol.title}, {"about", protocol.about},
          {"needs", protocol.needs}, {"rig", protocol.rig},   {"parameters", parameters}};
}

/// As it could be written on the command line: hold=5s.
std::string argument_example(const ProtocolDescription& protocol) {
  if (protocol.parameters.empty()) return "";
  const Parameter& p = protocol.parameters.front();
  std::string value = p.required ? "..." : value_text(p.fallback, p.unit);
  std::erase(value, ' ');
  return " " + p.name + "=" + value;
}

void describe(const ProtocolDescription& protocol, bool json) {
  std::cout << (json ? describe_json(protocol).dump() + "\n" : describe_text(protocol));
}

void list(ScriptEngine& engine, bool json) {
  nlohmann::json rows = nlohmann::json::array();
  for (const std::string& file : Program::protocol_files()) {
    try {
      const ProtocolDescription protocol = engine.describe(file);
      if (json)
        rows.push_back({{"name", protocol.name}, {"file", file}, {"title", protocol.title}});
      else
        fmt::print("{:<22} {}\n", protocol.name, protocol.title);
    } catch (const ScriptError& error) {
      if (json)
        rows.push_back({{"file", file}, {"error", error.what()}});
      else
        fmt::print("{:<22} does not load: {}\n", std::filesystem::path(file).stem().string(), error.what());
    }
  }
  if (json) std::cout << rows.dump() << "\n";
}

}  // namespace

std::string describe_text(const ProtocolDescription& protocol) {
  return protocol_text(protocol) +
         fmt::format("for instance: vitreo run {}{}\n", protocol.name, argument_example(protocol));
}

void add_describe(CommandLine& line, Program& program) {
  struct Wanted {
    std::string protocol;
    bool json = false;
  };
  const auto wanted = std::make_shared<Wanted>();
  Command all = line.command("list", "the protocols there are",
                             [&program, wanted] { return list(program.engine(), wanted->json), 0; });
  all.flag("--json", wanted->json, "as JSON");
  Command one = line.command("describe", "what a protocol does and which parameters it takes", [&program, wanted] {
    describe(program.engine().describe(Program::protocol_file(wanted->protocol)), wanted->json);
    return 0;
  });
  one.option("protocol", wanted->protocol, "a protocol's file or name").required();
  one.flag("--json", wanted->json, "as JSON, SI units");
  one.examples({"vitreo describe servo_square", "vitreo describe ./mine.lua --json"});
  all.examples({"vitreo list"});
}

}  // namespace vitreo::cli
