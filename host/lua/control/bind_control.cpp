// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"

#include <utility>

namespace vitreo::lua {
/// In the order of the reference; made once, when a state first opens the library.
const std::vector<Binding>& control_functions() {
  static const std::vector<Binding> functions = [] {
    std::vector<Binding> all = trajectory_functions();
    for (auto rows :
         {law_functions(), field_functions(), field_fit_functions(), identification_functions()})
      for (Binding& row : rows) all.push_back(std::move(row));
    return all;
  }();
  return functions;
}

}  // namespace vitreo::lua
