// SPDX-License-Identifier: Apache-2.0
#include "host/serve/job.h"

#include "host/config/config.h"
#include "host/record/run_labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <functional>
#include <map>

namespace vitreo::serve {
namespace {

// Bounds of what a stranger to this code may send: far above what a person types, far below what
// would fill the disk or a command line (ARG_MAX is 2 MB).
constexpr std::size_t kLongestText = 1000;  // characters of a name or an argument
constexpr std::size_t kMostWords = 200;     // arguments, answers or tags
constexpr int kMostRepeats = 100'000;
constexpr std::int64_t kLatest = 4'102'444'800;  // s since 1970: the year 2100

/// One line without control characters: it becomes a word of a command line.
std::string checked_text(const std::string& key, const nlohmann::json& value) {
  if (!value.is_string()) throw ConfigError(key + ": wants a text");
  const auto text = value.get<std::string>();
  if (text.size() > kLongestText)
    throw ConfigError(fmt::format("{}: wants at most {} characters", key, kLongestText));
  if (std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }))
    throw ConfigError(key + ": wants one line without control characters");
  return text;
}

// A list of words. Its length is checked before its texts, so that a huge one costs nothing.
std::vector<std::string> texts_of(const std::string& key, const nlohmann::json& value) {
  if (!value.is_array() || value.size() > kMostWords)
    throw ConfigError(fmt::format("{}: wants a list of at most {} texts", key, kMostWords));
  std::vector<std::string> texts;
  for (const auto& one : value) texts.push_back(checked_text(key, one));
  return texts;
}

// is_number_integer() and not is_number(): 1.5 repeats or a seed of 1e9 written as a float would be
// cut without a word.
std::int64_t whole_of(const std::string& key, const nlohmann::json& value, std::int64_t least,
                      std::int64_t most) {
  if (!value.is_number_integer() || value < least || value > most)
    throw ConfigError(fmt::format("{}: wants a whole number from {} to {}", key, least, most));
  return value.get<std::int64_t>();
}

bool flag_of(const std::string& key, const nlohmann::json& value) {
  if (!value.is_boolean()) throw ConfigError(key + ": wants true or false");
  return value.get<bool>();
}

// One row a key, so that a key which is not known can be told from one that is misspelt, and none
// is read and ignored.
using Setter = std::function<void(JobRequest&, const std::string&, const nlohmann::json&)>;
const std::map<std::string, Setter>& setters() {
  using J = nlohmann::json;
  using K = std::string;
  static const std::map<std::string, Setter> kSetters{
      {"protocol", [](auto& r, const K& k, const J& v) { r.protocol = checked_text(k, v); }},
      {"arguments", [](auto& r, const K& k, const J& v) { r.arguments = texts_of(k, v); }},
      {"rig", [](auto& r, const K& k, const J& v) { r.rig = checked_text(k, v); }},
      {"operator", [](auto& r, const K& k, const J& v) { r.operator_name = checked_text(k, v); }},
      {"answers", [](auto& r, const K& k, const J& v) { r.answers = texts_of(k, v); }},
      {"tags", [](auto& r, const K& k, const J& v) { r.tags = texts_of(k, v); }},
      {"seed",
       [](auto& r, const K& k, const J& v) {
         r.seed = static_cast<std::uint64_t>(whole_of(k, v, 0, INT64_MAX));
       }},
      {"real_time", [](auto& r, const K& k, const J& v) { r.real_time = flag_of(k, v); }},
      {"sweep", [](auto& r, const K& k, const J& v) { r.sweep = flag_of(k, v); }},
      {"repeats",
       [](auto& r, const K& k, const J& v) {
         r.repeats = static_cast<int>(whole_of(k, v, 1, kMostRepeats));
       }},
      {"due", [](auto& r, const K& k, const J& v) { r.due = whole_of(k, v, 0, kLatest); }},
      {"person", [](auto& r, const K& k, const J& v) { r.person = flag_of(k, v); }},
  };
  return kSetters;
}

/// A word as a shell takes it.
// Single quotes keep all but themselves (POSIX shell, 2.2.2); what needs none stays as people type
// it.
std::string quoted(const std::string& word) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=.,:/@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

}  // namespace

const char* to_string(JobState state) {
  switch (state) {
    case JobState::waiting:
      return "waiting";
    case JobState::running:
      return "running";
    case JobState::ended:
      return "ended";
  }
  return "?";
}

std::int64_t seconds_now() { return static_cast<std::int64_t>(std::time(nullptr)); }

bool needs_person(const Job& job) {
  if (job.request.person) return true;
  return job.rehearsal.is_object() && !job.rehearsal.value("asks", nlohmann::json()).empty();
}

