// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"

#include "devices/links/printable.h"
#include "devices/time/error.h"

#include <stdexcept>
#include <utility>

namespace vitreo::foot_pedal {
namespace {

/// In one call: a device that floods the link is not read for ever.
constexpr int kMostReports = 1024;

/// No watchdog as the SpaceMouse's: a pedal that is held sends nothing. What a lost link leaves
/// pressed is the error of the next call, which is_held() takes for released.
class FootPedal final : public OperatorInput {
 public:
  FootPedal(std::unique_ptr<HidLink> link, const Settings& settings)
      : link_(std::move(link)), settings_(settings) {}
  std::string identity() const override {
    return "foot switch with " + std::to_string(settings_.layout.pedals.size()) + " pedals";
  }
  // Reads whatever has come since the last call: the newest report counts, and older ones are only
  // needed to empty the queue. One that the layout does not know leaves no pedal held: it may have
  // been the release.
  OperatorState state() override {
    if (lost_)
      throw DeviceError(DeviceErrorKind::lost, settings_.name, "it was unplugged; open it again");
    try {
      for (int i = 0; i < kMostReports; ++i) {
        const auto report = link_->read(Time::zero());
        if (!report) break;
        const auto down = decode(*report, settings_.layout);
        state_.pressed = down.value_or(0);
        unknown_ = down ? "" : printable(*report);
      }
    } catch (const DeviceError& error) {
      lost_ = true;  // its last state is void: it may come back released
      throw renamed(error, settings_.name);
    }
    if (!unknown_.empty())
      throw DeviceError(
          DeviceErrorKind::protocol, settings_.name,
          "a report that its layout does not know, \"" + unknown_ + "\": is it another pedal?");
    return state_;
  }

 private:
  std::unique_ptr<HidLink> link_;
  const Settings settings_;
  OperatorState state_;
  std::string unknown_;  // the newest report, where it is not understood
  bool lost_ = false;
};

}  // namespace

// Which bit is which pedal differs from maker to maker, so byte and mask come from the rig file.
void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (layout.size < 1 || layout.size > 64)
    throw std::invalid_argument("layout: a report has 1 to 64 bytes");
  if (layout.pedals.empty() || layout.pedals.size() > 32)
    throw std::invalid_argument("layout: wants 1 to 32 pedals");
  for (const Pedal& pedal : layout.pedals)
    if (pedal.byte >= layout.size || pedal.byte < (layout.constant_first ? 1 : 0) ||
        pedal.mask == 0)
      throw std::invalid_argument("layout: a pedal is outside the report");
}

std::unique_ptr<OperatorInput> open(std::unique_ptr<HidLink> link, const Settings& settings) {
  if (!link) throw std::invalid_argument("link: must not be null");
  settings.check();
  return std::make_unique<FootPedal>(std::move(link), settings);
}

}  // namespace vitreo::foot_pedal
