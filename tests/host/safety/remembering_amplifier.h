// A coil amplifier for tests of the interlock that keeps the history of its set-points.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/coil_amplifier.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// Remembers what it was told; may lose its line, hang up, and measure.
class RememberingAmplifier : public CoilAmplifier {
 public:
  std::string identity() const override { return "remembering"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 10; }
  void set_currents(std::span<const double> currents) override {
    if (currents.size() != 3) throw std::invalid_argument("wants 3 currents");
    told.emplace_back(currents.begin(), currents.end());
    if (gone) throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
    now = told.back();
  }
  std::optional<std::vector<double>> measured_currents() override {
    ++asked;
    return measure ? std::optional(measure()) : std::nullopt;
  }
  LinkState link_state() const override { return links; }
  std::vector<double> currents() const override { return shown.empty() ? now : shown; }
  void make_safe() override {
    if (gone) throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
    told.emplace_back(3, 0.0);
    now = told.back();
    ++made_safe;
  }
  double most() const {
    double largest = 0;
    for (const std::vector<double>& one : told)
      for (const double current : one) largest = std::max(largest, std::abs(current));
    return largest;
  }
  std::vector<std::vector<double>> told;
  std::vector<double> now{0, 0, 0};
  std::vector<double> shown;                     // what it claims; empty: what it does
  std::function<std::vector<double>()> measure;  // empty: it has no read-back
  LinkState links;
  bool gone = false;
  int asked = 0;
  int made_safe = 0;
};

}  // namespace vitreo
