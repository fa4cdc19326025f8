// Openers of instruments that come back after they were lost.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/reopening.h"
#include "host/rig/registry.h"

#include <functional>
#include <memory>
#include <string>
#include <utility>

namespace vitreo {

/// `open(const RigContext&)` gives the instrument, now and each time after it was lost
/// (devices/roles/reopening.h). What stands at the far end of an emulated link must outlive it, as
/// the laboratory's emulators do.
template <class Role, class Open>
Opener<Role> reopened(const std::string& role, Open open) {
  return [role, open = std::move(open)](const RigContext& where) {
    std::function<std::unique_ptr<Role>()> again = [open, where] { return open(where); };
    return Opened<Role>{nullptr, reopening(std::move(again), {.name = role}, where.clock)};
  };
}

}  // namespace vitreo
