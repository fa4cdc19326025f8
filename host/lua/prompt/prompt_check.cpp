// check("drift_test", {hold = 5 * s}) at the prompt: the dry run of `vitreo check`, in a process of
// its own, so that neither a script that hangs nor the clock of the dry run can disturb the
// session.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"
#include "host/files/child_process.h"
#include "host/lua/interpreter/calculation.h"
#include "host/lua/prompt/prompt_calls.h"
#include "host/lua/prompt/prompt_see.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr std::chrono::milliseconds kTurn{20};  // so long at most others wait for their turn

struct Checked {
  int status = 0;
  std::string text;
};

/// "hold=5s", every digit kept.
std::string argument_word(const Parameter& parameter, const ArgumentValue& value) {
  const std::string text = argument_text(parameter, value);
  if (text.find('\0') != std::string::npos)
    throw std::invalid_argument(parameter.name + ": holds a zero byte");
  return parameter.name + "=" + text;
}

/// The same seed, rig and folder as the session's, so that the dry run is of this laboratory. What
/// follows "--" cannot be taken for an option.
std::vector<std::string> command(const Call& call, const ProtocolDescription& protocol) {
  const Session& session = session_of(call.L);
  const Recorder& recorder = session.recorder;
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  std::vector<std::string> words{self, "check", "--seed", std::to_string(session.seed)};
  for (const std::string& word :
       {std::string("--out"), recorder.folder().parent_path().string(), std::string("--rig"),
        recorder.start().rig.value("file", ""), std::string("--"), protocol.file})
    words.push_back(word);
  const auto given = given_parameters(call.L, call.index(1), protocol);
  for (const Parameter& parameter : protocol.parameters)
    if (const auto value = given.find(parameter.name); value != given.end())
      words.push_back(argument_word(parameter, value->second));
  return words;
}

/// On a task of the clock. A session in real time goes on meanwhile; in any other no time passes.
Checked run_check(const std::vector<std::string>& words, Clock& clock, bool real_time,
                  const YieldPoint& breath) {
  ChildProcess child(words, ChildProcess::Pipe::from_output_and_errors);
  Checked checked;
  char bytes[4096];
  for (;;) {
    while (!child.readable(real_time ? std::chrono::milliseconds(0) : kTurn))
      real_time ? clock.sleep_for(kTurn) : breath();
    const std::size_t got = child.read_some(bytes, sizeof bytes);
    if (got == 0) break;
    checked.text.append(bytes, got);
  }
  checked.status = child.finish();
  while (checked.text.ends_with('\n')) checked.text.pop_back();
  return checked;
}

/// A preflight that did not pass is an answer, false; any other end of the program is an error,
/// with what it said.
int show(Call& call, const Checked& checked) {
  const bool passed = checked.status == static_cast<int>(ExitCode::completed);
  if (!passed && checked.status != static_cast<int>(ExitCode::preflight_failed)) {
    constexpr std::string_view kProgram = "vitreo: ";
    throw std::runtime_error(
        checked.text.starts_with(kProgram) ? checked.text.substr(kProgram.size())
        : checked.text.empty() ? "the dry run ended with " + std::to_string(checked.status)
                               : checked.text);
  }
  if (const auto& print = call.context().print) print(checked.text);
  lua_pushboolean(call.L, passed);
  return 1;
}

int check(Call& call) {
  const ProtocolDescription protocol = named_protocol(call.context(), call.text(0));
  Session& session = session_of(call.L);
  check_roles(protocol, session.rig);
  return calculate(
      call, "check",
      [words = command(call, protocol), clock = &session.clock, real_time = session.real_time](
          const YieldPoint& breath) { return run_check(words, *clock, real_time, breath); },
      show);
}

}  // namespace

const std::vector<Binding>& prompt_functions() {
  static const std::vector<Binding> functions = [] {
    std::vector<Binding> rows = prompt_see_functions();
    rows.push_back(
        {"check",
         {{.name = "protocol", .type = Type::text, .help = "a name or a file"},
          {.name = "parameters",
           .type = Type::table,
           .optional = true,
           .help = "as for run(\"name\", {...}): SI, or texts such as \"5s\""}},
         "true or false",
         "at the prompt: true when a run would be let; shows what it would move and energize, by a "
         "dry "
         "run on the rig's twin",
         check,
         "check(\"drift_test\", { hold = 5 * units.s })"});
    return rows;
  }();
  return functions;
}

}  // namespace vitreo::lua
