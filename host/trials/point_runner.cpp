// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_runner.h"

#include "host/record/disk_watch.h"
#include "host/record/record_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <deque>
#include <map>
#include <set>
#include <thread>

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using Moment = std::chrono::steady_clock::time_point;

constexpr int kTries = 2;                        // of a point whose process dies
constexpr std::chrono::milliseconds kTurn = 1s;  // between two looks at the clock
constexpr const char* kResult = "result ";       // begins the last line of a worker

/// One call of run_points(). Claims are taken as late as possible, one for each free process, so
/// that others that share the folder find work too.
class Runner {
 public:
  Runner(const PointFolder& folder, const PointBody& body, const RunnerOptions& options)
      : folder_(folder), body_(body), options_(options) {
    // From the offset once round, so that tasks of an array seldom meet.
    const std::vector<std::size_t> left = folder.unfinished();
    const auto first = std::lower_bound(left.begin(), left.end(), options.offset);
    waiting_.assign(first, left.end());
    waiting_.insert(waiting_.end(), left.begin(), first);
  }
  RunnerEnd run();

 private:
  struct Work {
    // Gives the point back where it is destroyed without having been kept.
    std::unique_ptr<PointClaim> claim;
    std::string result;
    int tries = 1;
  };

  void start_some();
  void start(std::size_t point, std::unique_ptr<PointClaim> claim, int tries);
  void ended(std::size_t point, int status);
  void finish(std::size_t point, nlohmann::json result, const Work& work);
  void keep_alive();
  void pass_stops();
  void give_up(const std::string& why);
  bool look_again();
  bool is_full(std::size_t others) const;
  std::string full_text() const;
  void note(const std::string& text) const {
    if (options_.note) options_.note(text);
  }

  const PointFolder& folder_;
  const PointBody& body_;
  const RunnerOptions& options_;
  WorkerPool pool_;
  std::deque<std::size_t> waiting_;
  std::vector<std::size_t> elsewhere_;  // other processes work at these
  std::map<std::size_t, Work> under_way_;
  Moment beat_{};
  int stops_ = 0;  // passed on so far
  bool told_ = false;
  std::string failure_;
};

/// Whether a run beside `others` could not begin, or would be stopped, by the recorder's own
/// limits: that is no result of its point.
bool Runner::is_full(std::size_t others) const {
  const DiskLimits limits;
  const bool frames = !folder_.head().value("frames", nlohmann::json::array()).empty();
  // Each run under way may still lay down its reserve.
  return free_bytes(folder_.folder()) <
         (frames ? limits.stop_bytes_with_frames : limits.stop_bytes) +
             (others + 1) * limits.reserve_bytes;
}

std::string Runner::full_text() const {
  return folder_.folder().string() +
         ": the disk is full: " + size_text(free_bytes(folder_.folder())) +
         " are free, too little for a run";
}

// The first failure is kept: those that follow from it say less.
void Runner::give_up(const std::string& why) {
  if (failure_.empty()) failure_ = why;
}

// The child inherits protocol and rig as they were read; the last line that it says is its result.
void Runner::start(std::size_t point, std::unique_ptr<PointClaim> claim, int tries) {
  under_way_[point] = {std::move(claim), "", tries};
  const PlannedPoint& planned = folder_.points()[point];
  pool_.start(point, [this, &planned, point](const SayLine& say) {
    say(kResult + dumped(body_(planned, point, say)));
  });
}

// Room is asked for before each start: a run that finds the disk full is no result of its point.
void Runner::start_some() {
  while (!waiting_.empty() && under_way_.size() < static_cast<std::size_t>(options_.jobs) &&
         StopCount::count() == 0 && failure_.empty()) {
    const std::size_t point = waiting_.front();
    waiting_.pop_front();
    try {
      if (is_full(under_way_.size())) throw std::runtime_error(full_text());
      if (auto claim = folder_.claim(point)) {
        if (claim->attempt() > 1) note(fmt::format("point {}: begun before, done again", point));
        start(point, std::move(claim), 1);
      } else if (!folder_.is_marked(point)) {
        elsewhere_.push_back(point);
      }
    } catch (const std::exception& error) {
      give_up(error.what());
    }
  }
}

