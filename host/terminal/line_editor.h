// Line editor: source of the prompt's lines, a terminal with editing, history and completion, or
// any stream.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

class LineEditor {
 public:
  /// canceled: Ctrl-C took back what was being typed, which `line` is then.
  enum class Read { line, canceled, end };
  /// Candidates for the word that ends at `cursor`; each replaces the word from its
  /// first letter on. A word reaches back to a blank, a quote, a bracket or an operator; dots and
  /// colons belong to it.
  using Complete =
      std::function<std::vector<std::string>(const std::string& line, std::size_t cursor)>;

  virtual ~LineEditor() = default;
  /// Waits for a line, without its end. `idle` is called again and again meanwhile; it returns
  /// within some 20 ms, and false where no more lines are wanted: the end.
  virtual Read read(const std::string& prompt, std::string& line,
                    const std::function<bool()>& idle) = 0;
  /// Forgets what was typed ahead and is not read yet; of a stream nothing, which is a script.
  virtual void forget_ahead() {}
  /// Puts a whole statement, of one line or several, into the history.
  virtual void remember(const std::string& statement) = 0;
  virtual void set_completion(Complete complete) = 0;
  /// A person types the lines.
  virtual bool interactive() const = 0;
  /// Shows a line above what is being typed; false when nothing is being typed, and nothing was
  /// shown. Any thread.
  virtual bool show_above(const std::string& text) = 0;
};

/// Reads a stream; shows prompts on `out` when `interactive`. No history, no completion.
std::unique_ptr<LineEditor> stream_lines(std::istream& in, std::ostream& out, bool interactive);

/// GNU readline on the standard input and output, which must be a terminal; one at a time. The
/// history is kept in `history` (its folder is made; empty: it is not kept), the newest 5000
/// statements.
std::unique_ptr<LineEditor> terminal_lines(const std::filesystem::path& history);
/// $XDG_STATE_HOME/vitreo/history, else ~/.local/state/vitreo/history; empty where there is no
/// home.
std::filesystem::path history_file();

/// Index of the first character of the word that ends at `cursor`.
std::size_t word_start(const std::string& line, std::size_t cursor);

}  // namespace vitreo
