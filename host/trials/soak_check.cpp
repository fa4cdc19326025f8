// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_check.h"

#include "host/runs/run_care.h"
#include "host/runs/run_reader.h"
#include "host/trials/soak_patient.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <malloc.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// The violations of one run, as texts.
/// Checks go on after the first failure: a seed is rare and expensive, so everything about it is
/// told at once.
class Findings {
 public:
  template <class... Words>
  void unless(bool good, fmt::format_string<Words...> text, Words&&... words) {
    if (!good) found_.push_back(fmt::format(text, std::forward<Words>(words)...));
  }
  std::vector<std::string> take() { return std::move(found_); }

 private:
  std::vector<std::string> found_;
};

bool has_fault_of(const SoakPlan& plan, const std::string& role) {
  return std::any_of(plan.faults.begin(), plan.faults.end(),
                     [&](const Fault& fault) { return fault.role == role; });
}

/// s: when the first thing happens that the reference did not have.
/// Infinity where nothing happens at all: then the whole run is compared.
double first_disturbance(const SoakPlan& plan) {
  double first = plan.tier != StopTier::none || plan.kill ? plan.at : INFINITY;
  for (const Fault& fault : plan.faults) first = std::min(first, fault.after);
  return first;
}

/// Up to the first disturbance the run is the reference, to the bit: nothing is lost, nothing is
/// different.
/// A stream of the reference that begins later is not expected; one that is missing or short is a
/// loss of recorded data.
void check_prefix(const SoakPlan& plan, const SoakReference& reference, const Recorder& recorder,
                  Findings& findings) {
  const double first = first_disturbance(plan);
  const Time until = std::isfinite(first) ? from_seconds(first) : kForever;
  for (const Stream& wanted : reference.streams) {
    std::size_t count = 0;
    // A row's time may lie before the moment at which it is recorded: a frame is seen after it was
    // exposed. Half a second is above every latency of the simulated cameras.
    const Time latest = until == kForever ? kForever : until - std::chrono::milliseconds(500);
    while (count < wanted.times.size() && wanted.times[count] < latest) ++count;
    const Stream* const found = recorder.stream(wanted.info.name);
    if (count == 0) continue;
    findings.unless(
        found != nullptr && found->times.size() >= count,
        "stream {}: {} samples were recorded before anything happened, and only {} are there",
        wanted.info.name, count, found == nullptr ? 0 : found->times.size());
    if (found == nullptr || found->times.size() < count) continue;
    const std::size_t values = count * wanted.info.channels.size();
    const bool same =
        std::equal(wanted.times.begin(), wanted.times.begin() + static_cast<std::ptrdiff_t>(count),
                   found->times.begin()) &&
        std::equal(
            wanted.values.begin(), wanted.values.begin() + static_cast<std::ptrdiff_t>(values),
            // NaN equals NaN here.
            found->values.begin(), [](double a, double b) { return a == b || (a != a && b != b); });
    findings.unless(same, "stream {}: before anything happened it is not what it was without",
                    wanted.info.name);
  }
}

/// No set-point above the amplifier's limit, but for rounding.
/// The stream "currents" has what the loop commanded; current_limit() is the interlock's, the lower
/// one of the rig's and the amplifier's.
void check_currents(const Recorder& recorder, OpenRig& rig, Findings& findings) {
  const Stream* const stream = recorder.stream("currents");
  if (stream == nullptr || rig.rig().coils == nullptr) return;
  double most = 0;
  for (const double current : stream->values) most = std::max(most, std::abs(current));
  findings.unless(most <= rig.rig().coils->current_limit() * (1 + 1e-9),
                  "a current of {:g} A was asked for", most);
}

/// The record on the disk is whole, and is the one in memory.
/// What a reader finds must be what the run had in memory: the recorder writes in a thread of its
/// own, and the two could part.
void check_record(const Recorder& recorder, Findings& findings) {
  for (const std::string& problem : verify_run(recorder.folder()).problems)
    findings.unless(false, "verify: {}", problem);
  try {
    const RunData data = read_run(recorder.folder());
    findings.unless(data.end.has_value(), "there is no end record");
    if (data.end && recorder.end() != nullptr)
      findings.unless(data.end->outcome == recorder.end()->outcome &&
                          data.end->reason == recorder.end()->reason,
                      "the end record on the disk is another one");
    findings.unless(data.streams.size() == recorder.streams().size(),
                    "streams are missing on the disk");
    for (const Stream& stream : recorder.streams()) {
      const Stream* const stored = data.stream(stream.info.name);
      findings.unless(stored != nullptr && stored->times == stream.times,
                      "stream {}: the disk has {} samples of {}", stream.info.name,
                      stored == nullptr ? 0 : stored->times.size(), stream.times.size());
    }
  } catch (const std::exception& error) {
    findings.unless(false, "the record cannot be read: {}", error.what());
  }
}

}  // namespace

// Volts at the terminals of the simulated amplifier's analog outputs: the truth of the simulator,
// which no fault of a link can falsify.
double outputs_of(sim::Laboratory& laboratory) {
  double most = 0;
  for (const double volts : laboratory.coil_outputs().outputs())
    most = std::max(most, std::abs(volts));
  return most;
}

