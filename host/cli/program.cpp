// SPDX-License-Identifier: Apache-2.0
#include "host/cli/program.h"

#include "host/cli/command_line.h"
#include "host/config/config.h"
#include "host/lua/engine/engine.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <unistd.h>

namespace vitreo::cli {

namespace fs = std::filesystem;

Program::Program() = default;
Program::~Program() = default;

ScriptEngine& Program::engine() {
  if (!engine_)
    engine_ = make_lua_engine({in_data_folder("scripts")}, {in_data_folder("protocols")});
  return *engine_;
}

// VITREO_ROOT wins over all, for tests and for several checkouts. Beside the program ("../share")
// is found through /proc/self/exe, so that an installation can be moved. VITREO_SOURCE_DIR last: it
// makes a fresh build usable without an installation.
std::string Program::in_data_folder(const std::string& below) {
  const char* given = std::getenv("VITREO_ROOT");
  std::error_code error;
  const bool here = fs::exists("protocols", error) && fs::exists("scripts", error);
  const fs::path installed =
      fs::read_symlink("/proc/self/exe", error).parent_path() / "../share/vitreo";
  fs::path folder = given != nullptr                           ? given
                    : here                                     ? "."
                    : fs::exists(installed / "scripts", error) ? installed
                                                               : VITREO_SOURCE_DIR;
  // Docs and templates are the program's own, also where the present folder has protocols.
  if (given == nullptr && here && !fs::exists(folder / below, error) &&
      !below.starts_with("protocols") && !below.starts_with("scripts"))
    folder = fs::exists(installed / "scripts", error) ? installed : fs::path(VITREO_SOURCE_DIR);
  return (folder / below).lexically_normal().string();
}

namespace {

std::vector<std::string> lua_files(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;  // no such folder: no files
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".lua")
      files.push_back(entry.path().lexically_normal().string());
  std::sort(files.begin(), files.end());
  return files;
}

/// A file as given (a folder may have its name), or NAME.lua in `folder`. What looks like a path
/// and is none is returned as it is: opening it fails with the system's reason.
std::string file_or_name(const std::string& given, const std::string& folder,
                         const std::string& kind, const std::string& read_on) {
  if (fs::exists(given) && !fs::is_directory(given)) return given;
  if (given.find('/') != std::string::npos || given.ends_with(".lua")) return given;
  const std::string by_name = folder + "/" + given + ".lua";
  if (fs::exists(by_name)) return by_name;
  std::vector<std::string> names;
  for (const std::string& file : lua_files(folder)) names.push_back(fs::path(file).stem().string());
  // One that stands beside is given with its ending: a name alone is of the installed ones.
  const std::string near = fs::exists(given + ".lua") ? given + ".lua" : nearest(given, names);
  throw ConfigError("there is no " + kind + " '" + given + "', and no file of that name" +
                    (near.empty() ? read_on : "; did you mean " + near + "?"));
}

/// Before anything is opened: a run's folder can be made there.
/// The nearest folder above that exists decides: the missing ones below it are made with the run.
/// Only a courtesy: the rights may change until then, and open_record() reports that as well.
void check_writable(const std::string& out) {
  fs::path folder = fs::absolute(out).lexically_normal();
  std::error_code error;
  while (folder.has_relative_path() && !fs::exists(folder, error)) folder = folder.parent_path();
  if (!fs::is_directory(folder, error))
    throw ConfigError("--out " + out + ": " + folder.string() + " is no folder");
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    throw ConfigError("--out " + out + ": " + folder.string() + ": " + std::strerror(errno));
}

}  // namespace

std::string Program::protocol_file(const std::string& given) {
  return file_or_name(given, in_data_folder("protocols"), "protocol", "; vitreo list names them");
}

std::string Program::rig_file(const std::string& given) {
  const std::string folder = in_data_folder("scripts/rigs");
  return file_or_name(given, folder, "rig", "; they are in " + folder);
}

std::vector<std::string> Program::protocol_files() {
  return lua_files(in_data_folder("protocols"));
}

std::vector<std::string> Program::rig_files() { return lua_files(in_data_folder("scripts/rigs")); }

