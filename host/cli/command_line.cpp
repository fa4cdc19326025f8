// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"

#include "host/run_engine.h"

#include <CLI/CLI.hpp>

namespace vitreo::cli {

struct CommandLine::State {
  State(const std::string& about, const std::string& name) : app(about, name) {}
  CLI::App app;
  Action at_root;
  std::vector<std::pair<const CLI::App*, Action>> commands;
  char** words = nullptr;
};

CommandLine::CommandLine(const std::string& about, const std::string& name)
    : state_(std::make_unique<State>(about, name)) {}
CommandLine::~CommandLine() = default;

Command CommandLine::root(Action action) {
  state_->at_root = std::move(action);
  return Command(state_->app);
}

Command CommandLine::command(const std::string& name, const std::string& help, Action action) {
  CLI::App* app = state_->app.add_subcommand(name, help);
  state_->commands.emplace_back(app, std::move(action));
  return Command(*app);
}

void CommandLine::version(std::function<std::string()> text) {
  state_->app.set_version_flag("--version", std::move(text));
}

char** CommandLine::words() const { return state_->words; }

int CommandLine::run(int count, char** words) {
  state_->words = words;
  try {
    state_->app.parse(count, words);
  } catch (const CLI::ParseError& error) {
    return state_->app.exit(error) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  for (const auto& [app, action] : state_->commands)
    if (app->parsed()) return action();
  return state_->at_root();
}

Option Command::option(const std::string& names, std::string& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, std::vector<std::string>& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, std::uint64_t& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, int& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::option(const std::string& names, double& into, const std::string& help) {
  return Option(app_.add_option(names, into, help));
}
Option Command::flag(const std::string& names, bool& into, const std::string& help) {
  return Option(app_.add_flag(names, into, help));
}

void Command::one_of(const std::vector<std::string>& words, std::string& into) {
  CLI::Option_group* group = app_.add_option_group("format");
  for (const std::string& word : words)
    group->add_flag_function(
        "--" + word, [&into, word](std::int64_t) { into = word; }, "as " + word);
  group->require_option(1);
}

Option Option::required() { return option_->required(), *this; }
Option Option::needs(const std::string& other) { return option_->needs(other), *this; }
Option Option::delimiter(char separator) { return option_->delimiter(separator), *this; }
Option Option::one_word_each() { return option_->allow_extra_args(false), *this; }
Option Option::between(int least, int most) { return option_->check(CLI::Range(least, most)), *this; }

}  // namespace vitreo::cli
