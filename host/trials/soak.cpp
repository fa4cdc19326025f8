// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak.h"

#include "host/config/config.h"
#include "host/engine/request_check.h"
#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/rig/registry.h"
#include "host/session/session.h"
#include "host/trials/point_execution.h"
#include "host/trials/silent_listener.h"
#include "host/trials/soak_check.h"
#include "host/trials/soak_script.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <poll.h>
#include <stdexcept>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
constexpr double kSafeWithin = 0.25;          // s after an abort, of the run's clock
constexpr std::size_t kHeapGrowth = 4 << 20;  // bytes above the first runs'
constexpr int kWarmUp = 3;                    // runs, in which caches fill

/// Memory shared with the worker: the samples recorded a second before it was killed, which outlive
/// it. Lock-free atomics work across processes.
/// Anonymous and shared: the fork leaves one page in both processes.
struct Page {
  std::atomic<std::uint64_t> samples{0};
  std::atomic<bool> noted{false};
};

// Of all streams: the promise of the record is about the sum. What came since the disk is full
// waits in memory for the end of the run.
std::uint64_t samples_kept(const Recorder& recorder) {
  const std::vector<Event>& events = recorder.events();
  const auto full = std::find_if(events.begin(), events.end(), [](const Event& event) {
    return event.kind == "fault" && event.text.starts_with("disk full");
  });
  const Time until = full == events.end() ? Time::max() : full->time;
  std::uint64_t all = 0;
  for (const Stream& stream : recorder.streams())
    all += static_cast<std::uint64_t>(
        std::lower_bound(stream.times.begin(), stream.times.end(), until) - stream.times.begin());
  return all;
}

class Soak {
 public:
  Soak(ScriptEngine& engine, const SoakRequest& request) : engine_(engine), request_(request) {
    void* const page =
        mmap(nullptr, sizeof(Page), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED) throw std::runtime_error(std::string("soak: ") + std::strerror(errno));
    page_ = new (page) Page;
  }
  ~Soak() { munmap(page_, sizeof(Page)); }
  Soak(const Soak&) = delete;
  Soak& operator=(const Soak&) = delete;

  void run_undisturbed();
  void run(const std::function<void(const SoakedSeed&)>& report);

 private:
  struct Worker {
    // -1: there is none; the next seed starts one.
    pid_t process = -1;
    int pipe = -1;
    std::string received;  // the beginning of a line
  };

  // A folder a seed: after a kill there is exactly one run in it to be recovered.
  fs::path folder_of(std::uint64_t seed) const {
    return fs::path(request_.run.where.out) / fmt::format("soak_{:06}", seed);
  }
  SoakPlan plan_of(std::uint64_t seed) const {
    return draw_plan(seed, reference_.roles, reference_.horizon);
  }
  std::string script_of(std::uint64_t seed, const std::string& misbehavior) const;
  Worker start_worker(std::uint64_t first);
  [[noreturn]] void work(std::uint64_t first, int pipe);
  SoakedSeed run_one(std::uint64_t seed);
  void disturb(Session& session, const SoakPlan& plan, SoakWitness& witness);
  SoakedSeed result_of(Worker& worker, std::uint64_t seed);
  SoakedSeed lost(Worker& worker, std::uint64_t seed, bool stuck);
  static std::optional<std::string> line_from(Worker& worker, std::chrono::milliseconds timeout);

  ScriptEngine& engine_;
  SoakRequest request_;
  SoakReference reference_;
  Page* page_ = nullptr;
};

/// The reference run without disturbance: how long it takes, what is recorded, which roles there
/// are.
/// The rig's own seed is the same in all runs, so that up to the first disturbance each must equal
/// this one to the bit.
void Soak::run_undisturbed() {
  RunRequest alone = request_.run;
  alone.where.out =
      (fs::path(request_.run.where.out) / fmt::format("soak_reference_{:06}", request_.first))
          .string();
  SilentListener quiet;
  const RunResult result =
      run_protocol(engine_, alone, quiet, [this](const Recorder& recorder, OpenRig&) {
        reference_.streams = recorder.streams();
        reference_.roles = simulated_roles(recorder.start().rig["resolved"]);
        reference_.horizon = recorder.end()->experiment_time;
      });
  fs::remove_all(alone.where.out);
  if (result.outcome != Outcome::completed)
    throw ConfigError("soak: " + request_.run.what.protocol_file +
                      " does not complete when it is left alone: " + result.reason);
}

