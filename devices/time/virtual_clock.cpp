// Virtual clock: threads that hand one baton round, and a time that jumps to the next event.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/clock_task.h"
#include "devices/time/quiet_thread.h"
#include "devices/time/turn_sharing.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <ctime>
#include <mutex>
#include <pthread.h>
#include <stdexcept>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

namespace vitreo {

namespace {

/// How long a wait at the pace of the wall clock may miss interrupt(), which sets a flag only.
constexpr Time kSlice = std::chrono::milliseconds(10);
/// A simulation that is further behind the wall clock than this does not rush to catch up.
constexpr Time kForgetLag = std::chrono::milliseconds(100);
/// How often a waiter polls before it sleeps: the baton is mostly back within microseconds, while
/// to wake a thread on another core costs about 25 us.
constexpr int kYields = 20;
/// Of a task that is alone, before the others go on beside it, of its own processor time, so that a
/// loaded machine changes no run; less of it after so long by the wall, so that no dead-man (250
/// ms) comes first.
constexpr Time kAlone = std::chrono::milliseconds(50);
constexpr Time kAloneAtMost = std::chrono::milliseconds(100);
constexpr Time kAloneLate = std::chrono::milliseconds(10);
/// Between two looks at a task that is alone.
constexpr Time kRelayPeriod = std::chrono::milliseconds(5);

std::int64_t steady_now() { return std::chrono::steady_clock::now().time_since_epoch().count(); }

struct VirtualEntry : TaskEntry {
  std::uint64_t number = 0;  // order of spawning, for tasks of the same name
  std::condition_variable turn;
  Time due{};
  bool waits = false;  // for its turn; under the lock, until its own thread has woken
};

/// The order of tasks, the same in every run: due time, then name, then order of spawning. Nothing
/// in it depends on addresses or on the timing of threads.
bool goes_before(const VirtualEntry* a, const VirtualEntry* b) {
  return std::tie(a->due, a->name, a->number) < std::tie(b->due, b->name, b->number);
}

/// Tasks are threads of which one runs at a time, the one that holds the baton. A waiting task is
/// an entry with a due time; to hand the baton over is to find the entry that is due first, set the
/// time to its due time and wake its thread.
class VirtualClock final : public Clock, public TurnSharing {
 public:
  explicit VirtualClock(Pace pace) : pace_(pace), origin_(std::chrono::steady_clock::now()) {
    main_.name = "main";
    main_.thread = std::this_thread::get_id();
    entries_.push_back(&main_);
    current_ = &main_;
    moved();
    if (pace_ == Pace::real_time) relay_thread_ = quiet_thread([this] { relay(); });
  }
  ~VirtualClock() override {
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
      relay_.turn.notify_one();
    }
    if (relay_thread_.joinable()) relay_thread_.join();
  }
  VirtualClock(const VirtualClock&) = delete;
  VirtualClock& operator=(const VirtualClock&) = delete;

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
  bool begin_alone() override;
  bool end_alone() override;
  Time alone_for() const noexcept override;

  void start(VirtualEntry& entry, std::thread& thread, std::function<void()> body);
  void request_stop(VirtualEntry& entry);

 private:
  void run(VirtualEntry& entry, std::function<void()>& body);
  VirtualEntry& running();
  VirtualEntry& come_back();
  void await_turn(std::unique_lock<std::mutex>& lock, VirtualEntry& self);
  void throw_if_stopped(VirtualEntry& self);
  void hand_over(VirtualEntry& self, Time due, const Signal* signal = nullptr);
  bool gives_up_displaced(const VirtualEntry& self);
  void pass_baton();
  void moved() noexcept;
  VirtualEntry* choose();
  VirtualEntry* deadlocked();
  bool main_is_called() const {
    return interrupted_ && !main_.deaf && displaced_ != &main_ && away_ != &main_;
  }
  /// A task that comes for its turn out of order, before the next one is due.
  bool is_called() const { return main_is_called() || intruder_waits_ || reclaimed_; }
  bool pace_to(Time due);
  void relay();
  bool stays_alone();
  void give_away(VirtualEntry& self);

  const Pace pace_;
  // Of virtual time zero, under Pace::real_time.
  std::chrono::steady_clock::time_point origin_;
  // ns; atomic only so that any thread may read it.
  std::atomic<std::int64_t> now_{0};
  std::atomic<bool> interrupted_{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "interrupt() must be async-signal-safe");

