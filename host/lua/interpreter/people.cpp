// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/people.h"

#include "host/lua/interpreter/context.h"
#include "host/text/units.h"

#include <chrono>
#include <stdexcept>
#include <thread>

namespace vitreo::lua {
namespace {

using Instant = std::chrono::steady_clock::time_point;

constexpr std::chrono::milliseconds kLookOutside{
    10};  // of wall time, for what people do while the clock stands
constexpr Time kLook = std::chrono::milliseconds(50);  // of the clock, where it goes on
/// In real time the clock's wait is short, and taken again and again. On the virtual clock nothing
/// may pass while people think: the thread sleeps by the wall, and the clock stands.
Wait wait_until(const Call& call, const std::string& what, const std::function<bool()>& ready,
                const std::function<int(Call&)>& then, double limit, Instant give_up) {
  Session& session = session_of(call.L);
  const auto late = [give_up] { return std::chrono::steady_clock::now() >= give_up; };
  Wait wait;
  wait.what = what;
  session.control.set_waiting_for(what);
  if (!session.real_time)
    while (!ready() && !late() && session.control.tier() == StopTier::none)
      std::this_thread::sleep_for(kLookOutside);
  // Not yet answered: the clock's wait is what a stop breaks off.
  wait.deadline = ready() || late() ? session.clock.now() : later(session.clock.now(), kLook);
  wait.finish = [=](Call& done, bool) {
    if (ready()) return then(done);
    if (late())
      throw std::runtime_error("waited for " + what + " for " + format_quantity(limit, "s") +
                               " in vain");
    return done.wait(wait_until(done, what, ready, then, limit, give_up));
  };
  return wait;
}

/// What the operator typed, if anything: an answer that does not do is said why, and the question
/// stays open. What was typed ahead is the next question's.
bool answered(Session& session) {
  if (session.questions.answered()) return true;
  if (const auto line = session.listener.typed()) {
    try {
      session.questions.answer(*line, "operator at the terminal");
    } catch (const ConfigError& problem) {
      session.listener.message(problem.what());
    }
  }
  return session.questions.answered();
}

/// Closes a question that nobody waits for any more: its task was stopped, or lost its patience.
struct Asked {
  Questions& questions;
  const int number;
  Asked(Questions& all, int this_one) : questions(all), number(this_one) {}
  Asked(const Asked&) = delete;
  Asked& operator=(const Asked&) = delete;
  ~Asked() { questions.withdraw(number); }
};

/// Tasks side by side ask one after the other: one answer must not be taken for another question's.
Wait wait_for_turn(const Call& call, const Question& question, double limit, const OnAnswer& then) {
  Session& session = session_of(call.L);
  Wait wait;
  wait.what = "its turn to ask '" + question.text + "'";
  wait.deadline = later(session.clock.now(), kLook);
  wait.finish = [=](Call& done, bool) { return ask_people(done, question, limit, then); };
  return wait;
}

}  // namespace

Wait wait_for_people(const Call& call, const std::string& what, const std::function<bool()>& ready,
                     const std::function<int(Call&)>& then, double limit) {
  const auto patience = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(limit));
  return wait_until(call, what, ready, then, limit, std::chrono::steady_clock::now() + patience);
}

int ask_people(Call& call, const Question& question, double limit, const OnAnswer& then) {
  Session& session = session_of(call.L);
  call.check_can_wait();
  if (session.questions.open()) return call.wait(wait_for_turn(call, question, limit, then));
  session.recorder.event(session.clock.now(), "question", shown(question));
  // Shared by the functions of a wait, which are copied; the last of them to go closes the
  // question.
  const auto asked = std::make_shared<Asked>(session.questions, session.questions.ask(question));
  if (session.questions.answered())
    session.listener.message(shown(question) + ": answered in advance");
  else
    session.listener.question(question);
  return call.wait(wait_for_people(
      call, "an answer to '" + question.text + "'", [&session, asked] { return answered(session); },
      [&session, then](Call& done) {
        const auto answer = session.questions.take();
        session.recorder.event(session.clock.now(), "answer",
                               answer->text + " (" + answer->by + ")");
        return then(done, answer->value);
      },
      limit));
}

}  // namespace vitreo::lua
