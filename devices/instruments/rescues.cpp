// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/rescues.h"

#include "devices/instruments/kepco_bop/rescue.h"
#include "devices/instruments/usb3103/rescue.h"

#include <algorithm>

namespace vitreo {

namespace {

std::vector<Rescue> table() {
  std::vector<Rescue> rows;
  rows.push_back(kepco_bop::rescue_row("kepco_bop"));
  rows.push_back(usb3103::rescue_row("usb3103"));
  // An LED hangs on an output of a USB-3103 of its own.
  rows.push_back(usb3103::rescue_row("led"));
  return rows;
}

}  // namespace

const Rescue* find_rescue(std::string_view driver) {
  static const std::vector<Rescue> rows = table();
  const auto found = std::find_if(rows.begin(), rows.end(),
                                  [driver](const Rescue& row) { return row.driver == driver; });
  return found == rows.end() ? nullptr : &*found;
}

}  // namespace vitreo
