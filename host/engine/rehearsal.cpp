// SPDX-License-Identifier: Apache-2.0
#include "host/engine/rehearsal.h"

#include "devices/time/error.h"
#include "devices/time/quiet_thread.h"
#include "host/engine/disk_need.h"
#include "host/engine/interrupts.h"
#include "host/engine/loop_rate.h"
#include "host/engine/run_result.h"
#include "host/engine/watchdog.h"
#include "host/rig/calibrations.h"
#include "host/rig/registry.h"
#include "host/rig/rig_settings.h"
#include "host/servo/simulated_side.h"
#include "host/text/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <condition_variable>
#include <iostream>
#include <optional>
#include <pthread.h>
#include <thread>
#include <unistd.h>
#include <variant>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// The folder of the dry run's record; it goes with it.
class PassingFolder {
 public:
  PassingFolder() {
    std::string name = (fs::temp_directory_path() / "vitreo_check_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr)
      throw std::runtime_error(name + ": the dry run's folder cannot be made");
    path_ = name;
  }
  ~PassingFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  PassingFolder(const PassingFolder&) = delete;
  PassingFolder& operator=(const PassingFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// Stops the script after so much wall time: a script that waits for hours of the rig's time
/// computes for all of them.
/// Its thread touches nothing but the control, whose request() any thread may call.
class TimeLimit {
 public:
  TimeLimit(RunControl& control, double seconds) {
    thread_ = quiet_thread([this, &control, seconds] {
      std::unique_lock lock(mutex_);
      if (done_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return over_; }))
        return;
      expired_ = true;
      control.request(StopTier::stop);
    });
  }
  ~TimeLimit() { end(); }
  TimeLimit(const TimeLimit&) = delete;
  TimeLimit& operator=(const TimeLimit&) = delete;
  /// No stop comes after this; whether one came before.
  bool end() {
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    done_.notify_all();
    if (thread_.joinable()) thread_.join();
    return expired_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable done_;
  bool over_ = false, expired_ = false;
  std::thread thread_;
};

/// A dry run's messages and progress are not displayed.
class NullListener final : public ProgressListener {
 public:
  void progress(double, const std::string&) override {}
  void message(const std::string&) override {}
};

/// Start record of the dry run: only what the run's own calls may read.
RunStart start_of(const RunRequest& request, const ProtocolDescription& protocol) {
  RunStart start;
  start.protocol_file = protocol.file;
  start.protocol_title = protocol.title;
  start.parameters = start.parameter_units = start.rig = start.versions = nlohmann::json::object();
  start.devices = start.files = nlohmann::json::object();
  start.seed = request.how.seed;
  return start;
}

/// The dry run's record is thrown away: no reserve is kept, and a small disk will do.
/// The floor of 16 MB keeps the dry run itself from filling the disk.
RecordLimits passing_limits() {
  RecordLimits limits;
  limits.disk.reserve_bytes = 0;
  limits.disk.stop_bytes = limits.disk.stop_bytes_with_frames = 16'000'000;
  limits.disk.warn_seconds = limits.disk.stop_seconds = 0;
  return limits;
}

// The default of PreflightLimits::stuck.
[[noreturn]] void leave(const PreflightReport& report) {
  std::cerr << "vitreo: the preflight failed, nothing was opened: " << report.problems.back()
            << std::endl;
  _exit(static_cast<int>(ExitCode::preflight_failed));
}

/// The dry run, from its clock to its verdict.
class DryRun {
 public:
  DryRun(ScriptEngine& engine, const RunRequest& request, const CheckedRequest& checked,
         const PreflightLimits& limits, PreflightReport& report)
      : engine_(engine),
        request_(request),
        checked_(checked),
        limits_(limits),
        report_(report),
        clock_(virtual_clock()),
        twin_(checked.rig, *clock_, request.how.seed),
        recorder_(folder_.path(), start_of(request, checked.protocol), passing_limits()) {}

  void run() {
    Rig& rig = twin_.open_rig().rig();
    Rehearsal rehearsal;
    // The script asks its operator to bring the robot; in the twin it is put there.
    if (rig.sample == nullptr) rehearsal.bring_robot = [this] { twin_.bring_robot(); };
    rehearsal.pose_sensor = checked_.rig.table.contains("pose_sensor");
    rehearsal.frames = checked_.frames;
    {
      Session session(*clock_, rig, recorder_, listener_, request_.how.seed);
      session.rehearsal = &rehearsal;
      session.questions.prepare(request_.what.answers);
      session.questions.assume_answers();
      // As in a real run (conduct.cpp): stop and abort take the same ways.
      session.control.attach({[&] {
                                engine_.interrupt();
                                clock_->interrupt();
                              },
                              [&] { return twin_.open_rig().make_safe(); }});
      // A rig with real instruments has no truth, so its script must do without in the dry run too.
      if (!has_real_instruments(checked_.rig)) keep_truth(session);
      if (rig.coils != nullptr)
        if (auto warmth = observe_coil_temperatures(*clock_, *rig.coils, recorder_))
          session.keep(std::move(warmth));
      if (rig.side_camera != nullptr)
        session.keep(simulate_side(*clock_, *twin_.open_rig().laboratory(),
                                   rig.side_camera->info().frame_period, recorder_));
      // The script, under the watchdog and the time limit.
      play(session);
      session.control.detach();
      for (const std::string& assumed : session.questions.assumed())
        report_.warnings.push_back("not answered in advance, so the dry run took: " + assumed);
      for (const std::string& answer : session.questions.unused_answers())
        if (report_.simulated)
          report_.warnings.push_back("nothing was asked that wanted the answer " + answer);
    }
    twin_.open_rig().make_safe();
    report_use(rehearsal, rig);
  }

 private:
  /// What the run took and energized, and what was remarkable on the way.
  /// Axes and coils were counted by decorators in the twin, so the numbers are those of what the
  /// twin accepted.
  void report_use(const Rehearsal& rehearsal, const Rig& rig) {
    // The virtual clock jumps over waits but counts them.
    report_.duration = to_seconds(clock_->now());
    report_.coils = twin_.coils();
    report_.moves = twin_.moves();
    report_links(rehearsal);
    for (const std::string& trip : report_.coils.trips)
      report_.problems.push_back("the interlock tripped: " + trip);
    for (const std::string& remark : rehearsal.remarks) report_.warnings.push_back(remark);
    for (const std::string& warning : rig.warnings) report_.warnings.push_back(warning);
    report_.frame_bytes_per_second = frame_bytes_per_second(rehearsal.frames, rig);
    report_.disk_bytes =
        sample_bytes(recorder_) + report_.frame_bytes_per_second * report_.duration;
  }

  // By the rig file and not by its twin, whose clock waits for no machine: what the script's loops
  // ask of the links, and what those cannot keep.
  void report_links(const Rehearsal& rehearsal) {
    const LinkLoads rig = link_loads(checked_.rig);
    report_.loop = loop_rate(rig, rehearsal.loop_sources);
    // First: what the dry run itself stumbled over may come of it.
    const std::vector<std::string> slow = beyond_links(rig, rehearsal.loop_sources);
    report_.problems.insert(report_.problems.begin(), slow.begin(), slow.end());
    if (report_.coils.energized > 0)
      report_.warnings.insert(report_.warnings.end(), rig.warnings.begin(), rig.warnings.end());
  }

  // The same streams as conduct() records, so that a script that reads "truth" is rehearsed with
  // it.
  void keep_truth(Session& session) {
    const Rig& rig = session.rig;
    const double period = rig.top_camera ? rig.top_camera->info().frame_period
                                         : (rig.pose_sensor ? rig.pose_sensor->period() : 0);
    if (period > 0)
      session.keep(observe_truth(*clock_, *twin_.open_rig().laboratory(), period, recorder_));
  }

  // Runs the script to its end, to its error or to the limit; only the operator's own stop is
  // thrown on.
  void play(Session& session) {
    // Ctrl-C ends the check itself.
    InterruptScope interrupts;
    interrupts.begin(session.control);
    // Clean-up and grace are shorter than a run's: nothing is energized.
    const WatchdogLimits patience{std::chrono::milliseconds(1000), std::chrono::milliseconds(250),
                                  std::chrono::milliseconds(1000)};
    const auto stuck = [this] {
      report_.problems.push_back(
          fmt::format("the script is stuck in a call that nothing can interrupt, {} into the run: "
                      "an abort would not reach it",
                      format_quantity(to_seconds(clock_->now()), "s")));
      report_.wall_time = limits_.wall;
      limits_.stuck ? limits_.stuck(report_) : leave(report_);
    };
    const Watchdog watchdog(session.control, *clock_, patience,
                            {stuck, [] { return false; }, [](const std::string&) {}});
    TimeLimit limit(session.control, limits_.wall);
    try {
      switch_light_on(session.rig);
      engine_.run(checked_.protocol, checked_.arguments, session);
      report_.simulated = true;
    } catch (const Stopped&) {
      stopped(session.control, limit.end());
    } catch (const ScriptError& error) {
      if (!limit.end()) report_.problems.push_back(error.what());
    } catch (const DeviceError& error) {
      if (!limit.end()) report_.problems.push_back(error.what());
    }
    // Cut short by the limit: what was found until then holds, but it is not all.
    if (limit.end() && !report_.simulated) report_.warnings.push_back(not_fully());
  }

  std::string not_fully() const {
    return fmt::format(
        "not fully simulated: {:.3g} s of wall time were not enough for more than {} of the run",
        limits_.wall, format_quantity(to_seconds(clock_->now()), "s"));
  }

  /// A stop of the script's own is an end of the run like another; an abort of its own is a
  /// problem.
  void stopped(const RunControl& control, bool time_is_up) {
    if (time_is_up) return;
    if (!control.reason().starts_with("by the script"))
      throw Stopped();  // the operator, of the check itself
    report_.simulated = true;
    if (control.tier() >= StopTier::abort)
      report_.problems.push_back("aborted " + control.reason());
    else
      report_.warnings.push_back("stopped " + control.reason());
  }

  ScriptEngine& engine_;
  const RunRequest& request_;
  const CheckedRequest& checked_;
  const PreflightLimits& limits_;
  PreflightReport& report_;
  NullListener listener_;
  PassingFolder folder_;
  std::unique_ptr<Clock> clock_;
  Twin twin_;
  Recorder recorder_;
};

}  // namespace

// A rig that has no twin is not refused: the rehearsal is a help, and a rig file may hold settings
// that only the real instrument's driver can judge.
PreflightReport rehearse(ScriptEngine& engine, const RunRequest& request,
                         const CheckedRequest& checked, const PreflightLimits& limits) {
  PreflightReport report;
  const double began = wall_seconds();
  const Calibrations calibrations = Calibrations::of(checked.rig);
  for (const std::string& stale : calibrations.out_of_date(today_text()))
    // By date only: no instrument is open, so their identities are not known.
    (calibrations.refuse_stale ? report.problems : report.warnings).push_back(stale);
  report.loop = loop_rate(link_loads(checked.rig));
  std::optional<DryRun> dry_run;
  try {
    dry_run.emplace(engine, request, checked, limits, report);
  } catch (const ConfigError& error) {  // a setting that only the real instrument understands
    report.warnings.push_back(std::string("not simulated: the rig has no twin: ") + error.what());
  } catch (const DeviceError& error) {
    report.warnings.push_back(std::string("not simulated: the twin does not open: ") +
                              error.what());
  }
  // Without a twin the run is not refused; the warning says that it was not simulated.
  if (dry_run) dry_run->run();
  const std::string disk =
      disk_problem(request.where.out, report.disk_bytes, report.frame_bytes_per_second > 0);
  if (!disk.empty()) report.problems.push_back(disk);
  report.wall_time = wall_seconds() - began;
  return report;
}

std::optional<PreflightReport> rehearse_on_twin(ScriptEngine& engine, const RunRequest& request,
                                                const CheckedRequest& checked,
                                                ProgressListener& listener) {
  if (!is_laboratory(checked.rig)) return std::nullopt;
  listener.message("preflight: a dry run on the rig's twin");
  return rehearse(engine, request, checked);
}

namespace {

/// What only open instruments would show; nothing of a rig that has none.
std::vector<std::string> not_looked_at(const RigDescription& rig, const std::string& rig_file) {
  std::vector<std::string> instruments;
  for (const std::string& role : real_roles(rig)) {
    const std::string address = text_of(std::get<ConfigTable>(rig.table.at(role).value), "address");
    if (!address.empty() && !is_recording(address)) instruments.push_back(role);  // else a person
  }
  if (instruments.empty()) return {};
  std::vector<std::string> gaps{
      fmt::format("whether {} {} there and answer{} (vitreo devices --rig "
                  "{})",
                  fmt::join(instruments, ", "), instruments.size() == 1 ? "is" : "are",
                  instruments.size() == 1 ? "s" : "", rig_file)};
  const std::vector<Calibration> calibrations = Calibrations::of(rig).list;
  if (std::any_of(calibrations.begin(), calibrations.end(),
                  [](const Calibration& one) { return !one.devices.empty(); }))
    gaps.emplace_back("whether the calibrations are of these instruments");
  return gaps;
}

}  // namespace

PreflightReport preflight(ScriptEngine& engine, const RunRequest& request,
                          const PreflightLimits& limits) {
  const double began = wall_seconds();
  const CheckedRequest checked = check_request(engine, request);
  const double checked_in = wall_seconds() - began;
  PreflightReport report = rehearse(engine, request, checked, limits);
  report.arguments_time = checked_in;
  report.not_looked_at = not_looked_at(checked.rig, request.where.rig_file);
  return report;
}

}  // namespace vitreo
