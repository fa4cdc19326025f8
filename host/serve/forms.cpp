// SPDX-License-Identifier: Apache-2.0
#include "host/serve/forms.h"

#include "host/config/config.h"
#include "host/session/protocol_json.h"
#include "host/session/protocol_text.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sys/stat.h>

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

constexpr double kMostPoints = 10'000;  // as `vitreo sweep`
constexpr int kDigits = 6;              // of a declared value, as protocol_text() has it

/// Inode, size and time of change, or "" where there is no such file.
// A protocol is edited while the workbench serves; reading all of them takes a second.
std::string mark_of(const std::string& file) {
  struct stat about = {};
  if (::stat(file.c_str(), &about) != 0) return "";
  return fmt::format("{} {} {}.{:09}", about.st_ino, about.st_size, about.st_mtim.tv_sec,
                     about.st_mtim.tv_nsec);
}

std::string stem(const std::string& file) { return fs::path(file).stem().string(); }

/// A number in the parameter's own unit, as a field shows it.
// Not the display unit of that size, as elsewhere: the field has the declared unit beside it.
std::string in_unit(const Parameter& parameter, double si) {
  const auto unit = find_unit(parameter.unit);
  return format_number(unit ? unit->from_si(si) : si, kDigits);
}

std::string default_text(const Parameter& parameter) {
  if (parameter.required) return "";
  if (const double* one = std::get_if<double>(&parameter.fallback)) return in_unit(parameter, *one);
  return plain_value_text(parameter, parameter.fallback);
}

/// "0.05 to 2", "at least 1", in the parameter's own unit.
std::string range_text(const Parameter& parameter) {
  const bool least = std::isfinite(parameter.min), most = std::isfinite(parameter.max);
  if (least && most)
    return in_unit(parameter, parameter.min) + " to " + in_unit(parameter, parameter.max);
  if (least) return "at least " + in_unit(parameter, parameter.min);
  if (most) return "at most " + in_unit(parameter, parameter.max);
  return "";
}

/// Several values, or a range of them, where a run takes one.
// Lists, vectors and ranges are one value of their own kind: a comma in them makes no sweep.
bool is_sweep_text(const Parameter& parameter, const std::string& text) {
  switch (parameter.kind) {
    case ParameterKind::number:
    case ParameterKind::integer:
      return text.find(',') != std::string::npos || text.find("..") != std::string::npos;
    case ParameterKind::choice:
    case ParameterKind::flag:
      return text.find(',') != std::string::npos;
    default:
      return false;
  }
}

/// The error without the parameter's name, which stands beside the field.
std::string without_name(const std::string& error, const std::string& name) {
  return error.starts_with(name + ": ") ? error.substr(name.size() + 2) : error;
}

}  // namespace

std::string with_unit_of(const Parameter& parameter, const std::string& typed) {
  if (!is_numeric(parameter.kind) || parameter.unit.empty() || typed.empty()) return typed;
  const std::size_t count = typed.find(':');
  const std::string numbers = typed.substr(0, count);
  const std::string rest = count == std::string::npos ? "" : typed.substr(count);
  // An exponent is part of a number; any other letter is a unit.
  const bool bare = numbers.find_first_not_of("0123456789+-.,eE ") == std::string::npos &&
                    numbers.find_first_of("0123456789") != std::string::npos;
  return bare ? numbers + parameter.unit + rest : typed;
}

/// How many runs a sweep would be, without making them. Throws ConfigError.
double Forms::count_points(const ProtocolDescription& protocol,
                           const std::vector<std::string>& words, int repeats) const {
  // A product of counts, as a double: 1..2:1000 on four axes would overflow a whole number.
  const double points = sources_.count_settings(protocol, words) * repeats;
  if (points > kMostPoints)
    throw ConfigError(fmt::format("{:.0f} runs are too many; at most {:.0f}", points, kMostPoints));
  return points;
}

Forms::Forms(ScriptEngine& engine, FormSources sources)
    : engine_(engine), sources_(std::move(sources)) {}

// By name alone: what a browser asks for is none of the file system's paths.
ProtocolDescription Forms::described(const std::string& name) {
  std::vector<std::string> names;
  for (const std::string& file : sources_.protocol_files()) {
    names.push_back(stem(file));
    if (names.back() != name) continue;
    const std::string mark = mark_of(file);
    // The engine reads one file at a time.
    const std::lock_guard lock(mutex_);
    const auto known = known_.find(file);
    if (known != known_.end() && known->second.mark == mark) return known->second.protocol;
    ProtocolDescription protocol = engine_.describe(file);
    known_[file] = {mark, protocol};
    return protocol;
  }
  const std::string near = nearest(name.substr(0, 60), names);
  throw ConfigError("there is no protocol '" + name.substr(0, 60) + "'" +
                    (near.empty() ? "" : "; did you mean " + near + "?"));
}

