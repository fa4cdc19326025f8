// Interview that makes a rig file: `vitreo new rig`. Questions and answers as data; who shows and
// types them is elsewhere.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/asking.h"
#include "host/rig/interview/rig_draft.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// What the interview needs to know of the machine. Its functions are called during answer().
struct InterviewWorld {
  nlohmann::json plugged_in = nlohmann::json::array();  ///< as find_instruments() gives it
  std::function<AskingPlan(const std::string& address)> plan;
  /// Throws ConfigError for an address that cannot be asked, DeviceError.
  std::function<AskingResult(const std::string& address)> ask;
  /// The file of a rig of that name. Throws ConfigError where there is one already, or for no name.
  std::function<std::string(const std::string& name)> file_for;
  /// The whole file, as it would be written. Throws ConfigError where no rig can be opened by it.
  std::function<void(const std::string& file, const std::string& lua)> check;
  std::string today;  ///< "2026-11-21"
};

struct AnswerOption {
  std::string word;
  std::string text;
};

struct InterviewQuestion {
  std::string key;     ///< "coils.current_limit"; the name of its answer in a file of answers
  std::string before;  ///< shown above it, in lines; may be empty
  std::string text;
  std::string help;
  std::vector<AnswerOption> options{};  ///< answered by word or number; empty: free
  std::string fallback{};         ///< taken for an empty line; empty: there must be an answer
  std::string wanted{};           ///< "a current, 0.1 to 20 A"; empty: the options tell it
};
/// For people: what stands above the place where the answer is typed.
std::string to_text(const InterviewQuestion& question);

struct InterviewReply {
  enum class Kind { accepted, refused, explained, back, quit };
  Kind kind;
  std::string text;  ///< for people; may be empty
};

/// At one question at a time, from the rig's name to the whole file.
class RigInterview {
 public:
  /// `name`: of the rig or its file; empty: it is asked for. Throws ConfigError as `file_for` does.
  RigInterview(InterviewWorld world, const std::string& name);
  ~RigInterview();
  RigInterview(const RigInterview&) = delete;
  RigInterview& operator=(const RigInterview&) = delete;

  /// All is answered, and the person wants the file. No question is there then.
  bool done() const;
  /// A person quit: nothing is to be written.
  bool left() const;
  const InterviewQuestion& question() const;
  /// One line as typed: an answer, nothing (the default), "?", "back" or "quit". What is refused
  /// leaves the question as it was.
  InterviewReply answer(const std::string& typed);
  const RigDraft& draft() const;

 private:
  struct Inner;
  const std::unique_ptr<Inner> inner_;
};

}  // namespace vitreo
