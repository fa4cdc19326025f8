// `vitreo doctor`: whether this machine is set up for instruments, or for those of a rig, and the
// commands that mend it.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/doctor.h"

#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/engine/installed_calibration.h"
#include "host/record/disk_watch.h"
#include "host/record/record_json.h"
#include "host/rig/machine/udev_rules.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <sys/ioctl.h>
#include <unistd.h>

namespace vitreo::cli {
namespace {

struct DoctorWords {
  std::string rig;
  std::string out = "runs";
  std::string root = "/";
  bool json = false;
};

/// Where lines are broken: at the terminal's width, and not so far that they are hard to read.
std::size_t columns() {
  constexpr std::size_t kMost = 100;
  winsize size{};
  const bool told = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return told ? std::min<std::size_t>(size.ws_col, kMost) : kMost;
}

/// On a terminal whose user has not said NO_COLOR (no-color.org).
bool colors() {
  const char* const no_color = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  return isatty(STDOUT_FILENO) != 0 && (no_color == nullptr || *no_color == '\0') &&
         terminal != nullptr && std::string_view(terminal) != "dumb";
}

/// A program that the shell found by its name is found so again; another by its path.
std::string program_word(const char* called) {
  const std::string word = called;
  const bool path = word.find('/') != std::string::npos;
  return path ? machine::shell_word(std::filesystem::absolute(word).lexically_normal()) : word;
}

machine::Machine machine_at(const std::string& root) {
  if (!std::filesystem::is_directory(root)) throw ConfigError("--root " + root + ": is no folder");
  // What system calls tell is about this machine only.
  return root == "/" ? machine::Machine() : machine::Machine(root, machine::Kernel{});
}

machine::Wanted wanted_of(CommandLine& line, Program& program, const DoctorWords& words) {
  const DiskLimits limits;
  machine::Wanted wanted;
  if (!words.rig.empty()) {
    RigDescription rig = program.engine().load_rig(Program::rig_file(words.rig));
    take_installed_calibration(rig, words.out);
    wanted.rig = machine::needs_of(rig);
    wanted.rig->rig = words.rig;
  }
  wanted.rules = machine::udev_rules();
  wanted.program = program_word(line.words()[0]);
  wanted.runs = std::filesystem::absolute(words.out).lexically_normal().string();
  wanted.least_bytes = limits.stop_bytes_with_frames + limits.reserve_bytes;
  wanted.least_time = limits.warn_seconds;
  return wanted;
}

// 8 as a preflight that failed: a run would fail here. 7 where nothing is to be mended but a cable.
int exit_code_of(const machine::Findings& findings) {
  if (machine::count(findings, machine::State::fault) == 0) return 0;
  return static_cast<int>(machine::only_missing(findings) ? ExitCode::device_missing
                                                          : ExitCode::preflight_failed);
}

int doctor(CommandLine& line, Program& program, const DoctorWords& words) {
  const auto findings = machine::examine(machine_at(words.root), wanted_of(line, program, words));
  if (words.json)
    fmt::print("{}\n", dumped(machine::to_json(findings)));
  else
    fmt::print("{}", machine::to_text(findings, columns(), colors()));
  return exit_code_of(findings);
}

}  // namespace

void add_doctor(CommandLine& line, Program& program) {
  const auto words = std::make_shared<DoctorWords>();
  Command command = line.command(
      "doctor", "whether this machine is set up for instruments, and the commands that mend it",
      [&line, &program, words] { return doctor(line, program, *words); });
  command.option("--rig", words->rig,
                 "only what this rig needs, and whether its instruments are there (a file or a "
                 "name)");
  command.option("--out", words->out, "folder in which runs would be (default: runs)");
  command.option("--root", words->root,
                 "the machine whose /etc, /proc, /run, /sys and /usr are in this folder (default: "
                 "/)");
  command.flag("--json", words->json, "as JSON");
  command.examples({"vitreo doctor", "vitreo doctor --rig lab.lua"});
}

}  // namespace vitreo::cli
