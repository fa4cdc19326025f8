// SPDX-License-Identifier: Apache-2.0
#include "host/rig/asking.h"

#include "devices/links/dialogue.h"
#include "devices/links/printable.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <set>
#include <stdexcept>

namespace vitreo {
namespace {

using namespace std::chrono_literals;

/// After the last byte of an answer; a USB adapter holds bytes back for 16 ms.
constexpr Time kAnswerSilence = 100ms;
/// What comes unasked before the first question is passed over for at most so long.
constexpr Time kLongestChatter = 1s;
constexpr Time kSendTimeout = 1s;
/// An instrument that does not fall silent is heard so far.
constexpr std::size_t kMostHeard = 4096;
/// Of an identity.
constexpr std::size_t kMostShown = 200;

/// One question and those who ask it, before it is spread over its rates.
struct SharedQuestion {
  PortQuestion question;
  std::vector<IdentifiedDriver> drivers;
};

/// Two drivers whose question is the same one share it, and its answer.
std::vector<SharedQuestion> shared_questions(const std::vector<IdentifiedDriver>& drivers) {
  std::vector<SharedQuestion> all;
  for (const IdentifiedDriver& driver : drivers) {
    if (!driver.identification.question) continue;
    const PortQuestion& question = *driver.identification.question;
    const auto same = std::find_if(all.begin(), all.end(), [&](const SharedQuestion& other) {
      return other.question.messages == question.messages &&
             other.question.baud_rates == question.baud_rates;
    });
    if (same == all.end())
      all.push_back({question, {driver}});
    else
      same->drivers.push_back(driver);
  }
  return all;
}

bool holds_command_of(const PortQuestion& question, const IdentifiedDriver& driver) {
  const std::string_view commands = driver.identification.commands;
  return std::any_of(question.messages.begin(), question.messages.end(), [&](const auto& message) {
    return std::any_of(message.begin(), message.end(), [&](std::uint8_t byte) {
      return commands.find(static_cast<char>(byte)) != std::string_view::npos;
    });
  });
}

/// A question at one of its rates, until it has its place in the order.
struct WaitingStep {
  const SharedQuestion* asks;
  int baud_rate;
  std::size_t rank;  // of the rate, the likeliest is 0
};

/// Whether an instrument that is still to be asked, by another question, would take a byte of
/// `next` for a command.
bool must_wait(const WaitingStep& next, const std::vector<WaitingStep>& waiting) {
  return std::any_of(waiting.begin(), waiting.end(), [&](const WaitingStep& other) {
    return other.asks != next.asks &&
           std::any_of(other.asks->drivers.begin(), other.asks->drivers.end(),
                       [&](const IdentifiedDriver& driver) {
                         return holds_command_of(next.asks->question, driver);
                       });
  });
}

/// Likeliest rates first, as far as no step must wait for another.
std::vector<WaitingStep> in_safe_order(std::vector<WaitingStep> waiting) {
  std::stable_sort(waiting.begin(), waiting.end(),
                   [](const WaitingStep& a, const WaitingStep& b) { return a.rank < b.rank; });
  std::vector<WaitingStep> ordered;
  while (!waiting.empty()) {
    const auto next = std::find_if(waiting.begin(), waiting.end(), [&](const WaitingStep& one) {
      return !must_wait(one, waiting);
    });
    if (next == waiting.end())
      throw std::logic_error("asking: each question left holds a command of another instrument");
    ordered.push_back(*next);
    waiting.erase(next);
  }
  return ordered;
}

std::string messages_text(const PortQuestion& question) {
  std::vector<std::string> shown;
  for (const ByteString& message : question.messages) shown.push_back(printable(message));
  return fmt::format("{}", fmt::join(shown, "  "));
}

std::string at_rate(int baud_rate) {
  return baud_rate > 0 ? fmt::format(" at {} baud", baud_rate) : "";
}

std::string names_of(const std::vector<IdentifiedDriver>& drivers) {
  std::vector<std::string> names;
  for (const IdentifiedDriver& driver : drivers) names.push_back(driver.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

/// A port while it is asked: opened at one rate at a time.
class AskedPort {
 public:
  AskedPort(const OpenLine& open, Clock& clock) : open_(open), clock_(clock) {}

  void prepare(const AskingStep& step) {
    SerialSettings line = step.file ? step.file->line : SerialSettings{};
    line.baud_rate = step.baud_rate;
    if (!link_ || line_ != to_string(line)) {
      link_.reset();  // a port has one owner
      link_ = open_(line);
      line_ = to_string(line);
      opened_ = clock_.now();
    }
    clock_.sleep_until(later(opened_, from_seconds(step.question.opening_pause)));
    const Time end = later(clock_.now(), kLongestChatter);
    while (clock_.now() < end && !link_->read(kMostHeard, kAnswerSilence / 2).empty()) {
    }
  }

  ByteString exchange(const ByteString& message, double patience) {
    link_->write(message, kSendTimeout);
    ByteString answer = link_->read(kMostHeard, from_seconds(patience));
    while (!answer.empty() && answer.size() < kMostHeard) {
      const ByteString more = link_->read(kMostHeard - answer.size(), kAnswerSilence);
      if (more.empty()) break;
      answer.insert(answer.end(), more.begin(), more.end());
    }
    return answer;
  }

 private:
  const OpenLine& open_;
  Clock& clock_;
  std::unique_ptr<ByteLink> link_;
  std::string line_;
  Time opened_{};
};

/// Takes what was sent off the answer's begin; whether it stood there.
bool take_echo(ByteString& answer, const ByteString& message) {
  if (answer.size() < message.size() || !std::equal(message.begin(), message.end(), answer.begin()))
    return false;
  answer.erase(answer.begin(), answer.begin() + static_cast<std::ptrdiff_t>(message.size()));
  return true;
}

std::optional<FoundInstrument> recognized(const AskingStep& step, const std::string& address,
                                          const std::vector<ByteString>& answers) {
  for (const IdentifiedDriver& driver : step.drivers) {
    const auto is = step.file ? step.file->recognize(answers)
                              : driver.identification.question->recognize(answers);
    // What an instrument says stands in a comment of a rig file, and on a terminal.
    if (is)
      return FoundInstrument{
          driver.name, address, step.baud_rate,
          printable(to_string(is->identity), kMostShown) + at_rate(step.baud_rate), is->roles};
  }
  return std::nullopt;
}

/// Text in whole characters: the rate is right, whatever it is.
bool is_readable(const ByteString& answer) {
  constexpr std::size_t kLeast = 4;
  const std::string text = text_of_bytes(answer);
  return text.size() >= kLeast && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= ' ' && c <= '~') || c == '\r' || c == '\n' || c == '\t';
         });
}

/// Sends one step's messages. What is heard and not recognized is added to `result`.
std::optional<FoundInstrument> ask_step(const AskingStep& step, AskedPort& port,
                                        AskingResult& result) {
  std::vector<ByteString> answers;
  for (const ByteString& message : step.question.messages) {
    ByteString answer = port.exchange(message, step.question.patience);
    const bool echo = take_echo(answer, message);
    if (echo || !answer.empty())
      result.heard.push_back(
          {step.baud_rate, printable(message), printable(answer), echo && answer.empty()});
    if (is_readable(answer)) result.heard.back().readable = true;
    answers.push_back(answer);
    if (auto found = recognized(step, result.plan.address, answers)) return found;
    if (answers.size() == 1 && answer.empty() && !step.question.may_begin_silent) break;
  }
  return std::nullopt;
}

std::string step_text(const AskingResult& result, std::size_t before) {
  if (!result.found.empty()) return result.found.front().answer;
  if (result.heard.size() == before) return "silence";
  const bool echo =
      std::all_of(result.heard.begin() + static_cast<std::ptrdiff_t>(before), result.heard.end(),
                  [](const HeardAnswer& heard) { return heard.echo; });
  return echo ? "an echo of what was sent" : result.heard.back().answer;
}

}  // namespace

