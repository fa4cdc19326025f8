// Process that stands still while a test wants it to: frozen by SIGSTOP, as one that hangs, or that
// gets no processor.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <csignal>
#include <fstream>
#include <string>
#include <sys/types.h>
#include <thread>

namespace vitreo {

/// As in proc(5): 'S' asleep, 'T' frozen, 'Z' ended and not yet waited for; 0 when it is no more.
inline char state_of(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t at = text.rfind(')');  // behind its name, which may hold anything
  return at == std::string::npos || at + 2 >= text.size() ? '\0' : text[at + 2];
}

inline bool has_ended(pid_t process) {
  const char state = state_of(process);
  return state == '\0' || state == 'Z' || state == 'X';
}

/// Thawed at the end of its object, whatever becomes of the test.
class Frozen {
 public:
  explicit Frozen(pid_t process) : process_(process) {
    if (process_ <= 0) return;  // kill() would take it for many
    ::kill(process_, SIGSTOP);
    while (state_of(process_) != 'T' && !has_ended(process_))
      std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  ~Frozen() { thaw(); }
  Frozen(const Frozen&) = delete;
  Frozen& operator=(const Frozen&) = delete;
  void thaw() {
    if (process_ > 0 && state_of(process_) == 'T') ::kill(process_, SIGCONT);
    process_ = -1;
  }

 private:
  pid_t process_;
};

}  // namespace vitreo
