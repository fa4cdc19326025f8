// Links of a rig's instruments, with the tap in them that a run asks for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/link_tap.h"
#include "host/rig/registry.h"

#include <memory>
#include <string>
#include <utility>

namespace vitreo {

/// Every reader of a driver passes its link through this, real or in memory; without a tap it is
/// the link itself.
template <class Link>
std::unique_ptr<Link> traced(const RigContext& where, const std::string& role,
                             const std::string& address, std::unique_ptr<Link> link) {
  return where.tap == nullptr ? std::move(link)
                              : tapped(std::move(link), {role, address}, *where.tap, where.clock);
}

}  // namespace vitreo