AskingPlan plan_asking(const std::string& address, const std::vector<IdentifiedDriver>& drivers) {
  const std::vector<SharedQuestion> questions = shared_questions(drivers);
  const bool has_rate = !address.starts_with("tcp:");
  std::vector<WaitingStep> waiting;
  AskingPlan plan{address, {}, {}};
  for (const SharedQuestion& one : questions) {
    const std::vector<int> rates = has_rate ? one.question.baud_rates : std::vector<int>{0};
    for (std::size_t rank = 0; rank < rates.size(); ++rank)
      waiting.push_back({&one, rates[rank], rank});
    for (const IdentifiedDriver& driver : one.drivers)
      if (!driver.identification.caution.empty())
        plan.cautions.push_back(driver.identification.caution);
  }
  for (const WaitingStep& step : in_safe_order(waiting))
    plan.steps.push_back({step.baud_rate, step.asks->question, step.asks->drivers, nullptr});
  return plan;
}

AskingPlan with_files(AskingPlan plan, const std::vector<std::shared_ptr<const AskedFile>>& files) {
  if (plan.steps.empty()) return plan;
  const bool tcp = plan.address.starts_with("tcp:");
  for (const auto& file : files) {
    const auto& buses = file->buses;
    if (std::find(buses.begin(), buses.end(), tcp ? "tcp" : "serial") == buses.end()) continue;
    plan.steps.push_back(
        {tcp ? 0 : file->line.baud_rate, file->question, {{file->name, {}}}, file});
  }
  return plan;
}

