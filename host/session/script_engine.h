// Script engine: interface of the host to a script language. Implemented in host/lua/.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <cstdint>
#include <iosfwd>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

class LineEditor;
class Session;

/// Numbers in SI. Several of them: a list, a vector (x, y, z) or a range (least, most).
using ArgumentValue = std::variant<bool, double, std::string, std::vector<double>>;

enum class ParameterKind { number, integer, flag, choice, text, list, vector, range };
/// "number", as programs compare it.
const char* to_string(ParameterKind kind);
/// Whether a parameter has unit and bounds: a number, or several.
bool is_numeric(ParameterKind kind);
/// Whether its value is several numbers: a list, a vector or a range.
bool is_several(ParameterKind kind);

struct Parameter {
  std::string name;
  std::string help;
  ParameterKind kind = ParameterKind::number;
  /// As the protocol declares it, e.g. "mm/s"; its dimension is what a value must have.
  std::string unit;
  ArgumentValue fallback;
  // SI; of several numbers, for each
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices;
  bool required = false;  // a text that must be given: there is no sensible default
};

/// How a protocol wants to be tested (scripts/testing.lua).
struct ProtocolTest {
  enum class Kind { run, fail, stop } kind = Kind::run;
  std::string arguments;  // as on the command line, blanks between
  std::string answers;    // likewise
  std::string rig;        // a name in scripts/rigs/ or a file; empty: the protocol's own
  std::uint64_t seed = 1;
  std::map<std::string, std::pair<double, double>> results;  // of run: least and most, SI
  std::string fault;                                         // of fail, as the two below
  std::string outcome;
  std::string says;
  int times = 100;  // of stop
};

struct ProtocolDescription {
  std::string file;
  std::string name;  // the file's stem
  std::string title;
  std::string text;                // the source
  std::string about;               // the comment at the file's head
  std::vector<std::string> needs;  // roles
  std::string rig;  // on which it runs unless another is named; a name in scripts/rigs/, or empty
  bool simulated_only = false;  // a laboratory cannot do it: it redraws the machine, or wants truth
  std::vector<Parameter> parameters;  // in the order of their names
  std::vector<ProtocolTest> tests;    // as the file lists them
};

/// A script's fault, or a protocol file's: one line, with "file:line: " in front where there is
/// one.
class ScriptError : public std::runtime_error {
 public:
  ScriptError(const std::string& message, std::string trace = "")
      : std::runtime_error(message), trace_(std::move(trace)) {}
  const std::string& trace() const { return trace_; }

 private:
  std::string trace_;
};

/// "speed=5um" checked against the declaration; throws ConfigError naming the parameter and what it
/// wants. Missing ones take their defaults.
std::map<std::string, ArgumentValue> check_arguments(const ProtocolDescription& protocol,
                                                     const std::vector<std::string>& words);

/// One value as people write it, "5um", "0.1,0.5mm/s", "0.1..2mm/s"; throws ConfigError naming the
/// parameter and what it wants.
ArgumentValue read_argument(const Parameter& parameter, const std::string& text);

/// A value so that read_argument() gives it back to the bit: "5e-06m".
std::string argument_text(const Parameter& parameter, const ArgumentValue& value);

/// The parameter of "name=value". Throws ConfigError naming the ones there are.
const Parameter& parameter_of(const ProtocolDescription& protocol, const std::string& word);

/// Several numbers as the parameter's kind wants them: three of a vector, two ascending ones of a
/// range, each within the bounds. Throws ConfigError.
void check_several(const Parameter& parameter, const std::vector<double>& values);

class ScriptEngine {
 public:
  virtual ~ScriptEngine() = default;
  /// Reads a protocol without running it. Throws ScriptError.
  virtual ProtocolDescription describe(const std::string& file) = 0;
  /// Reads a rig file and what it builds on: constants only. Throws ScriptError.
  virtual RigDescription load_rig(const std::string& file) = 0;
  /// The same from the texts that a run's record kept, `bases` the nearest first, whatever the
  /// files are now.
  virtual RigDescription recorded_rig(const RigSource& rig,
                                      const std::vector<RigSource>& bases) = 0;
  /// Runs a protocol in a fresh state. Throws ScriptError, DeviceError, Stopped.
  virtual void run(const ProtocolDescription& protocol,
                   const std::map<std::string, ArgumentValue>& arguments, Session& session) = 0;
  /// Reads statements from `in` until its end; shows results on `out`, what is wrong on `err`.
  /// Where `in` is no terminal, throws ScriptError at the end when some failed.
  virtual void prompt(Session& session, LineEditor& in, std::ostream& out, std::ostream& err) = 0;
  /// Stops the script that runs, wherever it is: run() throws Stopped. Async-signal-safe.
  virtual void interrupt() noexcept = 0;
};

}  // namespace vitreo
