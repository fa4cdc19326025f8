// Openers of instruments that come back after they were lost.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/reopening.h"
#include "host/registry.h"

#include <functional>
#include <memory>
#include <string>
#include <utility>

namespace vitreo {

/// `open(const Surroundings&)` gives the instrument, now and each time after it was lost (devices/reopening.h). What
/// stands at the far end of an emulated link must outlive it, as the laboratory's emulators do.
template <class Role, class Open>
Opener<Role> reopened(const std::string& role, Open open) {
  return [role, open = std::move(open)](const Surroundings& where) {
    std::function<std::unique_ptr<Role>()> again = [open, where] { return open(where); };
    return Opened<Role>{nullptr, reopening(std::move(again), {.name = role}, where.clock)};
  };
}

}  // namespace vitreo
