// Command line: commands, their options and their help, over CLI11, whose headers only one file of
// ours reads.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace vitreo::cli {

/// One option or positional word of a command; each call returns the same option.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option required();
  /// Another option of the command, which must be given with this one.
  Option needs(const std::string& other);
  Option delimiter(char separator);  ///< a list may be given as one word
  /// Of a list: each `--name word` adds one, and the word after that does not belong to it.
  Option one_word_each();
  Option between(int least, int most);

 private:
  CLI::Option* option_;
};

/// A command. `names`: "word" is positional, "--word" or "--word,-w" an option. What `into` refers
/// to must live as long as the command line (keep it in a shared_ptr that the command's action
/// captures); it keeps its value when the word is not given.
class Command {
 public:
  explicit Command(CLI::App& app) : app_(app) {}
  Option option(const std::string& names, std::string& into, const std::string& help);
  Option option(const std::string& names, std::vector<std::string>& into, const std::string& help);
  Option option(const std::string& names, std::uint64_t& into, const std::string& help);
  Option option(const std::string& names, int& into, const std::string& help);
  Option option(const std::string& names, double& into, const std::string& help);
  /// A time with its unit, "10s"; a bare number is in s. Throws ConfigError.
  Option seconds(const std::string& names, double& into, const std::string& help);
  Option flag(const std::string& names, bool& into, const std::string& help);
  /// A flag for each of these, {word, help}; `into` gets the words of those that are given.
  void flags(const std::vector<std::pair<std::string, std::string>>& words,
             std::vector<std::string>& into);
  /// Shown below the options, one a line.
  Command& examples(const std::vector<std::string>& lines);
  /// Called when --help is asked with a first positional word: prints the help about that, instead
  /// of the command's.
  Command& help_about_word(std::function<void()> print);
  /// Not shown in lists.
  Command& hidden();

 private:
  friend class CommandLine;
  CLI::App& app_;
  std::function<void()>* about_word_ = nullptr;
};

/// A command as it was declared: for completion and the man page.
struct Described {
  struct Word {
    std::vector<std::string> names;  // "--json"; the bare name of a positional word
    std::string help;
    bool positional = false;
    bool takes_value = false;
  };
  std::string name;  // "" for the program without a command
  std::string help;
  std::string examples;
  std::vector<Word> words;
};

class CommandLine {
 public:
  using Action = std::function<int()>;  // returns the exit code

  CommandLine(const std::string& about, const std::string& name);
  ~CommandLine();
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  /// The words without a command: the program's own options, and what it does then.
  Command root(Action action);
  Command command(const std::string& name, const std::string& help, Action action);
  void version(std::function<std::string()> text);  ///< what --version prints

  /// Parses the words and does what they ask; 0 for --help and --version. Throws ConfigError for
  /// words that are not understood: one line that says what is wrong, and where to read on.
  int run(int count, char** words);
  char** words() const;  ///< those that run() was given
  /// The program's own words, then every command that is not hidden.
  std::vector<Described> describe() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::cli