/// On the run's clock: the stop, or the kill, of the plan.
void Soak::disturb(Session& session, const SoakPlan& plan, SoakWitness& witness) {
  // A plan without either disturbs by its faults alone.
  if (!plan.kill && plan.tier == StopTier::none) return;
  // `session` ends its tasks before `plan` and `witness`, which run_one() holds, go.
  session.keep(session.clock.spawn("soak", [this, &session, &plan, &witness] {
    session.clock.sleep_until(from_seconds(plan.at));
    if (plan.kill) {
      page_->samples = samples_kept(session.recorder);
      page_->noted = true;
      // Wall time on purpose: the promise is about the disk, not about the run's clock.
      std::this_thread::sleep_for(1s);  // what is promised is what is older than that
      raise(SIGKILL);
    }
    // A run that is ending by itself at this moment may complete or stop, and either is right: only
    // a stop that came while the script ran is expected in the outcome.
    const RunPhase phase = session.control.status().phase;
    witness.asked = phase != RunPhase::ended && phase != RunPhase::stopping &&
                    phase != RunPhase::stop_requested;
    if (phase == RunPhase::ended) return;
    session.control.request_and_wait(plan.tier);
    // Only an abort promises zero within a time; and not through a wire that carries nothing.
    if (plan.tier < StopTier::abort || coils_unreachable(plan)) return;
    session.clock.sleep_for(from_seconds(kSafeWithin));
    // As they are, and not as they are believed: over a link that swallows answers a zero arrives.
    if (outputs_of(*session.faults->laboratory()) > kZeroOutput)
      witness.violations.push_back("the coils were energized 250 ms after the abort");
  }));
}

/// The file of the protocol that misbehaves so.
std::string Soak::script_of(std::uint64_t seed, const std::string& misbehavior) const {
  const fs::path file = folder_of(seed).string() + ".lua";
  fs::create_directories(file.parent_path());
  std::ofstream out(file);
  out << misbehaving(read_whole_file(request_.run.what.protocol_file), misbehavior);
  out.close();
  if (!out) throw std::runtime_error(file.string() + ": cannot be written");
  return file.string();
}

/// One run under its plan, in the worker: checked while its rig is still open, and again by its
/// result.
/// The digest is of the canonical export: two soaks of the same program agree seed by seed, except
/// where the wall clock has a part in the record, as with faults of the disk.
SoakedSeed Soak::run_one(std::uint64_t seed) {
  const SoakPlan plan = plan_of(seed);
  SoakWitness witness;
  SoakedSeed one{seed, to_string(plan)};
  RunRequest request = request_.run;
  request.where.out = folder_of(seed).string();
  if (plan.machine != 0) request.how.seed = plan.machine;
  // Beside the seed's folder, in which is one run and nothing else.
  if (!plan.script.empty()) request.what.protocol_file = script_of(seed, plan.script);
  request.how.companion = [&](Session& session) {
    for (const Fault& fault : plan.faults) session.faults->add(fault);
    disturb(session, plan, witness);
  };
  bool wall = false;  // has a part in what is recorded
  for (const Fault& fault : plan.faults) wall = wall || fault.role == "disk";
  SilentListener quiet;
  try {
    const RunResult result =
        run_protocol(engine_, request, quiet, [&](const Recorder& recorder, OpenRig& rig) {
          one.violations = check_ended(plan, witness, reference_, recorder, rig);
          one.ending = fmt::format("{} after {:.3f} s", to_string(recorder.end()->outcome),
                                   recorder.end()->experiment_time);
          if (!wall) one.digest = sha256(canonical_export(recorder));
        });
    one.outcome = to_string(result.outcome);
    if (!wall && !result.reason.empty()) one.ending += ": " + result.reason;
    for (const std::string& violation : check_result(plan, witness, result))
      one.violations.push_back(violation);
  } catch (const std::exception& error) {
    one.ending = one.outcome = "refused";
    one.violations.push_back(std::string("the run did not begin: ") + error.what());
  }
  return one;
}

