// SPDX-License-Identifier: Apache-2.0
#include "host/trials/protocol_check.h"

#include "host/runs/run_care.h"
#include "host/trials/silent_listener.h"
#include "host/trials/soak_check.h"

#include <fmt/format.h>

#include <filesystem>
#include <random>
#include <sstream>

namespace vitreo {
namespace {

// The test's own words replace the command line's; what it leaves open is taken from there.
RunRequest request_of(const RunRequest& base, const ProtocolTest& test) {
  RunRequest request = base;
  if (!test.arguments.empty()) request.what.arguments = words_of(test.arguments);
  if (!test.answers.empty()) request.what.answers = words_of(test.answers);
  request.how.seed = test.seed;
  if (!test.fault.empty()) request.how.faults = {test.fault};
  if (!test.rig.empty()) request.where.rig_file = test.rig;
  return request;
}

struct Ended {
  RunResult result;
  std::string unsafe;  // what was not as it must be afterwards; empty: nothing
};

/// However a run ends: no current flows, and its record is whole.
/// Looked at while the rig is still open, after the engine's own safe state: `inspect` of
/// conduct(). An unsafe end outweighs a broken record.
Ended run_and_look(ScriptEngine& engine, const RunRequest& request) {
  SilentListener listener;
  Ended ended;
  ended.result = run_protocol(engine, request, listener, [&ended](const Recorder&, OpenRig& open) {
    const Rig& rig = open.rig();
    // As the outputs really are, where that can be known: an amplifier that does not answer may
    // have obeyed.
    const bool flows = open.laboratory() != nullptr
                           ? outputs_of(*open.laboratory()) > kZeroOutput
                           : rig.coils != nullptr && rig.coils->energized();
    if (flows) ended.unsafe = "the coils are energized after the end";
  });
  const RunCheck record = verify_run(ended.result.folder);
  if (ended.unsafe.empty() && !record.problems.empty())
    ended.unsafe = "the record: " + record.problems.front();
  return ended;
}

/// NaN for a result that the run did not state.
double value_of(const RunResult& result, const std::string& name) {
  for (const StatedResult& one : result.results)
    if (one.name == name) return one.value;
  return std::nan("");
}

/// The first result that is missing or outside its range; empty: none.
std::string fault_of_results(const RunResult& result, const ProtocolTest& test) {
  for (const auto& [name, range] : test.results) {
    // A result that is stated as NaN counts as missing: it would slip through both comparisons
    // below.
    const double value = value_of(result, name);
    if (std::isnan(value)) return "it states no result " + name;
    if (value < range.first || value > range.second)
      return fmt::format("{} is {:g}, wanted {:g} to {:g}", name, value, range.first, range.second);
  }
  return "";
}

/// "run speed=1mm/s"; "run" where there is nothing to add.
std::string titled(const std::string& what, const std::string& how) {
  return how.empty() ? what : what + " " + how;
}

// What was unsafe comes first; an outcome other than completed is reported beside it: it is what
// led there.
void try_run(ScriptEngine& engine, const RunRequest& base, const ProtocolTest& test,
             const std::function<void(const ProtocolTrial&)>& report) {
  const Ended ended = run_and_look(engine, request_of(base, test));
  std::string problem = ended.unsafe;
  if (ended.result.outcome != Outcome::completed)
    problem += fmt::format("{}{}: {}", problem.empty() ? "" : "; ", to_string(ended.result.outcome),
                           ended.result.reason);
  else if (problem.empty())
    problem = fault_of_results(ended.result, test);
  report({titled("run", test.arguments), problem});
}

/// Whether a run that must fail did, and as the test says; empty: yes.
/// An empty `says` is found in every reason, so a test need not name one.
std::string fault_of_failure(const ProtocolTest& test, const std::string& outcome,
                             const std::string& reason) {
  if (outcome == "completed") return "it completed";
  if (!test.outcome.empty() && outcome != test.outcome)
    return fmt::format("it ended as {}, not as {}: {}", outcome, test.outcome, reason);
  if (reason.find(test.says) == std::string::npos)
    return fmt::format("its reason does not say \"{}\": {}", test.says, reason);
  return "";
}

// Refused arguments count as a failure of the expected kind ("refused"): checking its arguments is
// part of what a protocol does.
void try_fail(ScriptEngine& engine, const RunRequest& base, const ProtocolTest& test,
              const std::function<void(const ProtocolTrial&)>& report) {
  std::string outcome;
  std::string reason;
  std::string problem;
  try {
    const Ended ended = run_and_look(engine, request_of(base, test));
    outcome = to_string(ended.result.outcome);
    reason = ended.result.reason;
    problem = ended.unsafe;
  } catch (const ConfigError& refused) {  // of arguments that the protocol does not take
    outcome = "refused";
    reason = refused.what();
  }
  if (problem.empty()) problem = fault_of_failure(test, outcome, reason);
  report({titled(titled("fail", test.arguments), test.fault), problem});
}

/// A run with a stop asked for at `moment`, s of its clock.
/// The task is named and kept by the session, so it ends before what it refers to.
/// request_and_wait(): the script's thread has felt the stop when this task goes on, so the run
/// repeats to the bit.
Ended stopped_at(ScriptEngine& engine, RunRequest request, double moment) {
  request.how.companion = [moment](Session& session) {
    session.keep(session.clock.spawn("stop by test", [&session, moment] {
      session.clock.sleep_until(from_seconds(moment));
      session.control.set_reason("by the test");
      session.control.request_and_wait(StopTier::stop);
    }));
  };
  return run_and_look(engine, request);
}

// One run without a stop gives the duration; moments are uniform in it. The generator's seed is the
// test's, so a failing moment comes again in the next call.
void try_stop(ScriptEngine& engine, const RunRequest& base, const ProtocolTest& test,
              const std::function<void(const ProtocolTrial&)>& report) {
  const RunRequest request = request_of(base, test);
  const Ended whole = run_and_look(engine, request);
  const double duration = value_of(whole.result, "experiment_time");
  std::mt19937_64 random(test.seed);
  // Above zero even for a script that takes no time: the range of a distribution must not be empty.
  std::uniform_real_distribution<double> moments(0, std::max(duration, 1e-6));
  for (int number = 1; number <= test.times; ++number) {
    const double moment = moments(random);
    const Ended ended = stopped_at(engine, request, moment);
    std::string problem = ended.unsafe;
    // A run that is not stopped must have ended before the moment came.
    const bool before = ended.result.outcome == Outcome::completed &&
                        value_of(ended.result, "experiment_time") <= moment;
    if (problem.empty() && ended.result.outcome != Outcome::stopped && !before)
      problem = fmt::format("{}: {}", to_string(ended.result.outcome), ended.result.reason);
    report({fmt::format("stop {} of {}, at {:.3f} s", number, test.times, moment), problem});
    std::error_code ignored;  // what went well leaves no hundred folders
    if (problem.empty()) std::filesystem::remove_all(ended.result.folder, ignored);
  }
}

}  // namespace

// It completes, and it can be stopped at any of 100 moments.
std::vector<ProtocolTest> usual_tests() {
  ProtocolTest stop;
  stop.kind = ProtocolTest::Kind::stop;
  return {ProtocolTest{}, stop};
}

void try_protocol(ScriptEngine& engine, const RunRequest& base, const ProtocolTest& test,
                  const std::function<void(const ProtocolTrial&)>& report) {
  switch (test.kind) {
    case ProtocolTest::Kind::run:
      return try_run(engine, base, test, report);
    case ProtocolTest::Kind::fail:
      return try_fail(engine, base, test, report);
    case ProtocolTest::Kind::stop:
      return try_stop(engine, base, test, report);
  }
}

}  // namespace vitreo
