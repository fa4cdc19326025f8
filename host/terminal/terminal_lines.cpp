// Line editor on a terminal, over GNU readline: the only file that includes it.
// SPDX-License-Identifier: Apache-2.0
#include "host/terminal/line_editor.h"

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fcntl.h>
#include <iostream>
#include <mutex>
#include <poll.h>
#include <readline/history.h>
#include <readline/readline.h>
#include <stdexcept>
#include <termios.h>
#include <unistd.h>

namespace vitreo {
namespace {

constexpr int kKept = 5000;  // statements
constexpr int kCtrlC = 3;

class TerminalLines;
TerminalLines* the_editor = nullptr;  // readline's callbacks have no place for one of ours

/// Ctrl-C is a key at the prompt: a signal would ask for the end of a run that does not run.
/// Called by readline before each line, in place of its own function, and undone by it after the
/// line.
void prepare_terminal(int meta) {
  rl_prep_terminal(meta);
  termios settings = {};
  if (tcgetattr(STDIN_FILENO, &settings) != 0) return;
  settings.c_cc[VINTR] = _POSIX_VDISABLE;
  settings.c_cc[VQUIT] = _POSIX_VDISABLE;
  settings.c_cc[VSUSP] = _POSIX_VDISABLE;  // a host that stands still cannot watch over its coils
  tcsetattr(STDIN_FILENO, TCSANOW, &settings);
}

/// Owner-only, since statements may name patients.
/// Made before readline writes: it would make the file with the rights of the umask.
bool make_private(const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::create_directories(file.parent_path(), error);
  const int made = open(file.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
  if (made < 0) return false;
  close(made);
  return true;
}

class TerminalLines final : public LineEditor {
 public:
  explicit TerminalLines(const std::filesystem::path& history) : history_(history.string()) {
    // readline's state is global: a second editor would take the first one's line.
    if (the_editor != nullptr)
      throw std::logic_error("there is one terminal, and it has a prompt already");
    the_editor = this;
    rl_readline_name = "vitreo";  // for conditions in ~/.inputrc
    rl_catch_signals = 0;         // the run's own handlers stay
    rl_prep_term_function = prepare_terminal;
    // As word_start() has them.
    rl_basic_word_break_characters = " \t\n\"'()[]{}=<>~+-*/%^#&|,;";
    rl_completer_quote_characters = "";
    rl_attempted_completion_function = complete;
    rl_bind_key(kCtrlC, cancel);
    open_history();
  }
  ~TerminalLines() override {
    if (reading_) rl_callback_handler_remove();
    the_editor = nullptr;
  }

  Read read(const std::string& prompt, std::string& line,
            const std::function<bool()>& idle) override {
    done_ = false;
    // readline's callback interface: characters are handed over one by one, and the host's own work
    // goes on in between.
    rl_callback_handler_install(prompt.c_str(), take_line);
    set_reading(true);
    while (!done_) {
      show_waiting();
      pollfd input{STDIN_FILENO, POLLIN, 0};
      // With `idle` the waiting is its: it returns within 20 ms. Without, the poll waits, so that
      // lines from other threads appear in time.
      if (poll(&input, 1, idle ? 0 : 20) > 0)
        rl_callback_read_char();
      else if (idle && !idle())
        leave();
    }
    set_reading(false);
    line = std::move(line_);
    line_.clear();
    show_waiting();
    return result_;
  }

  void forget_ahead() override { tcflush(STDIN_FILENO, TCIFLUSH); }

  // The same statement twice in a row is kept once. A history that cannot be written is given up
  // with one complaint; the prompt goes on.
  void remember(const std::string& statement) override {
    if (statement.empty() || statement == last_) return;
    last_ = statement;
    add_history(statement.c_str());
    if (history_.empty() || append_history(1, history_.c_str()) == 0) return;
    std::cerr << "vitreo: " << history_ << ": the history cannot be kept: " << std::strerror(errno)
              << "\n";
    history_.clear();
  }
  void set_completion(Complete wanted) override { complete_ = std::move(wanted); }
  bool interactive() const override { return true; }

  bool show_above(const std::string& text) override {
    const std::lock_guard lock(mutex_);
    if (!reading_) return false;
    waiting_.push_back(text);
    return true;
  }

 private:
  void open_history() {
    using_history();
    history_comment_char = '#';
    // `history_comment_char` marks the lines with time stamps.
    history_write_timestamps = 1;  // keeps statements of several lines together
    if (history_.empty() || !make_private(history_)) return;
    read_history(history_.c_str());
    if (const HIST_ENTRY* newest = history_get(history_base + history_length - 1))
      last_ = newest->line;
    history_truncate_file(history_.c_str(), kKept);
    stifle_history(kKept);
  }

  /// Other threads ask whether a line is being typed.
  void set_reading(bool reading) {
    const std::lock_guard lock(mutex_);
    reading_ = reading;
  }

  /// In readline's own thread: takes the line being typed off the screen, prints, and draws it
  /// again.
  void show_waiting() {
    std::deque<std::string> lines;
    {
      const std::lock_guard lock(mutex_);
      lines.swap(waiting_);
    }
    if (lines.empty()) return;
    if (reading_) rl_clear_visible_line();
    for (const std::string& line : lines) std::cout << line << "\n";
    std::cout << std::flush;
    if (!reading_) return;
    rl_on_new_line();
    rl_redisplay();
  }

  void finish(Read result) {
    rl_callback_handler_remove();
    result_ = result;
    done_ = true;
  }

  void leave() {
    std::cout << std::endl;
    finish(Read::end);
  }

  /// readline's callback for a line that is complete; null at the end of the input (Ctrl-D).
  static void take_line(char* typed) {
    TerminalLines& self = *the_editor;
    if (typed == nullptr) return self.leave();
    self.line_ = typed;
    std::free(typed);  // readline's
    self.finish(Read::line);
  }

  // Leaves the read() by `result_`; what was typed is gone, as in a shell.
  static int cancel(int, int) {
    std::cout << "^C" << std::endl;
    the_editor->line_ = rl_line_buffer;
    rl_replace_line("", 0);
    the_editor->finish(Read::canceled);
    return 0;
  }

  /// readline wants: first what all have in common, then all, in memory of malloc.
  static char** complete(const char* word, int start, int end) {
    rl_attempted_completion_over = 1;       // no file names
    rl_completion_append_character = '\0';  // readline sets it anew for each completion
    const TerminalLines& self = *the_editor;
    if (!self.complete_) return nullptr;
    // Static, since readline calls the generator below without any context. There is one editor,
    // and it completes in one thread.
    static std::vector<std::string> found;
    found = self.complete_(rl_line_buffer, static_cast<std::size_t>(end));
    (void)start;
    return found.empty() ? nullptr
                         : rl_completion_matches(word, [](const char*, int state) -> char* {
                             static std::size_t next = 0;
                             if (state == 0) next = 0;
                             return next < found.size() ? strdup(found[next++].c_str()) : nullptr;
                           });
  }

  std::string history_;  // file; empty: none
  std::string last_;     // newest statement of the history
  std::string line_;
  Complete complete_;
  bool done_ = false;
  Read result_ = Read::end;
  std::mutex mutex_;  // of the two below
  bool reading_ = false;
  std::deque<std::string> waiting_;
};

}  // namespace

std::unique_ptr<LineEditor> terminal_lines(const std::filesystem::path& history) {
  return std::make_unique<TerminalLines>(history);
}

}  // namespace vitreo
