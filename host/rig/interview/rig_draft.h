// Draft of a rig file: its tables as data, as the settings' reader takes them, and as Lua text.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"
#include "host/rig/interview/setting_answer.h"

#include <string>
#include <vector>

namespace vitreo {

/// One line of a table. `key` may be dotted: "z.device" stands in the table's own table z.
struct DraftSetting {
  std::string key;
  WrittenValue value;
  std::string comment{};  ///< behind it; empty: none
};

/// One role, or the loop's model.
struct DraftTable {
  std::string name;
  std::vector<std::string> comments;  ///< above it, a line each
  std::vector<DraftSetting> settings;
  const DraftSetting* find(const std::string& key) const;
  /// In its place where the key is there already, else at the end.
  void set(DraftSetting setting);
};

struct RigDraft {
  std::string file;   ///< where it would be written
  std::string title;  ///< for people
  std::string today;  ///< "2026-11-21"
  std::vector<DraftTable> tables;
  std::vector<std::string> folders{};  ///< as RigDescription::folders
  DraftTable* find(const std::string& name);
  const DraftTable* find(const std::string& name) const;
  /// The table of this name, made where it is not there yet.
  DraftTable& table(const std::string& name);
};

/// As the file would be read; its text is empty, so that errors have no line.
RigDescription description_of(const RigDraft& draft);
/// The whole file. Reading it gives the tables of description_of() but for rounding.
std::string to_lua(const RigDraft& draft);

}  // namespace vitreo
