// The program: its command line joins the host and Lua.
// SPDX-License-Identifier: Apache-2.0
#include "devices/error.h"
#include "host/commands.h"
#include "host/control_socket.h"
#include "host/emulate.h"
#include "host/instruments.h"
#include "host/lua/engine.h"
#include "host/mask_command.h"
#include "host/progress_line.h"
#include "host/run_engine.h"
#include "host/run_reader.h"
#include "host/units.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <optional>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Where protocols/ and scripts/ are: here, else where the program was built.
fs::path data_folder() {
  if (const char* given = std::getenv("VITREO_ROOT")) return given;
  return fs::exists("protocols") && fs::exists("scripts") ? fs::path(".") : fs::path(VITREO_SOURCE_DIR);
}

std::string in_data_folder(const fs::path& below) { return (data_folder() / below).lexically_normal().string(); }

/// A path as given, or a protocol's bare name.
std::string protocol_file(const std::string& given) {
  if (fs::exists(given)) return given;
  const std::string by_name = in_data_folder(fs::path("protocols") / (given + ".lua"));
  return given.find('/') == std::string::npos && fs::exists(by_name) ? by_name : given;
}

std::vector<std::string> protocol_files() {
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(in_data_folder("protocols")))
    if (entry.path().extension() == ".lua") files.push_back(entry.path().lexically_normal().string());
  std::sort(files.begin(), files.end());
  return files;
}

std::string value_text(const ArgumentValue& value, const std::string& unit) {
  if (const bool* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const std::string* text = std::get_if<std::string>(&value)) return *text;
  const auto known = find_unit(unit);
  return format_quantity(std::get<double>(value), known ? std::string(known->dimension) : unit);
}

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
  return {{"name", protocol.name},   {"file", protocol.file},   {"title", protocol.title},
          {"about", protocol.about}, {"needs", protocol.needs}, {"parameters", parameters}};
}

std::string range_text(const Parameter& p) {
  if (!p.choices.empty()) return fmt::format("one of {}", fmt::join(p.choices, ", "));
  if (!std::isfinite(p.min) && !std::isfinite(p.max)) return "";
  if (!std::isfinite(p.max)) return "at least " + value_text(p.min, p.unit);
  if (!std::isfinite(p.min)) return "at most " + value_text(p.max, p.unit);
  return value_text(p.min, p.unit) + " to " + value_text(p.max, p.unit);
}

void describe(const ProtocolDescription& protocol, bool json) {
  if (json) {
    std::cout << describe_json(protocol).dump() << "\n";
    return;
  }
  fmt::print("{}: {}\n{}needs: {}\n", protocol.name, protocol.title,
             protocol.about.empty() ? "" : protocol.about + "\n", fmt::join(protocol.needs, ", "));
  for (const Parameter& p : protocol.parameters) {
    const std::string range = range_text(p);
    fmt::print("  {:<14} {:<12} {}{}{}\n", p.name, p.required ? "(needed)" : value_text(p.fallback, p.unit), p.help,
               range.empty() || p.help.empty() ? "" : "; ", range);
  }
}

void list(ScriptEngine& engine, bool json) {
  nlohmann::json rows = nlohmann::json::array();
  for (const std::string& file : protocol_files()) {
    try {
      const ProtocolDescription protocol = engine.describe(file);
      if (json)
        rows.push_back({{"name", protocol.name}, {"file", file}, {"title", protocol.title}});
      else
        fmt::print("{:<20} {}\n", protocol.name, protocol.title);
    } catch (const ScriptError& error) {
      if (json)
        rows.push_back({{"file", file}, {"error", error.what()}});
      else
        fmt::print("{:<20} does not load: {}\n", fs::path(file).stem().string(), error.what());
    }
  }
  if (json) std::cout << rows.dump() << "\n";
}

void show(const RunResult& result, bool json) {
  if (json) {
    std::cout << to_json(result).dump() << "\n";
    return;
  }
  for (const Figure& figure : result.figures)
    fmt::print("{:<28} {}\n", figure.name, format_quantity(figure.value, figure.unit));
  fmt::print("{}{}{}\nrun: {}\nreport: {}\n", to_string(result.outcome), result.reason.empty() ? "" : ": ",
             result.reason, result.folder, (fs::path(result.folder) / "report.html").string());
}

