// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_slurm.h"

#include "host/files/child_process.h"
#include "host/files/published_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <thread>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

struct Answer {
  int code = -1;
  std::string text;  // without the last line end
};

/// What a program of Slurm says; errors are among its words. One that says nothing for so long, as
/// it does where the scheduler's machine is gone, or while which a stop comes, is ended: code -1.
Answer ask(const std::vector<std::string>& words) {
  constexpr auto kPatience = 60s;
  ChildProcess child(words, ChildProcess::Pipe::from_output_and_errors);
  Answer answer;
  const int stops = StopCount::count();
  auto heard = std::chrono::steady_clock::now();
  for (char part[4096];;) {
    if (!child.readable(100ms)) {
      const bool silent = std::chrono::steady_clock::now() - heard > kPatience;
      if (!silent && StopCount::count() == stops) continue;
      answer.text = silent ? words[0] + " does not answer" : words[0] + " was ended by a stop";
      return answer;
    }
    const std::size_t got = child.read_some(part, sizeof part);
    if (got == 0) break;
    answer.text.append(part, got);
    heard = std::chrono::steady_clock::now();
  }
  answer.code = child.finish();
  while (answer.text.ends_with('\n')) answer.text.pop_back();
  return answer;
}

/// For a shell: within single quotes.
std::string shell_word(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// `exec`, so that what scancel ends is the program itself, which stops its run in order. --requeue:
// a task whose node is gone is begun again elsewhere, and finds what is done.
std::string script_of(const PointFolder& folder, const SlurmRequest& request) {
  return fmt::format(
      "#!/bin/sh\n# An array of tasks for one sweep (vitreo sweep --slurm); each takes points "
      "until "
      "none is left.\nexec {} sweep --work {} --jobs \"${{SLURM_CPUS_PER_TASK:-1}}\"\n",
      shell_word(request.program), shell_word(folder.folder().string()));
}

/// As squeue shows it.
std::string job_name(const nlohmann::json& head) {
  return "vitreo_" + head.value("/protocol/name"_json_pointer, head.value("kind", "sweep"));
}

long number_of(const char* variable, long otherwise) {
  const char* const text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtol(text, nullptr, 10);
}

/// Whether the scheduler still knows tasks of the job that have not ended.
enum class JobLife { there, gone, not_known };
/// squeue lists only what has not ended, and after some minutes calls the number invalid.
JobLife life_of_job(const std::string& job) {
  const Answer answer = ask({"squeue", "--noheader", "--jobs=" + job, "--format=%T"});
  if (answer.code == 0) return answer.text.empty() ? JobLife::gone : JobLife::there;
  return answer.text.find("Invalid job id") != std::string::npos ? JobLife::gone
                                                                 : JobLife::not_known;
}

}  // namespace

// The tasks are no more than the points that are left: each takes points until none is left, so
// their number is how many run at a time, not how many there are.
std::string submit_slurm(const PointFolder& folder, const SlurmRequest& request) {
  const std::size_t left = folder.unfinished().size();
  const auto tasks = std::min<std::size_t>(left, static_cast<std::size_t>(request.tasks));
  const fs::path place = folder.folder() / "slurm";
  fs::create_directories(place);
  publish(place / "task.sh", script_of(folder, request));
  std::vector<std::string> words{"sbatch", "--parsable", "--requeue",
                                 "--job-name=" + job_name(folder.head()),
                                 fmt::format("--array=0-{}", tasks - 1),
                                 // %A is the number of the array job, %a that of the task in it
                                 // (sbatch(1)).
                                 "--output=" + (place / "%A_%a.txt").string()};
  // Behind these: of an option that is given twice sbatch takes the last.
  words.insert(words.end(), request.options.begin(), request.options.end());
  words.push_back((place / "task.sh").string());
  Answer answer;
  try {
    answer = ask(words);
  } catch (const std::runtime_error& absent) {
    throw SweepError(std::string("--slurm: there is no Slurm here: ") + absent.what() +
                     " (Debian: slurm-client); the plan stays, and without --slurm `vitreo sweep "
                     "--resume " +
                     folder.folder().string() + "` runs it on this machine");
  }
  // "1234", or "1234;cluster" where there are several; warnings may stand before it.
  const std::string last = answer.text.substr(answer.text.rfind('\n') + 1);
  if (answer.code != 0 || last.empty() || last[0] < '0' || last[0] > '9')
    throw SweepError("--slurm: sbatch refused: " + answer.text + "; the plan stays in " +
                     folder.folder().string());
  return last.substr(0, last.find(';'));
}

// A scheduler that does not answer for a while is waited for: its tasks go on without it.
RunnerEnd wait_for_slurm(const PointFolder& folder, const std::string& job,
                         const std::function<void(std::size_t done)>& progress,
                         const std::function<void(const std::string&)>& note) {
  constexpr auto kLook = 500ms;  // at the marks
  constexpr int kAsk = 6;        // looks between two questions to the scheduler
  const StopCount counting;
  bool silent = false;
  for (int look = 0; StopCount::count() == 0; ++look) {
    const auto began = std::chrono::steady_clock::now();
    const std::size_t left = folder.unfinished().size();
    progress(folder.points().size() - left);
    if (left == 0) return RunnerEnd::all_done;
    if (look % kAsk == kAsk - 1) {
      const JobLife life = life_of_job(job);
      if (life == JobLife::gone && !folder.unfinished().empty()) return RunnerEnd::some_left;
      if (life == JobLife::not_known && !silent) note("the scheduler does not answer: waiting");
      silent = life == JobLife::not_known;
    }
    // A million marks on a slow server: looking must not become its work.
    const auto took = std::chrono::steady_clock::now() - began;
    const auto next = std::chrono::steady_clock::now() +
                      std::max<std::chrono::steady_clock::duration>(kLook, 10 * took);
    while (StopCount::count() == 0 && std::chrono::steady_clock::now() < next)
      std::this_thread::sleep_for(50ms);
  }
  return RunnerEnd::stopped;
}

// Tasks that begin at different points seldom ask for the same claim.
std::size_t slurm_offset(std::size_t points) {
  // In the environment of an array's tasks (sbatch(1)); numbers from 0, as --array says.
  const long tasks = number_of("SLURM_ARRAY_TASK_COUNT", 1);
  const long task = number_of("SLURM_ARRAY_TASK_ID", 0);
  if (tasks < 1 || task < 0 || task >= tasks) return 0;
  return points * static_cast<std::size_t>(task) / static_cast<std::size_t>(tasks);
}

}  // namespace vitreo