// Also the reader of what the queue stored: a request that was taken once is read by the same
// rules.
JobRequest request_of(const nlohmann::json& json) {
  if (!json.is_object()) throw ConfigError("a job: wants an object with a protocol");
  JobRequest request;
  for (const auto& [key, value] : json.items()) {
    const auto found = setters().find(key);
    if (found == setters().end()) {
      std::vector<std::string> names;
      for (const auto& [name, setter] : setters()) names.push_back(name);
      const std::string near = nearest(key, names);
      throw ConfigError("'" + key.substr(0, 60) + "' is not known of a job" +
                        (near.empty() ? "" : "; did you mean " + near + "?"));
    }
    found->second(request, key, value);
  }
  if (request.protocol.empty()) throw ConfigError("protocol: is missing");
  // The record refuses a tag that is no word: better now than when the run begins at night.
  nlohmann::json checked;
  try {
    for (const std::string& tag : request.tags) {
      const auto [key, value] = key_and_value(tag);
      set_tag(checked, key, value);
    }
  } catch (const std::invalid_argument& error) {
    throw ConfigError(std::string("tags: ") + error.what());
  }
  return request;
}

// All keys, those at their defaults too: the form of a job is filled from it.
nlohmann::json to_json(const JobRequest& r) {
  return {{"protocol", r.protocol},
          {"arguments", r.arguments},
          {"rig", r.rig},
          {"answers", r.answers},
          {"operator", r.operator_name},
          {"tags", r.tags},
          {"seed", r.seed},
          {"real_time", r.real_time},
          {"sweep", r.sweep},
          {"repeats", r.repeats},
          {"due", r.due},
          {"person", r.person}};
}

// The process number is left out: it is of no use to a browser, and another process may have it by
// then.
nlohmann::json to_json(const Job& job) {
  return {{"id", job.id},
          {"request", to_json(job.request)},
          {"title", job.title},
          {"state", to_string(job.state)},
          {"added", job.added},
          {"started", job.started},
          {"ended", job.ended},
          {"run", job.run},
          {"outcome", job.outcome},
          {"reason", job.reason},
          {"command", command_of(job.request)},
          {"rehearsal", job.rehearsal},
          {"needs_person", needs_person(job)},
          {"attended_until", job.attended_until}};
}

// Options as one word each, "--x=y", and the positional words behind "--": no text of a request can
// become an option.
std::vector<std::string> words_of(const Job& job, const JobPlaces& places) {
  const JobRequest& r = job.request;
  std::vector<std::string> words{r.sweep ? "sweep" : "run", "--json", "--quiet"};
  if (!r.rig.empty()) words.push_back("--rig=" + r.rig);
  if (!r.operator_name.empty()) words.push_back("--operator=" + r.operator_name);
  // The seed is always said: the record of a job does not depend on the default of a later program.
  words.push_back("--seed=" + std::to_string(r.seed));
  for (const std::string& answer : r.answers) words.push_back("--answer=" + answer);
  // A sweep has a folder of its own, known before it begins, so that its progress can be read from
  // it.
  if (r.sweep) {
    words.push_back("--out=" + places.sweep);
    words.push_back("--repeat=" + std::to_string(r.repeats));
  } else {
    words.push_back("--out=" + places.runs);
    // By this tag the runs of the queue are found among all others, also by `vitreo runs --where`.
    words.push_back("--tag=job=" + std::to_string(job.id));
    for (const std::string& tag : r.tags) words.push_back("--tag=" + tag);
    if (r.real_time) words.push_back("--real-time");
    words.push_back("--view");
    words.push_back("--view-port=" + std::to_string(places.live_port));
    words.push_back("--listen=" + places.address);
    words.push_back("--token-file=" + places.token_file);
  }
  words.push_back("--");
  words.push_back(r.protocol);
  words.insert(words.end(), r.arguments.begin(), r.arguments.end());
  return words;
}

// For people: without what the workbench adds for itself, so that it gives the same run at a
// terminal.
std::string command_of(const JobRequest& r) {
  std::string text = std::string("vitreo ") + (r.sweep ? "sweep " : "run ") + quoted(r.protocol);
  for (const std::string& word : r.arguments) text += " " + quoted(word);
  if (!r.rig.empty()) text += " --rig " + quoted(r.rig);
  if (r.seed != 1) text += " --seed " + std::to_string(r.seed);
  if (r.sweep && r.repeats != 1) text += " --repeat " + std::to_string(r.repeats);
  for (const std::string& answer : r.answers) text += " --answer " + quoted(answer);
  if (r.real_time && !r.sweep) text += " --real-time";
  return text;
}

// No --out: a rehearsal writes nothing. No pace: the twin runs as fast as it can.
std::vector<std::string> rehearsal_words(const JobRequest& r) {
  std::vector<std::string> words{"check", "--json"};
  if (!r.rig.empty()) words.push_back("--rig=" + r.rig);
  words.push_back("--seed=" + std::to_string(r.seed));
  for (const std::string& answer : r.answers) words.push_back("--answer=" + answer);
  words.push_back("--");
  words.push_back(r.protocol);
  words.insert(words.end(), r.arguments.begin(), r.arguments.end());
  return words;
}

}  // namespace vitreo::serve