struct Options {
  RunRequest request;
  std::string protocol;
  bool json = false, real_time = false;
  std::string word, text, run_name;  // of the control command
};

void add_run_options(CLI::App& app, Options& options) {
  app.add_option("--rig", options.request.rig_file, "rig file (default: scripts/rigs/simulated.lua)");
  app.add_option("--seed", options.request.seed, "of everything that is drawn by chance (default: 1)");
  app.add_option("--out", options.request.out, "folder for the run's folder (default: runs)");
  app.add_option("--operator", options.request.operator_name, "who runs it, for the record");
  app.add_flag("--real-time", options.real_time, "pace a simulated rig to the wall clock");
  app.add_option("--frames", options.request.frames,
                 "cameras whose frames are recorded: top_camera, side_camera/5 (each fifth)")
      ->delimiter(',');
}

/// The commands about recorded runs; docs/records.md tells what they are for.
struct RecordCommands {
  CLI::App *runs = nullptr, *show = nullptr, *verify = nullptr, *recover = nullptr, *report = nullptr,
           *export_ = nullptr, *replay = nullptr;
  std::string run = "last", parent = "runs", into, format, csv;
  RunFilter filter;
  bool json = false;

  CLI::App* add(CLI::App& app, const std::string& name, const std::string& help) {
    CLI::App* command = app.add_subcommand(name, help);
    command->add_option("--runs", parent, "the folder in which the runs are (default: runs)");
    command->add_flag("--json", json, "one JSON document, SI units");
    return command;
  }
  CLI::App* add_one(CLI::App& app, const std::string& name, const std::string& help) {
    CLI::App* command = add(app, name, help);
    command->add_option("run", run, "a run's folder, its name or the beginning of it, or last")->required();
    return command;
  }
  void add_to(CLI::App& app);
  std::optional<int> dispatch(ScriptEngine& engine, std::ostream& out) const;
};

void RecordCommands::add_to(CLI::App& app) {
  runs = add(app, "runs", "the recorded runs, newest last");
  runs->add_option("--protocol", filter.protocol, "only those with this in protocol or title");
  runs->add_option("--operator", filter.operator_name, "only those with this in the operator's name");
  runs->add_option("--outcome", filter.state, "only completed, failed, stopped, aborted, lost, running or unreadable");
  runs->add_option("--since", filter.since, "only from this time on: 2026-11-21, 2026-11-21T14:30");
  runs->add_option("--newest", filter.newest, "only so many")->check(CLI::Range(1, 1000000));
  show = add_one(app, "show", "what a run was asked, what came out, what is recorded");
  verify = add_one(app, "verify", "whether a run's record is whole: hashes, counts, every frame");
  recover = add_one(app, "recover", "ends the record of a run whose program died");
  report = add_one(app, "report", "makes a run's report anew from its record");
  export_ = add_one(app, "export", "a run in the format of other programs");
  replay = add_one(app, "replay", "the recorded frames through today's tracker and localiser");
  replay->add_option("--csv", csv, "a file for the differences frame by frame");
  export_->add_option("--into", into, "a folder (default: export/ in the run's own)");
  CLI::Option_group* formats = export_->add_option_group("format");
  for (const std::string name : {"csv", "mcap", "tiff", "mkv", "hdf5"})
    formats->add_flag_function(
        "--" + name, [this, name](std::int64_t) { format = name; }, "as " + name);
  formats->require_option(1);
}

std::optional<int> RecordCommands::dispatch(ScriptEngine& engine, std::ostream& out) const {
  if (runs->parsed()) return list_runs(parent, filter, json, out);
  const auto folder = [this] { return find_run(run, parent); };
  if (show->parsed()) return show_run(folder(), json, out);
  if (verify->parsed()) return verify_command(folder(), json, out);
  if (recover->parsed()) return recover_command(folder(), json, out);
  if (report->parsed()) return report_command(folder(), json, out);
  if (export_->parsed()) return export_command(folder(), format, into, json, out);
  if (replay->parsed()) return replay_command(engine, folder(), csv, json, out);
  return {};
}

