// SPDX-License-Identifier: Apache-2.0
#include "host/cli/program.h"

#include "host/cli/command_line.h"
#include "host/lua/engine.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace vitreo::cli {

namespace fs = std::filesystem;

Program::Program() = default;
Program::~Program() = default;

ScriptEngine& Program::engine() {
  if (!engine_) engine_ = make_lua_engine({in_data_folder("scripts")});
  return *engine_;
}

std::string Program::in_data_folder(const std::string& below) {
  const char* given = std::getenv("VITREO_ROOT");
  const bool here = fs::exists("protocols") && fs::exists("scripts");
  const fs::path folder = given != nullptr ? given : here ? "." : VITREO_SOURCE_DIR;
  return (folder / below).lexically_normal().string();
}

std::string Program::protocol_file(const std::string& given) {
  if (fs::exists(given)) return given;
  const std::string by_name = in_data_folder("protocols/" + given + ".lua");
  return given.find('/') == std::string::npos && fs::exists(by_name) ? by_name : given;
}

std::vector<std::string> Program::protocol_files() {
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(in_data_folder("protocols")))
    if (entry.path().extension() == ".lua") files.push_back(entry.path().lexically_normal().string());
  std::sort(files.begin(), files.end());
  return files;
}

void add_run_options(Command& command, RunOptions& options) {
  command.option("--rig", options.request.rig_file, "rig file (default: scripts/rigs/simulated.lua)");
  command.option("--seed", options.request.seed, "of everything that is drawn by chance (default: 1)");
  command.option("--out", options.request.out, "folder for the run's folder (default: runs)");
  command.option("--operator", options.request.operator_name, "who runs it, for the record");
  command
      .option("--fault", options.request.faults,
              "breaks a simulated instrument: ROLE:KIND:after=3s,lasting=1s,by=80ms; `vitreo faults` lists the kinds")
      .one_word_each();
  command.flag("--real-time", options.real_time, "pace a simulated rig to the wall clock");
  command
      .option("--frames", options.request.frames,
              "cameras whose frames are recorded: top_camera, side_camera/5 (each fifth), top_camera@96 (a window of\n"
              "96 px about the robot), top_camera~10 (only 10 s around events)")
      .delimiter(',');
}

RunRequest& RunOptions::complete() {
  request.control_socket = true;
  if (request.rig_file.empty()) request.rig_file = Program::in_data_folder("scripts/rigs/simulated.lua");
  if (real_time) request.pace = Pace::real_time;
  return request;
}

}  // namespace vitreo::cli
