// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_plan.h"

#include "devices/time/error.h"
#include "host/config/config.h"
#include "host/engine/installed_calibration.h"
#include "host/engine/preparation.h"
#include "host/engine/request_check.h"
#include "host/engine/run_engine.h"
#include "host/engine/versions.h"
#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/rig/calibrations.h"
#include "host/text/units.h"
#include "host/trials/silent_listener.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Of all texts of which the rig is made.
std::string digest_of(const RigDescription& rig) {
  Sha256 digest;
  digest.update(rig.text);
  for (const RigSource& base : rig.bases) digest.update(base.text);
  return digest.hex();
}

/// Of the calibration in force, after take_installed_calibration(); empty: none is installed.
std::string calibration_digest(const RigDescription& rig) {
  const Calibrations calibrations = Calibrations::of(rig);
  if (!calibrations.installed || !fs::exists(calibrations.installed->file)) return "";
  return sha256(read_whole_file(calibrations.installed->file));
}

/// Absolute; empty: that of each run's own folder.
std::string calibrated_in(const RunRequest& run) {
  const std::string& runs = run.where.calibrated_in;
  return runs.empty() ? "" : fs::absolute(runs).lexically_normal().string();
}

/// Numbers keep every digit in JSON (shortest decimals that read back as the same doubles).
nlohmann::json value_json(const ArgumentValue& value) {
  return std::visit([](const auto& held) { return nlohmann::json(held); }, value);
}

/// The inverse; a number is always a double, as arguments are.
ArgumentValue value_from(const nlohmann::json& json) {
  if (json.is_boolean()) return json.get<bool>();
  if (json.is_number()) return json.get<double>();
  if (json.is_array()) return json.get<std::vector<double>>();
  return json.get<std::string>();
}

/// The words of `vitreo run` that make the same request.
/// Read again by the code of the command line, so that a point is what `vitreo run` does.
std::vector<std::string> argument_words(const ProtocolDescription& protocol,
                                        const nlohmann::json& values) {
  std::vector<std::string> words;
  for (const Parameter& parameter : protocol.parameters)
    if (values.contains(parameter.name))
      words.push_back(parameter.name + "=" +
                      argument_text(parameter, value_from(values[parameter.name])));
  return words;
}

/// What a table needs of the parameters that were given. One value: not varied.
nlohmann::json axes_json(const std::vector<SweepAxis>& axes) {
  nlohmann::json all = nlohmann::json::array();
  for (const SweepAxis& axis : axes) {
    nlohmann::json one = {{"name", axis.parameter.name},
                          {"unit", si_unit(axis.parameter.unit)},
                          {"declared_unit", axis.parameter.unit},
                          {"kind", to_string(axis.parameter.kind)},
                          {"varied", axis.drawn() || axis.values.size() > 1}};
    if (axis.drawn())
      one["drawn"] = {{"low", axis.low}, {"high", axis.high}, {"log", axis.logarithmic}};
    for (const ArgumentValue& value : axis.values) one["values"].push_back(value_json(value));
    all.push_back(one);
  }
  return all;
}

const char* word_of(SweepSeeds seeds) {
  return seeds == SweepSeeds::fresh ? "fresh" : seeds == SweepSeeds::paired ? "paired" : "same";
}

/// What all points have in common. Absolute paths: a task on another node starts elsewhere.
nlohmann::json head_of(const SweepRequest& request, const CheckedRequest& checked,
                       const std::vector<SweepAxis>& axes) {
  const RunRequest& run = request.run;
  return {{"kind", "sweep"},
          {"protocol",
           {{"file", fs::absolute(run.what.protocol_file).lexically_normal().string()},
            {"name", checked.protocol.name},
            {"title", checked.protocol.title},
            {"sha256", sha256(checked.protocol.text)}}},
          {"rig",
           {{"file", fs::absolute(run.where.rig_file).lexically_normal().string()},
            {"name", fs::path(run.where.rig_file).stem().string()},
            {"sha256", digest_of(checked.rig)}}},
          {"calibrated_in", calibrated_in(run)},
          {"calibration", calibration_digest(checked.rig)},
          {"axes", axes_json(axes)},
          {"repeats", request.repeats},
          {"seeds", word_of(request.seeds)},
          {"seed", run.how.seed},
          {"draws", request.draws.count},
          {"draw", request.draws.kind == Draw::latin ? "latin" : "random"},
          {"frames", run.what.frames},
          {"answers", run.what.answers},
          {"faults", run.how.faults},
          {"operator", operator_of(run)},
          {"versions", versions()},
          {"created", wall_time_text()}};
}

/// A slip of the keyboard is refused with the option that would allow it.
void check_bound(const SweepRequest& request, double points) {
  if (points <= static_cast<double>(request.most)) return;
  throw ConfigError(fmt::format(
      "sweep: that would be {:.0f} points, and at most {} are taken; where so many are meant: "
      "--most {:.0f}",
      points, request.most, points));
}

/// The request of the head, without arguments, seed and folder.
RunRequest request_of(const nlohmann::json& head) {
  RunRequest request;
  request.what.protocol_file = head.at("protocol").at("file").get<std::string>();
  request.where.rig_file = head.at("rig").at("file").get<std::string>();
  request.where.calibrated_in = head.value("calibrated_in", "");
  request.what.frames = head.at("frames").get<std::vector<std::string>>();
  request.what.answers = head.at("answers").get<std::vector<std::string>>();
  request.how.faults = head.at("faults").get<std::vector<std::string>>();
  request.how.operator_name = head.at("operator").get<std::string>();
  return request;
}

