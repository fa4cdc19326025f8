// SPDX-License-Identifier: Apache-2.0
#include "host/trials/worker_pool.h"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <poll.h>
#include <stdexcept>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {
namespace {

// Those that a person or a scheduler ends a sweep with.
constexpr std::array<int, 3> kStopSignals{SIGINT, SIGTERM, SIGHUP};
volatile std::sig_atomic_t stops_asked = 0;  // a signal handler reaches nothing else
// What was in force before. One StopCount lives at a time, so one set is enough.
std::array<struct sigaction, kStopSignals.size()> handlers_before{};

void count_stop(int) { stops_asked = stops_asked + 1; }

[[noreturn]] void fail() {
  throw std::runtime_error(std::string("workers: ") + std::strerror(errno));
}

/// A line. A pipe that is closed ends this process: a result without a reader is none.
void write_all(int pipe, std::string text) {
  text += '\n';
  for (std::size_t at = 0; at < text.size();) {
    const ssize_t written = ::write(pipe, text.data() + at, text.size() - at);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) _exit(1);  // the reader has gone
    at += static_cast<std::size_t>(written);
  }
}

/// The child: no terminal, no signals of the parent's, and no longer life than its parent's.
[[noreturn]] void run_child(pid_t parent, int pipe,
                            const std::function<void(const SayLine&)>& body) {
  // A runner that is killed outright cannot pass its end on: the kernel does.
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(1);  // it died before that was in force
  setpgid(0, 0);                      // the terminal's Ctrl-C is for the parent, which passes it on
  // The run that this process becomes installs handlers of its own.
  for (const int signal : kStopSignals) std::signal(signal, SIG_DFL);
  // Questions of a run are answered by --answer; its lines go through the pipe.
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  // The standard error stays: what a library says in distress is to be seen.
  ::dup2(nothing, STDIN_FILENO);
  ::dup2(nothing, STDOUT_FILENO);
  try {
    body([pipe](const std::string& line) { write_all(pipe, line); });
  } catch (const std::exception&) {
    _exit(1);  // a body says what is wrong by its lines
  }
  _exit(0);  // no destructors of what belongs to the parent
}

}  // namespace

// Without SA_RESTART, so that a wait for workers ends at once.
StopCount::StopCount() {
  stops_asked = 0;
  struct sigaction counting {};
  counting.sa_handler = count_stop;  // without SA_RESTART: poll() returns at once
  for (std::size_t i = 0; i < kStopSignals.size(); ++i)
    ::sigaction(kStopSignals[i], &counting, &handlers_before[i]);
}

StopCount::~StopCount() {
  for (std::size_t i = 0; i < kStopSignals.size(); ++i)
    ::sigaction(kStopSignals[i], &handlers_before[i], nullptr);
}

int StopCount::count() noexcept { return stops_asked; }

// Only where an exception leaves workers behind: a runner waits for its own.
WorkerPool::~WorkerPool() {
  signal(SIGKILL);
  for (auto& [task, worker] : workers_) {
    ::close(worker.pipe);
    while (::waitpid(worker.process, nullptr, 0) < 0 && errno == EINTR) continue;
  }
}

/// To the worker alone, not to its group: it ends in order what it has started.
void WorkerPool::signal(int number) const {
  for (const auto& [task, worker] : workers_) ::kill(worker.process, number);
}

// fork() and not posix_spawn(): the child goes on with what this process has read. Allowed because
// this process has one thread.
void WorkerPool::start(std::size_t task, const std::function<void(const SayLine&)>& body) {
  std::array<int, 2> ends{};
  // Closed on exec, or the guardian of a run would hold the pipe open after its worker.
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) fail();
  const pid_t parent = getpid();
  const pid_t process = fork();
  if (process < 0) {
    const int problem = errno;
    ::close(ends[0]);
    ::close(ends[1]);
    errno = problem;
    fail();
  }
  if (process == 0) {
    ::close(ends[0]);
    run_child(parent, ends[1], body);
  }
  // Before the next fork, so that no later worker has this end.
  ::close(ends[1]);
  // Read until there is no more, without waiting for one worker while others have something.
  ::fcntl(ends[0], F_SETFL, O_NONBLOCK);
  workers_[task] = {process, ends[0], ""};
}

// Reads what is there. The end of the pipe is the end of the worker: it holds the only other end.
void WorkerPool::take_lines(std::size_t task, Worker& worker, std::vector<Event>& events) {
  std::array<char, 65536> bytes{};
  for (;;) {
    const ssize_t got = ::read(worker.pipe, bytes.data(), bytes.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return;  // EAGAIN: no more for now
    if (got == 0) break;
    // A line may come in parts; what has no end yet waits for the next turn.
    worker.received.append(bytes.data(), static_cast<std::size_t>(got));
    for (std::size_t end = 0; (end = worker.received.find('\n')) != std::string::npos;) {
      events.push_back({task, false, worker.received.substr(0, end), 0});
      worker.received.erase(0, end + 1);
    }
  }
  Event ended{task, true, "", 0};
  ::close(worker.pipe);
  // The pipe is closed, so the process is ending: this wait is short.
  while (::waitpid(worker.process, &ended.status, 0) < 0 && errno == EINTR) continue;
  events.push_back(ended);
}

// A signal ends the wait without an event, and the caller looks at StopCount.
std::vector<WorkerPool::Event> WorkerPool::wait(std::chrono::milliseconds patience) {
  std::vector<pollfd> ends;
  std::vector<std::size_t> tasks;
  for (const auto& [task, worker] : workers_) {
    ends.push_back({worker.pipe, POLLIN, 0});
    tasks.push_back(task);
  }
  std::vector<Event> events;
  if (::poll(ends.data(), ends.size(), static_cast<int>(patience.count())) <= 0) return events;
  for (std::size_t i = 0; i < ends.size(); ++i) {
    // POLLHUP comes without POLLIN: the end of a worker that said nothing.
    if (ends[i].revents == 0) continue;
    take_lines(tasks[i], workers_.at(tasks[i]), events);
    // The last event may be another worker's: this one may have sent a part of a line only.
    if (!events.empty() && events.back().ended && events.back().task == tasks[i])
      workers_.erase(tasks[i]);
  }
  return events;
}

std::string status_text(int status) {
  return WIFSIGNALED(status) ? fmt::format("ended by signal {}", WTERMSIG(status))
                             : fmt::format("left with {}", WEXITSTATUS(status));
}

}  // namespace vitreo
