// Owner of a claim: the process that works at a point, and whether it still lives.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

namespace vitreo {

/// This process: host, boot, namespace of process numbers, number, start.
nlohmann::json this_owner();

enum class OwnerLife { lives, dead, elsewhere };
/// Exact for a process of this machine; `elsewhere` for one of another, of which only its signs of
/// life are seen. An owner that cannot be read is `elsewhere`, too.
OwnerLife life_of(const nlohmann::json& owner);

}  // namespace vitreo
