// Wall clock: tasks are threads that share one baton, a mutex, which a waiting task puts down.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/clock_task.h"
#include "devices/time/quiet_thread.h"
#include "devices/time/turn_sharing.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

using Steady = std::chrono::steady_clock;  // monotonic: a step of the system's time is no step here

/// How long a wait of the main task may miss interrupt(), which sets a flag only.
constexpr Time kWallSlice = std::chrono::milliseconds(10);

/// A mutex that can be taken from a holder that does not give it back, and that knows for how long
/// it has been held. std::mutex can neither be taken over nor asked.
class Baton {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    ++came_;
    free_.wait(lock, [this] { return taken_at_ == 0; });
    ++served_;
    take();
  }
  /// After as many others as wait for it now: who takes it again and again leaves them their turns.
  void lock_after_others() {
    std::unique_lock lock(mutex_);
    const std::uint64_t before = came_;
    last_.wait(lock, [&] { return taken_at_ == 0 && served_ >= before; });
    take();
  }
  bool try_lock_for(Time patience) {
    std::unique_lock lock(mutex_);
    ++came_;
    const bool taken = free_.wait_for(lock, patience, [this] { return taken_at_ == 0; });
    ++served_;
    if (!taken) return false;
    take();
    return true;
  }
  void unlock() {
    const std::lock_guard lock(mutex_);
    taken_at_ = 0;
    free_.notify_one();
    last_.notify_one();
  }
  /// The holder has it no longer, the caller has.
  void seize() { take(); }
  Time held_for() const noexcept {
    const std::int64_t since = taken_at_;
    return since == 0 ? Time(0) : Time(Steady::now().time_since_epoch().count() - since);
  }

 private:
  void take() { taken_at_ = Steady::now().time_since_epoch().count(); }
  std::mutex mutex_;
  std::condition_variable free_;
  std::condition_variable last_;  // of lock_after_others(), whose condition is another
  std::uint64_t came_ = 0, served_ = 0;
  // ns of the steady clock; 0: it is free.
  std::atomic<std::int64_t> taken_at_{0};
};

struct WallEntry : TaskEntry {
  std::unique_lock<Baton> baton;
  std::condition_variable_any turn;
  bool notified = false;
};

/// Of the thread's task, while it is outside() or alone; else null.
thread_local WallEntry* away = nullptr;

class WallClock final : public Clock, public TurnSharing {
 public:
  WallClock() {
    main_.thread = std::this_thread::get_id();
    main_.baton = std::unique_lock(baton_);
    entries_.push_back(&main_);
    current_ = &main_;
  }

  Time now() const override { return std::chrono::duration_cast<Time>(Steady::now() - origin_); }
  void sleep_until(Time due) override;
  bool wait(Signal& signal, const std::function<bool()>& ready, Time deadline) override;
  void notify(Signal& signal) override;
  void outside(const std::function<void()>& work) override;
  void inside(const std::function<void()>& some) override;
  bool begin_alone() override;
  bool end_alone() override;
  Time alone_for() const noexcept override;
  std::unique_ptr<Task> spawn(std::string name, std::function<void()> body) override;
  void interrupt() noexcept override { interrupted_ = true; }
  bool set_deaf(bool deaf) override { return std::exchange(running().deaf, deaf); }
  bool break_in(Time patience) override;
  bool displaced() override { return displaced_ != nullptr; }
  void leave() override;
  Time stuck_for() const noexcept override { return baton_.held_for(); }

  void start(WallEntry& entry, std::thread& thread, std::function<void()> body);
  void request_stop(WallEntry& entry);

 private:
  WallEntry& running();
  void throw_if_stopped(WallEntry& self);
  bool is_stopped(const WallEntry& self) const {
    return !self.deaf && (self.stop || (&self == &main_ && interrupted_.load()));
  }
  void rest(WallEntry& self, Time due);
  void run(WallEntry& entry, std::function<void()>& body);

