// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/game_pad/driver.h"

#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <utility>

namespace vitreo::game_pad {
namespace {

/// Where a deflection comes from.
struct Source {
  std::size_t axis = 0;
  double sign = 0;        ///< 0: from nowhere
  double middle = 0;      ///< counts
  double half = 1;        ///< counts from the middle to the end
  bool released = false;  ///< it was within the dead zone once
};

class GamePad final : public OperatorInput {
 public:
  GamePad(std::unique_ptr<EventLink> link, const Settings& settings)
      : link_(std::move(link)), settings_(settings) {
    const EventDevice& device = link_->device();
    for (std::size_t i = 0; i < sources_.size(); ++i) sources_[i] = source(settings.axes[i]);
    for (const std::string& name : settings.buttons) {
      const auto found = std::find(device.buttons.begin(), device.buttons.end(), name);
      if (found == device.buttons.end()) fail_missing("button", name, device.buttons);
      buttons_.push_back(static_cast<std::size_t>(found - device.buttons.begin()));
    }
  }
  std::string identity() const override {
    const EventDevice& device = link_->device();
    return device.name + (device.serial.empty() ? "" : ", serial " + device.serial);
  }

  OperatorState state() override {
    try {
      const EventState& now = link_->state();
      OperatorState state;
      for (std::size_t i = 0; i < sources_.size(); ++i)
        (i < 3 ? state.translation : state.rotation)[static_cast<Eigen::Index>(i % 3)] =
            deflection(sources_[i], now);
      for (std::size_t i = 0; i < buttons_.size(); ++i)
        if (now.pressed[buttons_[i]]) state.pressed |= 1U << i;
      return state;
    } catch (const DeviceError& error) {
      throw renamed(error, settings_.name);
    }
  }

 private:
  [[noreturn]] void fail_missing(const std::string& what, const std::string& name,
                                 const std::vector<std::string>& there) const {
    std::string all;
    for (const std::string& one : there) all += (all.empty() ? "" : ", ") + one;
    throw DeviceError(DeviceErrorKind::not_found, settings_.name,
                      identity() + " has no " + what + " " + name + "; it has " + all);
  }

  Source source(const std::string& text) const {
    Source made;
    if (text.empty()) return made;
    const std::string name = text.substr(text.front() == '-' ? 1 : 0);
    const auto& axes = link_->device().axes;
    const auto found = std::find_if(axes.begin(), axes.end(),
                                    [&](const EventAxis& axis) { return axis.name == name; });
    if (found == axes.end()) {
      std::vector<std::string> names;
      names.reserve(axes.size());
      for (const EventAxis& axis : axes) names.push_back(axis.name);
      fail_missing("axis", name, names);
    }
    made.axis = static_cast<std::size_t>(found - axes.begin());
    made.sign = text.front() == '-' ? -1 : 1;
    made.middle = (static_cast<double>(found->minimum) + found->maximum) / 2;
    made.half = std::max(1.0, (static_cast<double>(found->maximum) - found->minimum) / 2);
    return made;
  }

  /// 0 within the dead zone, and continuous at its edge: (|d| - dead) / (1 - dead).
  double deflection(Source& from, const EventState& now) const {
    if (from.sign == 0) return 0;
    const double part =
        std::clamp(from.sign * (now.axes[from.axis] - from.middle) / from.half, -1.0, 1.0);
    const double beyond = std::abs(part) - settings_.dead_zone;
    if (beyond <= 0) from.released = true;
    if (beyond <= 0 || !from.released) return 0;
    return std::copysign(beyond / (1 - settings_.dead_zone), part);
  }

  const std::unique_ptr<EventLink> link_;
  const Settings settings_;
  std::array<Source, 6> sources_;
  std::vector<std::size_t> buttons_;
};

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (!(dead_zone >= 0.01 && dead_zone < 0.9))
    throw std::invalid_argument("dead_zone: must be in [0.01, 0.9)");
  if (buttons.size() > 32) throw std::invalid_argument("buttons: must be 32 at most");
}

std::unique_ptr<OperatorInput> open(std::unique_ptr<EventLink> link, const Settings& settings) {
  if (!link) throw std::invalid_argument("link: must not be null");
  settings.check();
  return std::make_unique<GamePad>(std::move(link), settings);
}

}  // namespace vitreo::game_pad