// Other faults of the link (silent, garbled) may lose answers, but commands still arrive.
bool coils_unreachable(const SoakPlan& plan) {
  return std::any_of(plan.faults.begin(), plan.faults.end(), [](const Fault& fault) {
    return fault.role == "coils" && fault.kind == "unplugged";
  });
}

// Both directions are checked: outputs that hold a voltage must be reported as unsafe, and "unsafe"
// must not be reported of a healthy device.
std::vector<std::string> check_ended(const SoakPlan& plan, const SoakWitness& witness,
                                     const SoakReference& reference, const Recorder& recorder,
                                     OpenRig& rig) {
  Findings findings;
  const auto& events = recorder.events();
  const bool unsafe = std::any_of(events.begin(), events.end(),
                                  [](const Event& one) { return one.kind == "unsafe"; });
  const double volts = outputs_of(*rig.laboratory());
  if (coils_unreachable(plan) && volts > kZeroOutput)  // what cannot be done must be said
    findings.unless(unsafe,
                    "the outputs hold {:g} V behind a pulled cable, and the record does not say so",
                    volts);
  else
    findings.unless(volts <= kZeroOutput, "the outputs hold {:g} V at the end", volts);
  findings.unless(!unsafe || has_fault_of(plan, "coils") || has_fault_of(plan, "lens_mover") ||
                      has_fault_of(plan, "stage") || has_fault_of(plan, "rotation_stage"),
                  "a device could not be made safe though nothing was wrong with it");
  findings.unless(recorder.end() != nullptr, "the run was not finished");
  check_currents(recorder, rig, findings);
  if (plan.machine == 0) check_prefix(plan, reference, recorder, findings);
  check_record(recorder, findings);
  std::vector<std::string> all = findings.take();
  all.insert(all.end(), witness.violations.begin(), witness.violations.end());
  const std::vector<std::string> claims = check_patient(recorder, rig);
  all.insert(all.end(), claims.begin(), claims.end());
  return all;
}

// Only what follows from the plan is demanded: with a fault many outcomes are right, without one
// just one is.
std::vector<std::string> check_result(const SoakPlan& plan, const SoakWitness& witness,
                                      const RunResult& result) {
  Findings findings;
  const bool faulty = !plan.faults.empty() || !plan.script.empty();
  const Outcome outcome = result.outcome;
  findings.unless(result.exit_code != ExitCode::internal, "internal error: {}", result.reason);
  findings.unless((outcome == Outcome::completed) == (result.exit_code == ExitCode::completed),
                  "{} with exit code {}", to_string(outcome), static_cast<int>(result.exit_code));
  findings.unless(outcome == Outcome::completed || !result.reason.empty(), "{} without a reason",
                  to_string(outcome));
  // A fault may end the run before the stop does; without one the outcome must be the stop's.
  findings.unless(!witness.asked || outcome != Outcome::completed,
                  "completed, though it was told to end");
  if (!faulty && witness.asked)
    findings.unless(outcome == (plan.tier == StopTier::stop ? Outcome::stopped : Outcome::aborted),
                    "{} after a {}", to_string(outcome), to_string(plan.tier));
  if (!faulty && !witness.asked)
    findings.unless(outcome == Outcome::completed, "{} though it was left alone: {}",
                    to_string(outcome), result.reason);
  findings.unless(outcome != Outcome::stopped || witness.asked, "stopped, though nobody asked: {}",
                  result.reason);
  return findings.take();
}

// The promise of the record (docs/records.md): what was a second old at the kill is on the disk,
// and the recovered record says "lost", never "completed".
std::vector<std::string> check_killed(const fs::path& parent, std::uint64_t samples) {
  Findings findings;
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(parent)) folders.push_back(entry.path());
  findings.unless(folders.size() == 1, "there are {} run folders", folders.size());
  if (folders.size() != 1) return findings.take();
  try {
    recover_run(folders.front());
    const RunData data = read_run(folders.front());
    std::uint64_t there = 0;
    for (const Stream& stream : data.streams) there += stream.times.size();
    findings.unless(there >= samples,
                    "of {} samples that were a second old at the kill {} are there", samples,
                    there);
    findings.unless(data.end && data.end->outcome == Outcome::lost,
                    "the recovered record does not say that it was lost");
    for (const std::string& problem : verify_run(folders.front()).problems)
      findings.unless(false, "verify after recover: {}", problem);
  } catch (const std::exception& error) {
    findings.unless(false, "the record of the killed run: {}", error.what());
  }
  return findings.take();
}

// Of this very process: /proc/self/fd holds the descriptor of its own listing too, each time alike.
Footprint footprint() {
  const auto entries = [](const char* folder) {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
  };
  // glibc's own count: allocated chunks of the arenas, and large blocks that are mapped.
  const struct mallinfo2 heap = mallinfo2();
  return {entries("/proc/self/fd"), entries("/proc/self/task"), heap.uordblks + heap.hblkhd};
}

}  // namespace vitreo
