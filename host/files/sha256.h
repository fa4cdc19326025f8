// SHA-256 (FIPS 180-4), for the hashes in the record.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace vitreo {

/// 64 hexadecimal digits.
std::string sha256(std::string_view bytes);

}  // namespace vitreo
