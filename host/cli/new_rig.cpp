// SPDX-License-Identifier: Apache-2.0
#include "host/cli/new_rig.h"

#include "devices/time/clock.h"
#include "host/cli/program.h"
#include "host/engine/run_result.h"
#include "host/files/posix_file.h"
#include "host/lua/engine/library.h"
#include "host/lua/script/reading.h"
#include "host/rig/calibrations.h"
#include "host/rig/interview/rig_interview.h"
#include "host/rig/plugged_in.h"
#include "host/rig/rig_settings.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <unistd.h>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

/// Where answers come from.
class Answers {
 public:
  virtual ~Answers() = default;
  /// One line; nothing: there are no more.
  virtual std::optional<std::string> next(const InterviewQuestion& question) = 0;
  /// Whether a refused answer is asked for again: by a person alone. Lines that were written for
  /// other questions would give a wrong rig.
  virtual bool asks_again() const { return false; }
  /// Throws ConfigError for answers that were not asked for.
  virtual void finish() const {}
};

/// Lines in the order of the questions.
class Lines final : public Answers {
 public:
  explicit Lines(bool terminal) : terminal_(terminal) {}
  std::optional<std::string> next(const InterviewQuestion& question) override {
    std::string line;
    if (std::getline(std::cin, line)) {
      any_ = true;
      return line;
    }
    if (terminal_) return std::nullopt;
    if (!any_)
      throw ConfigError(
          "new rig: asks at a terminal, and the standard input is none: give --answers FILE, or "
          "the "
          "answers line by line on the standard input");
    throw ConfigError("new rig: the answers end before " + question.key + ": nothing is written");
  }
  bool asks_again() const override { return terminal_; }

 private:
  const bool terminal_;
  bool any_ = false;
};

/// "key = answer" lines, in any order; of a key that stands there several times, in their order.
/// What is not there has its default.
class AnswerFile final : public Answers {
 public:
  explicit AnswerFile(const std::string& file) : file_(file) {
    std::ifstream in(file);
    if (!in) throw ConfigError(file + ": cannot be read: " + std::strerror(errno));
    std::string line;
    for (int number = 1; std::getline(in, line); ++number) add(line, number);
  }

  std::optional<std::string> next(const InterviewQuestion& question) override {
    const auto found = answers_.find(question.key);
    if (found == answers_.end() || found->second.empty()) {
      if (question.fallback.empty())
        throw ConfigError(fmt::format("{}: has no answer to {}, which has no default: {}", file_,
                                      question.key, question.text));
      return "";
    }
    const std::string answer = found->second.front().text;
    found->second.pop_front();
    return answer;
  }

  void finish() const override {
    for (const auto& [key, left] : answers_)
      if (!left.empty())
        throw ConfigError(
            fmt::format("{}:{}: {}: was not asked for", file_, left.front().line, key));
  }

 private:
  struct Answer {
    std::string text;
    int line;
  };

  static std::string stripped(const std::string& text) {
    const std::size_t begin = text.find_first_not_of(" \t\r");
    if (begin == std::string::npos) return "";
    return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
  }

  void add(const std::string& line, int number) {
    const std::string text = stripped(line);
    if (text.empty() || text.front() == '#') return;
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos)
      throw ConfigError(fmt::format("{}:{}: wants key = answer", file_, number));
    answers_[stripped(text.substr(0, equals))].push_back(
        {stripped(text.substr(equals + 1)), number});
  }

  const std::string file_;
  std::map<std::string, std::deque<Answer>> answers_;
};

std::unique_ptr<Answers> answers_of(const NewRigWords& words) {
  if (!words.answers.empty()) return std::make_unique<AnswerFile>(words.answers);
  return std::make_unique<Lines>(isatty(STDIN_FILENO) != 0);
}

bool is_rig_name(const std::string& name) {
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyz_0123456789";
  return !name.empty() && name.size() <= 60 && name[0] >= 'a' && name[0] <= 'z' &&
         name.find_first_not_of(kLetters) == std::string::npos;
}

