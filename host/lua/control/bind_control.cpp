// The module `control`: trajectories, field models, robots.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"

#include "host/config/config.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/values.h"

#include <stdexcept>
#include <string_view>
#include <utility>

namespace vitreo::lua {
namespace {}  // namespace

const std::vector<Binding>& control_functions() {
  static const std::vector<Binding> functions = [] {
    std::vector<Binding> all = trajectory_functions();
    for (Binding& row : field_functions()) all.push_back(std::move(row));
    for (Binding& row : field_fit_functions()) all.push_back(std::move(row));
    return all;
  }();
  return functions;
}

}  // namespace vitreo::lua
