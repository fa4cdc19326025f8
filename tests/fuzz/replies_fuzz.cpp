// libFuzzer target of the drivers that talk bytes: whatever the instrument says, a driver opens,
// works, or says what is wrong with a DeviceError, in a finite time. The first byte chooses the
// driver, the rest is what comes.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mpc200/driver.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

namespace {

using namespace vitreo;

/// Says a piece of the input whenever it is asked, and nothing when there is none left. A piece has
/// a length before it.
class Babbler final : public ByteLink {
 public:
  Babbler(std::span<const std::uint8_t> says, Clock& clock) : says_(says), clock_(clock) {}
  const std::string& address() const override { return address_; }
  void write(std::span<const std::uint8_t>, Time) override {
    clock_.sleep_for(std::chrono::milliseconds(1));
  }
  ByteString read(std::size_t most, Time timeout) override {
    if (says_.empty() || says_[0] % 8 == 0) {  // now and then it is late
      if (!says_.empty()) says_ = says_.subspan(1);
      clock_.sleep_for(timeout);
      return {};
    }
    const std::size_t size = std::min({std::size_t{says_[0]} % 64, says_.size() - 1, most});
    const auto piece = says_.subspan(1, size);
    says_ = says_.subspan(1 + size);
    clock_.sleep_for(std::min(timeout, Time(std::chrono::milliseconds(1))));
    return {piece.begin(), piece.end()};
  }
  void reopen() override {}

 private:
  std::span<const std::uint8_t> says_;
  Clock& clock_;
  const std::string address_ = "serial:nothing";
};

void use(Stage& stage, Clock& clock) {
  for (int i = 0; i < 3; ++i) {
    try {
      const auto& axes = stage.info().axes;
      std::vector<double> target;
      for (const StageAxis& axis : axes) target.push_back((axis.travel_min + axis.travel_max) / 2);
      stage.position();
      move_to(stage, target, axes.front().speed, std::chrono::seconds(1), clock);
    } catch (const DeviceError&) {  // as the role says
    } catch (const std::invalid_argument&) {
    }
  }
}

void open_and_use(unsigned driver, std::span<const std::uint8_t> says, Clock& clock) {
  auto link = std::make_unique<Babbler>(says, clock);
  if (driver == 0) use(*sutter_mp285::open(std::move(link), {}, clock), clock);
  if (driver == 1) use(*sutter_mpc200::open(std::move(link), {}, clock), clock);
  if (driver == 2) use(*zaber::open(std::move(link), {}, clock), clock);
  if (driver == 3) scpi_probe::open(std::move(link), {}, clock)->measure(std::chrono::seconds(1));
  if (driver == 4) {
    std::vector<std::unique_ptr<ByteLink>> links;
    links.push_back(std::move(link));
    const auto coils = kepco_bop::open(std::move(links), {}, clock);
    coils->set_currents(std::vector<double>{1});
    coils->measured_currents();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto clock = virtual_clock();
  try {
    open_and_use(data[0] % 5, {data + 1, size - 1}, *clock);
  } catch (const DeviceError&) {  // as the roles say; anything else is a finding
  }
  if (clock->now() > std::chrono::minutes(60)) std::abort();
  return 0;
}