/// `bench`, `bench.lua` or `folder/bench.lua`. Also of the program's own rigs there is only one of
/// each name: `--rig bench` would open one of two.
std::string file_for(const std::string& given) {
  const fs::path file = given.ends_with(".lua") ? fs::path(given) : fs::path(given + ".lua");
  const std::string name = file.stem().string();
  if (!is_rig_name(name))
    throw ConfigError("'" + name + "' is not a name: small letters, digits and _, a letter first");
  if (fs::exists(fs::symlink_status(file)))
    throw ConfigError(file.string() +
                      ": is there already, and is not written over: choose another name");
  for (const std::string& own : Program::rig_files())
    if (fs::path(own).stem() == name)
      throw ConfigError("a rig named " + name + " is among the program's own (" + own +
                        "): choose another name");
  if (file.has_parent_path() && !fs::is_directory(file.parent_path()))
    throw ConfigError(file.parent_path().string() + ": there is no such folder");
  return file.string();
}

/// The same reading and the same bounds as of each run.
void check_whole(const std::string& file, const std::string& lua) {
  try {
    RigDescription rig = lua::read_recorded_rig(lua::library(), {file, lua}, {});
    rig.folders = {Program::in_data_folder("scripts")};
    check_rig(rig);
  } catch (const ScriptError& problem) {
    throw ConfigError(problem.what());
  }
}

/// Fails where the file is there, also when it was made in the meantime.
void write_new_file(const std::string& file, const std::string& text) {
  const Descriptor made(create_new_file(file));
  append_whole(made.number(), text, file);
  sync_file(made.number(), file);
}

InterviewWorld world_here(Clock& clock, bool shown) {
  InterviewWorld world;
  world.plugged_in = find_instruments();
  world.plan = plan_for_address;
  // The plan was shown with the question: `before` has nothing to add.
  world.ask = [&clock, shown](const std::string& address) {
    return ask_address(
        address, clock, [](const AskingPlan&) {},
        [shown](const std::string& line) {
          if (!shown) return;
          fmt::print("  {}\n", line);
          std::fflush(stdout);
        });
  };
  world.file_for = file_for;
  world.check = check_whole;
  world.today = today_text();
  world.folders = {Program::in_data_folder("scripts")};
  return world;
}

/// Until all is answered or the person has left.
void interview(RigInterview& asked, Answers& answers, bool shown) {
  while (!asked.done() && !asked.left()) {
    const InterviewQuestion question = asked.question();
    if (shown) fmt::print("{}", to_text(question));
    std::fflush(stdout);
    const std::optional<std::string> line = answers.next(question);
    if (shown && !answers.asks_again()) fmt::print("{}\n", line.value_or(""));
    if (shown && !line) fmt::print("\n");
    const InterviewReply reply = asked.answer(line.value_or("quit"));
    if (reply.kind == InterviewReply::Kind::refused && !answers.asks_again())
      throw ConfigError("new rig: " + question.key + ": " + reply.text + ": nothing is written");
    if (shown && !reply.text.empty())
      fmt::print("{}{}", wrapped(reply.text), reply.text.ends_with('\n') ? "" : "\n");
  }
}

std::string next_steps(const std::string& file) {
  return fmt::format(
      "{0} is written. Next:\n"
      "  vitreo doctor --rig {0}        is the machine set up for it\n"
      "  vitreo devices --rig {0}       open each instrument; nothing moves\n"
      "  vitreo check hold --rig {0}    a dry run: would a protocol be let\n",
      file);
}

}  // namespace

int new_rig(const NewRigWords& words) {
  const std::unique_ptr<Answers> answers = answers_of(words);
  const auto clock = wall_clock();
  if (!words.name.empty()) file_for(words.name);  // before a second of looking for cameras
  RigInterview asked(world_here(*clock, !words.json), words.name);
  if (!words.json)
    fmt::print("Enter takes the answer in [ ]; ? explains, back goes back, quit leaves.\n\n");
  interview(asked, *answers, !words.json);
  if (asked.left()) return static_cast<int>(ExitCode::stopped);
  answers->finish();
  const RigDraft& draft = asked.draft();
  write_new_file(draft.file, to_lua(draft));
  if (words.json)
    fmt::print(
        "{}\n",
        nlohmann::json{{"files", {draft.file}}, {"changed", nlohmann::json::array()}}.dump());
  else
    fmt::print("{}", next_steps(draft.file));
  return 0;
}

}  // namespace vitreo::cli
