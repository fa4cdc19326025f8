// Turn of a script's thread at the clock (devices/time/turn_sharing.h): while Lua runs plain
// statements the servo loop and all other tasks may go on beside it; the host's own code, which
// touches what they touch, has the turn.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/turn_sharing.h"
#include "host/lua/interpreter/context.h"

namespace vitreo::lua {

/// Null while a file is only read.
inline TurnSharing* sharing_of(const Context& context) {
  return context.session == nullptr ? nullptr : turn_sharing(context.session->clock);
}

/// Scope guard: Lua's own code. Nothing changes within another one, or while a file is only read.
class PlainLua {
 public:
  explicit PlainLua(const Context& context) : sharing_(sharing_of(context)) {
    if (sharing_ != nullptr) began_ = sharing_->begin_alone();
  }
  ~PlainLua() {
    if (began_) sharing_->end_alone();
  }
  PlainLua(const PlainLua&) = delete;
  PlainLua& operator=(const PlainLua&) = delete;

 private:
  TurnSharing* const sharing_;
  bool began_ = false;
};

/// Scope guard: code of the host that Lua has called. Nothing changes where the turn is in hand.
class HostCode {
 public:
  explicit HostCode(const Context& context) : sharing_(sharing_of(context)) {
    if (sharing_ != nullptr) called_ = sharing_->end_alone();
  }
  ~HostCode() {
    if (called_) sharing_->begin_alone();
  }
  HostCode(const HostCode&) = delete;
  HostCode& operator=(const HostCode&) = delete;

 private:
  TurnSharing* const sharing_;
  bool called_ = false;
};

}  // namespace vitreo::lua
