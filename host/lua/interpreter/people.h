// Waits for an operator's answer, at the terminal or through the control socket.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/wait.h"
#include "host/session/questions.h"

#include <functional>
#include <string>

namespace vitreo::lua {

/// In real time the clock goes on, and the loop with it; otherwise it stands still, so that the
/// answer comes at the same time in every run of the same seed. After `limit` seconds of wall time
/// it is std::runtime_error.
Wait wait_for_people(const Call& call, const std::string& what, const std::function<bool()>& ready,
                     const std::function<int(Call&)>& then, double limit);

/// What a call does with the answer; as Wait::finish.
using OnAnswer = std::function<int(Call&, const ArgumentValue&)>;
/// `return ask_people(...)`: asks the operator, by name if `question.answer` has one, and goes on
/// with the answer. Question and answer are events of the record. After `limit` seconds of wall
/// time without one it is std::runtime_error.
int ask_people(Call& call, const Question& question, double limit, const OnAnswer& then);

}  // namespace vitreo::lua
