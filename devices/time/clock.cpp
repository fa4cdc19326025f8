// The virtual clock: threads that hand one baton round, and a time that jumps to whatever is due
// next.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include "devices/time/quiet_thread.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

namespace vitreo {

Time from_seconds(double seconds) {
  const double nanoseconds = seconds * 1e9;
  // The largest double below 2^63; written so that a NaN fails too.
  if (!(std::abs(nanoseconds) <= 9223372036854774784.0))
    throw std::invalid_argument("seconds: " + std::to_string(seconds) + " is not a time that fits");
  return Time(std::llround(nanoseconds));
}

namespace {

constexpr Time kSlice =
    std::chrono::milliseconds(10);  // how long a real-time wait may be deaf to interrupt()
constexpr Time kForgetLag =
    std::chrono::milliseconds(100);  // a pace that fell back further does not rush to catch up
/// How often a waiter looks before it falls asleep: the baton is mostly back within microseconds,
/// while to wake a thread on another core costs about 25 us.
constexpr int kYields = 20;

/// What the scheduler knows of one task. Touched only by whoever holds the baton.
struct VirtualEntry {
  std::string name;
  std::uint64_t number = 0;  // order of birth, for tasks of the same name
  std::thread::id thread;
  std::condition_variable turn;
  Time due{};
  const Signal* signal = nullptr;  // what it waits for, if anything
  bool deaf = false;               // its waits must not be broken off: it is cleaning up
  bool stop = false;
  bool done = false;
  Signal ended;
  std::exception_ptr error;
};

bool goes_before(const VirtualEntry* a, const VirtualEntry* b) {
  return std::tie(a->due, a->name, a->number) < std::tie(b->due, b->name, b->number);
}

class VirtualClock final : public Clock {
 public:
  explicit VirtualClock(Pace pace) : pace_(pace), origin_(std::chrono::steady_clock::now()) {
    main_.name = "main";
    main_.thread = std::this_thread::get_id();
    entries_.push_back(&main_);
    current_ = &main_;
    moved();
  }

  Time now() const override { return Time(now_.load()); }
  void sleep_until(Time due) override;
  bool wait(Signal& signal, const std::function<bool()>& ready, Time deadline) override;
  void notify(Signal& signal) override;
  std::unique_ptr<Task> spawn(std::string name, std::function<void()> body) override;
  void interrupt() noexcept override { interrupted_ = true; }
  bool set_deaf(bool deaf) override { return std::exchange(running().deaf, deaf); }

  bool break_in(Time patience) override;
  void leave() override;
  Time stuck_for() const noexcept override;
  bool displaced() override { return displaced_ != nullptr; }

  void run(VirtualEntry& entry, std::function<void()>& body);
  void start(VirtualEntry& entry, std::thread& thread, std::function<void()> body);
  void request_stop(VirtualEntry& entry);
  void join(VirtualEntry& entry, bool deaf);

 private:
  VirtualEntry& running();
  void come_back();
  void throw_if_stopped(VirtualEntry& self);
  void hand_over(VirtualEntry& self, Time due);
  void pass_baton();
  void moved() noexcept;
  VirtualEntry* choose();
  VirtualEntry* deadlocked();
  bool main_is_called() const { return interrupted_ && !main_.deaf && displaced_ != &main_; }
  bool pace_to(Time due);

  const Pace pace_;
  std::chrono::steady_clock::time_point origin_;  // of virtual time zero, under Pace::real_time
  std::atomic<std::int64_t> now_{0};              // atomic only so that any thread may look at it
  std::atomic<bool> interrupted_{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "interrupt() must be async-signal-safe");

  std::mutex
      mutex_;  // held while the baton changes hands; what a task does with the baton needs no lock
  std::atomic<VirtualEntry*> current_;
  VirtualEntry main_, intruder_;
  std::atomic<bool> intruder_waits_{false};
  std::atomic<std::int64_t> moved_at_{0};  // ns since origin_'s epoch; only under Pace::real_time
  std::atomic<VirtualEntry*> displaced_{
      nullptr};  // whom the baton was taken from, until it has had a new turn
  std::vector<VirtualEntry*> entries_;  // all that have not ended; few, so a scan beats any heap
  std::uint64_t births_ = 0;
  std::string deadlock_;
};

class VirtualTask final : public Task {
 public:
  VirtualTask(VirtualClock& clock, std::string name) : clock_(clock) {
    entry_.name = std::move(name);
  }
  ~VirtualTask() override {
    if (!thread_.joinable()) return;
    clock_.request_stop(entry_);
    clock_.join(entry_, true);
    thread_.join();
  }
  void start(std::function<void()> body) { clock_.start(entry_, thread_, std::move(body)); }
  void request_stop() override { clock_.request_stop(entry_); }
  void join() override {
    clock_.join(entry_, false);
    if (thread_.joinable()) thread_.join();
    if (entry_.error) std::rethrow_exception(std::exchange(entry_.error, nullptr));
  }
  bool done() const override { return entry_.done; }

