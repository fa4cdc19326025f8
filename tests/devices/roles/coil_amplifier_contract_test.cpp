// Contract of the coil amplifiers: kept by every one, and broken ones are noticed.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/coil_amplifier.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Findings = std::vector<std::string>;

TEST(CoilAmplifierContract, IsKeptByTheUsb3103OverItsEmulator) {
  const auto clock = virtual_clock();
  usb3103::EmulatorSettings errs;
  errs.slope[0] = 1.05;
  errs.offset[7] = 300;
  usb3103::Bench bench(errs);
  const usb3103::Settings settings;
  const auto coils =
      usb3103::open(memory_hid_link(bench, *clock, std::chrono::milliseconds(1)), settings, *clock);
  contract::CoilAmplifierCheck how;
  how.measured = [&] {
    std::vector<double> amperes(bench.outputs().begin(), bench.outputs().end());
    for (double& current : amperes) current *= settings.amperes_per_volt;
    return amperes;
  };
  EXPECT_EQ(contract::check(*coils, how), Findings{});
  how.fraction = 1;
  EXPECT_EQ(contract::check(*coils, how), Findings{});
  EXPECT_EQ(coils->currents(), std::vector<double>(8));
}

/// Keeps the contract but for one fault.
struct FaultyAmplifier final : CoilAmplifier {
  enum Fault {
    none,
    no_limit,
    takes_nan,
    any_count,
    deaf_to_safe,
    drifts,
    throws,
    measures_too_few
  };
  explicit FaultyAmplifier(Fault its_fault) : fault(its_fault) {}

  std::string identity() const override { return "faulty"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 2; }
  void set_currents(std::span<const double> currents) override {
    if (fault == throws) throw std::runtime_error("no");
    if (fault != any_count && currents.size() != 3) throw std::invalid_argument("count");
    for (const double current : currents) {
      if (fault != takes_nan && !(current - current == 0))
        throw std::invalid_argument("not finite");
      if (fault != no_limit && (current > 2 || current < -2))
        throw DeviceError(DeviceErrorKind::refused, "faulty", "no");
    }
    set.assign(currents.begin(), currents.end());
  }
  std::vector<double> currents() const override { return set; }
  std::optional<std::vector<double>> measured_currents() override {
    if (fault == measures_too_few) return std::vector<double>(2);
    return set;
  }
  void make_safe() override {
    if (fault != deaf_to_safe) set.assign(3, 0.);
  }

  Fault fault;
  std::vector<double> set = std::vector<double>(3);
};

Findings findings_of(FaultyAmplifier::Fault fault) {
  FaultyAmplifier amplifier(fault);
  contract::CoilAmplifierCheck how;
  how.measured = [&] {
    auto flowing = amplifier.set;
    if (fault == FaultyAmplifier::drifts && !flowing.empty()) flowing[0] += 0.01;
    return flowing;
  };
  return contract::check(amplifier, how);
}

TEST(CoilAmplifierContract, NoticesAnAmplifierThatBreaksIt) {
  EXPECT_EQ(findings_of(FaultyAmplifier::none), Findings{});
  EXPECT_FALSE(findings_of(FaultyAmplifier::no_limit).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::takes_nan).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::any_count).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::deaf_to_safe).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::drifts).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::throws).empty());
  EXPECT_FALSE(findings_of(FaultyAmplifier::measures_too_few).empty());
}

TEST(CoilAmplifierContract, LeavesTheAmplifierSafeWhenItIsStopped) {
  const auto clock = virtual_clock();
  usb3103::Bench bench;
  const auto coils =
      usb3103::open(memory_hid_link(bench, *clock, std::chrono::milliseconds(1)), {}, *clock);
  const auto operator_ = clock->spawn("operator", [&] {
    clock->sleep_for(std::chrono::milliseconds(5));
    clock->interrupt();
  });
  EXPECT_THROW(contract::check(*coils), Stopped);
  EXPECT_EQ(bench.outputs(), usb3103::Voltages{});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
