// Commands that open a rig and leave a record: `vitreo run`, `vitreo view` and the prompt.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/faces.h"
#include "host/cli/program.h"
#include "host/record/record_json.h"
#include "host/runs/results_text.h"
#include "host/runs/run_reader.h"
#include "host/session/protocol_text.h"
#include "host/terminal/line_editor.h"
#include "host/terminal/progress_line.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <streambuf>
#include <string_view>
#include <unistd.h>

namespace vitreo::cli {
namespace {

struct Run : ProtocolOptions {
  bool quiet = false;
  bool verbose = false;
};

/// Progress of --quiet: nothing but questions, which want an answer, and the addresses of the live
/// view and for Foxglove, without which they cannot be opened.
/// question() and typed() are ProgressLine's own, so questions still appear.
class Quiet : public ProgressLine {
 public:
  using ProgressLine::ProgressLine;
  void progress(double, const std::string&) override {}
  void message(const std::string& line) override {
    if (line.starts_with("live view: ") || line.starts_with("foxglove: "))
      ProgressLine::message(line);
  }
};

/// What was opened, and what became of it, for --verbose: on the standard error.
/// The arguments with their defaults filled in, in display units: what the run will use, not what
/// was typed.
void print_before(ScriptEngine& engine, const RunRequest& request) {
  const ProtocolDescription protocol = engine.describe(request.what.protocol_file);
  fmt::print(stderr, "protocol {}\nrig {}\nseed {}\n", protocol.file, request.where.rig_file,
             request.how.seed);
  for (const auto& [name, value] : check_arguments(protocol, request.what.arguments)) {
    const auto known =
        std::find_if(protocol.parameters.begin(), protocol.parameters.end(),
                     [&key = name](const Parameter& one) { return one.name == key; });
    fmt::print(stderr, "{} = {}\n", name, value_text(*known, value));
  }
}

/// Every event of the record.
/// Read from the closed record and not from memory: it shows what a reader of the run will find.
void print_after(const RunResult& result) {
  for (const Event& event : read_run(result.folder).events)
    fmt::print(stderr, "{:10.3f} s  {}: {}\n", to_seconds(event.time), event.kind,
               for_terminal(event.text));
}

/// The outcome, colored on a terminal whose user has not said NO_COLOR (no-color.org).
std::string colored(Outcome outcome) {
  const char* const no_color = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  const bool plain = isatty(STDOUT_FILENO) == 0 || (no_color != nullptr && *no_color != '\0') ||
                     terminal == nullptr || std::string_view(terminal) == "dumb";
  if (plain) return to_string(outcome);
  // SGR parameters (ECMA-48) of the foreground.
  constexpr int kGreen = 32;
  constexpr int kYellow = 33;
  constexpr int kRed = 31;
  const int color = outcome == Outcome::completed ? kGreen
                    : outcome == Outcome::stopped ? kYellow
                                                  : kRed;
  return fmt::format("\x1b[{}m{}\x1b[0m", color, to_string(outcome));
}

void show(const RunResult& result, bool json) {
  if (json) {
    std::cout << dumped(to_json(result)) << "\n";
    return;
  }
  fmt::print("{}", results_text(result.results));
  fmt::print("{}{}{}\nrun: {}\nreport: {}\n", colored(result.outcome),
             result.reason.empty() ? "" : ": ", for_terminal(result.reason), result.folder,
             (std::filesystem::path(result.folder) / "report.html").string());
}

// The faces are made after complete(), which may refuse, and before the run: a page that cannot
// listen must fail before an instrument is opened. The progress line is cleared before anything is
// printed below it.
int run(Program& program, Run& wanted) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  const auto progress = wanted.quiet ? std::make_unique<Quiet>(std::cerr, false)
                                     : std::make_unique<ProgressLine>(std::cerr, terminal);
  const RunRequest& request = wanted.complete(program);
  if (wanted.verbose) print_before(program.engine(), request);
  Faces faces(wanted, *progress);
  const RunResult result = run_protocol(program.engine(), faces.of(request), faces.listener());
  progress->clear();
  if (wanted.verbose) print_after(result);
  if (!wanted.quiet || wanted.json) show(result, wanted.json);
  if (wanted.quiet && result.exit_code != ExitCode::completed)
    fmt::print(stderr, "vitreo: {}: {}\n", to_string(result.outcome), for_terminal(result.reason));
  return static_cast<int>(result.exit_code);
}

/// Progress at a prompt: messages that come while a line is typed appear above it.
/// The readline editor owns the line in which is typed: show_above() redraws it below the message.
/// It returns false while no line is being read; then the message is printed as usual.
class PromptLines : public ProgressLine {
 public:
  PromptLines(std::ostream& out, bool animate, LineEditor& editor)
      : ProgressLine(out, animate), editor_(editor) {}
  void message(const std::string& line) override {
    if (!editor_.show_above(harmless(line))) ProgressLine::message(line);
  }

