// Published files: they appear whole under their name or not at all, on folders that several
// machines share (NFS), whatever is killed meanwhile.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string_view>

namespace vitreo {

/// Makes the file unless it is there: of several that try, exactly one gets true. What it returns
/// for is on the disk. Throws std::runtime_error naming the file.
bool publish_new(const std::filesystem::path& file, std::string_view bytes);

/// Makes the file or replaces it; two that write at once never mix. Throws as publish_new().
void publish(const std::filesystem::path& file, std::string_view bytes);

}  // namespace vitreo
