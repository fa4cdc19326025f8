// SPDX-License-Identifier: Apache-2.0
#include "host/lua/prompt/prompt.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/prompt/completion.h"
#include "host/lua/prompt/prompt_calls.h"
#include "host/lua/prompt/prompt_see.h"
#include "host/lua/prompt/prompt_show.h"
#include "host/lua/reference/reference.h"
#include "host/lua/script/running.h"
#include "host/runs/results_text.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <ostream>
#include <thread>
#include <vector>

namespace vitreo::lua {
namespace {

constexpr std::size_t kMostRead =
    64u << 20;  // bytes that one statement may cost while it is looked whether it is whole

enum class Loaded { yes, incomplete, no };

class Prompt {
 public:
  Prompt(ScriptRun& script, LineEditor& in, std::ostream& out, std::ostream& err)
      : script_(script),
        L_(script.main()),
        in_(in),
        out_(out),
        err_(err),
        seen_events_(script.context().session->recorder.events().size()) {}
  PromptEnd run();

 private:
  bool read_line(std::string& line);
  void take_line(const std::string& line);
  Loaded load();
  std::string source() const;
  void execute();
  void end_nested();
  void make_safe_after_stop(std::size_t failed_before);
  bool answer_stop();
  bool tell_stop();
  void tell_failed_loops(bool known);
  void end_for(const std::string& reason, const EndCause& cause);
  std::vector<StatedResult> stated_results();
  void show_results(int count);
  void greet();
  bool leaves(const std::string& line) const;
  void refuse(const std::string& message, const std::string& trace = "");
  void expand_help();
  void forget();

