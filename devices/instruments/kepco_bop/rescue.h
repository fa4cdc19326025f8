// BOP supplies that a host which is gone has left energized.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <memory>
#include <vector>

namespace vitreo::kepco_bop {

/// Whether a BOP is there, asked without telling it anything: for a line that may lead elsewhere by
/// now.
bool answers(ByteLink& link);

/// Clears what is half said, then zero current and output off, told to all of them before any is
/// listened to; then reads back. Throws DeviceError when one did not take it or does not answer;
/// the others have had theirs.
void rescue(const std::vector<std::unique_ptr<ByteLink>>& links);

}  // namespace vitreo::kepco_bop
