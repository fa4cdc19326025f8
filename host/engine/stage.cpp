// SPDX-License-Identifier: Apache-2.0
#include "host/engine/stage.h"

#include "devices/time/error.h"
#include "host/engine/versions.h"
#include "host/rig/geometry.h"
#include "host/rig/identities.h"
#include "host/rig/instrument_file.h"
#include "host/rig/measured_chain.h"
#include "host/rig/registry.h"
#include "host/runs/report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <iterator>
#include <span>
#include <sstream>
#include <thread>

namespace vitreo {
namespace {

/// The request's faults, before anything opens: a real laboratory has no simulated ones, but for
/// the disk's. Throws ConfigError.
std::vector<Fault> faults_of(const RunRequest& request, const std::vector<std::string>& real) {
  std::vector<Fault> faults;
  for (const std::string& word : request.how.faults) {
    faults.push_back(parse_fault(word));
    if (!real.empty() && faults.back().role != "disk")
      throw ConfigError(fmt::format(
          "fault {}: this rig's {} is real, and only a rig that is simulated throughout can be "
          "broken on purpose",
          word, fmt::join(real, ", ")));
  }
  return faults;
}

/// Each fits an instrument of the rig that is open. Throws ConfigError.
void check_faults(const std::vector<Fault>& faults, const SimulatedRoles& breakable) {
  for (const Fault& fault : faults) {
    try {
      check(fault, breakable);
    } catch (const std::invalid_argument& problem) {
      throw ConfigError("fault " + to_string(fault) + ": " + problem.what());
    }
  }
}

/// Values in SI, as the record keeps them.
nlohmann::json to_json(const std::map<std::string, ArgumentValue>& arguments) {
  nlohmann::json object = nlohmann::json::object();
  for (const auto& [name, value] : arguments)
    std::visit([&object, &key = name](const auto& held) { object[key] = held; }, value);
  return object;
}

/// Everything that a later reader needs to repeat the run: protocol and rig as texts, the resolved
/// rig, versions, seed, devices, and the hashes of files that the rig names.
RunStart start_record(const RunRequest& request, const CheckedRequest& checked,
                      const RunStage& stage) {
  const ProtocolDescription& protocol = checked.protocol;
  const RigDescription& description = checked.rig;
  RunStart start;
  start.protocol_file = protocol.file;
  start.protocol_title = protocol.title;
  start.protocol_text = protocol.text;
  start.parameters = to_json(checked.arguments);
  for (const Parameter& parameter : protocol.parameters)
    start.parameter_units[parameter.name] = parameter.unit;
  start.rig = {{"file", description.file},
               {"text", description.text},
               {"resolved", stage.rig->resolved()},
               {"geometry", geometry_of(stage.rig->rig().model)}};
  for (const RigSource& base : description.bases)
    start.rig["bases"].push_back({{"file", base.file}, {"text", base.text}});
  for (const InstrumentFile& file : instrument_files(description, is_built_in))
    start.rig["instruments"].push_back({{"file", file.path}, {"text", file.text}});
  if (const auto& chain = stage.rig->rig().model.chain) start.rig["chain"] = chain->text;
  start.versions = versions();
  start.seed = request.how.seed;
  start.operator_name = operator_of(request);
  start.devices = stage.devices;
  start.files = hashes_of_files(start.rig);
  start.tags = checked.tags;
  start.sample = checked.sample;
  // One moment of both clocks.
  const Time now = stage.clock->now();
  const auto wall = std::chrono::system_clock::now().time_since_epoch();
  start.t0_utc_ns = (std::chrono::duration_cast<Time>(wall) - now).count();
  start.clock =
      stage.rig->laboratory() == nullptr || stage.pace == Pace::real_time ? "real" : "virtual";
  return start;
}

/// Under the virtual clock the recorder takes what it is given; in real time it must not hold up a
/// camera.
RecordLimits record_limits(bool real_time, const std::shared_ptr<DiskFaults>& disk) {
  RecordLimits limits;
  // Fault injection of the disk (host/session/faults.h) acts where the recorder asks for free
  // space.
  limits.disk.free_bytes = [disk](const std::filesystem::path& folder) {
    std::this_thread::sleep_for(std::chrono::milliseconds(disk->stall_ms.exchange(0)));
    return disk->full ? 0 : free_bytes(folder);
  };
  limits.drop_frames = real_time;
  return limits;
}

/// The last of what passed on the links of the role that failed; of all where the error names none
/// of them.
void show_trace(const LinkTrace& trace, const DeviceError& error, ProgressListener& listener) {
  constexpr std::size_t kShown = 40;
  std::vector<LinkRow> rows;
  std::copy_if(trace.waiting().begin(), trace.waiting().end(), std::back_inserter(rows),
               [&](const LinkRow& row) { return row.role == error.device; });
  if (rows.empty()) rows = trace.waiting();
  const std::size_t first = rows.size() - std::min(kShown, rows.size());
  std::istringstream lines(to_text(std::span(rows).subspan(first)));
  for (std::string line; std::getline(lines, line);) listener.message(line);
}

}  // namespace

// The clock comes before the rig, whose devices wait on it from their first byte on. One real
// instrument is enough to make the whole run real time.
RunStage open_stage(const RunRequest& request, const CheckedRequest& checked,
                    ProgressListener& listener) {
  RunStage stage;
  stage.rights = Rights::of(checked.rig);
  const std::vector<std::string> real_ones = real_roles(checked.rig);
  stage.faults = faults_of(request, real_ones);
  stage.frames = checked.frames;
  const bool real = !real_ones.empty();
  // Instruments keep the wall clock's pace, whatever was asked for.
  stage.pace = real ? Pace::real_time : request.how.pace;
  stage.clock = real ? wall_clock() : virtual_clock(stage.pace);
  if (request.how.trace_links) stage.trace = std::make_unique<LinkTrace>();
  try {
    stage.rig = open_rig(checked.rig, *stage.clock, request.how.seed, request.how.shifts,
                         stage.trace.get());
  } catch (const DeviceError& error) {
    if (stage.trace) show_trace(*stage.trace, error, listener);
    throw;
  }
  stage.devices = identities(stage.rig->rig());
  if (!real) stage.breakable = simulated_roles(stage.rig->resolved());
  check_faults(stage.faults, stage.breakable);
  return stage;
}

namespace {

/// What the cameras said of themselves when they were opened: exposure, gain, format ...
void record_cameras(const RunStage& stage) {
  const Rig& rig = stage.rig->rig();
  const auto record = [&stage](const char* role, const Camera* camera) {
    if (camera == nullptr || camera->info().settings.empty()) return;
    std::string text;
    for (const auto& [name, value] : camera->info().settings)
      text += (text.empty() ? "" : ", ") + name + " " + value;
    stage.recorder->event(stage.clock->now(), "settings", std::string(role) + ": " + text);
  };
  record("top_camera", rig.top_camera);
  record("side_camera", rig.side_camera);
}

}  // namespace

void open_record(RunStage& stage, const RunRequest& request, const CheckedRequest& checked) {
  stage.interrupts = std::make_unique<InterruptScope>();
  stage.recorder =
      std::make_unique<Recorder>(request.where.out, start_record(request, checked, stage),
                                 record_limits(stage.pace == Pace::real_time, stage.disk));
  // The recorder (host/record) does not know the report (host/runs).
  stage.recorder->set_report([](const RunData& data) { return report_html(data); });
  if (stage.trace) stage.traced = {*stage.trace, *stage.recorder};
  record_cameras(stage);
}

}  // namespace vitreo