  // Held while the baton changes hands; what a task does with the baton needs no lock.
  std::mutex mutex_;
  // The holder of the baton.
  std::atomic<VirtualEntry*> current_;
  VirtualEntry main_;
  VirtualEntry intruder_;  // the thread of break_in()
  std::atomic<bool> intruder_waits_{false};
  // ns since origin_'s epoch; only under Pace::real_time.
  std::atomic<std::int64_t> moved_at_{0};
  // The task that the baton was taken from, until it has had a new turn.
  std::atomic<VirtualEntry*> displaced_{nullptr};

  // Of the task that is alone (begin_alone()); null: none is.
  std::atomic<VirtualEntry*> alone_{nullptr};
  enum class Alone { none, with_baton, away };
  std::atomic<Alone> alone_state_{Alone::none};
  std::atomic<std::int64_t> alone_since_{0};  // ns of the steady clock; 0: no task is alone
  std::uint64_t turns_ = 0;                   // how often the baton was handed over
  std::atomic<clockid_t> alone_processor_{};  // its own processor time
  // The one whose turn went to the others while it is alone.
  std::atomic<VirtualEntry*> away_{nullptr};
  std::atomic<bool> reclaimed_{false};  // it wants its turn back
  struct {
    std::uint64_t turn = 0;
    std::int64_t processor = 0;  // ns, when the turn was seen first
  } seen_;
  // Hands the baton on for a task that is away: no task of its own, and never chosen.
  VirtualEntry relay_;
  bool over_ = false;
  std::thread relay_thread_;

  // All that have not ended; few, so a scan is faster than a heap.
  std::vector<VirtualEntry*> entries_;
  std::uint64_t births_ = 0;
  // The error that the main task is to throw.
  std::string deadlock_;
};

/// The caller's entry; every call but now() begins here. Throws std::logic_error for a thread that
/// does not hold the baton and was not displaced.
VirtualEntry& VirtualClock::running() {
  // Looked at once: a watchdog may take the baton at any moment.
  VirtualEntry* const holder = current_;
  return holder->thread == std::this_thread::get_id() ? *holder : come_back();
}

/// Until its own thread is awake a task that was handed the baton still waits (break_in()).
void VirtualClock::await_turn(std::unique_lock<std::mutex>& lock, VirtualEntry& self) {
  self.waits = true;
  self.turn.wait(lock, [&] { return current_ == &self; });
  self.waits = false;
}

/// A displaced task waits for a new turn; for any other thread the call is an error.
VirtualEntry& VirtualClock::come_back() {
  std::unique_lock lock(mutex_);
  if (VirtualEntry* const holder = current_; holder->thread == std::this_thread::get_id())
    return *holder;  // given back meanwhile
  VirtualEntry* const self = displaced_;
  if (!self || self->thread != std::this_thread::get_id())
    throw std::logic_error("virtual clock: called by a thread that does not hold the baton");
  self->due = now();  // from kForever: it may be chosen again
  await_turn(lock, *self);
  return *self;
}

/// Becomes a task in two ways: in turn, when a task hands the baton over within `patience`
/// (choose() prefers the intruder), or by force. Then the holder still runs, outside of all tasks,
/// until its next call of the clock, and is not chosen until then: its due time is kForever. One
/// that was handed the baton and has not woken yet does not run: it waits for another turn.
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
    holder->due = holder->waits ? now() : kForever;
    displaced_ = holder->waits ? nullptr : holder;
    current_ = &intruder_;
  }
  intruder_.number = ++births_;
  entries_.push_back(&intruder_);
  return !in_turn;
}

/// Notes when the baton was seen to move, for stuck_for(). Not without a pace: the time of day has
/// no part in such a run.
void VirtualClock::moved() noexcept {
  if (pace_ == Pace::real_time) moved_at_ = steady_now();
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
  // A displaced task that has not called the clock meanwhile gets the baton back and never knows.
  if (VirtualEntry* const stuck = displaced_.exchange(nullptr)) {
    stuck->due = now();
    current_ = stuck;
    stuck->turn.notify_one();
    return;
  }
  // A watchdog's thread must not sleep until the next event: with a task away that may be never.
  if (away_ != nullptr && !over_) {
    current_ = &relay_;
    relay_.turn.notify_one();
    return;
  }
  pass_baton();
}