  ScriptRun& script_;
  lua_State* const L_;
  LineEditor& in_;
  std::ostream &out_, &err_;
  std::string chunk_;
  std::vector<std::string> typed_;  // every line, its beginning
  int line_ = 0, chunk_line_ = 1;   // the newest of them; the chunk's first
  std::size_t read_ = 0;            // bytes that were compiled for this chunk
  std::size_t seen_events_;         // of the record
  PromptEnd end_;
};

/// What may be said of the devices after their safe state was asked for. Of the lamp too, for its
/// safe state is no rest that one would expect: who goes on sees a dark picture.
std::string rest_text(const std::vector<std::string>& failures, const Rig& rig) {
  if (!failures.empty()) return fmt::format("not safe: {}", fmt::join(failures, "; "));
  return rig.lamp == nullptr ? "the devices are safe" : "the devices are safe, the lamp is dark";
}

/// Lines are counted from the session's beginning, so that a function that was typed long ago can
/// be named.
std::string Prompt::source() const {
  return std::string(static_cast<std::size_t>(chunk_line_ - 1), '\n');
}

/// As an expression first, then as statements; the function, or the message, is on the stack.
Loaded Prompt::load() {
  const std::string before = source(), expression = before + "return " + chunk_,
                    statement = before + chunk_;
  read_ += expression.size() + statement.size();
  const auto open = [this] { return std::string_view(lua_tostring(L_, -1)).ends_with("<eof>"); };
  if (luaL_loadbufferx(L_, expression.data(), expression.size(), "=prompt", "t") == LUA_OK)
    return Loaded::yes;
  const bool open_expression = open();
  if (luaL_loadbufferx(L_, statement.data(), statement.size(), "=prompt", "t") == LUA_OK) {
    lua_remove(L_, -2);
    return Loaded::yes;
  }
  const bool open_statement = open();
  // What begins like no statement ("{ 1, ", "20 + ") was meant as an expression: its message says
  // what is wrong.
  const std::size_t begin = std::min(chunk_.find_first_not_of(" \t\r\n"), chunk_.size() - 1);
  const bool word =
      std::isalpha(static_cast<unsigned char>(chunk_[begin])) != 0 || chunk_[begin] == '_';
  const bool meant_expression = !open_statement && (open_expression || !word);
  lua_remove(L_, meant_expression ? -1 : -2);
  return open_expression || open_statement ? Loaded::incomplete : Loaded::no;
}

/// The first error is kept: where nobody watches it is what the run fails with.
void Prompt::refuse(const std::string& message, const std::string& trace) {
  err_ << show_error(message, trace, typed_, chunk_line_ == line_ ? line_ : 0) << std::flush;
  if (end_.failed++ == 0) end_.first_error = message;
}

/// Only the first value has the unit of the call that gave it, and is kept as `_`.
void Prompt::show_results(int count) {
  std::string line;
  in_lua(L_, count, [&] {
    for (int i = 1; i <= count; ++i)
      line += (i > 1 ? "\t" : "") +
              show_value(L_, i, i == 1 ? script_.context().last_result : Context::Result());
    if (count > 0) lua_pushvalue(L_, 1);
    if (count > 0) lua_setglobal(L_, "_");
    lua_settop(L_, 0);
  });
  if (count > 0) out_ << line << '\n';
}

/// The recorder has the results of the whole session: those that the protocol of this statement
/// stated, and the time that it stood idle.
std::vector<StatedResult> Prompt::stated_results() {
  Context& context = script_.context();
  std::vector<StatedResult> stated;
  for (const StatedResult& one : context.session->recorder.results()) {
    bool by_this = one.name == "dead_time" && context.dead_time > 0;
    in_lua(L_, 0, [&] {
      lua_getfield(L_, LUA_REGISTRYINDEX, kStatedResults);
      by_this = by_this || lua_getfield(L_, -1, one.name.c_str()) == LUA_TBOOLEAN;
      lua_settop(L_, 0);
    });
    if (by_this) stated.push_back(one);
  }
  return stated;
}

/// What a protocol that ran inside of the statement deferred and left open ends here, and its
/// results are shown.
void Prompt::end_nested() {
  Context& context = script_.context();
  if (!context.nested) return;
  const Context::Nested before = *context.nested;
  context.nested.reset();
  try {
    script_.clean_up(before.deferred, before.closers);
  } catch (const Stopped&) {
    out_ << "its clean-up was stopped\n";
  } catch (const std::exception& error) {
    refuse(std::string("clean-up: ") + error.what());
  }
  out_ << results_text(stated_results());
}

/// A stop of the statement is one of what the session has left running too (a loop that holds),
/// unless the person at this terminal, or the script, has meant the statement: Ctrl-C.
void Prompt::make_safe_after_stop(std::size_t failed_before) {
  RunControl& control = script_.context().session->control;
  const EndCause cause = control.cause();
  end_for(control.reason(), cause);
  const bool of_statement = cause.by == "script" || cause.signal == "SIGINT";
  if (control.tier() == StopTier::none || (control.tier() == StopTier::stop && of_statement)) {
    out_ << "stopped\n";
    return;
  }
  Clock& clock = script_.context().session->clock;
  const StopShield shield(clock);
  control.make_safe();  // once: after an abort it was before the clean-up
  // The watchdog's, which has come first: nothing is said before it is so.
  while (control.making_safe()) clock.sleep_for(std::chrono::milliseconds(1));
  std::vector<std::string> failures = control.failures();
  failures.erase(failures.begin(), failures.begin() + static_cast<std::ptrdiff_t>(failed_before));
  out_ << (control.tier() == StopTier::stop ? "stopped " : "aborted ") << control.reason() << "; "
       << rest_text(failures, script_.context().session->rig) << "\n";
}

/// A stop that comes while no statement runs. False where it is to end the session.
bool Prompt::answer_stop() {
  Session& session = *script_.context().session;
  const StopShield shield(session.clock);
  session.control.make_safe_between();
  return tell_stop();
}

bool Prompt::tell_stop() {
  Session& session = *script_.context().session;
  const auto stop = session.control.take_answered();
  if (!stop) return true;
  const std::string text =
      "stopped " + stop->reason + "; " + rest_text(stop->failures, session.rig);
  session.recorder.event(session.clock.now(), "stop", "between two statements: " + text);
  session.listener.message(text);
  end_for(stop->reason, stop->cause);
  return end_.stopped.empty();
}

/// A loop that was left running has ended by itself: no call is there to throw that, and the robot
/// is let go. `known`: the statement that has just ended told of it.
void Prompt::tell_failed_loops(bool known) {
  Session& session = *script_.context().session;
  while (seen_events_ < session.recorder.events().size()) {
    const Event event = session.recorder.events()[seen_events_++];
    const Interlock* const coils = session.rig.coils;
    // A trip has an alarm of its own, and ends loops.
    if (known || event.kind != "servo failed" || (coils != nullptr && !coils->tripped().empty()))
      continue;
    const bool flows = coils != nullptr && coils->energized();
    session.raise("servo", AlarmPriority::high,
                  "the loop has ended: " + event.text +
                      (flows ? "; the coils may be energized" : "; the coils are at zero"));
  }
}

/// Who sends these wants the process gone: a service manager, a terminal that is closed.
void Prompt::end_for(const std::string& reason, const EndCause& cause) {
  if (cause.signal != "SIGTERM" && cause.signal != "SIGHUP") return;
  end_.stopped = reason;
  end_.stopped_by = cause;
}

/// Runs the function on the stack. Whatever ends it, the session goes on: what the statement left
/// behind (laps, a trace, an interrupt that came late) is forgotten before the next one.
void Prompt::execute() {
  Context& context = script_.context();
  RunControl& control = context.session->control;
  context.last_result = {};
  bool stopped = false;
  const std::size_t failed_before = control.failures().size();
  const auto errors_before = end_.failed;
  control.set_idle(false);
  try {
    show_results(script_.scheduler().run(0));
  } catch (const Stopped&) {
    stopped = true;
  } catch (const ScriptError& error) {
    refuse(error.what(), error.trace());
  } catch (const std::exception& error) {
    refuse(error.what());
  }
  end_nested();
  if (stopped) make_safe_after_stop(failed_before);
  tell_failed_loops(end_.failed > errors_before);
  control.set_idle(true);
  script_.context().waits_end = kForever;
  context.interrupted = false;
  context.laps.clear();
  context.trace.clear();
  out_.flush();
}

/// `servo:go_to?` is help about what stands before the question mark.
void Prompt::expand_help() {
  std::string word = chunk_;
  while (!word.empty() && std::isspace(static_cast<unsigned char>(word.back())) != 0)
    word.pop_back();
  if (!word.ends_with('?') || word.find("--") != std::string::npos ||
      word.find('\n') != std::string::npos)
    return;
  while (word.ends_with('?') || word.ends_with(' ')) word.pop_back();
  word.erase(0, std::min(word.find_first_not_of(' '), word.size()));
  const bool called = std::any_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) == 0 && c != '_' && c != '.' && c != ':';
  });
  in_lua(L_, 0, [&] {
    if (const Bound bound = bound_path(L_, word); bound.row != nullptr) {
      // The class of an instrument in Lua is this rig's own: it stands in no page of calls.
      const bool own = bound.owner != nullptr &&
                       find_class(*script_.context().library, bound.owner->name) == nullptr;
      std::string value = word;
      std::replace(value.begin(), value.end(), ':', '.');
      chunk_ = own ? "help(" + value + ")" : "help(\"" + full_name(bound.owner, *bound.row) + "\")";
    } else {  // a value of that name comes first, then what the name says
      push_path(L_, word);
      const bool library = lua_istable(L_, -1) && !to_vector(L_, -1);
      const bool value = called || !(lua_isnil(L_, -1) || lua_isfunction(L_, -1) || library);
      chunk_ = word.empty() ? "help()" : value ? "help(" + word + ")" : "help(\"" + word + "\")";
    }
    lua_settop(L_, 0);
  });
}