  const Steady::time_point origin_ = Steady::now();
  std::atomic<bool> interrupted_{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "interrupt() must be async-signal-safe");
  Baton baton_;
  // The holder; null while all wait or are outside().
  std::atomic<WallEntry*> current_;
  // ns of the steady clock: since when a task is alone; 0: none is.
  std::atomic<std::int64_t> alone_since_{0};
  // Written by the task that is alone.
  std::atomic<WallEntry*> alone_{nullptr};
  // The task that it was taken from, until it is back.
  std::atomic<WallEntry*> displaced_{nullptr};
  // All that have not ended.
  std::vector<WallEntry*> entries_;
  WallEntry main_;
  WallEntry intruder_;  // the thread of break_in()
};

/// The caller's entry; a displaced task waits here for the baton. Throws std::logic_error for a
/// thread that does not hold it and was not displaced.
WallEntry& WallClock::running() {
  WallEntry* entry = current_;
  WallEntry* const stuck = displaced_;
  if (stuck && stuck != entry && stuck->thread == std::this_thread::get_id()) {
    // It waits in line from here on, or leave() has just given it back what it lost: one of the two
    // clears displaced_.
    if (WallEntry* expected = stuck; displaced_.compare_exchange_strong(expected, nullptr)) {
      baton_.lock();  // its own lock believes that it never lost it
      current_ = stuck;
    }
    entry = current_;
  }
  if (entry == nullptr || entry->thread != std::this_thread::get_id())
    throw std::logic_error("wall clock: called by a thread that does not hold the baton");
  return *entry;
}

/// By force the holder goes on outside of all tasks until its next call of the clock.
bool WallClock::break_in(Time patience) {
  const bool in_turn = baton_.try_lock_for(patience);
  if (!in_turn) {
    displaced_ = current_.load();
    baton_.seize();
  }
  intruder_.thread = std::this_thread::get_id();
  intruder_.baton = std::unique_lock(baton_, std::adopt_lock);
  entries_.push_back(&intruder_);
  current_ = &intruder_;
  return !in_turn;
}

void WallClock::leave() {
  running();
  std::erase(entries_, &intruder_);
  // A displaced task that has not called the clock meanwhile gets the baton back and never knows:
  // its own lock was not released.
  if (WallEntry* stuck = displaced_) {
    current_ = stuck;  // first: from the exchange on it may call the clock as the holder
    if (displaced_.compare_exchange_strong(stuck, nullptr)) {
      intruder_.baton.release();
      return;
    }
  }
  current_ = nullptr;
  intruder_.baton.unlock();
}

/// An interrupt is thrown once, a stop at every wait.
void WallClock::throw_if_stopped(WallEntry& self) {
  if (self.deaf) return;
  if (&self == &main_ && interrupted_.exchange(false)) throw Stopped();
  if (self.stop) throw Stopped();
}

/// Puts the baton down until the task is notified or `due` has come. The main task wakes every
/// kWallSlice for interrupt(), which, called by a signal handler, may not touch a condition
/// variable.
void WallClock::rest(WallEntry& self, Time due) {
  running();  // displaced while its predicate computed: it has no baton to put down
  const Time until = &self == &main_ ? std::min(due, later(now(), kWallSlice)) : due;
  current_ = nullptr;
  // kForever would overflow the time point: a day, and then another.
  self.turn.wait_until(self.baton, origin_ + std::min(until, later(now(), std::chrono::hours(24))));
  current_ = &self;
}

void WallClock::sleep_until(Time due) {
  WallEntry& self = running();
  throw_if_stopped(self);
  if (now() >= due) outside([] { std::this_thread::yield(); });  // let the others have a turn
  while (now() < due && !is_stopped(self)) rest(self, due);
  throw_if_stopped(self);
}