/// Cheap where the stretch stays short: two atomic words; the turn is taken away by relay() only.
bool VirtualClock::begin_alone() {
  if (pace_ != Pace::real_time || alone_ != nullptr) return false;
  VirtualEntry& self = running();
  alone_ = &self;
  clockid_t processor{};
  pthread_getcpuclockid(pthread_self(), &processor);
  alone_processor_ = processor;
  const std::int64_t wall = steady_now();
  alone_since_ = wall;
  alone_state_ = Alone::with_baton;
  if (wall - moved_at_ < kAloneAtMost.count()) return true;
  // One that calls the host all the time is seldom alone when relay() looks.
  const std::lock_guard lock(mutex_);
  Alone expected = Alone::with_baton;
  if (current_ == &self && !stays_alone() &&
      alone_state_.compare_exchange_strong(expected, Alone::away))
    give_away(self);
  return true;
}

bool VirtualClock::end_alone() {
  VirtualEntry* const self = alone_;
  if (self == nullptr || self->thread != std::this_thread::get_id()) return false;
  Alone expected = Alone::with_baton;
  if (!alone_state_.compare_exchange_strong(expected, Alone::none)) {
    // The task that paces the clock holds the lock, and hands it over when it sees this.
    reclaimed_ = true;
    std::unique_lock lock(mutex_);
    // From kForever: it may be chosen. After what the wall clock has made due meanwhile.
    const Time wall(steady_now() - origin_.time_since_epoch().count());
    self->due = std::min(self->due, std::max(now(), wall));
    await_turn(lock, *self);
    away_ = nullptr;
    reclaimed_ = false;
    ++turns_;
    alone_state_ = Alone::none;
  }
  alone_since_ = 0;
  alone_ = nullptr;
  running();  // displaced by a watchdog meanwhile: it waits here
  return true;
}

Time VirtualClock::alone_for() const noexcept {
  const std::int64_t since = alone_since_;
  return since == 0 ? Time(0) : Time(steady_now() - since);
}

/// Under the lock. False where the task that is alone has computed for long.
bool VirtualClock::stays_alone() {
  if (alone_state_ != Alone::with_baton || displaced_ != nullptr) return true;
  timespec used{};
  clock_gettime(alone_processor_, &used);
  const std::int64_t processor = used.tv_sec * 1'000'000'000LL + used.tv_nsec;
  // Since the others had a turn last: a loop of short calls into the host is no shorter for them.
  if (seen_.turn != turns_) {
    seen_ = {turns_, processor};
    return true;
  }
  const bool late = steady_now() - moved_at_ >= kAloneAtMost.count();
  return processor - seen_.processor < (late ? kAloneLate : kAlone).count();
}

/// Under the lock: from here on relay() has the baton, to hand it on.
void VirtualClock::give_away(VirtualEntry& self) {
  moved();
  self.due = kForever;
  away_ = &self;
  current_ = &relay_;
  relay_.turn.notify_one();
}

/// The body of a thread of its own, under Pace::real_time: takes the turn from a task that stays
/// alone, without its doing, and gives it to the others.
void VirtualClock::relay() {
  relay_.name = "relay";
  std::unique_lock lock(mutex_);
  while (!over_) {
    relay_.waits = true;
    relay_.turn.wait_for(lock, kRelayPeriod, [this] { return over_ || current_ == &relay_; });
    relay_.waits = false;
    if (over_) return;
    if (current_ != &relay_) {
      if (stays_alone()) continue;
      VirtualEntry* const holder = alone_;
      Alone expected = Alone::with_baton;
      // It may have come back this very moment.
      if (!alone_state_.compare_exchange_strong(expected, Alone::away)) continue;
      give_away(*holder);
    }
    pass_baton();
  }
}

/// An interrupt is thrown once, a stop at every wait.
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
  // A notified task evaluates ready() at its own turn: another one may have taken what it waits for
  // meanwhile.
  while (!ready()) {
    if (now() >= deadline) return false;
    hand_over(self, deadline, &signal);
  }
  return true;
}

void VirtualClock::notify(Signal& signal) {
  running();
  const std::lock_guard lock(mutex_);
  for (VirtualEntry* entry : entries_)
    if (entry->signal == &signal) entry->due = now();
}

void VirtualClock::request_stop(VirtualEntry& entry) {
  const VirtualEntry& self = running();
  const std::lock_guard lock(mutex_);
  entry.stop = true;
  if (&entry != &self && !entry.deaf) entry.due = now();
}