/// The next line begins a statement.
void Prompt::forget() {
  chunk_.clear();
  read_ = 0;
}

/// Takes one line; runs the statement when it is complete.
void Prompt::take_line(const std::string& line) {
  if (chunk_.empty())
    chunk_line_ = line_ - static_cast<int>(std::count(line.begin(), line.end(), '\n'));
  chunk_ += (chunk_.empty() ? "" : "\n") + line;
  if (chunk_.find_first_not_of(" \t\r\n") == std::string::npos) return forget();
  const std::string typed = chunk_;
  Loaded loaded = Loaded::no;
  try {
    expand_help();
    in_lua(L_, 0, [&] { loaded = load(); });
  } catch (const std::exception& error) {
    refuse(error.what());
    return forget();
  }
  if (loaded == Loaded::incomplete && read_ > kMostRead) {
    refuse("what began on line " + std::to_string(chunk_line_) + " is still open after " +
           std::to_string(line_ - chunk_line_ + 1) + " lines; it is left out");
    lua_settop(L_, 0);
    return forget();
  }
  if (loaded == Loaded::incomplete) return lua_settop(L_, 0);
  in_.remember(typed);
  if (loaded == Loaded::yes)
    execute();
  else
    refuse(lua_tostring(L_, -1));
  lua_settop(L_, 0);
  forget();
}

/// Which rig, where the record goes, and what to type first.
void Prompt::greet() {
  const Session& session = *script_.context().session;
  const nlohmann::json& rig = session.recorder.start().rig;
  const std::string file = rig.is_object() ? rig.value("file", "") : "";
  session.listener.message("Vitreo" + (file.empty() ? "" : ", rig " + file) + "; record in " +
                           session.recorder.folder().string());
  session.listener.message(
      "help() tells what there is, help(\"drift\") about a topic; show(image) and plot(x, y) draw "
      "here; exit leaves");
}

