// Log of the host: one line an event that matters beyond one run, in files of bounded size.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace vitreo {

struct LogLimits {
  std::uint64_t bytes = 5'000'000;  // then host.log becomes host.log.1, and so on
  int kept = 5;                     // older files
};

/// From now on write_log() writes there. Throws std::runtime_error naming the file when it cannot.
void open_log(const std::filesystem::path& file, const LogLimits& limits = {});
void close_log() noexcept;
/// Where it is by default: VITREO_LOG, else host.log in state_folder(); empty where there is none.
std::filesystem::path default_log();

/// "2026-11-21T14:30:00+0100 [1234] text", on one line whatever is in the text. Several programs
/// may write the same file. Without an open log: nothing. Never throws: what the disk refuses is
/// lost, and said on the standard error once.
void write_log(const std::string& text) noexcept;

}  // namespace vitreo
