// Rig file as plain data, and its reader: every key has bounds, and a key that was not read is an
// error.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace vitreo {

struct ConfigValue;
using ConfigTable = std::map<std::string, ConfigValue>;
using ConfigList = std::vector<ConfigValue>;
struct ConfigValue {
  std::variant<bool, double, std::string, ConfigList, ConfigTable> value;
};

struct RigSource {
  std::string file;
  std::string text;
};

/// What a rig file says, on top of what the files that it builds on say; files and texts are kept
/// for errors and for the record.
struct RigDescription {
  std::string file;
  std::string text;
  ConfigTable table;
  std::vector<RigSource> bases;  // the nearest first
  std::map<std::string, std::size_t>
      from_base{};  // dotted keys that stand in a base and not nearer: which of `bases`
  std::vector<std::string> folders{};  // of the program's own rigs and instruments
  /// The file in which the key stands; of a key that is nowhere, where its table does.
  RigSource source_of(std::string key) const;
};

/// One line, with file and line number: "scripts/rigs/x.lua:12: top_camera.focsu is not known; did
/// you mean focus?"
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct Bounds {
  // inclusive, SI
  double min;
  double max;
  std::string_view unit;  // dimension, for the error
};

/// A key as the program reads it, whether the file has it or not: for questions about it.
struct KnownSetting {
  enum class Kind { number, integer, flag, text, choice, numbers, texts };
  std::string key;  // dotted: "top_camera.microscope.focus"
  Kind kind;
  nlohmann::json fallback;             // SI
  double min = 0, max = 0;             // SI, inclusive; of numbers
  std::string unit{};                  // dimension; of numbers
  std::size_t count = 0;               // of a list; 0: any
  std::vector<std::string> choices{};  // of a choice
};

/// The text of a key, "" where there is none: before a reader, or beside one.
std::string text_of(const ConfigTable& table, const std::string& key);

/// Reads one table. Every value read, defaults included, goes into `resolved()`: the rig as it was
/// used. Borrows the description, and a sub-table's reader borrows its parent's: neither is copied.
/// Errors are ConfigError.
class ConfigReader {
 public:
  /// `known`, where it is not null, gets each key as it is read; it outlives the reader.
  explicit ConfigReader(const RigDescription& rig, std::vector<KnownSetting>* known = nullptr);
  ConfigReader(const ConfigReader&) = delete;
  ConfigReader& operator=(const ConfigReader&) = delete;
  double number(const std::string& key, double fallback, const Bounds& bounds);
  int integer(const std::string& key, int fallback, int min, int max);
  bool flag(const std::string& key, bool fallback);
  std::string text(const std::string& key, const std::string& fallback);
  std::string choice(const std::string& key, const std::string& fallback,
                     const std::vector<std::string>& choices);
  Eigen::Vector2d vector2(const std::string& key, const Eigen::Vector2d& fallback,
                          const Bounds& bounds);
  Eigen::Vector3d vector3(const std::string& key, const Eigen::Vector3d& fallback,
                          const Bounds& bounds);
  /// A list of numbers of any length.
  std::vector<double> numbers(const std::string& key, const std::vector<double>& fallback,
                              const Bounds& bounds);
  /// A list of texts of any length; empty when it is not there.
  std::vector<std::string> texts(const std::string& key);
  bool has(const std::string& key) const;
  /// The text of a key, "" where there is none; the key is not read by that.
  std::string peek(const std::string& key) const { return text_of(table_, key); }
  /// The file in which the key stands, or its table.
  std::string file_of(const std::string& key) const { return rig_.source_of(path_ + key).file; }
  const RigDescription& rig() const { return rig_; }
  /// What is in the table, sorted: for tables whose keys are names that the file chooses.
  std::vector<std::string> keys() const;
  /// A sub-table; empty when it is not there.
  ConfigReader table(const std::string& key);
  /// Throws ConfigError for the first key that was not read, with the nearest known one.
  void finish() const;
  const nlohmann::json& resolved() const { return *resolved_; }
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const;

 private:
  ConfigReader(const RigDescription& rig, const ConfigTable& table, std::string path,
               nlohmann::json* resolved, std::vector<KnownSetting>* known);
  void note(KnownSetting setting, const Bounds& bounds) const;
  const ConfigValue* find(const std::string& key);
  [[noreturn]] void wrong_type(const std::string& key, const std::string& wanted,
                               const ConfigValue& found) const;
  void check_bounds(const std::string& key, double value, const Bounds& bounds) const;
  std::vector<double> read_numbers(const std::string& key, const std::vector<double>& fallback,
                                   const Bounds& bounds, std::size_t wanted);
  const RigDescription& rig_;
  const ConfigTable& table_;
  std::string path_;  // "top_camera." or ""
  std::set<std::string> known_;
  std::vector<KnownSetting>* settings_;  // null: not wanted
  nlohmann::json own_;                   // of the root
  nlohmann::json* resolved_;             // where this table's values go
};

/// The candidate nearest to `word`, or "" when none is near: for "did you mean".
std::string nearest(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace vitreo