nlohmann::json Forms::protocols() {
  nlohmann::json rows = nlohmann::json::array();
  for (const std::string& file : sources_.protocol_files()) {
    nlohmann::json row{{"name", stem(file)}};
    try {
      const ProtocolDescription protocol = described(stem(file));
      row["title"] = protocol.title;
      row["about"] = protocol.about;
      row["simulated_only"] = protocol.simulated_only;
      // A broken file is a row with its reason, and hides no other.
    } catch (const ScriptError& error) {
      row["error"] = error.what();
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<std::string> Forms::rigs() const {
  std::vector<std::string> names;
  for (const std::string& file : sources_.rig_files()) names.push_back(stem(file));
  return names;
}

nlohmann::json Forms::form(const std::string& name) {
  const ProtocolDescription protocol = described(name);
  nlohmann::json form = to_json(protocol);
  // A path of this machine is of no use to a browser.
  form.erase("file");
  for (std::size_t i = 0; i < protocol.parameters.size(); ++i) {
    const Parameter& parameter = protocol.parameters[i];
    nlohmann::json& row = form["parameters"][i];
    const auto unit = find_unit(parameter.unit);
    // For programs that fill the form with numbers in SI.
    row["scale"] = unit ? unit->factor : 1.0;
    row["default_text"] = default_text(parameter);
    row["range_text"] = range_text(parameter);
    row["print_unit"] = print_unit(parameter.unit);
  }
  return form;
}

nlohmann::json Forms::check(const std::string& name, const nlohmann::json& typed, int repeats) {
  if (!typed.is_object()) throw ConfigError("values: wants an object of texts");
  const ProtocolDescription protocol = described(name);
  nlohmann::json errors = nlohmann::json::object(), changed = nlohmann::json::array();
  std::vector<std::string> words;
  bool sweep = false;
  // Every field is judged, not only up to the first that is wrong: a form shows them all.
  for (const auto& [key, value] : typed.items()) {
    try {
      if (!value.is_string()) throw ConfigError(key + ": wants a text");
      const Parameter& parameter = parameter_of(protocol, key + "=");
      const std::string text = with_unit_of(parameter, value.get<std::string>());
      words.push_back(key + "=" + text);
      changed.push_back(key);
      if (is_sweep_text(parameter, text)) {
        sweep = true;
        sources_.count_settings(protocol, {words.back()});
      } else {
        read_argument(parameter, text);
      }
    } catch (const ConfigError& error) {
      errors[key] = without_name(error.what(), key);
    }
  }
  // What is needed and not typed has no text to be wrong; the command line would say so as well.
  for (const Parameter& parameter : protocol.parameters)
    if (parameter.required && !typed.contains(parameter.name))
      errors[parameter.name] = "is needed: there is no default";
  double points = 1;
  try {
    if (errors.empty() && (sweep || repeats > 1)) points = count_points(protocol, words, repeats);
  } catch (const ConfigError& error) {
    errors[""] = error.what();
  }
  // The command below the form is the one that the job will have.
  JobRequest request{name, words};
  request.sweep = sweep || repeats > 1;
  request.repeats = repeats;
  return {{"errors", errors},
          {"arguments", words},
          {"sweep", request.sweep},
          {"points", points},
          {"command", command_of(request)},
          {"changed", changed}};
}

// A job that comes from a program passes the same checks as one from the form.
std::string Forms::check(const JobRequest& request) {
  const ProtocolDescription protocol = described(request.protocol);
  if (!request.rig.empty()) {
    // By name: a path would let a browser choose any file of the machine as a rig.
    const std::vector<std::string> names = rigs();
    if (std::find(names.begin(), names.end(), request.rig) == names.end()) {
      const std::string near = nearest(request.rig, names);
      throw ConfigError("there is no rig '" + request.rig + "'" +
                        (near.empty() ? "" : "; did you mean " + near + "?"));
    }
  }
  if (request.sweep) {
    count_points(protocol, request.arguments, request.repeats);
  } else {
    check_arguments(protocol, request.arguments);
  }
  return protocol.title;
}

}  // namespace vitreo::serve
