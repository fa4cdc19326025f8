// Rescue of BOP supplies: zero current and output off after the death of the host that drove them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/rescue.h"
#include "devices/links/byte_link.h"

#include <memory>
#include <vector>

namespace vitreo::kepco_bop {

/// Whether a BOP answers, by a question that sets nothing: for a line that may lead elsewhere by
/// now.
bool answers(ByteLink& link);

/// Clears what was begun, then zero current and output off, sent to all of them before any answer
/// is read; then reads back. Throws DeviceError when one did not take it or does not answer; the
/// others have had theirs.
void rescue(const std::vector<std::unique_ptr<ByteLink>>& links);

/// What the guardian needs to know, under the driver's name in the rig file.
Rescue rescue_row(std::string_view driver);

}  // namespace vitreo::kepco_bop
