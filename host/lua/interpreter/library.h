// Library of a state: classes of handles, modules and global functions beside Lua's own.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <string>
#include <vector>

namespace vitreo::lua {

/// Rows named "optics.trace", "vision.color_model.train": a global table, and what require() gives.
struct Module {
  std::string name;
  const std::vector<Binding>* rows = nullptr;
};

/// Plain data, put together once by host/lua/engine/library.h in the order in which help() lists
/// it.
struct Library {
  std::vector<const Class*> classes;
  const std::vector<Binding>* globals = nullptr;  // help() and such: rows without an object
  const std::vector<Binding>* prompt = nullptr;   // what only the prompt has
  std::vector<Module> modules;
};

}  // namespace vitreo::lua
