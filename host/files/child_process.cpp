// SPDX-License-Identifier: Apache-2.0
#include "host/files/child_process.h"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <stdexcept>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace vitreo {

// Both ends are close-on-exec, so that no other child inherits them and keeps the pipe open; the
// end that is duplicated onto 0, 1 or 2 is not.
ChildProcess::ChildProcess(const std::vector<std::string>& words, Pipe pipe) {
  // posix_spawn() and not fork(): this process has threads, and between fork() and exec() only
  // calls that a signal handler may make would be allowed.
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    throw std::runtime_error(words.at(0) + ": " + std::strerror(errno));
  const bool input = pipe == Pipe::to_input;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (!input) posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, ends[input ? 0 : 1], input ? 0 : 1);
  if (pipe == Pipe::from_output_and_errors) posix_spawn_file_actions_adddup2(&actions, ends[1], 2);
  // Libraries open files without close-on-exec, such as the sockets of a server: a child that had
  // one would keep its port.
  posix_spawn_file_actions_addclosefrom_np(&actions, 3);
  // A signal mask is inherited: a task that blocks signals would make a program that none can end.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  std::vector<char*> arguments;
  for (const std::string& word : words)
    arguments.push_back(const_cast<char*>(word.c_str()));  // posix_spawn's own way
  arguments.push_back(nullptr);
  const int error =
      posix_spawnp(&pid_, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  // The child's end is closed here: otherwise this process would hold the pipe open itself, and
  // never read an end of the child's output.
  ::close(ends[input ? 0 : 1]);
  pipe_ = ends[input ? 1 : 0];
  if (error == 0) return;
  ::close(pipe_);
  throw std::runtime_error("the program " + words[0] +
                           " cannot be started: " + std::strerror(error));
}

// Killed without a chance to end by itself: the destructor runs before finish() only when its owner
// gives up. It is still waited for, or it would stay as a zombie.
ChildProcess::~ChildProcess() {
  if (pid_ >= 0) ::kill(pid_, SIGKILL);
  finish();
}

bool ChildProcess::write(std::string_view bytes) {
  // A write to a program that has ended raises SIGPIPE, which would end this one too.
  // The disposition is the whole process': for as long as this call lasts other threads ignore the
  // signal too.
  const auto before = std::signal(SIGPIPE, SIG_IGN);
  bool taken = true;
  while (!bytes.empty() && taken) {
    const ssize_t written = ::write(pipe_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    taken = written > 0;
    if (taken) bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  std::signal(SIGPIPE, before);
  return taken;
}

std::size_t ChildProcess::read(void* into, std::size_t bytes) {
  std::size_t got = 0;
  while (got < bytes) {
    const std::size_t more = read_some(static_cast<char*>(into) + got, bytes - got);
    if (more == 0) break;
    got += more;
  }
  return got;
}

// An end of the output counts as readable: poll() answers POLLHUP, and read_some() then gives 0.
bool ChildProcess::readable(std::chrono::milliseconds patience) const {
  pollfd end{pipe_, POLLIN, 0};
  return ::poll(&end, 1, static_cast<int>(patience.count())) > 0;
}

// An error of the pipe is taken for its end; the exit status says more about the reason.
std::size_t ChildProcess::read_some(void* into, std::size_t bytes) {
  for (;;) {
    const ssize_t got = ::read(pipe_, into, bytes);
    if (got < 0 && errno == EINTR) continue;
    return got > 0 ? static_cast<std::size_t>(got) : 0;
  }
}

// The exit code as a shell gives it: 128 and the signal's number for one that was killed.
// The pipe is closed first: a program that reads until its input ends would never end, one that
// still writes is stopped by SIGPIPE, and waitpid() would wait for both.
int ChildProcess::finish() {
  if (pipe_ >= 0) ::close(pipe_);
  pipe_ = -1;
  if (pid_ < 0) return 0;
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) continue;
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace vitreo
