// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/spacemouse/driver.h"

#include "devices/instruments/spacemouse/wire.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::spacemouse {
namespace {

/// In one call: a device that floods the link is not read for ever.
constexpr int kMostReports = 1024;

/// Reports are absolute deflections, whatever the descriptors of old models say, and come every 8
/// ms (Navigator) or 16 ms (wireless) while the handle is deflected. After the release three
/// reports of zeros follow; where they are lost, or the device is unplugged, the watchdog ends the
/// deflection.
class SpaceMouse final : public OperatorInput {
 public:
  SpaceMouse(std::unique_ptr<HidLink> link, const Settings& settings, Clock& clock)
      : link_(std::move(link)), settings_(settings), clock_(clock) {}
  std::string identity() const override { return "3Dconnexion SpaceMouse"; }

  // The watchdog ends deflections only, by which something moves; buttons stay as they were last
  // reported.
  OperatorState state() override {
    if (lost_)
      throw DeviceError(DeviceErrorKind::lost, settings_.name, "it was unplugged; open it again");
    try {
      for (int i = 0; i < kMostReports; ++i) {
        const auto report = link_->read(Time::zero());
        if (!report) break;
        take(*report);
      }
    } catch (const DeviceError& error) {
      lost_ = true;
      throw renamed(error, settings_.name);
    }
    if (clock_.now() - moved_ > from_seconds(settings_.watchdog))
      state_.translation = state_.rotation = {0, 0, 0};
    return state_;
  }

 private:
  /// Reports of other kinds are ignored (battery).
  void take(const Report& report) {
    const auto input = decode(report);
    if (!input) return;
    if (const auto* buttons = std::get_if<Buttons>(&*input)) {
      state_.pressed = buttons->pressed;
      return;
    }
    moved_ = clock_.now();
    if (const auto* t = std::get_if<Translation>(&*input)) state_.translation = ours(t->counts);
    if (const auto* r = std::get_if<Rotation>(&*input)) state_.rotation = ours(r->counts);
    if (const auto* both = std::get_if<Both>(&*input)) {
      state_.translation = ours(both->translation);
      state_.rotation = ours(both->rotation);
    }
  }
  /// Device axes are x right, y towards the operator, z down; ours y away from the operator, z up.
  /// The two differ by half a turn about x, which holds for rotations too.
  Eigen::Vector3d ours(const Axes& counts) const {
    return {scaled(counts[0]), -scaled(counts[1]), -scaled(counts[2])};
  }
  /// 0 within the dead zone, and continuous at its edge: (|d| - dead) / (1 - dead).
  /// Clamped first, so that no count gives more than full deflection.
  double scaled(int counts) const {
    const double deflection = std::clamp(static_cast<double>(counts) / kFullScale_counts, -1., 1.);
    const double beyond = std::abs(deflection) - settings_.dead_zone;
    return beyond <= 0 ? 0 : std::copysign(beyond / (1 - settings_.dead_zone), deflection);
  }

  std::unique_ptr<HidLink> link_;
  const Settings settings_;
  Clock& clock_;
  OperatorState state_;
  Time moved_{};
  bool lost_ = false;
};

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (!(dead_zone >= 0 && dead_zone < 0.9))
    throw std::invalid_argument("dead_zone: must be in [0, 0.9)");
  if (!(watchdog >= 0.02 && watchdog <= 10))
    throw std::invalid_argument("watchdog: must be in [0.02, 10] s");
}

std::unique_ptr<OperatorInput> open(std::unique_ptr<HidLink> link, const Settings& settings,
                                    Clock& clock) {
  if (!link) throw std::invalid_argument("link: must not be null");
  settings.check();
  return std::make_unique<SpaceMouse>(std::move(link), settings, clock);
}

}  // namespace vitreo::spacemouse
