// `vitreo attach`: live status of a run of another program; with --control also a line of commands
// to it.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/view/control_client.h"

#include <fmt/format.h>

#include <iostream>
#include <poll.h>
#include <unistd.h>

namespace vitreo::cli {
namespace {

struct Attach {
  std::string run;
  bool control = false;
  bool json = false;
};

// One reply or change of status per line. std::endl and not "\n": what follows a run live is mostly
// a pipe, and a line must not wait there for a full buffer.
void show(const nlohmann::json& reply, bool json) {
  if (json)
    std::cout << reply.dump() << std::endl;
  else if (!reply.at("ok"))
    std::cerr << "vitreo: " << reply.at("error").get<std::string>() << std::endl;
  else if (const nlohmann::json& status = reply.at("status"); status.contains("question"))
    std::cout << status.at("text").get<std::string>()
              << "; asked: " << status.at("question").at("text").get<std::string>() << std::endl;
  else
    std::cout << status.at("text").get<std::string>() << std::endl;
}

/// "pause after focus", "answer 3 mm": the first word and the rest.
/// The line protocol of `vitreo control`, typed: the rest of the line belongs to "answer" as its
/// text and to "pause" as the checkpoint's name; to other words it is dropped.
nlohmann::json request_of(const std::string& line) {
  const std::size_t blank = line.find(' ');
  const std::string word = line.substr(0, blank);
  const std::string rest = blank == std::string::npos ? "" : line.substr(blank + 1);
  nlohmann::json request = {{"do", word}};
  if (word == "answer") request["text"] = rest;
  if (word == "pause" && !rest.empty()) request["at"] = rest;
  return request;
}

/// What was typed, line by line; false at the end of the input, and for a line that no run would
/// take.
/// Unfinished input stays in `typed` for the next call, so it is bounded: past kLongest without a
/// line end the keyboard is given up, and the run is still followed.
bool take_typed(ControlConnection& run, bool control, std::string& typed) {
  constexpr std::size_t kLongest = 32 << 10;
  char bytes[4096];
  const ssize_t count = read(STDIN_FILENO, bytes, sizeof bytes);
  if (count <= 0) return false;
  typed.append(bytes, static_cast<std::size_t>(count));
  for (std::size_t end; (end = typed.find('\n')) != std::string::npos; typed.erase(0, end + 1)) {
    const std::string line = typed.substr(0, end);
    if (line.empty()) continue;
    if (control)
      run.send(request_of(line));
    else
      std::cerr << "vitreo: this looks on only; vitreo attach --control may also speak to the run"
                << std::endl;
  }
  if (typed.size() <= kLongest) return true;
  std::cerr << "vitreo: a line of more than 32 KiB is not understood; what is typed is not looked "
               "at any more\n";
  return false;
}

/// Waits for the run and for the keyboard at once, until the run closes its socket.
/// Everything goes through one poll(), so no thread is needed. The exit code does not tell how the
/// run ended, only whether following it worked; the status lines have the outcome's phase.
int attach(const Attach& wanted) {
  ControlConnection run(wanted.run);
  run.send({{"do", "watch"}});
  bool typing = true;
  std::string typed;
  for (;;) {
    // A negative descriptor is left out by poll().
    pollfd watched[] = {{run.descriptor(), POLLIN, 0}, {typing ? STDIN_FILENO : -1, POLLIN, 0}};
    if (poll(watched, 2, -1) < 0 && errno != EINTR) return static_cast<int>(ExitCode::internal);
    // Also on POLLHUP: receive() then returns false, which is the end of the run.
    if (watched[0].revents != 0) {
      if (!run.receive()) break;
      while (const auto reply = run.next()) show(*reply, wanted.json);
      if (!std::cout) return 0;  // the reader has closed the pipe
    }
    if (typing && watched[1].revents != 0) typing = take_typed(run, wanted.control, typed);
  }
  if (!wanted.json) fmt::print("{} has ended\n", run.name());
  return 0;
}

}  // namespace

void add_attach(CommandLine& line, Program&) {
  const auto wanted = std::make_shared<Attach>();
  Command command = line.command(
      "attach", "follows a run that is going on, each change of what it does in a line",
      [wanted] { return attach(*wanted); });
  command.option("run", wanted->run,
                 "the run's name, or its beginning, where several are going on");
  command.flag(
      "--control", wanted->control,
      "lines that are typed go to the run: pause, resume, stop, abort, emergency, answer TEXT");
  command.flag("--json", wanted->json, "each status as JSON, one a line");
  command.examples({"vitreo attach", "vitreo attach 2026-11-21T1830 --control"});
}

}  // namespace vitreo::cli
