// `vitreo run`, and the prompt: what opens a rig and leaves a record.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/progress_line.h"
#include "host/units.h"

#include <fmt/format.h>

#include <filesystem>
#include <iostream>
#include <unistd.h>

namespace vitreo::cli {
namespace {

struct Run : RunOptions {
  std::string protocol;
  bool json = false;
};

void show(const RunResult& result, bool json) {
  if (json) {
    std::cout << to_json(result).dump() << "\n";
    return;
  }
  for (const Figure& figure : result.figures)
    fmt::print("{:<28} {}\n", figure.name, format_quantity(figure.value, figure.unit));
  fmt::print("{}{}{}\nrun: {}\nreport: {}\n", to_string(result.outcome), result.reason.empty() ? "" : ": ",
             result.reason, result.folder, (std::filesystem::path(result.folder) / "report.html").string());
}

int run(Program& program, Run& wanted) {
  wanted.request.protocol_file = Program::protocol_file(wanted.protocol);
  ProgressLine progress(std::cerr, isatty(STDERR_FILENO) != 0);
  const RunResult result = run_protocol(program.engine(), wanted.complete(), progress);
  progress.clear();
  show(result, wanted.json);
  return static_cast<int>(result.exit_code);
}

int prompt(Program& program, RunOptions& options) {
  const bool interactive = isatty(STDIN_FILENO) != 0;
  if (interactive) options.real_time = true;
  ProgressLine progress(std::cerr, interactive);
  const RunResult result = run_prompt(program.engine(), options.complete(), progress, std::cin, std::cout, interactive);
  if (interactive) fmt::print("run: {}\n", result.folder);
  return static_cast<int>(result.exit_code);
}

}  // namespace

void add_run(CommandLine& line, Program& program) {
  const auto at_prompt = std::make_shared<RunOptions>();
  Command root = line.root([&program, at_prompt] { return prompt(program, *at_prompt); });
  add_run_options(root, *at_prompt);

  const auto wanted = std::make_shared<Run>();
  Command command = line.command("run", "run a protocol", [&program, wanted] { return run(program, *wanted); });
  add_run_options(command, *wanted);
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  command.option("arguments", wanted->request.arguments, "name=value, with units: speed=0.5mm/s");
  command.flag("--json", wanted->json, "one JSON object on the standard output at the end, SI units");
  command.option("--answer", wanted->request.answers,
                 "answers a question of the script in advance: name=value, or value in their order");
  command.option("--override", wanted->request.override_reason,
                 "run although the preflight fails, and why (a researcher's right; it is recorded)");
}

}  // namespace vitreo::cli
