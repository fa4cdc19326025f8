// Forms of the protocols: what a page needs to ask for a run's values, and their check as they are
// typed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/serve/job.h"
#include "host/session/script_engine.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace vitreo::serve {

/// Where the protocols and rigs are: the program's own folders; and how a sweep's words are read.
struct FormSources {
  std::function<std::vector<std::string>()> protocol_files;
  std::function<std::vector<std::string>()> rig_files;
  /// How many settings these words make. Throws ConfigError for wrong ones, and for a range that
  /// is to be drawn.
  std::function<double(const ProtocolDescription&, const std::vector<std::string>&)> count_settings;
};

/// What was typed into a field as the command line takes it: a bare number gets the field's unit,
/// before a count of points: "1" is "1mm/s", "0.1..2:5" is "0.1..2mm/s:5".
std::string with_unit_of(const Parameter& parameter, const std::string& typed);

/// Any thread; one reads at a time, since the engine has one state. A protocol is read again when
/// its file has changed.
class Forms {
 public:
  Forms(ScriptEngine& engine, FormSources sources);

  /// [{"name", "title", "simulated_only"}, or "error" of one that does not load], by name.
  nlohmann::json protocols();
  std::vector<std::string> rigs() const;
  /// As `vitreo describe --json`, each parameter also with "scale" (SI of one of its unit),
  /// "default_text" and "range_text" in that unit. Throws ConfigError for a name that is none.
  nlohmann::json form(const std::string& name);

  /// What was typed: {name: text}. {"errors": {name: why}, "arguments": [...], "sweep": flag,
  /// "points": number, "command": text, "changed": [names]}; of a sweep with more than 10000
  /// points "errors" has "".
  nlohmann::json check(const std::string& name, const nlohmann::json& typed, int repeats = 1);
  /// Throws ConfigError or ScriptError for a job that would be refused before anything is opened:
  /// an unknown protocol or rig, arguments that do not fit. Returns the protocol's title.
  std::string check(const JobRequest& request);

 private:
  ProtocolDescription described(const std::string& name);
  double count_points(const ProtocolDescription& protocol, const std::vector<std::string>& words,
                      int repeats) const;

  ScriptEngine& engine_;
  const FormSources sources_;
  std::mutex mutex_;
  struct Known {
    std::string mark;  // of the file as it was read
    ProtocolDescription protocol;
  };
  std::map<std::string, Known> known_;
};

}  // namespace vitreo::serve
