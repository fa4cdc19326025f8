// `vitreo serve`: the workbench, a server that holds no instrument and starts runs as processes of
// their own.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/engine/versions.h"
#include "host/files/child_process.h"
#include "host/files/state_folder.h"
#include "host/serve/workbench.h"
#include "host/trials/sweep_axes.h"

#include <fmt/format.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <unistd.h>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kPort = 7600;

struct ServeWords {
  std::string address = "127.0.0.1";
  int port = kPort;
  int live_port = 0;
  std::string token_file;
  std::string runs = "runs";
  std::string sweeps = "sweeps";
  std::string state;
  std::string messages;
  bool open = false;
};

fs::path config_folder() {
  const char* const given = std::getenv("XDG_CONFIG_HOME");
  const char* const home = std::getenv("HOME");
  if (given != nullptr && *given == '/') return fs::path(given) / "vitreo";
  return home != nullptr && *home == '/' ? fs::path(home) / ".config/vitreo" : fs::path();
}

serve::WorkbenchSettings settings_of(const ServeWords& wanted) {
  serve::WorkbenchSettings settings;
  settings.web.address = wanted.address;
  settings.web.port = static_cast<unsigned short>(wanted.port);
  settings.web.token_file = wanted.token_file;
  settings.live_port = wanted.live_port;
  settings.state = wanted.state.empty() ? state_folder() / "workbench" : fs::absolute(wanted.state);
  if (!settings.state.is_absolute())
    throw ConfigError("serve: has no folder for its queue, since there is no HOME; give --state");
  settings.runs = fs::absolute(wanted.runs).lexically_normal();
  settings.sweeps = fs::absolute(wanted.sweeps).lexically_normal();
  settings.messages =
      wanted.messages.empty() ? config_folder() / "messages.json" : fs::absolute(wanted.messages);
  settings.program = fs::read_symlink("/proc/self/exe").string();
  const nlohmann::json built = versions();
  settings.version = built.value("vitreo", "") + " " + built.value("commit", "");
  return settings;
}

double count_swept(const ProtocolDescription& protocol, const std::vector<std::string>& words) {
  const std::vector<SweepAxis> axes = read_axes(protocol, words);
  for (const SweepAxis& axis : axes)
    if (axis.drawn())
      throw ConfigError(axis.parameter.name +
                        ": wants a number of values, such as 1..5:3 for three of that range");
  return count_settings(axes, {});
}

/// As the desktop opens a file.
void open_in_browser(const fs::path& door) {
  ChildProcess opener({"xdg-open", door.string()}, ChildProcess::Pipe::to_input);
  if (opener.finish() != 0)
    throw std::runtime_error("xdg-open found no browser; open " + door.string() + " yourself");
}

// The signals are blocked before there is a thread, so that this one alone gets them.
int serve_now(Program& program, const ServeWords& wanted) {
  const serve::WorkbenchSettings settings = settings_of(wanted);
  if (wanted.open) {
    if (const fs::path door = serve::open_door(settings.state); !door.empty())
      return open_in_browser(door), 0;
  }
  sigset_t ends;
  sigemptyset(&ends);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&ends, signal);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);
  serve::Workbench workbench(settings, program.engine(),
                             {Program::protocol_files, Program::rig_files, count_swept});
  // A token that works once, for the one who reads this terminal; a log would keep it.
  if (isatty(STDOUT_FILENO) != 0)
    fmt::print("workbench: {}\n", workbench.invitation());
  else
    fmt::print("workbench: {}\n", workbench.address());
  fmt::print("or open {}\n", workbench.door().string());
  std::fflush(stdout);
  if (wanted.open) open_in_browser(workbench.door());
  int got = 0;
  sigwait(&ends, &got);
  return 0;
}

}  // namespace

void add_serve(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<ServeWords>();
  Command command = line.command(
      "serve", "the workbench: protocols, a queue, runs and their reports in the browser",
      [&program, wanted] { return serve_now(program, *wanted); });
  command.option("--port", wanted->port, "of the page (default: 7600)").between(0, 65535);
  command
      .option("--view-port", wanted->live_port,
              "of the runs' live views (default: one that is free)")
      .between(0, 65535);
  command.option("--listen", wanted->address,
                 "an IP address of this machine at which it is served (default: 127.0.0.1, this "
                 "machine alone)");
  command.option("--token-file", wanted->token_file,
                 "a file for you alone (0600; made where there is none) whose token lets browsers "
                 "in (default: one in --state)");
  command.option("--runs", wanted->runs, "the folder in which the runs are (default: runs)");
  command.option("--sweeps", wanted->sweeps,
                 "the folder in which the sweeps are (default: sweeps)");
  command.option("--state", wanted->state,
                 "the folder of the queue (default: ~/.local/state/vitreo/workbench)");
  command.option("--messages", wanted->messages,
                 "who is told when a job ends or fails (default: ~/.config/vitreo/messages.json)");
  command.flag("--open", wanted->open,
               "opens it in the browser; where one serves already, opens that and ends");
  command.examples({"vitreo serve", "vitreo serve --open",
                    "vitreo serve --listen 192.168.1.5 --token-file ~/.config/vitreo/token "
                    "--view-port 7601"});
}

}  // namespace vitreo::cli
