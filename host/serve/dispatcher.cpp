// SPDX-License-Identifier: Apache-2.0
#include "host/serve/dispatcher.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/files/child_process.h"
#include "host/files/log.h"
#include "host/files/run_folder.h"
#include "host/runs/open_record.h"
#include "host/text/error_words.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <ctime>

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

constexpr auto kStep = std::chrono::milliseconds(100);
constexpr auto kAfterError = std::chrono::seconds(2);
constexpr int kStepsALook = 10;          // at the points of a sweep, which reads its folder
constexpr std::int64_t kAskedLong = 60;  // s, after which a question of an unwatched run is told

/// "03:12", here.
// Local time: the message is read by a person of this laboratory.
std::string clock_text(std::int64_t moment) {
  const std::time_t time = moment;
  std::tm here{};
  localtime_r(&time, &here);
  char text[16];
  std::strftime(text, sizeof text, "%H:%M", &here);
  return text;
}

/// What the record says of the coils at the end; "" where it says nothing.
std::string coils_text(const fs::path& run) {
  try {
    OpenRecord record(run);
    Statement rows =
        record.select("event", {"text"}, "WHERE kind = 'coils' ORDER BY rowid DESC LIMIT 1");
    return rows.step() ? rows.text(0) : "";
  } catch (const std::exception&) {
    return "";  // no record, or none that can be read: the message says where it would be
  }
}

/// How many points of a sweep have a mark, without reading its plan.
// Marks decide in a sweep's folder (decision 12); a plan of 10 000 points takes longer to read.
std::size_t marks_in(const fs::path& sweep) {
  std::size_t count = 0;
  std::error_code none;
  for (auto at = fs::recursive_directory_iterator(sweep / "done", none);
       at != fs::recursive_directory_iterator(); at.increment(none))
    if (at->path().extension() == ".json") ++count;
  return count;
}

/// What of the preflight's report a person decides by.
// Questions are warnings of the report, since the dry run had to assume their answers.
nlohmann::json shortened(const nlohmann::json& report) {
  constexpr std::string_view kAsked = "not answered in advance, so the dry run took: ";
  nlohmann::json asks = nlohmann::json::array(), warnings = nlohmann::json::array();
  for (const auto& one : report.value("warnings", nlohmann::json::array())) {
    const std::string text = one.get<std::string>();
    if (text.starts_with(kAsked))
      asks.push_back(text.substr(kAsked.size()));
    else
      warnings.push_back(text);
  }
  const nlohmann::json coils = report.value("coils", nlohmann::json::object());
  // The largest of all coils, A: what a person compares with the limit on the label.
  double peak = 0;
  for (const auto& one : coils.value("peak", nlohmann::json::array()))
    peak = std::max(peak, one.get<double>());
  return {{"passed", report.value("passed", false)},
          {"duration", report.value("duration", 0.0)},
          {"problems", report.value("problems", nlohmann::json::array())},
          {"warnings", warnings},
          {"asks", asks},
          {"peak", peak},
          {"energized", coils.value("energized", 0.0)},
          {"disk_bytes", report.value("disk_bytes", 0.0)},
          {"wall_time", report.value("wall_time", 0.0)}};
}

}  // namespace

Dispatcher::Dispatcher(JobQueue& queue, DispatcherSettings settings)
    : queue_(queue),
      settings_(std::move(settings)),
      thread_(quiet_thread([this] { work(); })),
      rehearser_(quiet_thread([this] { rehearsals(); })) {}

Dispatcher::~Dispatcher() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  wake_.notify_all();
  thread_.join();
  rehearser_.join();
}

// By number: a protocol's name may hold what no folder may.
fs::path Dispatcher::folder_of(std::int64_t job) const {
  return settings_.state / "jobs" / std::to_string(job);
}

std::string Dispatcher::place_of(const Job& job) const {
  return (settings_.sweeps / fmt::format("job{}_{}", job.id, slug(job.request.protocol, "sweep")))
      .string();
}

// An error of the disk must not end the server: it is logged, and the next step tries again.
void Dispatcher::work() {
  for (;;) {
    std::chrono::milliseconds pause = kStep;
    try {
      step();
    } catch (const std::exception& error) {
      write_log("queue: " + error_words(error));
      pause = kAfterError;
    }
    std::unique_lock lock(mutex_);
    if (wake_.wait_for(lock, pause, [this] { return ended_; })) return;
  }
}

