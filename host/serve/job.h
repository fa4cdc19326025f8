// Job of the workbench: one run or sweep that a person asked for, as the queue keeps it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace vitreo::serve {

/// What is asked for; the words of the command line.
struct JobRequest {
  std::string protocol;                  // its name
  std::vector<std::string> arguments{};  // "speed=1mm/s"; of a sweep also "speed=0.1..2mm/s:5"
  std::string rig{};                     // its name; empty: the protocol's own, else simulated
  std::string operator_name{};
  std::vector<std::string> answers{};  // "name=value", to questions of the script
  std::vector<std::string> tags{};     // "key=value"
  std::uint64_t seed = 1;
  bool real_time = false;  // a simulated rig keeps the pace of the clock
  bool sweep = false;
  int repeats = 1;       // of each setting of a sweep
  std::int64_t due = 0;  // s since 1970, before which it does not start; 0: at once
  bool person = false;   // it never starts without a person
};

enum class JobState { waiting, running, ended };
const char* to_string(JobState state);

struct Job {
  std::int64_t id = 0;
  JobRequest request{};
  std::string title{};  // of the protocol
  JobState state = JobState::waiting;
  // s since 1970; 0: not yet
  std::int64_t added = 0;
  std::int64_t started = 0;
  std::int64_t ended = 0;
  int process = 0;
  /// Until when a person who asked for it is taken to be there, s since 1970.
  std::int64_t attended_until = 0;
  std::string run{};  // its folder's name, or a sweep's; known once it runs
  std::string
      outcome{};  // "completed", "failed", ...; "refused" before anything was opened, "lost"
  std::string reason{};
  nlohmann::json rehearsal{};  // null: not rehearsed yet; else as Rehearsal writes it
};

/// The wall clock, s since 1970.
std::int64_t seconds_now();

/// Whether its turn wants a person: it says so, or its rehearsal asked something.
bool needs_person(const Job& job);

/// Throws ConfigError for an unknown key, and for a value of another type or beyond its bounds; the
/// protocol, its arguments and the rig are checked elsewhere (forms.h).
JobRequest request_of(const nlohmann::json& json);
nlohmann::json to_json(const JobRequest& request);
nlohmann::json to_json(const Job& job);

/// The words behind `vitreo` that do the job; paths are absolute. `live`: where its live view
/// listens.
struct JobPlaces {
  std::string runs;        // a folder
  std::string sweep;       // the folder of this sweep
  std::string token_file;  // of the live view
  std::string address = "127.0.0.1";
  int live_port = 0;
};
std::vector<std::string> words_of(const Job& job, const JobPlaces& places);
/// The same as a person would type it: "vitreo run servo_square speed=1mm/s".
std::string command_of(const JobRequest& request);
/// Of a rehearsal: `vitreo check`.
std::vector<std::string> rehearsal_words(const JobRequest& request);

}  // namespace vitreo::serve