/// The worker process: run after run until one kills it, a line of JSON each. In one process, so
/// that what leaks from run to run shows.
/// The footprint is compared with that of the first runs, which fill caches, load libraries lazily
/// and let the allocator's arenas grow.
void Soak::work(std::uint64_t first, int pipe) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // the worker does not outlive its parent
  setpgid(0, 0);                     // the terminal's Ctrl-C is for the parent
  Footprint base;
  for (std::uint64_t seed = first, done = 0; seed < request_.first + request_.count;
       ++seed, ++done) {
    SoakedSeed one = run_one(seed);
    Footprint now = footprint();
    // A thread that was joined is counted for a moment longer: the kernel wakes who waits for it
    // before it takes its entry away.
    for (int i = 0; i < 100 && done > 0 && now.threads > base.threads; ++i) {
      std::this_thread::sleep_for(10ms);
      now = footprint();
    }
    // Heap: the largest of the first runs; descriptors and threads: those of the first.
    if (done < kWarmUp) {
      base.heap = std::max(base.heap, now.heap);
      base.descriptors = done == 0 ? now.descriptors : base.descriptors;
      base.threads = done == 0 ? now.threads : base.threads;
    }
    if (now.descriptors > base.descriptors)
      one.violations.push_back(
          fmt::format("{} descriptors are open, {} were", now.descriptors, base.descriptors));
    if (now.threads > base.threads)
      one.violations.push_back(
          fmt::format("{} threads live on, {} did", now.threads, base.threads));
    if (now.heap > base.heap + kHeapGrowth)
      one.violations.push_back(
          fmt::format("{} kB of heap are in use, {} kB were", now.heap >> 10U, base.heap >> 10U));
    const std::string line =
        to_json(one).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    if (::write(pipe, line.data(), line.size()) != static_cast<ssize_t>(line.size())) break;
  }
  _exit(0);  // no destructors of what belongs to the parent
}

/// Forks: the engine and the reference are there already. Only the calling thread goes on in the
/// child.
/// The undisturbed run has joined its own threads by then.
Soak::Worker Soak::start_worker(std::uint64_t first) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    throw std::runtime_error(std::string("soak: ") + std::strerror(errno));
  const pid_t process = fork();
  if (process < 0) throw std::runtime_error(std::string("soak: ") + std::strerror(errno));
  if (process == 0) {
    // The child never returns from work().
    ::close(ends[0]);
    work(first, ends[1]);
  }
  ::close(ends[1]);
  return {process, ends[0], ""};
}

/// Nothing at its end, or when it does not say anything for so long.
/// Bytes behind the line stay in `received` for the next call.
std::optional<std::string> Soak::line_from(Worker& worker, std::chrono::milliseconds timeout) {
  const auto until = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    const std::size_t end = worker.received.find('\n');
    if (end != std::string::npos) {
      std::string line = worker.received.substr(0, end);
      worker.received.erase(0, end + 1);
      return line;
    }
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        until - std::chrono::steady_clock::now());
    pollfd one{worker.pipe, POLLIN, 0};
    if (left <= 0ms || ::poll(&one, 1, static_cast<int>(left.count())) == 0) return std::nullopt;
    std::array<char, 4096> bytes{};
    const ssize_t got = ::read(worker.pipe, bytes.data(), bytes.size());
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return std::nullopt;
    worker.received.append(bytes.data(), static_cast<std::size_t>(got));
  }
}