void Dispatcher::step() {
  // A job that runs is watched also while the queue is held: holding stops the next one, not this
  // one.
  if (const auto running = queue_.running()) return watch(*running);
  link_.follow(0);
  if (queue_.held()) return;
  if (const auto next = queue_.next(seconds_now())) start(*next);
}

void Dispatcher::start(const Job& job) {
  queue_.begin(job.id, seconds_now());
  raised_.clear();
  points_done_ = 0;
  asked_since_ = 0;
  try {
    // Here and not by the run: a folder that cannot be made is an error of the job, with its
    // reason.
    fs::create_directories(job.request.sweep ? settings_.sweeps : settings_.runs);
    std::vector<std::string> words =
        words_of(job, {settings_.runs.string(), place_of(job), settings_.token_file.string(),
                       settings_.address, settings_.live_port});
    words.insert(words.begin(), settings_.program);
    queue_.set_process(job.id, JobProcess(folder_of(job.id)).start(words));
  } catch (const std::exception& error) {
    conclude(job, {"refused", "it cannot be started: " + error_words(error), "", true});
  }
}

void Dispatcher::watch(const Job& job) {
  const JobProcess process(folder_of(job.id));
  // A zombie has let go of its lock, but stays in the table of processes.
  JobProcess::reap(job.process);
  if (!process.alive()) return conclude(job, process.end(job.request.sweep));
  link_.follow(job.process);
  if (job.request.sweep) {
    if (job.run.empty()) queue_.set_run(job.id, fs::path(place_of(job)).filename().string());
    return watch_points(job);
  }
  // As soon as it is known, so that the next server shows the same run.
  if (const std::string run = link_.run(); !run.empty() && run != job.run)
    queue_.set_run(job.id, run);
  watch_alarms(job);
}

void Dispatcher::watch_points(const Job& job) {
  if (looks_++ % kStepsALook != 0) return;
  const std::size_t done = marks_in(place_of(job));
  if (points_done_.exchange(done) != done) ++points_changes_;
}

// Each alarm once a run, and a question that has stood for long.
void Dispatcher::watch_alarms(const Job& job) {
  const nlohmann::json status = link_.status();
  if (!status.is_object()) return;
  for (const auto& alarm : status.value("alarms", nlohmann::json::array())) {
    // Medium and low ones are for those who look at the page.
    if (alarm.value("priority", "") != "high") continue;
    const std::string name = alarm.value("name", ""), text = alarm.value("text", "");
    if (raised_.insert("alarm " + name).second)
      raise(job, fmt::format("ALARM in {}: {}", job.title, text),
            fmt::format("Alarm {} of high priority at {}.", name, clock_text(seconds_now())));
  }
  const auto question = status.find("question");
  if (question == status.end()) {
    asked_since_ = 0;
    return;
  }
  // From when the server saw it; after a restart of the server it counts anew.
  if (asked_since_ == 0) asked_since_ = seconds_now();
  const std::string text = question->value("text", "");
  // Who pressed Start is there, and sees it.
  if (job.attended_until >= seconds_now()) return;
  if (seconds_now() - asked_since_ >= kAskedLong && raised_.insert("question " + text).second)
    raise(job, fmt::format("{} waits for an answer since {}", job.title, clock_text(asked_since_)),
          text);
}

void Dispatcher::raise(const Job& job, const std::string& subject, const std::string& text) {
  queue_.add_messages(messages_for(read_message_settings(settings_.messages), Occasion::failure,
                                   job.id, subject, text, seconds_now()));
}

// The end is written down whatever the settings of the messages are; what is wrong with them is
// logged.
void Dispatcher::conclude(const Job& job, JobEnd end) {
  if (end.run.empty()) end.run = job.run;
  if (end.run != job.run) queue_.set_run(job.id, end.run);
  const auto [subject, text] = message_of(job, end);
  const Occasion occasion = end.outcome == "completed" ? Occasion::end : Occasion::failure;
  std::vector<Message> messages;
  try {
    const MessageSettings settings = read_message_settings(settings_.messages);
    messages = messages_for(settings, occasion, job.id, subject, text, seconds_now());
  } catch (const ConfigError& error) {
    write_log(std::string("messages: ") + error.what());
  }
  if (end.hold)
    queue_.set_held(
        true, fmt::format("job {} ({}) was {}: {}", job.id, job.title, end.outcome, end.reason));
  queue_.end(job.id, seconds_now(), end.outcome, end.reason, messages);
  link_.follow(0);
}

