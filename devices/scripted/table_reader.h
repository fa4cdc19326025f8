// Reader of a table of a driver's file: every key is checked, and one that was not read is an
// error.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/instrument.h"
#include "devices/scripted/sandbox.h"

#include <optional>
#include <set>
#include <string>
#include <vector>

namespace vitreo::scripted {

/// Errors are ScriptFault: "pump.lua: properties.rate.unit: must be a text".
class TableReader {
 public:
  /// The table is on top of the sandbox's stack; it is popped. `path`: "properties.rate".
  TableReader(Sandbox& sandbox, std::string path);

  bool has(const std::string& key);
  std::optional<std::string> text(const std::string& key);
  std::string text(const std::string& key, const std::string& fallback);
  std::optional<double> number(const std::string& key, double min, double max);
  std::optional<int> whole(const std::string& key, int min, int max);
  bool flag(const std::string& key, bool fallback);
  Reference function(const std::string& key);
  /// A text, a function, or nothing.
  Action action(const std::string& key);
  /// A text, or a list of them; empty when it is not there.
  std::vector<std::string> texts(const std::string& key);
  std::vector<double> numbers(const std::string& key);
  std::optional<TableReader> table(const std::string& key);
  /// Its entries that are tables, by their keys 1, 2, ...
  std::vector<TableReader> list(const std::string& key);
  /// A name, a number or a flag, as its type is; nothing when it is not there.
  std::optional<QuantityValue> value(const std::string& key);
  /// The keys that are texts, sorted.
  std::vector<std::string> keys();
  /// Time in s, from 0 to `most`.
  Time seconds(const std::string& key, double fallback, double most);
  /// The whole table as a reference: [] -> []
  const Reference& reference() const { return table_; }
  void finish();
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const;
  const std::string& path() const { return path_; }

 private:
  int push(const std::string& key);  // the type
  std::string name_of(const std::string& key) const;
  Sandbox* sandbox_;
  Reference table_;
  std::string path_;
  std::set<std::string> known_;
};

}  // namespace vitreo::scripted