std::string to_text(const AskingPlan& plan) {
  std::string text = plan.address + " will be sent, until an answer is recognized:\n";
  std::set<std::string> shown;
  for (const AskingStep& step : plan.steps) {
    const std::string messages = messages_text(step.question);
    if (!shown.insert(messages).second) continue;
    std::vector<std::string> rates;
    for (const AskingStep& other : plan.steps)
      if (other.question.messages == step.question.messages && other.baud_rate > 0)
        rates.push_back(std::to_string(other.baud_rate));
    text += fmt::format("  {}{} ({})\n", messages,
                        rates.empty() ? "" : fmt::format(" at {} baud", fmt::join(rates, ", ")),
                        names_of(step.drivers));
  }
  text += "None of it moves or energizes one of these instruments in this order";
  for (const std::string& caution : plan.cautions) text += "; " + caution;
  return text + ". Of other instruments nothing is known.\n";
}

// Of a step that may begin in silence every message waits; of another only the first.
double longest_time(const AskingPlan& plan) {
  const double chatter = to_seconds(kAnswerSilence) / 2;
  double seconds = 0;
  for (const AskingStep& step : plan.steps) {
    const std::size_t waits = step.question.may_begin_silent ? step.question.messages.size() : 1;
    seconds +=
        step.question.opening_pause + chatter + static_cast<double>(waits) * step.question.patience;
  }
  return seconds;
}

AskingResult ask_port(const AskingPlan& plan, const OpenLine& open, Clock& clock,
                      const TellStep& tell) {
  AskingResult result;
  result.plan = plan;
  AskedPort port(open, clock);
  for (const AskingStep& step : plan.steps) {
    const std::size_t before = result.heard.size();
    const auto text = std::find_if(result.heard.begin(), result.heard.end(),
                                   [](const HeardAnswer& heard) { return heard.readable; });
    if (text != result.heard.end() && text->baud_rate != step.baud_rate) continue;
    port.prepare(step);
    if (auto found = ask_step(step, port, result)) result.found = {*found};
    tell(fmt::format("{}{}: {}", names_of(step.drivers), at_rate(step.baud_rate),
                     step_text(result, before)));
    if (result.found.empty()) continue;
    result.heard.clear();
    break;
  }
  return result;
}

}  // namespace vitreo
