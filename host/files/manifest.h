// Manifest of a closed run, SHA256SUMS: the hash of every file, as `sha256sum -c` reads it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

inline constexpr const char* kManifest = "SHA256SUMS";

/// 64 hexadecimal digits. Throws std::runtime_error naming the file.
std::string sha256_file(const std::filesystem::path& file);

/// Hashes every file of the folder and those below it, but for itself and what `vitreo export` put
/// into export/. Throws std::runtime_error naming the file.
void write_manifest(const std::filesystem::path& folder);

/// How many files it hashes, or would.
std::size_t count_files(const std::filesystem::path& folder);

/// What differs from the manifest: changed, missing, and files that it does not know; empty when
/// nothing. One line each.
std::vector<std::string> check_manifest(const std::filesystem::path& folder);

}  // namespace vitreo
