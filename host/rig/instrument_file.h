// Instruments that are one Lua file each: where a rig file's driver names one, and what of it the
// rest of the host asks for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/scripted/declaration.h"
#include "host/config/config.h"

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

struct InstrumentFile {
  std::string path;
  std::string text;
};

/// The file that the driver `name` is: a path that ends in .lua, from where the rig file stands, or
/// NAME.lua beside the rig file, in its folder instruments/, or among the program's own. Nothing
/// where there is none. Throws ConfigError for one that cannot be read, or is too large.
std::optional<InstrumentFile> find_instrument_file(const RigDescription& rig,
                                                   const std::string& rig_file,
                                                   const std::string& name);
/// Names of the program's own, sorted.
std::vector<std::string> instrument_file_names(const RigDescription& rig);

/// What an instrument's file is, for a choice among several.
struct InstrumentSummary {
  std::string name;  ///< as a rig file gives it
  std::string title;
  std::string kind;
  std::string measures;
  std::vector<std::string> buses{};
  std::vector<std::pair<std::string, std::string>> settings{};  ///< name, and its help
};
/// Those that a rig file there could name: the program's own, and what lies beside it or in its
/// folder instruments/. A file that cannot be read as an instrument is none. Sorted by name.
std::vector<InstrumentSummary> instrument_summaries(const RigDescription& rig,
                                                    const std::string& rig_file);

/// As scripted::load(), with the host's units. Throws ConfigError with the file's line.
scripted::Loaded load_instrument(const InstrumentFile& file,
                                 const scripted::SettingValues& values = {});

/// Every such file that the rig uses, each once: for its record. A driver that is built in
/// (host/rig/identities.h) is no file's.
std::vector<InstrumentFile> instrument_files(
    const RigDescription& rig, const std::function<bool(const std::string&)>& is_built_in);

/// What the guardian sends for an output with such a driver, on the link as the role's reader has
/// it; empty where the driver is no file, or declares no rescue.
std::string rescue_text(const ConfigReader& reader);

}  // namespace vitreo