// Marked before the claim is kept: between the two a death of this process makes the point be done
// again never, since it is finished.
void Runner::finish(std::size_t point, nlohmann::json result, const Work& work) {
  const bool whole = result.value("outcome", "") == "completed";
  if (!whole && StopCount::count() > 0) return;  // it was told to: the claim is given back
  if (!whole && is_full(0))
    return give_up(full_text() + " (point " + std::to_string(point) + ": " +
                   result.value("reason", "") + ")");
  result["tries"] = work.tries;
  // False where another process was first: its result stands, and is not told twice.
  if (folder_.mark(point, result) && options_.finished) options_.finished(point, result);
  work.claim->keep();
}

// A worker that says no result has died: by a crash, or killed for its memory. It is tried again,
// since the reason may lie in the machine; twice is a result.
void Runner::ended(std::size_t point, int status) {
  Work work = std::move(under_way_.at(point));
  under_way_.erase(point);
  try {
    nlohmann::json result = nlohmann::json::parse(work.result, nullptr, false);
    if (result.is_object()) return finish(point, std::move(result), work);
    if (StopCount::count() > 0) return;
    const std::string how = "its process " + status_text(status);
    note(fmt::format("point {}: {}", point, how));
    if (work.tries < kTries) return start(point, std::move(work.claim), work.tries + 1);
    finish(point, {{"outcome", "lost"}, {"exit_code", 5}, {"reason", how}}, work);
  } catch (const std::exception& error) {
    give_up(error.what());
  }
}

// At most once in a beat: on a shared folder each is a question to its server.
void Runner::keep_alive() {
  const Moment now = std::chrono::steady_clock::now();
  if (now - beat_ < std::chrono::duration<double>(PointClaim::kBeat)) return;
  beat_ = now;
  for (const auto& [point, work] : under_way_) work.claim->beat();
}

// The first ends the runs in order, the second aborts them, the third kills, as InterruptScope of
// each run has it.
void Runner::pass_stops() {
  for (; stops_ < StopCount::count(); ++stops_) {
    if (stops_ == 0) note("stopping: the points under way end first");
    pool_.signal(SIGTERM);
  }
}

/// Points of other processes, whose owners may have died by now; false where nothing is left to
/// wait for. One that does not wait asks once more before it leaves.
bool Runner::look_again() {
  std::erase_if(elsewhere_, [this](std::size_t point) { return folder_.is_marked(point); });
  if (elsewhere_.empty() || (told_ && !options_.wait_for_others)) return false;
  if (!told_ && options_.wait_for_others)
    note(fmt::format("waiting for {} points at which other processes work", elsewhere_.size()));
  told_ = true;
  if (options_.wait_for_others) std::this_thread::sleep_for(kTurn);
  waiting_.assign(elsewhere_.begin(), elsewhere_.end());
  elsewhere_.clear();
  return true;
}

// One thread: it forks, reads pipes and keeps claims alive. After a failure or a stop nothing new
// is begun, and what is under way is waited for.
RunnerEnd Runner::run() {
  for (;;) {
    start_some();
    if (under_way_.empty()) {
      if (!failure_.empty())
        throw std::runtime_error(failure_ + "; what is finished stays, and --resume goes on");
      if (StopCount::count() > 0) return RunnerEnd::stopped;
      if (waiting_.empty() && !look_again())
        return elsewhere_.empty() ? RunnerEnd::all_done : RunnerEnd::some_left;
      continue;
    }
    // All lines of a worker come before its end, its result among them.
    for (const WorkerPool::Event& event : pool_.wait(kTurn)) {
      if (event.ended)
        ended(event.task, event.status);
      else if (event.line.starts_with(kResult))
        under_way_.at(event.task).result = event.line.substr(std::string_view(kResult).size());
      else if (options_.said)
        options_.said(event.task, event.line);
    }
    keep_alive();
    pass_stops();
  }
}

}  // namespace

RunnerEnd run_points(const PointFolder& folder, const PointBody& body,
                     const RunnerOptions& options) {
  // Before the first fork: the children put the signals back (run_child()).
  const StopCount counting;
  return Runner(folder, body, options).run();
}

}  // namespace vitreo
