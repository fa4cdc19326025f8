// Guardian's double: stands beside a test program in the guardian's place, writes down what the
// host says, and answers as it is told. It opens no output.
//   VITREO_GUARDIAN_HEARD  file: a line a message, "SECONDS TEXT", SECONDS of the monotonic clock
//   VITREO_GUARDIAN_MODE   ready, shared, refuse, mute, leaves, dies, lingers: what it does first
//                          and last; or how it acknowledges and leaves:
//                          deaf     gets ready, and acknowledges nothing
//                          slow     each acknowledgement 60 ms late, however many are on their way
//                          tires    acknowledges the first ten messages, and then none
//                          eager    acknowledges each message three times
//                          dawdles  needs a second to leave, and writes "left" then
//                          stays    does not leave, whatever it is told
// The protocol is docs/safety.md's: packets over a socket with the number 3; 'O' and the outputs,
// answered with 'R' (or 'r': in the host's control group) or with what cannot be guarded; then 'a'
// armed, 'b' beats, 'd' all at zero, each acknowledged with 'p'; 'q' leave, 'x' leave and bring to
// zero.
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <string>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

namespace {

constexpr int kHost = 3;
constexpr long long kLate = 60'000'000;  // ns
constexpr int kUntilTired = 10;

std::string variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

long long now() {  // ns
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<long long>(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

/// One write, so that a reader never sees half a line.
void note(int file, std::string text) {
  for (char& c : text)
    if (c == '\n') c = '|';
  const long long time = now();
  char seconds[40];
  std::snprintf(seconds, sizeof seconds, "%lld.%09lld ", time / 1'000'000'000,
                time % 1'000'000'000);
  const std::string line = seconds + text + "\n";
  if (write(file, line.data(), line.size()) < 0) _exit(3);
}

/// A host that does not read does not hold it up: the packet is lost then.
bool answer(const std::string& text) {
  return send(kHost, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT) >= 0;
}

/// What is owed for the host's messages, each at its own time.
class Acknowledgements {
 public:
  explicit Acknowledgements(const std::string& mode)
      : late_(mode == "slow" ? kLate : 0),
        most_(mode == "deaf" ? 0 : (mode == "tires" ? kUntilTired : -1)),
        each_(mode == "eager" ? 3 : 1) {}
  void owe() {
    if (most_ == 0) return;
    if (most_ > 0) --most_;
    for (int k = 0; k < each_; ++k) due_.push_back(now() + late_);
    pay();
  }
  void pay() {
    for (; !due_.empty() && due_.front() <= now(); due_.pop_front()) answer("p");
  }
  /// ms until the next, for poll(); -1: none is owed.
  int patience() const {
    if (due_.empty()) return -1;
    return static_cast<int>(std::max(0LL, due_.front() - now()) / 1'000'000 + 1);
  }

 private:
  const long long late_;
  int most_;  // -1: without end
  const int each_;
  std::deque<long long> due_;
};

}  // namespace

int main(int count, char** words) {
  // A test that is killed leaves nothing behind, not even one that stands still.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const std::string mode = variable("VITREO_GUARDIAN_MODE");
  const int file = open(variable("VITREO_GUARDIAN_HEARD").c_str(),
                        O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (file < 0 || count != 2) return 2;
  note(file, std::string("for ") + words[1] + (getsid(0) == getpid() ? " in a session" : ""));
  Acknowledgements acknowledgements(mode);
  char bytes[16384];
  for (;;) {
    pollfd host{kHost, POLLIN, 0};
    poll(&host, 1, acknowledgements.patience());
    acknowledgements.pay();
    if (host.revents == 0) continue;
    const ssize_t size = recv(kHost, bytes, sizeof bytes, 0);
    // A host that closes with an acknowledgement unread: the kernel says so, once, before it hands
    // out what the host has said.
    if (size < 0 && errno == ECONNRESET) continue;
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
        acknowledgements.owe();
        break;
      case 'b':
      case 'd':
        acknowledgements.owe();
        break;
      case 'x':
        if (mode == "lingers") usleep(700'000);
        return 0;
      case 'q':
        if (mode == "stays") break;
        if (mode == "dawdles") {
          usleep(1'000'000);
          note(file, "left");
        }
        return 0;
    }
  }
  note(file, "end");
  while (mode == "stays") pause();
  return 0;
}