/// JSON has no NaN: a result without a number is null.
nlohmann::json results_json(const std::vector<StatedResult>& results) {
  nlohmann::json rows = nlohmann::json::array();
  for (const StatedResult& one : results)
    rows.push_back(
        {{"name", one.name},
         {"value", std::isfinite(one.value) ? nlohmann::json(one.value) : nlohmann::json()},
         {"unit", si_unit(one.unit)}});
  return rows;
}

/// An outcome of its own: nothing was opened, and there is no run.
nlohmann::json refused(const std::exception& error, ExitCode code) {
  return {{"outcome", "refused"}, {"exit_code", static_cast<int>(code)}, {"reason", error.what()}};
}

}  // namespace

std::uint64_t seed_of(const SweepRequest& request, std::size_t settings, std::size_t setting,
                      std::size_t repeat) {
  const std::uint64_t first = request.run.how.seed;
  if (request.seeds == SweepSeeds::same) return first;
  // Repeat by repeat through all settings: more repeats add seeds at the end.
  return request.seeds == SweepSeeds::paired ? first + repeat : first + repeat * settings + setting;
}

// Only the first setting is checked against the rig: what else a setting may be wrong about, the
// preflight of its run says, as the result of its point. The key leaves out the number of the
// setting, which changes when a value is added.
PointPlan plan_sweep(ScriptEngine& engine, const SweepRequest& request) {
  const ProtocolDescription protocol = engine.describe(request.run.what.protocol_file);
  const std::vector<SweepAxis> axes = read_axes(protocol, request.run.what.arguments);
  check_bound(request, count_settings(axes, request.draws) * request.repeats);
  const std::vector<SweepSetting> settings = make_settings(axes, request.draws);
  std::vector<nlohmann::json> values;
  for (const SweepSetting& setting : settings) {
    values.push_back(nlohmann::json::object());
    for (const auto& [name, value] : setting) values.back()[name] = value_json(value);
  }
  RunRequest first = request.run;
  first.what.arguments = argument_words(protocol, values.front());
  const CheckedRequest checked = check_request(engine, first);
  PointPlan plan{head_of(request, checked, axes), {}};
  for (std::size_t setting = 0; setting < settings.size(); ++setting)
    for (std::size_t repeat = 0; repeat < static_cast<std::size_t>(request.repeats); ++repeat) {
      const nlohmann::json what = {{"setting", setting},
                                   {"repeat", repeat + 1},
                                   {"seed", seed_of(request, settings.size(), setting, repeat)},
                                   {"values", values[setting]}};
      nlohmann::json all = what;
      all.erase("setting");
      // What else decides about the result, and so about the key. The operator does not.
      for (const char* key : {"frames", "answers", "faults"}) all[key] = plan.head[key];
      all["protocol"] = plan.head["protocol"]["sha256"];
      all["rig"] = plan.head["rig"]["sha256"];
      if (plan.head["calibration"] != "") all["calibration"] = plan.head["calibration"];
      plan.points.push_back({point_key(all), what});
    }
  return plan;
}

// The modules that the protocol requires are not compared: their texts are in each run's record.
void check_unchanged(ScriptEngine& engine, const nlohmann::json& head) {
  const RunRequest request = request_of(head);
  const auto check = [&head](const char* what, const std::string& file, const std::string& now) {
    if (head.at(what).at("sha256") != now)
      throw SweepError(file +
                       ": has changed since the sweep began, and its table would mix two: put it "
                       "back, or begin a new sweep");
  };
  check("protocol", request.what.protocol_file,
        sha256(engine.describe(request.what.protocol_file).text));
  RigDescription rig = engine.load_rig(request.where.rig_file);
  check("rig", request.where.rig_file, digest_of(rig));
  if (request.where.calibrated_in.empty()) return;
  take_installed_calibration(rig, request.where.calibrated_in);
  if (head.value("calibration", "") != calibration_digest(rig))
    throw SweepError(request.where.rig_file +
                     ": a calibration was installed since the sweep began, and its table "
                     "would mix two: begin a new sweep");
}

// By the types of the exceptions, as main() does: from before a run all of them say that it did not
// begin. The wall time is this process', from the request to the closed record.
nlohmann::json run_request_point(ScriptEngine& engine, const RunRequest& request) {
  const auto began = std::chrono::steady_clock::now();
  SilentListener quiet;
  try {
    const RunResult result = run_protocol(engine, request, quiet);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
    return {{"outcome", to_string(result.outcome)},
            {"exit_code", static_cast<int>(result.exit_code)},
            {"reason", result.reason},
            {"run", fs::path(result.folder).filename().string()},
            {"results", results_json(result.results)},
            {"wall_time", took.count()}};
  } catch (const PreflightError& error) {
    return refused(error, ExitCode::preflight_failed);
  } catch (const DeviceError& error) {
    return refused(error, ExitCode::device_missing);
  } catch (const Stopped&) {
    return {{"outcome", "stopped"}, {"exit_code", static_cast<int>(ExitCode::stopped)}};
  } catch (const std::exception& error) {
    return refused(error, ExitCode::usage);
  }
}

/// A protocol that cannot be read any more is the result of its points and ends no sweep.
nlohmann::json run_sweep_point(ScriptEngine& engine, const nlohmann::json& head,
                               const nlohmann::json& what, const fs::path& out) {
  RunRequest request = request_of(head);
  request.where.out = out.string();
  request.how.seed = what.at("seed").get<std::uint64_t>();
  try {
    request.what.arguments =
        argument_words(engine.describe(request.what.protocol_file), what.at("values"));
  } catch (const ScriptError& error) {
    return refused(error, ExitCode::usage);
  }
  return run_request_point(engine, request);
}

}  // namespace vitreo
