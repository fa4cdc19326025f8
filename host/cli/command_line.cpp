// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"

#include "host/config/config.h"
#include "host/text/units.h"

#include <CLI/CLI.hpp>

#include <charconv>
#include <limits>
#include <map>

namespace vitreo::cli {

namespace {
constexpr const char* kAboutWord = "protocol";  // the positional word that --help may be about
}  // namespace

// What the header hides of CLI11. `commands` has the order of their declaration, which is that of
// lists, help and man page; `about_word` holds what Command::help_about_word() was given, and a
// std::map keeps the address of each entry that a Command points to.
struct CommandLine::State {
  State(const std::string& about, const std::string& name) : app(about, name) {}
  CLI::App app;
  Action at_root;
  std::vector<std::pair<const CLI::App*, Action>> commands;
  std::map<const CLI::App*, std::function<void()>> about_word;
  char** words = nullptr;

  std::vector<std::string> names() const;
  std::string refusal(const CLI::ParseError& error) const;
};

// Of the commands that people see: CLI11 shows none whose group is empty, so neither does a
// suggestion.
std::vector<std::string> CommandLine::State::names() const {
  std::vector<std::string> known;
  for (const auto& [command, action] : commands)
    if (!command->get_group().empty()) known.push_back(command->get_name());
  return known;
}

namespace {

/// "; did you mean ...?", or nothing where no word is near.
std::string suggestion(const std::string& word, const std::vector<std::string>& known) {
  const std::string near = nearest(word, known);
  return near.empty() ? "" : "; did you mean " + near + "?";
}

// Long names only: a near miss of one letter would suggest any other letter.
std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> known;
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  return known;
}

}  // namespace

/// One line that says what is wrong, and where to read on.
/// CLI11 knows the deepest command that it entered; words that no command took are in remaining().
/// At the top a word without a dash must have been meant as a command; anywhere else it is an
/// option or a word too many of that command.
std::string CommandLine::State::refusal(const CLI::ParseError& error) const {
  const CLI::App* at = &app;
  for (const auto& [command, action] : commands)
    if (command->parsed()) at = command;
  const std::vector<std::string> extra = app.remaining(true);
  std::string what = error.what();
  if (at == &app && !extra.empty() && !extra.front().starts_with("-"))
    what = "there is no command '" + extra.front() + "'" + suggestion(extra.front(), names());
  else if (!extra.empty())
    what = "'" + extra.front() + "' is not understood" +
           (extra.front().starts_with("--") ? suggestion(extra.front(), option_names(*at)) : "");
  return what + "; see vitreo " + (at == &app ? "" : at->get_name() + " ") + "--help";
}

CommandLine::CommandLine(const std::string& about, const std::string& name)
    : state_(std::make_unique<State>(about, name)) {}
CommandLine::~CommandLine() = default;

Command CommandLine::root(Action action) {
  state_->at_root = std::move(action);
  return Command(state_->app);
}

// `action` is called by run() after the whole line was parsed, so the order of options and words is
// free.
Command CommandLine::command(const std::string& name, const std::string& help, Action action) {
  CLI::App* app = state_->app.add_subcommand(name, help);
  app->get_formatter()->column_width(28);
  app->footer("");  // CLI11 would show the program's own examples
  state_->commands.emplace_back(app, std::move(action));
  Command made(*app);
  made.about_word_ = &state_->about_word[app];
  return made;
}

void CommandLine::version(std::function<std::string()> text) {
  state_->app.set_version_flag("--version", std::move(text));
}

char** CommandLine::words() const { return state_->words; }

// CLI11 reports by exceptions: CallForHelp and other Success for what was asked for and is done,
// ParseError for what was not understood. CallForHelp is a Success, so it is caught before.
int CommandLine::run(int count, char** words) {
  state_->words = words;
  try {
    state_->app.parse(count, words);
  } catch (const CLI::CallForHelp& call) {
    // `vitreo run NAME --help` is about the protocol.
    for (const auto& [command, print] : state_->about_word)
      if (command->parsed() && print && command->get_option_no_throw(kAboutWord) != nullptr &&
          command->get_option(kAboutWord)->count() > 0)
        return print(), 0;
    return state_->app.exit(call);
  } catch (const CLI::Success& call) {
    return state_->app.exit(call);
  } catch (const CLI::ParseError& error) {
    throw ConfigError(state_->refusal(error));
  }
  for (const auto& [app, action] : state_->commands)
    if (app->parsed()) return action();
  return state_->at_root();
}

