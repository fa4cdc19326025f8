// Stop between two statements of the prompt: no script runs that could feel it, but what it has
// left running does (a loop that holds), and is made safe.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/session/run_status.h"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

class StopBetween {
 public:
  /// Any thread, signal handlers too (`signal`: its number, else 0). The first one's time counts.
  void ask(StopTier tier, int signal = 0) noexcept;
  /// With why, and by whom; of several the first one's.
  void ask(StopTier tier, const std::string& reason, const EndCause& cause);
  /// What was asked and is not answered; none where nothing was.
  StopTier tier() const noexcept { return tier_; }
  /// Since it was asked; nothing where nothing was.
  std::optional<std::chrono::steady_clock::duration> since() const;

  struct Asked {
    StopTier tier = StopTier::none;
    std::string reason{};  // "": by a signal, or by a person without a word
    EndCause cause{};
    int signal = 0;
  };
  /// Once, by whichever thread comes first.
  Asked take();
  static std::int64_t steady_now() noexcept;  // ns, of the clock that requests are timed by

 private:
  std::atomic<StopTier> tier_{StopTier::none};
  static_assert(std::atomic<StopTier>::is_always_lock_free);
  std::atomic<std::int64_t> at_{0};  // ns of the steady clock; 0: never
  std::atomic<int> signal_{0};
  std::mutex mutex_;  // of what follows; never taken in a signal handler
  std::string reason_;
  EndCause cause_;
};

/// What came of it.
struct AnsweredStop {
  std::string reason;  // "by the operator"
  EndCause cause;
  std::vector<std::string> failures;  // of the devices' safe state
};

}  // namespace vitreo