/// The worker is gone, or stands still, with this seed.
/// A worker that died by its own plan's kill is no violation: its record is recovered and judged.
/// Death by another signal, or an exit, is a crash.
SoakedSeed Soak::lost(Worker& worker, std::uint64_t seed, bool stuck) {
  if (stuck) ::kill(worker.process, SIGKILL);
  int status = 0;
  // Reaped here, so that a soak of thousands of seeds leaves no zombies.
  while (::waitpid(worker.process, &status, 0) < 0 && errno == EINTR) continue;
  ::close(worker.pipe);
  worker.process = -1;
  const SoakPlan plan = plan_of(seed);
  SoakedSeed one{seed, to_string(plan), "killed", "lost"};
  if (stuck) {
    one.ending = "stuck";
    one.violations.push_back(
        fmt::format("it did not end within {} s of wall time", request_.patience.count()));
  } else if (plan.kill && page_->noted && WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) {
    one.violations = check_killed(folder_of(seed), page_->samples);
  } else {
    one.ending = "crashed";
    one.violations.push_back(WIFSIGNALED(status)
                                 ? fmt::format("the process ended by signal {}", WTERMSIG(status))
                                 : fmt::format("the process left with {}", WEXITSTATUS(status)));
  }
  page_->noted = false;
  return one;
}

/// The worker's line about this seed, or what became of the worker.
/// No line and no patience used up means that the pipe was closed: the process is gone.
SoakedSeed Soak::result_of(Worker& worker, std::uint64_t seed) {
  const auto began = std::chrono::steady_clock::now();
  const auto line = line_from(worker, request_.patience);
  if (!line)
    return lost(worker, seed, std::chrono::steady_clock::now() - began >= request_.patience);
  const nlohmann::json said = nlohmann::json::parse(*line);
  return {said["seed"],    said["plan"],   said["ending"],
          said["outcome"], said["digest"], said["violations"]};
}

/// One worker at a time; a new one takes over after a seed that killed or stuck its process.
void Soak::run(const std::function<void(const SoakedSeed&)>& report) {
  Worker worker;
  for (std::uint64_t seed = request_.first; seed < request_.first + request_.count; ++seed) {
    if (worker.process < 0) worker = start_worker(seed);
    const SoakedSeed one = result_of(worker, seed);
    if (one.violations.empty()) {
      fs::remove_all(folder_of(seed));
      fs::remove(folder_of(seed).string() + ".lua");
    }
    report(one);
  }
  if (worker.process >= 0) {
    ::close(worker.pipe);
    ::waitpid(worker.process, nullptr, 0);
  }
}

}  // namespace

nlohmann::json to_json(const SoakResult& result) {
  return {{"seeds", result.seeds},
          {"violations", result.violations},
          {"bad_seeds", result.bad_seeds},
          {"outcomes", result.outcomes},
          {"wall_time", result.seconds}};
}

namespace {

constexpr std::uint64_t kLeastGroup = 16;  // seeds: fewer would not show what leaks

/// Seeds in groups that keep all processes busy to the end.
PointPlan soak_groups(const SoakRequest& request) {
  const RunRequest& run = request.run;
  PointPlan plan{{{"kind", kSoakKind},
                  {"protocol", run.what.protocol_file},
                  {"arguments", run.what.arguments},
                  {"rig", run.where.rig_file},
                  {"out", fs::absolute(run.where.out).lexically_normal().string()},
                  {"seed", run.how.seed},
                  {"patience", request.patience.count()}},
                 {}};
  const int beside = request.slurm ? request.slurm->tasks : request.jobs;
  const auto jobs = static_cast<std::uint64_t>(std::max(beside, 1));
  const std::uint64_t group =
      jobs == 1 ? request.count : std::max(kLeastGroup, request.count / (4 * jobs));
  for (std::uint64_t done = 0; done < request.count; done += group) {
    const nlohmann::json what = {{"first", request.first + done},
                                 {"count", std::min(group, request.count - done)}};
    plan.points.push_back({point_key(what), what});
  }
  return plan;
}

SoakedSeed soaked_seed(const nlohmann::json& said) {
  return {said.at("seed"),    said.at("plan"),   said.at("ending"),
          said.at("outcome"), said.at("digest"), said.at("violations")};
}

/// Lines of the groups in the order of the seeds: those of a later group wait.
class InOrder {
 public:
  InOrder(std::size_t groups, std::function<void(const std::string&)> take)
      : waiting_(groups), ended_(groups, false), take_(std::move(take)) {}
  void said(std::size_t group, const std::string& line) {
    waiting_[group].push_back(line);
    drain();
  }
  void ended(std::size_t group) {
    ended_[group] = true;
    drain();
  }

