// Likeness of received bytes to the answers of known instruments, or to an echo. Judged from the
// bytes alone: nothing is sent to an instrument that is not known.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace vitreo {

/// Of bytes that no driver of its own has asked for: "a Zaber device", "the SCPI instrument KEPCO
/// BOP 36-12MG". Nothing where they are like nothing that is known.
std::optional<std::string> likeness(std::span<const std::uint8_t> heard);

/// Whether `heard` is what was sent, come back: the same bytes but for line ends, from the first
/// one on, as far as the shorter one goes, and two at least.
bool is_echo(std::span<const std::uint8_t> sent, std::span<const std::uint8_t> heard);

}  // namespace vitreo