namespace {

/// Validator for CLI11: the complaint about what is no whole number, or nothing. CLI11's own
/// conversion takes -1 for the largest unsigned number.
template <class Number>
std::string is_number(const std::string& text) {
  Number number{};
  const char* const end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, number);
  if (read.ec == std::errc() && read.ptr == end && !text.empty()) return "";
  return "wants a whole number from " + std::to_string(std::numeric_limits<Number>::min()) +
         " to " + std::to_string(std::numeric_limits<Number>::max()) + "; got '" + text + "'";
}

// A number with a unit is refused: these options state their own unit (px), and 6mm would be taken
// as 6e-3 of it.
std::string is_plain_number(const std::string& text) {
  const auto quantity = parse_quantity(text);
  return quantity && quantity->bare ? "" : "wants a plain number; got '" + text + "'";
}

// The time in s. Zero is refused with the negative ones: a limit of nothing would end before it
// began.
double seconds_in(const std::string& option, const std::string& text) {
  const auto quantity = parse_quantity(text);
  if (!quantity || !(quantity->bare || quantity->dimension == "s") || !(quantity->value > 0))
    throw ConfigError(option + ": wants a time above zero, such as 10s; got '" + text + "'");
  return quantity->value;
}

}  // namespace

Option Command::option(const std::string& names, std::string& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, std::vector<std::string>& into,
                       const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, std::uint64_t& into, const std::string& help) {
  return Option(app_.add_option(names, into, help)->check(is_number<std::uint64_t>));
}
Option Command::option(const std::string& names, int& into, const std::string& help) {
  return Option(app_.add_option(names, into, help)->check(is_number<int>));
}
Option Command::option(const std::string& names, double& into, const std::string& help) {
  return Option(app_.add_option(names, into, help)->check(is_plain_number));
}
// A function and not a variable of CLI11's: it converts while it parses, so that an error names the
// option as it was declared.
Option Command::seconds(const std::string& names, double& into, const std::string& help) {
  return Option(app_.add_option_function<std::string>(
      names, [names, &into](const std::string& text) { into = seconds_in(names, text); }, help));
}
Option Command::flag(const std::string& names, bool& into, const std::string& help) {
  return Option(app_.add_flag(names, into, help));
}

Command& Command::examples(const std::vector<std::string>& lines) {
  std::string text = "\nFor instance\n";
  for (const std::string& line : lines) text += "  " + line + "\n";
  return app_.footer(text), *this;
}
Command& Command::help_about_word(std::function<void()> print) {
  return *about_word_ = std::move(print), *this;
}
Command& Command::hidden() { return app_.group(""), *this; }

namespace {

// The declaration as plain data, without CLI11's types: completion, man page and tests read that. A
// flag expects no value, so its largest number of them is 0.
Described describe_one(const CLI::App& app, const std::string& name) {
  Described made{name, app.get_description(), app.get_footer(), {}};
  for (const CLI::Option* option : app.get_options()) {
    Described::Word word;
    word.positional = option->get_positional();
    for (const std::string& one : option->get_snames()) word.names.push_back("-" + one);
    for (const std::string& one : option->get_lnames()) word.names.push_back("--" + one);
    if (word.positional) word.names = {option->get_name(true)};
    word.help = option->get_description();
    word.takes_value = option->get_expected_max() > 0;
    made.words.push_back(word);
  }
  return made;
}

}  // namespace

std::vector<Described> CommandLine::describe() const {
  std::vector<Described> all{describe_one(state_->app, "")};
  for (const auto& [command, action] : state_->commands)
    if (!command->get_group().empty()) all.push_back(describe_one(*command, command->get_name()));
  return all;
}

// Each word is a flag of its own that adds its name.
void Command::flags(const std::vector<std::pair<std::string, std::string>>& words,
                    std::vector<std::string>& into) {
  for (const auto& [word, help] : words)
    app_.add_flag_function(
        "--" + word, [&into, name = word](std::int64_t) { into.push_back(name); }, help);
}

Option Option::required() { return option_->required(), *this; }
Option Option::needs(const std::string& other) { return option_->needs(other), *this; }
Option Option::delimiter(char separator) { return option_->delimiter(separator), *this; }
Option Option::one_word_each() { return option_->allow_extra_args(false), *this; }
// The range is checked but not shown as CLI11's own "INT in [0 - 65535]": the help text says it
// where it matters.
Option Option::between(int least, int most) {
  return option_->check(CLI::Validator(CLI::Range(least, most)).description("")), *this;
}

}  // namespace vitreo::cli
