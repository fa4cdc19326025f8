// Thread with all signals blocked: signals go to the script's thread, the one that can be
// interrupted.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <signal.h>
#include <thread>
#include <utility>

namespace vitreo {

/// Starts `body`. Throws std::system_error where the system has no thread left; the caller's own
/// mask is as it was.
template <class Body>
std::thread quiet_thread(Body&& body) {
  struct Mask {
    sigset_t before{};
    Mask() {
      sigset_t all;
      sigfillset(&all);
      // Blocked before the thread exists: a new thread inherits its creator's mask.
      pthread_sigmask(SIG_SETMASK, &all, &before);
    }
    ~Mask() { pthread_sigmask(SIG_SETMASK, &before, nullptr); }
  } const mask;
  return std::thread(std::forward<Body>(body));
}

}  // namespace vitreo