 private:
  LineEditor& editor_;
};

/// Stream buffer of the prompt's output: clears the progress that stands in the line first.
/// Results of statements and the animated progress share the terminal; without this the first
/// characters of a result would be written over the progress text.
class AfterProgress : public std::streambuf {
 public:
  AfterProgress(ProgressLine& progress, std::ostream& out) : progress_(progress), out_(out) {}

 protected:
  int overflow(int c) override {
    if (c == traits_type::eof()) return sync();
    progress_.clear();
    return out_.put(static_cast<char>(c)) ? c : traits_type::eof();
  }
  // All or nothing: a stream that fails has failed for the whole text, and std::ostream sets
  // badbit.
  std::streamsize xsputn(const char* text, std::streamsize count) override {
    progress_.clear();
    return out_.write(text, count) ? count : 0;
  }
  int sync() override { return out_.flush() ? 0 : -1; }

 private:
  ProgressLine& progress_;
  std::ostream& out_;
};

// Three cases: a person at a terminal gets line editing and animation, at the pace of the wall
// clock; a terminal whose output goes to a file gets neither; a pipe runs at the virtual clock's
// pace and prints plain lines.
int prompt(Program& program, RunOptions& options) {
  const bool terminal = isatty(STDIN_FILENO) != 0;
  if (terminal) options.real_time = true;
  const bool edits = terminal && isatty(STDOUT_FILENO) != 0;
  // Declared before what uses it: progress, buffer and stream refer to each other in this order and
  // die in the reverse one.
  const auto editor =
      edits ? terminal_lines(history_file()) : stream_lines(std::cin, std::cout, terminal);
  PromptLines progress(edits ? std::cout : std::cerr, edits, *editor);
  AfterProgress buffer(progress, std::cout);
  std::ostream above(&buffer);
  std::ostream& out = edits ? above : std::cout;
  const RunRequest& request = options.complete(program);
  Faces faces(options, progress);
  const RunResult result = run_prompt(program.engine(), faces.of(request), faces.listener(),
                                      *editor, out, edits ? out : std::cerr);
  progress.clear();
  if (terminal) fmt::print("run: {}\n", result.folder);
  return static_cast<int>(result.exit_code);
}

// Words that `run` and `view` have in common beyond those of every run.
void add_arguments(Command& command, Program& program, const std::shared_ptr<Run>& wanted) {
  command.option("arguments", wanted->request.what.arguments,
                 "name=value, with units: speed=0.5mm/s");
  command.flag("--json", wanted->json,
               "one JSON object on the standard output at the end, SI units");
  command
      .option("--answer", wanted->request.what.answers,
              "answers a question of the script in advance: name=value, or value in their order")
      .one_word_each();
  command.option(
      "--override", wanted->request.how.override_reason,
      "run although the preflight fails, and why (a researcher's right; it is recorded)");
  command.flag("--quiet,-q", wanted->quiet, "nothing but errors and questions");
  command.flag("--verbose,-v", wanted->verbose,
               "also what was chosen, and every event of the record");
  command.help_about_word([&program, wanted] {
    fmt::print("{}\noptions: vitreo run --help\n",
               describe_text(program.engine().describe(Program::protocol_file(wanted->protocol)),
                             wanted->protocol));
  });
}

}  // namespace

void add_run(CommandLine& line, Program& program) {
  const auto at_prompt = std::make_shared<RunOptions>();
  Command root = line.root([&program, at_prompt] { return prompt(program, *at_prompt); });
  add_run_options(root, *at_prompt);
  add_view_options(root, *at_prompt);
  root.examples({"vitreo                                     a prompt on the simulated rig",
                 "vitreo run servo_square speed=0.5mm/s --seed 7", "vitreo run servo_square --help",
                 "echo 'print(rig.top_camera:info().identity)' | vitreo",
                 "vitreo docs                                the pages of the documentation"});

  const auto wanted = std::make_shared<Run>();
  Command command =
      line.command("run", "run a protocol", [&program, wanted] { return run(program, *wanted); });
  add_run_options(command, *wanted);
  add_view_options(command, *wanted);
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  add_arguments(command, program, wanted);
  command.examples({"vitreo run servo_square speed=0.5mm/s --seed 7",
                    "vitreo run drift_test --help", "vitreo run hold --json | jq .results"});

  // `view` is `run` with other defaults, set before the line is parsed; --view and --real-time may
  // be given again without harm.
  const auto watched = std::make_shared<Run>();
  watched->protocol = "steer";
  watched->real_time = watched->view.on = true;
  watched->view.linger = 600;  // the report is what is wanted next
  Command view =
      line.command("view", "run a protocol, shown by a page in the browser, in real time",
                   [&program, watched] { return run(program, *watched); });
  add_run_options(view, *watched);
  add_view_options(view, *watched);
  view.option("protocol", watched->protocol, "a protocol's file or name (default: steer, by hand)");
  add_arguments(view, program, watched);
  view.examples({"vitreo view", "vitreo view servo_square speed=0.5mm/s"});
}

}  // namespace vitreo::cli