/// "exit" and "quit" by themselves, where a statement would begin and the script has no such name
/// of its own.
bool Prompt::leaves(const std::string& line) const {
  if (!chunk_.empty()) return false;
  std::string word;
  for (const char c : line)
    if (std::isspace(static_cast<unsigned char>(c)) == 0 && c != ';') word += c;
  if (word.ends_with("()")) word.resize(word.size() - 2);
  if (word != "exit" && word != "quit") return false;
  lua_pushglobaltable(L_);
  lua_pushstring(L_, word.c_str());
  const bool own = lua_rawget(L_, -2) != LUA_TNIL;
  lua_pop(L_, 2);
  return !own;
}

/// While somebody thinks, the loop goes on holding the robot, and a stop is felt.
bool Prompt::read_line(std::string& line) {
  Session& session = *script_.context().session;
  const auto idle = [this, &session] {
    constexpr std::chrono::milliseconds kTurn(20);
    try {
      // On the virtual clock the world stands still meanwhile.
      if (session.real_time)
        session.clock.sleep_for(kTurn);
      else
        std::this_thread::sleep_for(kTurn);
    } catch (const Stopped&) {  // asked as its statement ended; it is answered here
    }
    // Lines that were sent before it: none of them begins behind it.
    if (session.control.between().tier() != StopTier::none) in_.forget_ahead();
    tell_failed_loops(false);
    return answer_stop();
  };
  for (;;) {
    const LineEditor::Read read = in_.read(chunk_.empty() ? "> " : ">> ", line, idle);
    // Answered by the watchdog while a pipe was waited for. One that came with the line is the
    // line's.
    if (!tell_stop()) return false;
    if (read == LineEditor::Read::canceled) {
      // The second Ctrl-C: the first has ended the statement, and there is no line to take back. It
      // is answered at once, for what is typed from here on was typed after it.
      if (chunk_.empty() && line.empty() && session.rig.coils != nullptr &&
          session.rig.coils->energized()) {
        session.control.request(StopTier::abort, "by the operator", {"person", "", "the terminal"});
        answer_stop();
      }
      forget();
      continue;
    }
    if (read == LineEditor::Read::end) return false;
    line_ +=
        1 + static_cast<int>(std::count(line.begin(), line.end(), '\n'));  // what was pasted is one
    for (std::size_t begin = 0; begin <= line.size();) {
      const std::size_t end = std::min(line.find('\n', begin), line.size());
      typed_.push_back(line.substr(begin, std::min<std::size_t>(end - begin, 200)));
      begin = end + 1;
    }
    return true;
  }
}

/// At a terminal print() goes through the listener, which knows of the line that is being edited;
/// into a pipe it goes at once, in the order of the results.
PromptEnd Prompt::run() {
  Context& context = script_.context();
  if (in_.interactive())
    context.print = [&context](const std::string& text) {
      context.session->listener.message(text);
    };
  else
    context.print = [this](const std::string& text) { out_ << text << std::endl; };
  context.remembers_results = true;
  in_lua(L_, 0, [this] {
    set_prompt_screen(L_, out_, in_.interactive());
    open_prompt_calls(L_);
    lua_settop(L_, 0);
  });
  in_.set_completion([this](const std::string& line, std::size_t cursor) {
    std::vector<std::string> words;
    try {
      in_lua(L_, 0, [&] {
        words = completions(L_, line, cursor);
        lua_settop(L_, 0);
      });
    } catch (const std::exception&) {  // a file that does not load, for instance: there is nothing
                                       // to offer
      words.clear();
    }
    return words;
  });
  context.session->control.set_idle(true);
  if (in_.interactive()) greet();
  for (std::string line; end_.stopped.empty() && read_line(line) && !leaves(line);) take_line(line);
  if (!chunk_.empty()) {
    in_lua(L_, 0, [this] { load(); });
    refuse(lua_tostring(L_, -1));
    lua_settop(L_, 0);
  }
  in_.set_completion({});
  context.session->control.set_idle(false);
  return end_;
}

}  // namespace

PromptEnd run_prompt(ScriptRun& script, LineEditor& in, std::ostream& out, std::ostream& err) {
  return Prompt(script, in, out, err).run();
}

}  // namespace vitreo::lua
