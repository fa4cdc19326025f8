// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <signal.h>
#include <thread>
#include <time.h>
#include <unistd.h>
#include <utility>

namespace vitreo {
namespace {

// The control that a signal handler on the script's thread acts on; one run at a time has it.
std::atomic<RunControl*> the_control{nullptr};

/// The name of a process, from /proc/PID/comm; "" where it is gone. Async-signal-safe: open, read
/// and close are, sprintf is not.
void name_of_process(pid_t process, std::array<char, 16>& name) noexcept {
  std::array<char, 32> path{"/proc/"};
  std::array<char, 12> digits{};
  std::size_t count = 0;
  for (pid_t rest = process; rest > 0 && count < digits.size(); rest /= 10)
    digits[count++] = static_cast<char>('0' + rest % 10);
  std::size_t at = std::strlen(path.data());
  while (count > 0) path[at++] = digits[--count];
  std::memcpy(path.data() + at, "/comm", sizeof "/comm");
  name = {};
  const int file = open(path.data(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return;
  const ssize_t read_bytes = read(file, name.data(), name.size() - 1);
  close(file);
  if (read_bytes <= 0) name = {};
  for (char& c : name)
    if (c == '\n') c = '\0';
}

const char* signal_name(int number) {
  return number == SIGINT    ? "SIGINT"
         : number == SIGTERM ? "SIGTERM"
         : number == SIGHUP  ? "SIGHUP"
         : number == SIGQUIT ? "SIGQUIT"
                             : "a signal";
}

/// Who sends which signal: Ctrl-C is a person's; Slurm's step daemon ends a job by SIGTERM, and so
/// do its tools within a job.
EndCause cause_of_signal(int number, const std::string& sender) {
  const char* const variable = std::getenv("SLURM_JOB_ID");
  const std::string job = variable != nullptr ? variable : "";
  if (sender == "slurmstepd" || (!job.empty() && number == SIGTERM))
    return {"scheduler", job.empty() ? "Slurm" : "Slurm, job " + job, "", signal_name(number)};
  if (number == SIGINT) return {"person", "", "the terminal", signal_name(number)};
  return {"signal", sender, "", signal_name(number)};
}

/// "by the operator", "by the scheduler (Slurm, job 7)", "by SIGTERM of systemd".
std::string reason_of(const EndCause& cause) {
  if (cause.by == "scheduler") return "by the scheduler (" + cause.name + ")";
  if (cause.by == "person") return "by the operator";
  return "by " + cause.signal + (cause.name.empty() ? "" : " of " + cause.name);
}

// SIGUSR1 on the script's thread: it breaks off a system call and runs the delivery there.
extern "C" void on_delivery(int) { deliver_to_script(); }

}  // namespace

RunControl* attached_control() noexcept { return the_control; }

/// Async-signal-safe: atomics, and the engine's and the clock's interrupt(), which are so too.
void deliver_to_script() noexcept {
  RunControl* const control = the_control;
  if (!control) return;
  if (control->hooks_.interrupt) control->hooks_.interrupt();
  ++control->deliveries_;
}

RunControl::RunControl() : script_(pthread_self()) { sem_init(&request_, 0, 0); }

// Detached before the semaphore goes, which a signal handler may post.
RunControl::~RunControl() {
  detach();
  sem_destroy(&request_);
}

// The handler is installed for the process, and acts only where `the_control` is set.
void RunControl::attach(ScriptHooks hooks) {
  hooks_ = std::move(hooks);
  safe_ = false;
  the_control = this;
  // Without SA_RESTART: a system call that the script waits in returns with EINTR.
  struct sigaction action = {};
  action.sa_handler = on_delivery;
  sigaction(SIGUSR1, &action, nullptr);
}

void RunControl::detach() {
  // Another run's control, attached since, is left alone.
  RunControl* mine = this;
  // The handler stays: a request that was under way is then without effect instead of ending the
  // process.
  the_control.compare_exchange_strong(mine, nullptr);
}

StopTier RunControl::next(StopTier tier) noexcept {
  return tier == StopTier::none ? StopTier::stop : std::max(tier, StopTier::abort);
}

void RunControl::request(StopTier tier) noexcept {
  if (tier == StopTier::none) return;
  if (idle_) {
    // No script is there to be interrupted: the prompt looks every 20 ms, the watchdog is woken.
    between_.ask(tier);
    ++changes_;
    return wake_watchdog();
  }
  if (tier < tier_) return;
  // A higher tier includes the lower ones; the first request of each starts its deadline.
  for (int i = 1; i <= static_cast<int>(tier); ++i) {
    std::int64_t never = 0;
    requested_at_[static_cast<std::size_t>(i)].compare_exchange_strong(never,
                                                                       StopBetween::steady_now());
  }
  // Raised only: a lower request beside a higher one changes nothing.
  StopTier before = tier_;
  while (before < tier && !tier_.compare_exchange_weak(before, tier)) {
  }
  ++changes_;
  sem_post(&request_);
  // Its statement has ended meanwhile: what this has left behind is of what goes on now.
  if (idle_) return between_.ask(tier);
  // On the script's own thread the delivery is a call; else a signal, which also breaks off a
  // blocking system call.
  if (pthread_equal(script_, pthread_self()))
    deliver_to_script();
  else if (the_control == this)
    pthread_kill(script_, SIGUSR1);
}

void RunControl::request(StopTier tier, const std::string& reason, const EndCause& cause) {
  if (idle_) {
    between_.ask(tier, reason, cause);
    ++changes_;
    return wake_watchdog();
  }
  // Not atomic with the request; of two at once either reason is a true one.
  if (tier > tier_) {
    set_reason(reason);
    const std::lock_guard lock(mutex_);
    cause_ = cause;
    signal_is_stronger_ = false;
  }
  request(tier);
}

void RunControl::request_by_signal(int number, pid_t sender, StopTier tier) noexcept {
  // What the statement before was ended by stays.
  if (idle_) {
    between_.ask(tier, number);
    ++changes_;
    return wake_watchdog();
  }
  if (signal_ == 0) {
    if (sender > 0) name_of_process(sender, sender_);
    signal_ = number;
  }
  if (tier > tier_) signal_is_stronger_ = true;
  request(tier);
}

void RunControl::request_and_wait(StopTier tier) noexcept {
  // Of 0.1 ms, 2 s: a thread that does not exist any more is not waited for.
  constexpr int kPatience = 20000;
  const unsigned long before = deliveries_;
  request(tier);
  // Returns when the delivery was counted, there is nothing to deliver to, or time is up.
  for (int i = 0; i < kPatience && deliveries_ == before && the_control == this && !idle_; ++i)
    std::this_thread::sleep_for(std::chrono::microseconds(100));
}

void RunControl::request_pause(const std::string& checkpoint) {
  const std::lock_guard lock(mutex_);
  pause_at_ = checkpoint;
  pause_ = true;
  // Shown at once; it takes effect at the checkpoint.
  if (status_.phase == RunPhase::running) status_.phase = RunPhase::pause_requested;
  status_.note = pause_note();
  ++changes_;
}

std::string RunControl::pause_note() const {
  return pause_at_.empty() ? "at the next checkpoint" : "at the checkpoint '" + pause_at_ + "'";
}

// A run that is paused already goes on by itself: its wait at the checkpoint sees resumed().
void RunControl::resume() {
  const std::lock_guard lock(mutex_);
  pause_ = false;
  if (status_.phase == RunPhase::pause_requested) status_.phase = RunPhase::running;
  status_.note.clear();
  ++changes_;
}

/// Called at each checkpoint: without a request it takes no lock.
bool RunControl::pause_wanted_at(const std::string& checkpoint) const {
  if (!pause_) return false;
  const std::lock_guard lock(mutex_);
  return pause_at_.empty() || pause_at_ == checkpoint;
}

bool RunControl::resumed() const { return !pause_; }

void RunControl::override_suspension(const std::string& by) {
  const std::lock_guard lock(mutex_);
  override_by_ = by;
}

std::string RunControl::take_override() {
  const std::lock_guard lock(mutex_);
  return std::exchange(override_by_, {});
}

// Locks, so it is never called from a signal handler; request(tier) alone is safe there.
void RunControl::set_reason(const std::string& reason) {
  const std::lock_guard lock(mutex_);
  reason_ = reason;
}

std::string RunControl::reason() const {
  const std::lock_guard lock(mutex_);
  if (!reason_.empty() && !signal_is_stronger_) return reason_;
  const int number = signal_;
  return number == 0 ? "by the operator" : reason_of(cause_of_signal(number, sender_.data()));
}

EndCause RunControl::cause() const {
  const std::lock_guard lock(mutex_);
  if (!cause_.by.empty() && !signal_is_stronger_) return cause_;
  const int number = signal_;
  return number == 0 ? EndCause{"person"} : cause_of_signal(number, sender_.data());
}

void RunControl::set_location(const std::string& location) {
  const std::lock_guard lock(mutex_);
  location_ = location;
}

std::string RunControl::location() const {
  const std::lock_guard lock(mutex_);
  return location_;
}

void RunControl::set_phase(RunPhase phase, const std::string& note) {
  const std::lock_guard lock(mutex_);
  status_.phase = phase;
  status_.note = note;
  ++changes_;
}

void RunControl::set_waiting_for(const std::string& what) {
  const std::lock_guard lock(mutex_);
  if (status_.waiting_for == what) return;
  status_.waiting_for = what;
  ++changes_;
}

void RunControl::set_progress(double fraction, const std::string& doing) {
  const std::lock_guard lock(mutex_);
  status_.progress = fraction;
  if (!doing.empty()) status_.doing = doing;
  status_.remaining = remaining_.told(fraction).value_or(-1);
  ++changes_;
}

/// The true state: a request that the script has not felt yet is "stop requested", not "stopping".
RunStatus RunControl::status() const {
  const std::lock_guard lock(mutex_);
  RunStatus status = status_;
  status.tier = std::max(tier(), between_.tier());
  const bool not_felt_yet = status.phase == RunPhase::running || status.phase == RunPhase::ready ||
                            status.phase == RunPhase::pause_requested ||
                            status.phase == RunPhase::paused || status.phase == RunPhase::suspended;
  if (status.tier != StopTier::none && not_felt_yet) {
    status.phase = RunPhase::stop_requested;
    status.note.clear();
  }
  return status;
}

void RunControl::begin_stopping() {
  felt_ = true;
  // An abort zeroes the outputs before the script's clean-up runs; a stop after it.
  set_phase(RunPhase::stopping);
  if (tier() >= StopTier::abort) make_safe();
}

// The baton is with the caller. The lock is not held during the hook, which waits for instruments,
// so that the faces can ask for the status meanwhile.
void RunControl::make_safe() {
  ++making_safe_;
  // Once, by whichever comes first: the script's thread or the watchdog.
  if (hooks_.make_safe && !safe_.exchange(true)) {
    std::vector<std::string> failures = hooks_.make_safe();
    const std::lock_guard lock(mutex_);
    failures_.insert(failures_.end(), failures.begin(), failures.end());
  }
  --making_safe_;
}

std::vector<std::string> RunControl::failures() const {
  const std::lock_guard lock(mutex_);
  return failures_;
}

// The deadlines of a stop are over with its statement.
void RunControl::forget_end() noexcept {
  tier_ = StopTier::none;
  for (auto& time : requested_at_) time = 0;
}

void RunControl::set_idle(bool idle) {
  // First: a request from here on is of what goes on between two statements.
  if (idle) idle_ = true;
  forget_end();
  if (idle) {
    const std::lock_guard lock(mutex_);
    status_ = {};
    status_.phase = RunPhase::ready;
    ++changes_;
    return;
  }
  // A new statement, with a stop, a reason and a safe state of its own.
  safe_ = false;
  felt_ = false;
  signal_is_stronger_ = false;
  // Asked in the last moment, and not answered: it ends this statement before it begins.
  const StopBetween::Asked asked = between_.take();
  std::string note;
  {
    const std::lock_guard lock(mutex_);
    reason_ = asked.reason;
    cause_ = asked.cause;
    signal_ = asked.signal;
    if (pause_) note = pause_note();
  }
  set_phase(pause_ ? RunPhase::pause_requested : RunPhase::running, note);
  idle_ = false;
  // With what came since; what comes still later, by a thread that has just seen `idle_`, the
  // watchdog answers.
  request(std::max(asked.tier, between_.take().tier));
}

void RunControl::make_safe_between() {
  const StopBetween::Asked asked = between_.take();
  if (asked.tier == StopTier::none) return;
  // Of a request that came as its statement ended.
  if (idle_) forget_end();
  AnsweredStop answered{asked.reason, asked.cause, {}};
  if (hooks_.make_safe) answered.failures = hooks_.make_safe();
  if (answered.reason.empty()) {
    answered.cause = asked.signal == 0 ? EndCause{"person"} : cause_of_signal(asked.signal, "");
    answered.reason = reason_of(answered.cause);
  }
  const std::lock_guard lock(mutex_);
  failures_.insert(failures_.end(), answered.failures.begin(), answered.failures.end());
  answered_ = answered;
  ++changes_;
}

std::optional<AnsweredStop> RunControl::take_answered() {
  const std::lock_guard lock(mutex_);
  return std::exchange(answered_, {});
}

void RunControl::wait_for_request(std::chrono::milliseconds patience) {
  // Monotonic, as steady_clock: not affected when the wall clock is set.
  timespec until = {};
  clock_gettime(CLOCK_MONOTONIC, &until);
  const std::int64_t nanoseconds = until.tv_nsec + std::chrono::nanoseconds(patience).count();
  until.tv_sec += nanoseconds / 1'000'000'000;
  until.tv_nsec = nanoseconds % 1'000'000'000;
  sem_clockwait(&request_, CLOCK_MONOTONIC, &until);
}

// Zero stands for never: the steady clock is far beyond it when a run begins.
std::optional<std::chrono::steady_clock::duration> RunControl::since(StopTier tier) const {
  const std::int64_t requested = requested_at_[static_cast<std::size_t>(tier)];
  if (requested == 0) return std::nullopt;
  return std::chrono::nanoseconds(StopBetween::steady_now() - requested);
}

}  // namespace vitreo
