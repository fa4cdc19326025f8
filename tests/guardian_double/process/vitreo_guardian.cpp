// Guardian's double: stands beside a test program in the guardian's place, writes down what the
// host says, and answers as it is told. It opens no output.
//   VITREO_GUARDIAN_HEARD  file: a line a message, "SECONDS TEXT", SECONDS of the monotonic clock
//   VITREO_GUARDIAN_MODE   ready, shared, refuse, mute, leaves, dies, lingers
// The protocol is docs/safety.md's: packets over a socket with the number 3; 'O' and the outputs,
// answered with 'R' (or 'r': in the host's control group) or with what cannot be guarded; then 'a'
// armed, 'b' beats, 'd' all at zero, 'q' leave, 'x' leave and bring to zero.
// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <string>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

namespace {

constexpr int kHost = 3;

std::string variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// One write, so that a reader never sees half a line.
void note(int file, std::string text) {
  for (char& c : text)
    if (c == '\n') c = '|';
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  char seconds[40];
  std::snprintf(seconds, sizeof seconds, "%lld.%09ld ", static_cast<long long>(now.tv_sec),
                now.tv_nsec);
  const std::string line = seconds + text + "\n";
  if (write(file, line.data(), line.size()) < 0) _exit(3);
}

}  // namespace

int main(int count, char** words) {
  const std::string mode = variable("VITREO_GUARDIAN_MODE");
  const int file = open(variable("VITREO_GUARDIAN_HEARD").c_str(),
                        O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (file < 0 || count != 2) return 2;
  note(file, std::string("for ") + words[1] + (getsid(0) == getpid() ? " in a session" : ""));
  const auto answer = [](const std::string& text) {
    return send(kHost, text.data(), text.size(), MSG_NOSIGNAL) >= 0;
  };
  char bytes[16384];
  for (;;) {
    const ssize_t size = recv(kHost, bytes, sizeof bytes, 0);
    if (size <= 0) break;
    const std::string said(bytes, static_cast<std::size_t>(size));
    note(file, said);
    switch (said[0]) {
      case 'O':
        if (mode == "leaves") return 0;
        if (mode == "refuse") return answer("a toaster cannot be brought to zero") ? 1 : 2;
        if (mode != "mute") answer(mode == "shared" ? "r" : "R");
        break;
      case 'a':
        if (mode == "dies") return 0;
        break;
      case 'x':
        if (mode == "lingers") usleep(700'000);
        return 0;
      case 'q':
        return 0;
    }
  }
  note(file, "end");
  return 0;
}