bool WallClock::wait(Signal& signal, const std::function<bool()>& ready, Time deadline) {
  WallEntry& self = running();
  throw_if_stopped(self);
  while (!ready()) {
    self.signal = &signal;
    self.notified = false;
    while (!self.notified && now() < deadline && !is_stopped(self)) rest(self, deadline);
    self.signal = nullptr;
    throw_if_stopped(self);
    if (!self.notified) return ready();
  }
  return true;
}

/// The flag tells a notification from a wake-up for another reason: wait() evaluates ready() only
/// after the former.
void WallClock::notify(Signal& signal) {
  running();
  for (WallEntry* entry : entries_)
    if (entry->signal == &signal) {
      entry->notified = true;
      entry->turn.notify_one();
    }
}

/// The baton comes back even when `work` throws.
void WallClock::outside(const std::function<void()>& work) {
  WallEntry& self = running();
  struct Return {
    WallClock& clock;
    WallEntry& self;
    WallEntry* before;
    ~Return() {
      away = before;
      self.baton.lock();
      clock.current_ = &self;
    }
  } const back{*this, self, std::exchange(away, &self)};
  current_ = nullptr;
  self.baton.unlock();
  work();
}

void WallClock::inside(const std::function<void()>& some) {
  WallEntry& self = *away;  // the task's own thread is in outside()
  self.baton.lock();
  current_ = &self;
  struct Leave {
    WallClock& clock;
    WallEntry& self;
    ~Leave() {
      clock.running();  // where it was displaced it first waits for what it lost
      clock.current_ = nullptr;
      self.baton.unlock();
      away = &self;
    }
  } const leave{*this, self};
  away = nullptr;
  some();
}

/// The baton is free meanwhile, and with it every other task.
bool WallClock::begin_alone() {
  if (away != nullptr) return false;  // it is alone, or outside()
  WallEntry& self = running();
  if (alone_ != nullptr) return false;
  alone_ = &self;
  away = &self;
  alone_since_ = Steady::now().time_since_epoch().count();
  current_ = nullptr;
  self.baton.unlock();
  return true;
}

/// Last in line: a script that asks the host for something in a tight loop leaves the servo loop
/// its turns.
bool WallClock::end_alone() {
  WallEntry* const self = away;
  if (self == nullptr || alone_ != self) return false;
  alone_since_ = 0;
  baton_.lock_after_others();
  self->baton = std::unique_lock(baton_, std::adopt_lock);
  current_ = self;
  alone_ = nullptr;
  away = nullptr;
  return true;
}

Time WallClock::alone_for() const noexcept {
  const std::int64_t since = alone_since_;
  return since == 0 ? Time(0) : Time(Steady::now().time_since_epoch().count() - since);
}

void WallClock::request_stop(WallEntry& entry) {
  running();
  entry.stop = true;
  entry.turn.notify_one();
}

std::unique_ptr<Task> WallClock::spawn(std::string name, std::function<void()> body) {
  running();
  auto task = std::make_unique<ClockTask<WallClock, WallEntry>>(*this, std::move(name));
  task->start(std::move(body));
  return task;
}

void WallClock::start(WallEntry& entry, std::thread& thread, std::function<void()> body) {
  entries_.reserve(entries_.size() + 1);  // nothing may throw once the thread runs
  thread = quiet_thread([this, &entry, own = std::move(body)]() mutable { run(entry, own); });
  entry.thread = thread.get_id();
  entries_.push_back(&entry);
}

/// The top of a task's thread: waits for its first turn, and frees the baton at its end.
void WallClock::run(WallEntry& entry, std::function<void()>& body) {
  entry.baton = std::unique_lock(baton_);
  current_ = &entry;
  entry.run(body);
  notify(entry.ended);
  std::erase(entries_, &entry);
  current_ = nullptr;
  entry.baton.unlock();
}

}  // namespace

std::unique_ptr<Clock> wall_clock() { return std::make_unique<WallClock>(); }

}  // namespace vitreo
