// The built program on a pseudo-terminal, as a user at the keyboard sees it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <string>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

namespace vitreo {

class Terminal {
 public:
  /// Starts `vitreo` with `words` in `folder`, which is its home too.
  explicit Terminal(const std::filesystem::path& folder, const std::string& words = "",
                    unsigned short columns = 80) {
    const winsize size{24, columns, 0, 0};
    child_ = forkpty(&master_, nullptr, nullptr, &size);
    if (child_ != 0) return;
    setenv("TERM", "xterm", 1);
    setenv("HOME", folder.c_str(), 1);
    setenv("INPUTRC", "/dev/null", 1);
    unsetenv("XDG_STATE_HOME");
    if (chdir(folder.c_str()) != 0) _exit(99);
    execl("/bin/sh", "sh", "-c", ("exec '" VITREO_PROGRAM "' " + words).c_str(), nullptr);
    _exit(99);
  }
  ~Terminal() {
    close(master_);
    if (!ended_) {
      kill(child_, SIGKILL);
      waitpid(child_, nullptr, 0);
    }
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  void type(const std::string& keys) const {
    for (std::size_t sent = 0; sent < keys.size();) {
      const ssize_t count = write(master_, keys.data() + sent, keys.size() - sent);
      if (count <= 0) return;
      sent += static_cast<std::size_t>(count);
    }
  }

  /// Waits until `text` has appeared since the last time; false after `patience`.
  bool sees(const std::string& text, std::chrono::seconds patience = std::chrono::seconds(10)) {
    const auto until = std::chrono::steady_clock::now() + patience;
    for (;;) {
      if (const std::size_t at = screen_.find(text, seen_); at != std::string::npos) {
        seen_ = at + text.size();
        return true;
      }
      if (std::chrono::steady_clock::now() > until || !take()) return false;
    }
  }

  /// Waits until it asks for a line and reads keys one by one: what is typed before that is the
  /// kernel's to interpret.
  bool prompts() {
    if (!sees("> ")) return false;
    termios settings{};
    for (int i = 0; i < 1000; ++i, usleep(10000))
      if (tcgetattr(master_, &settings) == 0 && (settings.c_lflag & ICANON) == 0) return true;
    return false;
  }

  /// The program's process.
  pid_t child() const { return child_; }

  /// All that has come.
  const std::string& screen() const { return screen_; }

  /// Waits until what came since the last sight ends in `text`, and nothing has come for a moment;
  /// false after `patience`.
  bool sees_end(const std::string& text, std::chrono::seconds patience) {
    constexpr auto kQuiet = std::chrono::milliseconds(300);
    const auto until = std::chrono::steady_clock::now() + patience;
    auto changed = std::chrono::steady_clock::now();
    for (std::size_t size = screen_.size(); std::chrono::steady_clock::now() < until;) {
      if (!take()) return false;
      if (screen_.size() != size) changed = std::chrono::steady_clock::now();
      size = screen_.size();
      if (std::chrono::steady_clock::now() - changed >= kQuiet && size > seen_ &&
          screen_.ends_with(text))
        return true;
    }
    return false;
  }
  /// What has come since the last sight, which is seen by that.
  std::string take_unseen() {
    const std::string text = unseen();
    seen_ = screen_.size();
    return text;
  }

  /// What has come since the last sight.
  std::string unseen() const { return screen_.substr(seen_); }

  /// Waits for the program's end; its exit code, -1 when it goes on for 10 s.
  int end() {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (take() && std::chrono::steady_clock::now() < until) {
    }
    int status = 0;
    while (std::chrono::steady_clock::now() < until) {
      if (waitpid(child_, &status, WNOHANG) == child_) {
        ended_ = true;
        return WIFEXITED(status) ? WEXITSTATUS(status) : -2;
      }
      usleep(10000);
    }
    return -1;
  }

 private:
  bool take() {
    pollfd input{master_, POLLIN, 0};
    char bytes[4096];
    if (poll(&input, 1, 100) == 0) return true;
    const ssize_t count = read(master_, bytes, sizeof bytes);
    if (count > 0) screen_.append(bytes, static_cast<std::size_t>(count));
    return count > 0;
  }

  int master_ = -1;
  pid_t child_ = -1;
  bool ended_ = false;
  std::string screen_;
  std::size_t seen_ = 0;
};

}  // namespace vitreo
