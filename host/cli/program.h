// Program: what its commands share, such as where its files are, and the script engine.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"
#include "host/view/admission.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::cli {

class CommandLine;
class Command;

class Program {
 public:
  Program();
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Made at the first call: commands without a script start faster.
  ScriptEngine& engine();

  /// A path below protocols/, scripts/, docs/ or templates/: in VITREO_ROOT, else here where both
  /// protocols/ and scripts/ are, else beside the installed program (../share/vitreo), else where
  /// the program was built.
  static std::string in_data_folder(const std::string& below);
  /// The value of `--rig`: a file, or the name of one in scripts/rigs/. Throws ConfigError when it
  /// can be neither.
  static std::string rig_file(const std::string& given);
  /// A path as given, or a protocol's bare name. Throws ConfigError when it can be neither.
  static std::string protocol_file(const std::string& given);
  static std::vector<std::string> protocol_files();
  static std::vector<std::string> rig_files();

 private:
  std::unique_ptr<ScriptEngine> engine_;
};

/// The options of everything that opens a rig and records: --rig, --seed, --out, --frames, ...
struct RunOptions {
  RunRequest request;
  view::ViewRequest view;      // a page in the browser that shows the run
  view::ViewRequest foxglove;  // its topics for Foxglove; address and token as of the page
  bool real_time = false;
  int view_port = 0;
  int foxglove_port = view::kFoxglovePort;
  std::string token_file;
  /// With the defaults that depend on where the program is, and on the protocol: its own rig.
  /// Throws ScriptError when that cannot be read, ConfigError for what cannot be.
  RunRequest& complete(Program& program);
};
void add_run_options(Command& command, RunOptions& options);
/// For runs that can be watched: --real-time, --view, ...
void add_view_options(Command& command, RunOptions& options);

/// The words of a command that runs a protocol.
struct ProtocolOptions : RunOptions {
  std::string protocol;  // as given: a file or a name
  bool json = false;
  /// As RunOptions', with the protocol's file. Throws ConfigError where there is none.
  RunRequest& complete(Program& program);
};

// One for each row of main.cpp, in a file of its name.
void add_run(CommandLine& line, Program& program);  // and the prompt: without a command
void add_check(CommandLine& line, Program& program);
void add_compare(CommandLine& line, Program& program);
void add_control(CommandLine& line, Program& program);
void add_describe(CommandLine& line, Program& program);
void add_devices(CommandLine& line, Program& program);
void add_doctor(CommandLine& line, Program& program);
void add_faults(CommandLine& line, Program& program);
void add_mask(CommandLine& line, Program& program);
void add_soak(CommandLine& line, Program& program);
void add_sweep(CommandLine& line, Program& program);
void add_serve(CommandLine& line, Program& program);
void add_reproduce(CommandLine& line, Program& program);
void add_test(CommandLine& line, Program& program);
void add_records(CommandLine& line, Program& program);
void add_attach(CommandLine& line, Program& program);
void add_completion(CommandLine& line, Program& program);
void add_docs(CommandLine& line, Program& program);
void add_new(CommandLine& line, Program& program);

/// The text of `vitreo describe`.
/// `word`: the protocol as it was typed.
std::string describe_text(const ProtocolDescription& protocol, const std::string& word);
/// The pages of `vitreo docs`.
std::vector<std::string> page_names();
/// The program's exit codes, one a line.
std::string exit_codes_text();

}  // namespace vitreo::cli
