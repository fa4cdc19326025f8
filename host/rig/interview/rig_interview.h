// Interview that makes a rig file: `vitreo new rig`. Questions and answers as data; who shows and
// types them is elsewhere.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/interview/question.h"
#include "host/rig/interview/rig_draft.h"

#include <memory>
#include <string>

namespace vitreo {

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