int run(ScriptEngine& engine, Options& options) {
  options.request.protocol_file = protocol_file(options.protocol);
  ProgressLine progress(std::cerr, isatty(STDERR_FILENO) != 0);
  const RunResult result = run_protocol(engine, options.request, progress);
  progress.clear();
  show(result, options.json);
  return static_cast<int>(result.exit_code);
}

int control(const Options& options) {
  nlohmann::json request = {{"do", options.word}};
  if (options.word == "answer") request["text"] = options.text;
  if (options.word == "pause" && !options.text.empty()) request["at"] = options.text;
  const nlohmann::json reply = control_run(options.run_name, request);
  if (options.json)
    std::cout << reply.dump() << "\n";
  else if (reply["ok"])
    fmt::print("{}\n", reply["status"]["text"].get<std::string>());
  else
    fmt::print(stderr, "vitreo: {}\n", reply["error"].get<std::string>());
  return reply["ok"] ? 0 : static_cast<int>(ExitCode::usage);
}

int prompt(ScriptEngine& engine, Options& options) {
  const bool interactive = isatty(STDIN_FILENO) != 0;
  if (interactive) options.request.pace = Pace::real_time;
  ProgressLine progress(std::cerr, interactive);
  const RunResult result = run_prompt(engine, options.request, progress, std::cin, std::cout, interactive);
  if (interactive) fmt::print("run: {}\n", result.folder);
  return static_cast<int>(result.exit_code);
}

/// The options of `vitreo mask`.
CLI::App* add_mask_command(CLI::App& app, MaskRequest& request) {
  CLI::App* command = app.add_subcommand(
      "mask",
      "masks of an object, to train a tracker with: NAME_mask.png, and overlays/NAME.png to look at. The outline is\n"
      "the object's in the first image; it is looked for in the others. For instance\n"
      "  vitreo mask frames/*.png --ellipse 320,240,60,30,15 --grab --out training");
  command->add_option("images", request.images, "of one size")->required();
  command->add_option("--ellipse", request.ellipses, "cx,cy,A,B,phi: full axes in px, degrees from right to down")
      ->allow_extra_args(false);
  command->add_option("--polygon", request.polygons, "x,y,x,y,x,y...: its corners")->allow_extra_args(false);
  command->add_flag("--grab", request.grab, "the outline is rough: cut by colour around it");
  command->add_option("--on", request.on, "x,y: surely on the object (with --grab)")->allow_extra_args(false);
  command->add_option("--off", request.off, "x,y: surely not on it (with --grab)")->allow_extra_args(false);
  command->add_option("--margin", request.margin_px, "px by which a rough outline may be wrong (6)");
  command->add_option("--out", request.out, "folder; the images are copied there too, as a training folder");
  command->add_flag("--force", request.force, "write over masks that are there");
  return command;
}

int mask(const MaskRequest& request) {
  try {
    return make_masks(request, std::cout) == 0 ? 0 : 1;
  } catch (const std::invalid_argument& error) {  // all of them name an option or a file of the user's
    throw ConfigError(std::string("mask: ") + error.what());
  }
}

struct DevicesOptions {
  std::string rig, test;
  std::vector<std::string> command;
  bool json = false;
};

int devices(ScriptEngine& engine, const DevicesOptions& options) {
  if (!options.test.empty()) {
    const std::vector<std::string> findings = test_instrument(engine.load_rig(options.rig), options.test);
    for (const std::string& finding : findings) fmt::print("{}: {}\n", options.test, finding);
    if (findings.empty()) fmt::print("{}: keeps its contract\n", options.test);
    return findings.empty() ? 0 : static_cast<int>(ExitCode::aborted);
  }
  const nlohmann::json rows = options.rig.empty() ? find_instruments() : examine_rig(engine.load_rig(options.rig));
  fmt::print("{}", options.json ? rows.dump() + "\n" : to_text(rows));
  return 0;
}

