// Folders of runs, and files that exist whole or not at all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

namespace vitreo {

/// A run's folder cannot be made where it was asked for; the text names the folder.
class FolderError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Makes `parent/2026-11-21T143000_servo_square_7f3a`, new and ours alone. Throws
/// FolderError.
std::filesystem::path make_run_folder(const std::filesystem::path& parent, const std::string& name);

/// Letters, digits, '-' and '_' of a text, for file names: "Error (depth)" is "Error_depth";
/// `fallback` when none is left.
std::string slug(std::string_view text, const std::string& fallback);

/// The wall clock here: "2026-11-21T14:30:00+0100".
std::string wall_time_text();
/// A moment of it as UTC: "2026-11-21T13:30:00.123456Z".
std::string utc_text(std::chrono::system_clock::time_point moment);

/// `digits` hexadecimal digits from the system's entropy: for names only, never for the science.
std::string random_hex(int digits);

/// Written beside and renamed: never half a file under its name. Throws std::runtime_error naming
/// the file.
void write_file(const std::filesystem::path& file, std::string_view bytes);

}  // namespace vitreo
