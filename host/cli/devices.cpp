// `vitreo devices` and `vitreo emulate`: the instruments, real and emulated.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/engine/run_result.h"
#include "host/record/record_json.h"
#include "host/rig/asking.h"
#include "host/rig/emulate.h"
#include "host/rig/instruments.h"
#include "host/rig/plugged_in.h"
#include "host/rig/testbed_process.h"
#include "host/rig/truth_file.h"
#include "host/view/technician.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo::cli {
namespace {

struct DeviceWords {
  std::string rig;
  std::string test;
  std::string ask;
  std::vector<std::string> command;
  bool json = false;
  std::uint64_t seed = 1;
  std::string truth;
  std::vector<std::string> faults;
};

// The contract suite of the role (devices/contract) against the instrument as it is connected. It
// moves and energizes, which is why it has a flag of its own and wants the rig to be named. 4: an
// instrument did not do what it must.
int test_role(Program& program, const DeviceWords& wanted) {
  const std::vector<std::string> findings =
      test_instrument(program.engine().load_rig(Program::rig_file(wanted.rig)), wanted.test);
  if (wanted.json) {
    const nlohmann::json row{
        {"role", wanted.test}, {"passed", findings.empty()}, {"findings", findings}};
    fmt::print("{}\n", dumped(row));
  } else {
    for (const std::string& finding : findings) fmt::print("{}: {}\n", wanted.test, finding);
    if (findings.empty()) fmt::print("{}: keeps its contract\n", wanted.test);
  }
  return findings.empty() ? 0 : static_cast<int>(ExitCode::aborted);
}

/// What is sent is shown before it is sent; 7: nothing that a driver knows.
int ask_what_is_there(const DeviceWords& wanted) {
  if (!wanted.rig.empty()) throw ConfigError("--ask is for an address, and not for a rig");
  const auto clock = wall_clock();
  const auto before = [](const AskingPlan& plan) { fmt::print(stderr, "{}", to_text(plan)); };
  const auto tell = [](const std::string& line) { fmt::print(stderr, "{}\n", line); };
  const AskingResult result = ask_address(wanted.ask, *clock, before, tell,
                                          asked_files({Program::in_data_folder("scripts")}));
  fmt::print("{}", wanted.json ? dumped(to_json(result)) + "\n" : to_text(result));
  return static_cast<int>(result.found.empty() ? ExitCode::device_missing : ExitCode::completed);
}

/// Null where none is wanted.
std::unique_ptr<TruthFile> truth_of(Emulation& emulation, const DeviceWords& wanted) {
  if (wanted.truth.empty()) return nullptr;
  return std::make_unique<TruthFile>(wanted.truth, emulation);
}

/// The emulated laboratory, for a command, whose runs find a technician there, or until Ctrl-C.
int emulate(const RigDescription& rig, const DeviceWords& wanted) {
  if (wanted.command.empty()) {
    const EndingSignals ending;
    Emulation emulation(rig, {.seed = wanted.seed, .faults = wanted.faults});
    const auto truth = truth_of(emulation, wanted);
    fmt::print(stderr, "press Ctrl-C to end\n");
    ending.wait();
    if (truth) truth->finish();
    return 0;
  }
  Emulation emulation(rig, {.seed = wanted.seed, .in_place = true, .faults = wanted.faults});
  const auto truth = truth_of(emulation, wanted);
  const Technician technician([&emulation](const nlohmann::json& task) { emulation.handle(task); });
  const int exit_code = run_among(wanted.command);
  if (truth) truth->finish();
  return exit_code;
}

// Without a rig the buses are listed, and no port is asked anything: a question could move
// something. With one, each role is opened by the driver that the rig file names; the exit code
// says whether all are there.
int devices(Program& program, const DeviceWords& wanted) {
  if (!wanted.ask.empty()) return ask_what_is_there(wanted);
  if (!wanted.test.empty()) return test_role(program, wanted);
  const nlohmann::json rows =
      wanted.rig.empty() ? find_instruments()
                         : examine_rig(program.engine().load_rig(Program::rig_file(wanted.rig)));
  fmt::print("{}", wanted.json ? dumped(rows) + "\n" : to_text(rows));
  const auto is_missing = [](const nlohmann::json& row) { return !row.value("present", true); };
  return std::any_of(rows.begin(), rows.end(), is_missing)
             ? static_cast<int>(ExitCode::device_missing)
             : 0;
}

}  // namespace

void add_devices(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<DeviceWords>();
  Command command = line.command("devices", "what is plugged in, and which driver would take it",
                                 [&program, wanted] { return devices(program, *wanted); });
  command.option("--rig", wanted->rig,
                 "open this rig instead (a file or a name), and show each role");
  command
      .option("--test", wanted->test,
              "a role: run its contract suite (it moves, it drives currents!)")
      .needs("--rig");
  command.option(
      "--ask", wanted->ask,
      "an address: ask what is there, and print its table for a rig file; what is sent is "
      "shown before, and moves nothing (it stops an MP-285 that moves)");
  command.flag("--json", wanted->json, "as JSON, SI units");
  command.examples({"vitreo devices", "vitreo devices --ask /dev/ttyUSB0",
                    "vitreo devices --rig lab.lua", "vitreo devices --rig lab.lua --test stage"});

  // A command sees emulated USB only from within umockdev-wrapper, so the program starts itself
  // anew.
  // umockdev works by a preloaded library, and that must be there when a process starts. The
  // process that restart_in_testbed() starts gets the same words and runs through here again,
  // inside the testbed.
  const auto emulation = [&program, &line, wanted] {
    if (!wanted->command.empty()) restart_in_testbed(line.words());
    return emulate(program.engine().load_rig(Program::rig_file(wanted->rig)), *wanted);
  };
  Command emulated = line.command(
      "emulate", "offer a rig's emulated instruments, or run a command among them", emulation);
  emulated.option("rig", wanted->rig, "a rig's file or name").required();
  emulated.option("--seed", wanted->seed, "of the machine and its noise, as a run's (default: 1)");
  emulated
      .option("--fault", wanted->faults,
              "breaks an instrument: ROLE:KIND:after=3s,lasting=1s,by=80ms, counted from the "
              "command's first\nword to an instrument; `vitreo faults --emulated` lists the kinds")
      .one_word_each();
  emulated.option("--truth", wanted->truth,
                  "a new CSV file: where the robot really is and what flows, every 20 ms");
  emulated.option("command", wanted->command, "after --: the command and its arguments");
  emulated.examples({"vitreo emulate octomag_lab -- vitreo devices",
                     "vitreo emulate octomag_lab --truth truth.csv -- vitreo run servo_square "
                     "--rig octomag_lab"});
}

}  // namespace vitreo::cli
