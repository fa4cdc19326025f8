// Long calculations beside the script: each on a task of its own, so that the rest of the run goes
// on, and a stop ends them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/work.h"

#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace vitreo::lua {

/// What a calculation calls now and then (at fixed places, or runs would not repeat): others due
/// now get their turn, and after a stop it throws Stopped.
class YieldPoint {
 public:
  explicit YieldPoint(Clock& clock) : clock_(&clock) {}
  void operator()() const {
    clock_->inside([this] { clock_->sleep_until(clock_->now()); });
  }

 private:
  Clock* clock_;
};

/// `return calculate(...)`: the script waits while `compute(breath)` runs, then `push(call,
/// result)` pushes what it returned. `compute` must own all it uses: the script's objects may be
/// gone before it notices a stop, and under the wall clock it runs without the baton, so that a
/// long calculation is not the program standing still.
template <class Compute, class Push>
int calculate(const Call& call, const std::string& name, Compute compute, Push push) {
  using Result = decltype(compute(std::declval<const YieldPoint&>()));
  call.check_can_wait();
  auto result = std::make_shared<std::optional<Result>>();
  const YieldPoint breath(session_of(call.L).clock);
  return call.wait(work(
      call, name,
      [result, breath, compute = std::move(compute), &clock = session_of(call.L).clock] {
        clock.outside([&] { result->emplace(compute(breath)); });
      },
      kForever, [result, push = std::move(push)](Call& done) { return push(done, **result); }));
}

}  // namespace vitreo::lua
