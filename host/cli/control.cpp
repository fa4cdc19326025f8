// `vitreo control`: speaks to a run that is going on, through its control socket.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/control_socket.h"

#include <fmt/format.h>

#include <iostream>

namespace vitreo::cli {
namespace {

struct Control {
  std::string word, text, run;
  bool json = false;
};

int control(const Control& wanted) {
  nlohmann::json request = {{"do", wanted.word}};
  if (wanted.word == "answer") request["text"] = wanted.text;
  if (wanted.word == "pause" && !wanted.text.empty()) request["at"] = wanted.text;
  const nlohmann::json reply = control_run(wanted.run, request);
  if (wanted.json)
    std::cout << reply.dump() << "\n";
  else if (reply["ok"])
    fmt::print("{}\n", reply["status"]["text"].get<std::string>());
  else
    fmt::print(stderr, "vitreo: {}\n", reply["error"].get<std::string>());
  return reply["ok"] ? 0 : static_cast<int>(ExitCode::usage);
}

}  // namespace

void add_control(CommandLine& line, Program&) {
  const auto wanted = std::make_shared<Control>();
  Command command = line.command("control", "speaks to a run that is going on", [wanted] { return control(*wanted); });
  command.option("word", wanted->word, "status, pause, resume, stop, abort, emergency or answer").required();
  command.option("text", wanted->text, "the answer, or the checkpoint at which to pause");
  command.option("--run", wanted->run, "the run's name, or its beginning, where several are going on");
  command.flag("--json", wanted->json, "the reply as JSON");
}

}  // namespace vitreo::cli