/// The caller waits until `due`, or until a notify() of `signal` or a stop moves its due time
/// forward, and has the baton again on return. A caller that was displaced since its last look at
/// the clock has no baton to pass on: it waits like any other task from here on, and leave() need
/// not give it back what it lost.
void VirtualClock::hand_over(VirtualEntry& self, Time due, const Signal* signal) {
  {
    const std::lock_guard lock(mutex_);
    self.due = std::max(due, now());  // the time never goes back
    self.signal = signal;
    self.waits = true;
    if (!gives_up_displaced(self)) pass_baton();
  }
  for (int i = 0; i < kYields && current_ != &self; ++i) std::this_thread::yield();
  {
    std::unique_lock lock(mutex_);
    await_turn(lock, self);
  }
  self.signal = nullptr;
  const std::string deadlock = &self == &main_ ? std::exchange(deadlock_, {}) : std::string();
  throw_if_stopped(self);
  if (!deadlock.empty()) throw std::logic_error(deadlock);
}

/// Under the lock. Whether break_in() has taken the baton from `self`, which is not away any more
/// then: it waits for its turn, or has ended.
bool VirtualClock::gives_up_displaced(const VirtualEntry& self) {
  if (current_ == &self) return false;
  if (displaced_ == &self) displaced_ = nullptr;
  return true;
}

/// Under the lock; every task that has not ended waits, and one always goes on.
void VirtualClock::pass_baton() {
  moved();
  ++turns_;
  VirtualEntry* const next = choose();
  if (next == displaced_) displaced_ = nullptr;
  if (next == current_) return;
  current_ = next;
  next->turn.notify_one();
}

/// The next holder, and the time at which it goes on: the intruder first, then a main task that was
/// interrupted, then the first by goes_before().
VirtualEntry* VirtualClock::choose() {
  if (intruder_waits_) return &intruder_;
  if (main_is_called()) return &main_;
  VirtualEntry* const next = *std::min_element(entries_.begin(), entries_.end(), goes_before);
  // One that is away comes back some time.
  if (next->due == kForever && away_ == nullptr) return deadlocked();
  if (pace_ == Pace::real_time && !pace_to(next->due)) {
    if (intruder_waits_) return &intruder_;
    return main_is_called() ? &main_ : away_.load();
  }
  now_ = std::max(now(), next->due).count();
  return next;
}

/// All wait for kForever, so no event can ever come: the main task is to throw the names of all, in
/// alphabetical order so that the message is the same in every run.
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
    if (is_called()) {
      now_ = std::max(now(), wall()).count();
      return false;
    }
    std::this_thread::sleep_for(std::min(kSlice, due - wall()));
    moved();
  }
  // A long command at the prompt, or a machine that is too slow: go on from here at the right pace.
  if (const Time lag = wall() - due; lag > kForgetLag) origin_ += lag;
  return true;
}

std::unique_ptr<Task> VirtualClock::spawn(std::string name, std::function<void()> body) {
  running();
  auto task = std::make_unique<ClockTask<VirtualClock, VirtualEntry>>(*this, std::move(name));
  task->start(std::move(body));
  return task;
}

void VirtualClock::start(VirtualEntry& entry, std::thread& thread, std::function<void()> body) {
  const std::lock_guard lock(mutex_);  // the new thread waits for it before its first turn
  entry.number = ++births_;
  entry.due = now();
  entries_.reserve(entries_.size() + 1);  // nothing may throw once the thread runs
  thread = quiet_thread([this, &entry, own = std::move(body)]() mutable { run(entry, own); });
  entry.thread = thread.get_id();
  entries_.push_back(&entry);
}

/// The top of a task's thread: waits for its first turn, and passes the baton on at its end.
void VirtualClock::run(VirtualEntry& entry, std::function<void()>& body) {
  {
    std::unique_lock lock(mutex_);
    await_turn(lock, entry);
  }
  entry.run(body);
  notify(entry.ended);
  const std::lock_guard lock(mutex_);
  std::erase(entries_, &entry);
  if (!gives_up_displaced(entry)) pass_baton();
}

}  // namespace

std::unique_ptr<Clock> virtual_clock(Pace pace) { return std::make_unique<VirtualClock>(pace); }

}  // namespace vitreo
