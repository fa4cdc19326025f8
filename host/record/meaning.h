// Meaning of the names in a record: files, tables, columns, clocks, frames of axes. Each is said
// once, here and in the schema's rows; run.sqlite, DATA.md and readers have it from there.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo {

/// To which instant the time of a stream's rows belongs; the words are part of the format.
inline constexpr const char* kExposure = "exposure";
inline constexpr const char* kSetPoint = "set point";
inline constexpr const char* kReadBack = "read back";
inline constexpr const char* kReading = "reading";
inline constexpr const char* kHostClock = "host";
inline constexpr const char* kScriptClock = "script";

/// Frames of axes.
inline constexpr const char* kWorld = "world";
inline constexpr const char* kTopImage = "top image";
inline constexpr const char* kSideImage = "side image";

struct Meaning {
  std::string kind;  // "file", "table", "column", "clock", "time", "axes"
  std::string name;  // "servo", "frame.t_ns", "exposure"
  std::string unit;  // of a column
  std::string text;
};

/// All that this program writes, in the order of DATA.md.
const std::vector<Meaning>& meanings();

}  // namespace vitreo
