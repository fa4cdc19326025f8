// Guardian process: watches the host that started it. When the host dies, or falls silent while
// something is energized (then it is killed first), it brings the outputs to zero.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/node_lock.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"
#include "host/safety/guardian/duty.h"
#include "host/safety/guardian/own_group.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

namespace vitreo::guardian {
namespace {

using Steady = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kDeath = 2s;       // within which a killed process is gone, if it can be
constexpr auto kKeenly = 10s;     // for so long it tries again each 2 ms,
constexpr auto kForLong = 10min;  // and for so long each second
constexpr int kUrgent = 5;        // SCHED_RR priority, where it is permitted; above the host's 4

// One packet; empty where there is none yet. `closed`: the host's end is gone, for a SEQPACKET
// socket gives 0 bytes then. Where the host has closed it with an acknowledgement unread, the
// kernel tells of that first, once, and of what the host has said before it after that.
std::string receive(int flags, bool& closed) {
  std::string bytes(kLongest, '\0');
  ssize_t size = recv(kSocket, bytes.data(), bytes.size(), flags);
  if (size < 0 && errno == ECONNRESET) size = recv(kSocket, bytes.data(), bytes.size(), flags);
  closed = size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR);
  bytes.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  return bytes;
}

/// The host's proof that it is watched. One that finds no room is not missed: only a host
/// that reads nothing has none, and that is judged by its heartbeats.
void acknowledge() { send(kSocket, &kPulse, 1, MSG_NOSIGNAL | MSG_DONTWAIT); }

enum class Verdict { leave, leave_unsure, host_died, host_hangs };

/// Waits for a message, for the end of the host (its pidfd becomes readable, its socket closes) or,
/// while armed, for silence. A pidfd and not a pid, which another process may have by then.
/// Messages are read before the pidfd is judged: a host that said that it leaves, and then died, is
/// one that left.
Verdict watch(int host) {
  bool armed = false;
  Steady::time_point heard = Steady::now();
  for (;;) {
    pollfd ends[2] = {{kSocket, POLLIN, 0}, {host, POLLIN, 0}};
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(heard + kSilence - Steady::now());
    poll(ends, 2, armed ? static_cast<int>(std::max(left, 0ms).count()) : -1);
    // All that has come counts as heard now: if this process was late, the host was not.
    for (bool closed = false;;) {
      const std::string said = receive(MSG_DONTWAIT, closed);
      if (closed) return Verdict::host_died;
      if (said.empty()) break;
      heard = Steady::now();
      if (said[0] == kArm) armed = true;
      if (said[0] == kDisarm) armed = false;
      if (said[0] == kQuit) return Verdict::leave;
      if (said[0] == kQuitUnsure) return Verdict::leave_unsure;
      acknowledge();
    }
    if ((ends[1].revents & POLLIN) != 0) return Verdict::host_died;
    if (armed && Steady::now() - heard >= kSilence) return Verdict::host_hangs;
  }
}

/// Kills the host, so that no command of its reaches the outputs after their zero: a device has one
/// owner.
/// By the pidfd, so that no process that has the number by now is killed. Waits for its end: until
/// then it holds the device.
void end_host(int host) {
  syscall(SYS_pidfd_send_signal, host, SIGKILL, nullptr, 0);
  pollfd end{host, POLLIN, 0};
  poll(&end, 1, static_cast<int>(std::chrono::milliseconds(kDeath).count()));
}

bool is_alive(int host) {
  pollfd end{host, POLLIN, 0};
  return ::poll(&end, 1, 0) == 0;
}

/// Tries every output until each was brought to zero once, or has another owner by now, which
/// zeroes what it opens. 0 when all were, else 1. Each output is tried on its own in turn, so one
/// that does not open holds up the others for one attempt only.
int bring_all_to_zero(std::vector<Duty>& duties, int host) {
  const auto clock = wall_clock();
  const auto began = Steady::now();
  std::vector<Duty*> left;
  for (Duty& duty : duties) left.push_back(&duty);
  std::string why;
  for (bool reported = false; !left.empty() && Steady::now() - began < kForLong;) {
    std::erase_if(left, [&](Duty* duty) {
      try {
        duty->bring_to_zero(*clock);
        const std::chrono::duration<double, std::milli> took = Steady::now() - began;
        std::fprintf(stderr, "vitreo guardian: %s is at zero, after %.1f ms\n",
                     duty->address().c_str(), took.count());
        return true;
      } catch (const OwnedError& error) {
        why = error.what();
        // A host that cannot be killed, or has sent this process away, may still have it itself.
        if (is_alive(host)) return false;
        std::fprintf(stderr, "vitreo guardian: %s has another owner by now: left to it\n",
                     duty->address().c_str());
        return true;
      } catch (const std::exception& error) {  // busy with the host that dies, unplugged, silent
        why = error.what();
        return false;
      }
    });
    const bool keen = Steady::now() - began < kKeenly;
    if (!left.empty() && !keen && !std::exchange(reported, true))
      std::fprintf(stderr, "vitreo guardian: NOT at zero yet, still trying: %s\n", why.c_str());
    if (!left.empty()) clock->sleep_for(keen ? Time(2ms) : Time(1s));
  }
  if (!left.empty())
    std::fprintf(stderr, "vitreo guardian: given up, NOT at zero: %s\n", why.c_str());
  return left.empty() ? 0 : 1;
}

/// The whole life of the process; its exit code.
/// The parent's number is compared after the pidfd was opened: where the host had died before that,
/// the process has another parent by now and the pidfd may be a stranger's.
int guard(pid_t host_pid) {
  const int host = static_cast<int>(syscall(SYS_pidfd_open, host_pid, 0));
  bool closed = false;
  const std::string asked = receive(0, closed);
  if (host < 0 || closed || getppid() != host_pid)
    return 1;  // it died before anything was energized
  std::vector<Duty> duties;
  try {
    // The first character is the message's 'O'.
    for (const Output& output : decode(asked.substr(1))) duties.emplace_back(output);
  } catch (const std::exception& problem) {
    const std::string said = problem.what();
    send(kSocket, said.data(), said.size(), MSG_NOSIGNAL);
    return 1;
  }
  const char ready = leave_group_of(host_pid) ? kReady : kReadyShared;
  send(kSocket, &ready, 1, MSG_NOSIGNAL);
  switch (watch(host)) {
    case Verdict::leave:
      return 0;
    case Verdict::leave_unsure:
      return bring_all_to_zero(duties, host);
    case Verdict::host_hangs:
      std::fprintf(stderr, "vitreo guardian: the host has not moved for %d ms; it is killed\n",
                   static_cast<int>(kSilence.count()));
      break;
    case Verdict::host_died:
      std::fprintf(stderr, "vitreo guardian: the host is gone\n");
      break;
  }
  end_host(host);
  return bring_all_to_zero(duties, host);
}

}  // namespace
}  // namespace vitreo::guardian

// The host's terminal signals are for the host: were the guardian ended by the same Ctrl-C, nothing
// would guard the clean-up. SIGPIPE too: its answers may find the socket closed.
int main(int count, char** words) {
  if (count != 2) {
    std::fprintf(stderr, "vitreo_guardian is started by vitreo, with its process id\n");
    return 2;
  }
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGQUIT}) ::signal(signal, SIG_IGN);
  prctl(PR_SET_NAME, "vitreo_guardian");
  const sched_param urgent{vitreo::guardian::kUrgent};
  // Each of these wants a permission; without it the process is as good as it can be.
  sched_setscheduler(0, SCHED_RR, &urgent);
  // Not MCL_FUTURE: beyond RLIMIT_MEMLOCK it would let memory fail later, in the middle of a
  // rescue.
  mlockall(MCL_CURRENT);
  if (std::FILE* const file = std::fopen("/proc/self/oom_score_adj", "w")) {
    std::fputs("-1000", file);
    std::fclose(file);
  }
  return vitreo::guardian::guard(static_cast<pid_t>(std::strtol(words[1], nullptr, 10)));
}