 private:
  VirtualClock& clock_;
  VirtualEntry entry_;
  std::thread thread_;
};

VirtualEntry& VirtualClock::running() {
  if (current_.load()->thread != std::this_thread::get_id()) come_back();
  return *current_;
}

/// A displaced task waits for a new turn; any other thread has no business here.
void VirtualClock::come_back() {
  std::unique_lock lock(mutex_);
  if (current_.load()->thread == std::this_thread::get_id()) return;  // given back meanwhile
  VirtualEntry* const self = displaced_;
  if (!self || self->thread != std::this_thread::get_id())
    throw std::logic_error("virtual clock: called by a thread that does not hold the baton");
  self->due = now();
  self->turn.wait(lock, [&] { return current_ == self; });
  displaced_ = nullptr;
}

bool VirtualClock::break_in(Time patience) {
  intruder_.name = "watchdog";
  intruder_.thread = std::this_thread::get_id();
  intruder_.due = now();
  intruder_.deaf = true;
  intruder_waits_ = true;
  std::unique_lock lock(mutex_);
  const bool in_turn =
      intruder_.turn.wait_for(lock, patience, [this] { return current_ == &intruder_; });
  intruder_waits_ = false;
  if (!in_turn) {
    VirtualEntry* const holder = current_;
    holder->due = kForever;
    displaced_ = holder;
    current_ = &intruder_;
  }
  intruder_.number = ++births_;
  entries_.push_back(&intruder_);
  return !in_turn;
}

void VirtualClock::moved() noexcept {
  if (pace_ == Pace::real_time)
    moved_at_ = std::chrono::steady_clock::now().time_since_epoch().count();
}

Time VirtualClock::stuck_for() const noexcept {
  if (pace_ != Pace::real_time) return Time(0);
  return std::chrono::steady_clock::now().time_since_epoch() -
         std::chrono::steady_clock::duration(moved_at_.load());
}

void VirtualClock::leave() {
  running();
  const std::lock_guard lock(mutex_);
  std::erase(entries_, &intruder_);
  if (VirtualEntry* const stuck =
          displaced_.exchange(nullptr)) {  // it has the baton back before it knew of its loss
    stuck->due = now();
    current_ = stuck;
    stuck->turn.notify_one();
    return;
  }
  pass_baton();
}

void VirtualClock::throw_if_stopped(VirtualEntry& self) {
  if (self.deaf) return;
  if (&self == &main_ && interrupted_.exchange(false)) throw Stopped();
  if (self.stop) throw Stopped();
}

void VirtualClock::sleep_until(Time due) {
  VirtualEntry& self = running();
  throw_if_stopped(self);
  hand_over(self, due);
}

bool VirtualClock::wait(Signal& signal, const std::function<bool()>& ready, Time deadline) {
  VirtualEntry& self = running();
  throw_if_stopped(self);
  // A notified task looks for itself, at its turn: what it waits for may have been taken by another
  // one meanwhile.
  while (!ready()) {
    if (now() >= deadline) return false;
    self.signal = &signal;
    hand_over(self, deadline);
  }
  return true;
}

void VirtualClock::notify(Signal& signal) {
  running();
  for (VirtualEntry* entry : entries_)
    if (entry->signal == &signal) entry->due = now();
}

void VirtualClock::request_stop(VirtualEntry& entry) {
  const VirtualEntry& self = running();
  entry.stop = true;
  if (&entry != &self && !entry.deaf) entry.due = now();
}

void VirtualClock::join(VirtualEntry& entry, bool deaf) {
  VirtualEntry& self = running();
  const bool was_deaf = std::exchange(self.deaf, self.deaf || deaf);
  try {
    wait(
        entry.ended, [&entry] { return entry.done; }, kForever);
  } catch (...) {
    self.deaf = was_deaf;
    throw;
  }
  self.deaf = was_deaf;
}

/// The caller waits until `due`, or until somebody moves its due time forward, and has the baton
/// again on return.
void VirtualClock::hand_over(VirtualEntry& self, Time due) {
  self.due = std::max(due, now());
  {
    const std::lock_guard lock(mutex_);
    pass_baton();
  }
  for (int i = 0; i < kYields && current_ != &self; ++i) std::this_thread::yield();
  if (current_ != &self) {
    std::unique_lock lock(mutex_);
    self.turn.wait(lock, [&] { return current_ == &self; });
  }
  self.signal = nullptr;
  const std::string deadlock = &self == &main_ ? std::exchange(deadlock_, {}) : std::string();
  throw_if_stopped(self);
  if (!deadlock.empty()) throw std::logic_error(deadlock);
}

/// Under the lock; every task that has not ended waits, and somebody always goes on.
void VirtualClock::pass_baton() {
  moved();
  VirtualEntry* const next = choose();
  if (next == current_) return;
  current_ = next;
  next->turn.notify_one();
}

VirtualEntry* VirtualClock::choose() {
  if (intruder_waits_) return &intruder_;
  if (main_is_called()) return &main_;
  VirtualEntry* const next = *std::min_element(entries_.begin(), entries_.end(), goes_before);
  if (next->due == kForever) return deadlocked();
  if (pace_ == Pace::real_time && !pace_to(next->due)) return intruder_waits_ ? &intruder_ : &main_;
  now_ = std::max(now(), next->due).count();
  return next;
}

VirtualEntry* VirtualClock::deadlocked() {
  std::vector<std::string> names;
  for (const VirtualEntry* entry : entries_) names.push_back(entry->name);
  std::sort(names.begin(), names.end());
  deadlock_ = "no task can ever go on; all wait without a deadline for each other: ";
  for (const std::string& name : names) deadlock_ += (&name == &names.front() ? "" : ", ") + name;
  return displaced_ == &main_ ? &intruder_ : &main_;
}

/// Sleeps until the wall clock has come to `due`. False when the main task was interrupted, or a
/// watchdog came, meanwhile.
bool VirtualClock::pace_to(Time due) {
  const auto wall = [this] {
    return std::chrono::duration_cast<Time>(std::chrono::steady_clock::now() - origin_);
  };
  while (wall() < due) {
    if (main_is_called() || intruder_waits_) {
      now_ = std::max(now(), wall()).count();
      return false;
    }
    std::this_thread::sleep_for(std::min(kSlice, due - wall()));
    moved();
  }
  // Somebody thought at the prompt, or the machine is too slow: go on from here at the right pace.
  if (const Time lag = wall() - due; lag > kForgetLag) origin_ += lag;
  return true;
}

std::unique_ptr<Task> VirtualClock::spawn(std::string name, std::function<void()> body) {
  running();
  auto task = std::make_unique<VirtualTask>(*this, std::move(name));
  task->start(std::move(body));
  return task;
}

void VirtualClock::start(VirtualEntry& entry, std::thread& thread, std::function<void()> body) {
  entry.number = ++births_;
  entry.due = now();
  entries_.reserve(entries_.size() + 1);  // nothing may throw once the thread runs
  thread = quiet_thread([this, &entry, own = std::move(body)]() mutable { run(entry, own); });
  entry.thread = thread.get_id();
  entries_.push_back(&entry);
}

/// The top of a task's thread.
void VirtualClock::run(VirtualEntry& entry, std::function<void()>& body) {
  {
    std::unique_lock lock(mutex_);
    entry.turn.wait(lock, [&] { return current_ == &entry; });
  }
  try {
    body();
  } catch (const Stopped&) {
  } catch (...) {
    entry.error = std::current_exception();
  }
  body = nullptr;  // what it holds dies with the baton in hand
  entry.done = true;
  notify(entry.ended);
  const std::lock_guard lock(mutex_);
  std::erase(entries_, &entry);
  pass_baton();
}

}  // namespace

std::unique_ptr<Clock> virtual_clock(Pace pace) { return std::make_unique<VirtualClock>(pace); }

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace vitreo