 private:
  void drain() {
    for (; next_ < waiting_.size(); ++next_) {
      for (const std::string& line : waiting_[next_]) take_(line);
      waiting_[next_].clear();
      if (!ended_[next_]) return;
    }
  }
  std::vector<std::vector<std::string>> waiting_;
  std::vector<bool> ended_;
  std::size_t next_ = 0;
  std::function<void(const std::string&)> take_;
};

void add_seed(SoakResult& result, const SoakedSeed& one) {
  ++result.seeds;
  ++result.outcomes[one.outcome];
  result.violations += one.violations.size();
  if (!one.violations.empty()) result.bad_seeds.push_back(one.seed);
}

}  // namespace

// What is wrong with the request is said by the group that finds it, and again by this process.
nlohmann::json run_soak_point(ScriptEngine& engine, const nlohmann::json& head,
                              const nlohmann::json& what,
                              const std::function<void(const std::string&)>& say) {
  SoakRequest request;
  request.run.what.protocol_file = head.at("protocol");
  request.run.what.arguments = head.at("arguments").get<std::vector<std::string>>();
  request.run.where.rig_file = head.at("rig");
  request.run.where.out = head.at("out");
  request.run.how.seed = head.at("seed").get<std::uint64_t>();
  request.patience = std::chrono::seconds(head.at("patience").get<std::int64_t>());
  request.first = what.at("first").get<std::uint64_t>();
  request.count = what.at("count").get<std::uint64_t>();
  // Both said and kept in the mark: what a task of Slurm says, only its log hears.
  std::vector<std::string> lines;
  try {
    Soak soaking(engine, request);
    soaking.run_undisturbed();
    soaking.run([&say, &lines](const SoakedSeed& one) {
      lines.push_back(to_json(one).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
      say(lines.back());
    });
  } catch (const std::exception& error) {
    return {{"outcome", "refused"}, {"reason", error.what()}};
  }
  return {{"outcome", "completed"}, {"seeds", lines}};
}

// Real instruments are refused before anything else: faults are injected, and processes killed in
// the middle of a motion.
SoakResult soak(ScriptEngine& engine, const SoakRequest& request,
                const std::function<void(const SoakedSeed&)>& report) {
  if (has_real_instruments(engine.load_rig(request.run.where.rig_file)))
    throw ConfigError("soak: " + request.run.where.rig_file +
                      " has real instruments: only a rig that is simulated throughout "
                      "is broken on purpose");
  check_request(engine, request.run);
  const auto began = std::chrono::steady_clock::now();
  const PointFolder folder =
      PointFolder::create(make_run_folder(request.run.where.out, "soak"), soak_groups(request));
  SoakResult result;
  InOrder lines(folder.points().size(), [&](const std::string& line) {
    const SoakedSeed one = soaked_seed(nlohmann::json::parse(line));
    add_seed(result, one);
    report(one);
  });
  std::string refusal;
  ExecuteOptions options;
  options.jobs = request.jobs;
  options.slurm = request.slurm;
  options.note = request.note;
  options.said = [&lines](std::size_t group, const std::string& line) { lines.said(group, line); };
  options.finished = [&](std::size_t group, const nlohmann::json& mark) {
    if (mark.at("outcome") != "completed") refusal = mark.value("reason", "");
    if (request.slurm)
      for (const std::string& line : mark.value("seeds", std::vector<std::string>()))
        lines.said(group, line);
    lines.ended(group);
  };
  const PointBody body = [&](const PlannedPoint& planned, std::size_t, const SayLine& say) {
    return run_soak_point(engine, folder.head(), planned.what, say);
  };
  const RunnerEnd end = execute_points(folder, body, options);
  // Tasks of Slurm may still go on in it.
  if (end == RunnerEnd::all_done || !request.slurm) fs::remove_all(folder.folder());
  if (!refusal.empty()) throw ConfigError(refusal);
  if (end != RunnerEnd::all_done) throw std::runtime_error("soak: stopped before its end");
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return result;
}

}  // namespace vitreo