// The same list as in docs/conventions.md; ExitCode (host/engine/run_result.h) has the numbers.
std::string exit_codes_text() {
  return "0  completed\n"
         "1  the script failed, or a statement of a piped prompt\n"
         "2  usage: unknown protocol, parameter out of range, error in a rig file; nothing was "
         "opened\n"
         "3  stopped, by the operator or by the script\n"
         "4  aborted: by the operator, because a device failed, or because the interlock tripped\n"
         "5  internal error, or the standard output could not be written\n"
         "6  the script did not respond to an abort: the devices are safe, the record is closed\n"
         "7  an instrument is missing\n"
         "8  the preflight failed: nothing was opened (vitreo check; vitreo run on a laboratory "
         "rig); vitreo doctor: something must be mended\n";
}

// Shared by `run`, `view`, `test` and the prompt, so that one option has one meaning and one text.
void add_run_options(Command& command, RunOptions& options) {
  command.option("--rig", options.request.where.rig_file,
                 "a rig's file or name (default: the protocol's own, else simulated)");
  command.option("--seed", options.request.how.seed,
                 "of everything that is drawn by chance (default: 1)");
  command.option("--out", options.request.where.out, "folder for the run's folder (default: runs)");
  command.option("--operator", options.request.how.operator_name, "who runs it, for the record");
  command
      .option("--fault", options.request.how.faults,
              "breaks a simulated instrument: ROLE:KIND:after=3s,lasting=1s,by=80ms; `vitreo "
              "faults` lists the kinds")
      .one_word_each();
  command
      .option("--tag", options.request.what.tags,
              "key=value, for the record: vitreo runs --where finds the run by it")
      .one_word_each();
  command
      .option("--sample", options.request.what.sample,
              "what is known of the sample: eye=, species=, age=, died=, removed=2026-11-24T08:10, "
              "pipette=, light=, robot=")
      .one_word_each();
  command.flag("--trace-links", options.request.how.trace_links,
               "every byte between the host and its instruments goes into the record: vitreo show "
               "RUN --links");
  command
      .option("--frames", options.request.what.frames,
              "cameras whose frames are recorded: top_camera, side_camera/5 (each fifth), "
              "top_camera@96 (a window of\n"
              "96 px about the robot), top_camera~10 (only 10 s around events)")
      .one_word_each()
      .delimiter(',');
}

void add_view_options(Command& command, RunOptions& options) {
  command.flag("--real-time", options.real_time, "pace a simulated rig to the wall clock");
  command.flag("--view", options.view.on,
               "a page in the browser shows the run; its address is printed");
  command.option("--view-port", options.view_port, "the page's port (default: one that is free)")
      .between(0, 65535);
  command.flag("--foxglove", options.foxglove.on,
               "Foxglove or Lichtblick shows the run, at the address that is printed");
  command.option("--foxglove-port", options.foxglove_port, "its port (default: 8765)")
      .between(0, 65535);
  command.option("--listen", options.view.address,
                 "an IP address of this machine at which page and Foxglove are served (default: "
                 "127.0.0.1, this machine alone)");
  command.option(
      "--token-file", options.token_file,
      "a file for you alone (0600; made where there is none) whose token lets browsers in");
}

// The protocol's file first: the default of the rig is asked from the protocol.
RunRequest& ProtocolOptions::complete(Program& program) {
  request.what.protocol_file = Program::protocol_file(protocol);
  return RunOptions::complete(program);
}

// In the order of the defaults: what was given, the protocol's own rig, the simulated one.
// Everything about files and addresses is refused here, before an instrument is opened.
RunRequest& RunOptions::complete(Program& program) {
  if (request.where.rig_file.empty() && !request.what.protocol_file.empty())
    request.where.rig_file = program.engine().describe(request.what.protocol_file).rig;
  request.where.rig_file =
      Program::rig_file(request.where.rig_file.empty() ? "simulated" : request.where.rig_file);
  check_writable(request.where.out);
  view.port = static_cast<unsigned short>(view_port);
  view.token_file = token_file;
  // An option that would be read and ignored is refused: a user who writes --listen expects a page.
  if (!view.on && !foxglove.on &&
      (view.address != view::ViewRequest().address || !token_file.empty()))
    throw ConfigError(
        "--listen, --token-file: are about the page, which wants --view, or about --foxglove");
  if (!foxglove.on && foxglove_port != view::kFoxglovePort)
    throw ConfigError("--foxglove-port: wants --foxglove");
  foxglove = {foxglove.on, view.address, static_cast<unsigned short>(foxglove_port),
              view.token_file};
  view::check(view);
  if (!token_file.empty()) view::shared_token(token_file);  // before anything is opened
  if (real_time) request.how.pace = Pace::real_time;
  return request;
}

}  // namespace vitreo::cli