int dispatch(int count, char** words) {
  CLI::App app{
      "Vitreo drives the instruments of a laboratory that steers microrobots inside the eye.\n"
      "Without a command: a Lua prompt on the rig.\n\n"
      "examples:\n  vitreo run servo_square speed=0.5mm/s --seed 7\n  vitreo describe servo_square\n"
      "  echo 'print(rig.top_camera:info().identity)' | vitreo\n",
      "vitreo"};
  Options options;
  add_run_options(app, options);
  CLI::App* run_command = app.add_subcommand("run", "run a protocol");
  add_run_options(*run_command, options);
  run_command->add_option("protocol", options.protocol, "a protocol's file or name")->required();
  run_command->add_option("arguments", options.request.arguments, "name=value, with units: speed=0.5mm/s");
  run_command->add_flag("--json", options.json, "one JSON object on the standard output at the end, SI units");
  run_command->add_option("--answer", options.request.answers,
                          "answers a question of the script in advance: name=value, or value in their order");
  CLI::App* control_command = app.add_subcommand("control", "speaks to a run that is going on");
  control_command->add_option("word", options.word, "status, pause, resume, stop, abort, emergency or answer")
      ->required();
  control_command->add_option("text", options.text, "the answer, or the checkpoint at which to pause");
  control_command->add_option("--run", options.run_name,
                              "the run's name, or its beginning, where several are going on");
  control_command->add_flag("--json", options.json, "the reply as JSON");
  CLI::App* list_command = app.add_subcommand("list", "the protocols there are");
  list_command->add_flag("--json", options.json, "as JSON");
  CLI::App* describe_command = app.add_subcommand("describe", "what a protocol does and which parameters it takes");
  describe_command->add_option("protocol", options.protocol, "a protocol's file or name")->required();
  describe_command->add_flag("--json", options.json, "as JSON, SI units");
  MaskRequest wanted_mask;
  const CLI::App* mask_command = add_mask_command(app, wanted_mask);
  RecordCommands records;
  records.add_to(app);
  DevicesOptions instruments;
  CLI::App* devices_command = app.add_subcommand("devices", "what is plugged in, and which driver would take it");
  devices_command->add_option("--rig", instruments.rig, "open this rig file instead, and show each role");
  devices_command
      ->add_option("--test", instruments.test, "a role: run its contract suite (it moves, it drives currents!)")
      ->needs("--rig");
  devices_command->add_flag("--json", instruments.json, "as JSON, SI units");
  CLI::App* emulate_command = app.add_subcommand("emulate", "run a command among a rig's emulated instruments");
  emulate_command->add_option("rig", instruments.rig, "rig file")->required();
  emulate_command->add_option("command", instruments.command, "after --: the command and its arguments");
  app.set_version_flag("--version", [] { return versions().dump(); });
  try {
    app.parse(count, words);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  if (mask_command->parsed()) return mask(wanted_mask);
  if (control_command->parsed()) return control(options);
  options.request.control_socket = true;
  if (options.request.rig_file.empty()) options.request.rig_file = in_data_folder("scripts/rigs/simulated.lua");
  if (options.real_time) options.request.pace = Pace::real_time;
  const auto engine = make_lua_engine({in_data_folder("scripts")});
  if (const auto code = records.dispatch(*engine, std::cout)) return *code;
  if (run_command->parsed()) return run(*engine, options);
  if (list_command->parsed()) return list(*engine, options.json), 0;
  if (describe_command->parsed()) return describe(engine->describe(protocol_file(options.protocol)), options.json), 0;
  if (devices_command->parsed()) return devices(*engine, instruments);
  if (emulate_command->parsed()) {
    restart_in_testbed(words);
    return emulate(engine->load_rig(instruments.rig), instruments.command);
  }
  return prompt(*engine, options);
}

}  // namespace
}  // namespace vitreo

int main(int count, char** words) {
  using vitreo::ExitCode;
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error that can be told
  cv::setNumThreads(1);           // the same bytes on every run; and the loop owns its core
  const auto fail = [](const std::exception& error, ExitCode code) {
    std::cerr << "vitreo: " << error.what() << "\n";
    return static_cast<int>(code);
  };
  try {
    return vitreo::dispatch(count, words);
  } catch (const vitreo::ScriptError& error) {
    return fail(error, ExitCode::usage);
  } catch (const vitreo::ConfigError& error) {
    return fail(error, ExitCode::usage);
  } catch (const vitreo::RecordError& error) {
    return fail(error, ExitCode::usage);
  } catch (const vitreo::DeviceError& error) {
    return fail(error, ExitCode::device_missing);
  } catch (const std::exception& error) {
    return fail(error, ExitCode::internal);
  }
}
