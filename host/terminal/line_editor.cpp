// SPDX-License-Identifier: Apache-2.0
#include "host/terminal/line_editor.h"

#include "host/files/state_folder.h"

#include <istream>
#include <ostream>
#include <poll.h>
#include <unistd.h>

namespace vitreo {
namespace {

// For pipes and files, and for a terminal without editing. `idle` is called only where a person
// types: between two lines of a file there is nothing to wait for.
class StreamLines final : public LineEditor {
 public:
  StreamLines(std::istream& in, std::ostream& out, bool interactive)
      : in_(in), out_(out), interactive_(interactive) {}

  Read read(const std::string& prompt, std::string& line,
            const std::function<bool()>& idle) override {
    if (interactive_) {
      out_ << prompt << std::flush;
      pollfd input{STDIN_FILENO, POLLIN, 0};
      // What the stream has buffered already is not seen by poll().
      while (idle && in_.rdbuf()->in_avail() <= 0 && poll(&input, 1, 0) == 0)
        if (!idle()) return Read::end;
    }
    return std::getline(in_, line) ? Read::line : Read::end;
  }
  void remember(const std::string&) override {}
  void set_completion(Complete) override {}
  bool interactive() const override { return interactive_; }
  bool show_above(const std::string&) override { return false; }

 private:
  std::istream& in_;
  std::ostream& out_;
  const bool interactive_;
};

}  // namespace

std::unique_ptr<LineEditor> stream_lines(std::istream& in, std::ostream& out, bool interactive) {
  return std::make_unique<StreamLines>(in, out, interactive);
}

std::filesystem::path history_file() {
  const std::filesystem::path folder = state_folder();
  return folder.empty() ? folder : folder / "history";
}

// Dots and colons belong to a word: "rig.coils:set" is completed as one.
std::size_t word_start(const std::string& line, std::size_t cursor) {
  // As readline's in terminal_lines.cpp.
  constexpr const char* kBreaks = " \t\n\"'()[]{}=<>~+-*/%^#&|,;";
  if (cursor > line.size()) cursor = line.size();
  if (cursor == 0) return 0;
  const std::size_t at = line.find_last_of(kBreaks, cursor - 1);
  return at == std::string::npos ? 0 : at + 1;
}

}  // namespace vitreo
