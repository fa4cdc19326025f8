// SPDX-License-Identifier: Apache-2.0
#include "host/session/stop_between.h"

#include <utility>

namespace vitreo {

std::int64_t StopBetween::steady_now() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

void StopBetween::ask(StopTier tier, int signal) noexcept {
  int none = 0;
  signal_.compare_exchange_strong(none, signal);
  std::int64_t never = 0;
  at_.compare_exchange_strong(never, steady_now());
  // Raised only, and last: who sees it finds the rest.
  StopTier before = tier_;
  while (before < tier && !tier_.compare_exchange_weak(before, tier)) {
  }
}

void StopBetween::ask(StopTier tier, const std::string& reason, const EndCause& cause) {
  {
    const std::lock_guard lock(mutex_);
    if (tier_ == StopTier::none) {
      reason_ = reason;
      cause_ = cause;
    }
  }
  ask(tier);
}

// A time that was left behind by a request that came while another was taken is too old: what is
// due is done sooner.
std::optional<std::chrono::steady_clock::duration> StopBetween::since() const {
  if (tier_ == StopTier::none) return std::nullopt;
  return std::chrono::nanoseconds(steady_now() - at_);
}

StopBetween::Asked StopBetween::take() {
  const std::lock_guard lock(mutex_);
  at_ = 0;
  const StopTier tier = tier_.exchange(StopTier::none);
  if (tier == StopTier::none) return {};
  return {tier, std::exchange(reason_, {}), std::exchange(cause_, {}), signal_.exchange(0)};
}

}  // namespace vitreo