/// Subject: what, how and when; text: the coils, the cause, what goes on, where.
std::pair<std::string, std::string> Dispatcher::message_of(const Job& job,
                                                           const JobEnd& end) const {
  // The first line alone must say what, how and when: a telephone shows no more of it.
  std::string subject = fmt::format("{} {} at {}", job.title,
                                    end.outcome == "refused" ? "was refused"
                                    : end.outcome == "lost"  ? "was lost"
                                                             : end.outcome,
                                    clock_text(seconds_now()));
  std::string text;
  // Safe or not, before the cause: what a person who is woken wants to know first.
  if (!job.request.sweep && !end.run.empty()) {
    const std::string coils = coils_text(settings_.runs / end.run);
    text += coils.empty() ? "The record says nothing of the coils.\n" : coils + "\n";
  }
  if (!end.reason.empty()) text += end.reason + "\n";
  text += command_of(job.request) + "\n";
  if (!end.run.empty()) text += "run: " + end.run + "\n";
  if (end.hold) text += "The queue is held: nothing starts until a person lets it go on.\n";
  const std::size_t left = queue_.waiting().size();
  text += left == 1 ? "1 job waits." : fmt::format("{} jobs wait.", left);
  return {subject, text};
}

// One at a time, with a thread of its own: a rehearsal takes seconds, and a run that goes on is
// watched meanwhile.
void Dispatcher::rehearsals() {
  for (;;) {
    {
      std::unique_lock lock(mutex_);
      if (wake_.wait_for(lock, 2 * kStep, [this] { return ended_; })) return;
    }
    try {
      const std::vector<Job> waiting = queue_.waiting();
      // A sweep is not rehearsed: its questions are answered in advance or not at all.
      const auto job = std::find_if(waiting.begin(), waiting.end(), [](const Job& one) {
        return !one.request.sweep && one.rehearsal.is_null();
      });
      if (job == waiting.end()) continue;
      queue_.set_rehearsal(job->id, rehearse(job->request));
    } catch (const std::exception& error) {
      write_log(std::string("rehearsal: ") + error.what());
    }
  }
}

nlohmann::json Dispatcher::rehearse(const JobRequest& request) const {
  std::vector<std::string> words = rehearsal_words(request);
  // The check has a limit of its own for the script; this one is for a program that hangs.
  words.insert(words.begin(), {"timeout", "--kill-after=5", "60", settings_.program});
  ChildProcess child(words, ChildProcess::Pipe::from_output);
  std::string out;
  char bytes[4096];
  while (const std::size_t count = child.read_some(bytes, sizeof bytes)) out.append(bytes, count);
  child.finish();
  // A rehearsal that found problems leaves with 8 and a whole report: the output decides, not the
  // code.
  const nlohmann::json report = nlohmann::json::parse(out, nullptr, false);
  if (!report.is_object())
    return {{"passed", false}, {"problems", {"the rehearsal gave no result"}}};
  if (report.contains("error"))
    return {{"passed", false}, {"problems", {report.value("error", "")}}};
  return shortened(report);
}

nlohmann::json Dispatcher::command(const nlohmann::json& request) const {
  const auto running = queue_.running();
  if (!running) throw ConfigError("no run is going on");
  if (!running->request.sweep) return link_.command(request);
  // A sweep's own control is its signal: it tells its runs to stop, and --resume goes on.
  const std::string word = request.value("do", "");
  if (word != "stop" && word != "abort" && word != "emergency")
    throw ConfigError("a sweep takes stop alone");
  if (running->process > 0) ::kill(running->process, word == "emergency" ? SIGKILL : SIGTERM);
  return {{"ok", true}, {"status", {{"text", "the sweep was told to stop"}}}};
}

// The status is the last that came: while a run writes its report its socket is gone already.
nlohmann::json Dispatcher::running() const {
  const auto job = queue_.running();
  if (!job) return nullptr;
  nlohmann::json shown{{"job", to_json(*job)}, {"status", link_.status()}, {"live", false}};
  if (!job->request.sweep)
    shown["live"] = !JobProcess(folder_of(job->id)).live_view().empty();
  else
    shown["done"] = points_done_.load();
  return shown;
}

std::string Dispatcher::live_view() const {
  const auto job = queue_.running();
  return job && !job->request.sweep ? JobProcess(folder_of(job->id)).live_view() : "";
}

std::string Dispatcher::said(std::int64_t job) const { return JobProcess(folder_of(job)).said(); }

unsigned long Dispatcher::changes() const {
  return queue_.changes() + link_.changes() + points_changes_;
}

}  // namespace vitreo::serve
