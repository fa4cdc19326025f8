// Read-back of the coils: a supply that is gone, at zero, reversed or swapped is noticed, by its
// own measurement and by a current sensor; and what was read back is told after every stop.
// SPDX-License-Identifier: Apache-2.0
#include "host/safety/current_watch.h"

#include "devices/time/error.h"
#include "host/safety/interlock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Currents = std::vector<double>;

/// What happens to a supply, as what flows for what is set.
enum class Mishap { none, gone, zero, reversed, swapped };

/// Three coils that carry what is set, with noise; a question to them takes its time.
class Supplies {
 public:
  explicit Supplies(Clock& clock) : clock_(clock) {}
  Currents flowing() {
    Currents now = set;
    if (mishap == Mishap::zero || mishap == Mishap::gone) now[1] = 0;
    if (mishap == Mishap::reversed) now[1] = -now[1];
    if (mishap == Mishap::swapped) std::swap(now[0], now[1]);
    for (double& current : now) current += noise_(random_);
    return now;
  }
  Currents ask(Time duration) {
    clock_.sleep_for(duration);
    if (mishap == Mishap::gone) throw DeviceError(DeviceErrorKind::lost, "coils", "hung up");
    return flowing();
  }
  Currents set{0, 0, 0};
  Mishap mishap = Mishap::none;

 private:
  Clock& clock_;
  std::mt19937 random_{7};
  std::normal_distribution<double> noise_{0, 0.01};
};

/// As a bipolar supply on a serial line, or, without a read-back, an analog output.
class Amplifier : public CoilAmplifier {
 public:
  Amplifier(Supplies& supplies, bool measures) : supplies_(supplies), measures_(measures) {}
  std::string identity() const override { return "fake"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 10; }
  void set_currents(std::span<const double> currents) override {
    supplies_.set.assign(currents.begin(), currents.end());
  }
  Currents currents() const override { return supplies_.set; }
  std::optional<Currents> measured_currents() override {
    if (!measures_) return std::nullopt;
    return supplies_.ask(25ms);
  }
  void make_safe() override { supplies_.set.assign(3, 0); }

 private:
  Supplies& supplies_;
  const bool measures_;
};

class Sensor : public CurrentSensor {
 public:
  explicit Sensor(Supplies& supplies, std::vector<int> coils = {0, 1, 2}) : supplies_(supplies) {
    info_.identity.name = "fake";
    info_.coils = std::move(coils);
  }
  const CurrentSensorInfo& info() const override { return info_; }
  Currents measure(Time) override {
    if (silent) throw DeviceError(DeviceErrorKind::timeout, "current_sensor", "no answer");
    const Currents all = supplies_.ask(33ms);  // eight channels of a reed multiplexer
    Currents own;
    for (const int coil : info_.coils) own.push_back(all[static_cast<std::size_t>(coil)]);
    return own;
  }
  bool silent = false;

 private:
  Supplies& supplies_;
  CurrentSensorInfo info_;
};

struct Bench {
  explicit Bench(bool amplifier_measures, bool with_sensor, std::vector<int> coils = {0, 1, 2})
      : amplifier(supplies, amplifier_measures), sensor(supplies, std::move(coils)) {
    interlock.on_trip([this](const Interlock::Trip& trip) {
      tripped = clock->now();
      why = trip.why;
    });
    interlock.on_rest([this](const CoilRest& rest) { rests.push_back(rest); });
    if (with_sensor) interlock.watch_by(sensor, {});
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  Supplies supplies{*clock};
  Amplifier amplifier;
  Sensor sensor;
  Interlock interlock{amplifier, {10, 30, 1e5}, clock.get()};
  std::optional<Time> tripped;
  std::string why;
  std::vector<CoilRest> rests;
};

/// ms from the mishap until the interlock opens, each at another moment of the watch's turn.
std::vector<double> times_of(Mishap mishap, bool amplifier_measures, bool with_sensor) {
  std::vector<double> took;
  std::mt19937 random(20261123);
  for (int i = 0; i < 50; ++i) {
    Bench bench(amplifier_measures, with_sensor);
    bench.interlock.set_currents(Currents{0.5, 1.5, -1});
    bench.clock->sleep_for(from_seconds(std::uniform_real_distribution(0.4, 0.6)(random)));
    EXPECT_FALSE(bench.tripped) << bench.why;
    bench.supplies.mishap = mishap;
    const Time began = bench.clock->now();
    bench.clock->sleep_for(700ms);
    EXPECT_TRUE(bench.tripped) << "never noticed";
    if (bench.tripped) took.push_back(to_seconds(*bench.tripped - began) * 1e3);
  }
  std::sort(took.begin(), took.end());
  return took;
}

void expect_noticed(const char* by, bool amplifier_measures, bool with_sensor, double within) {
  const std::vector<std::pair<const char*, Mishap>> all{{"gone", Mishap::gone},
                                                        {"at zero", Mishap::zero},
                                                        {"reversed", Mishap::reversed},
                                                        {"swapped", Mishap::swapped}};
  for (const auto& [name, mishap] : all) {
    const std::vector<double> took = times_of(mishap, amplifier_measures, with_sensor);
    ASSERT_EQ(took.size(), 50U) << name;
    std::printf("%s, by %s: %zu of 50; median %.0f ms, largest %.0f ms\n", name, by, took.size(),
                took[25], took.back());
    EXPECT_LT(took.back(), within) << name;
  }
}

TEST(CurrentWatch, ASupplysOwnMeasurementShowsWhatBecameOfItWithin500Ms) {
  expect_noticed("the supply itself", true, false, 500);
}

TEST(CurrentWatch, ASensorShowsItWithin200MsOnAmplifiersThatMeasureNothing) {
  expect_noticed("a current sensor", false, true, 200);
}

TEST(CurrentWatch, WithoutEitherNothingIsNoticed) {
  Bench bench(false, false);
  bench.interlock.set_currents(Currents{1, 1, 1});
  bench.supplies.mishap = Mishap::zero;
  bench.clock->sleep_for(5s);
  EXPECT_FALSE(bench.tripped);
}

TEST(CurrentWatch, AServoThatMovesItsCurrentsIsNoContradiction) {
  Bench bench(true, true);
  for (int i = 0; i < 600; ++i) {
    const double t = i / 60.0;
    bench.interlock.set_currents(
        Currents{3 * std::sin(5 * t), 3 * std::cos(7 * t), 2 * std::sin(3 * t)});
    bench.clock->sleep_for(from_seconds(1 / 60.0));
  }
  EXPECT_FALSE(bench.tripped) << bench.why;
}

TEST(CurrentWatch, ACoilThatIsNotMeasuredIsNotJudged) {
  Bench bench(false, true, {2});
  bench.interlock.set_currents(Currents{1, 1, 1});
  bench.supplies.mishap = Mishap::zero;  // of coil 2
  bench.clock->sleep_for(1s);
  EXPECT_FALSE(bench.tripped) << bench.why;
}

TEST(CurrentWatch, ASensorThatFallsSilentIsATrip) {
  Bench bench(false, true);
  bench.interlock.set_currents(Currents{1, 1, 1});
  bench.clock->sleep_for(500ms);
  bench.sensor.silent = true;
  bench.clock->sleep_for(200ms);
  ASSERT_TRUE(bench.tripped);
  EXPECT_NE(bench.why.find("the current sensor does not measure"), std::string::npos) << bench.why;
}

TEST(CurrentWatch, ASensorThatComesLaterKnowsWhatFlows) {
  Bench bench(false, false);
  bench.interlock.set_currents(Currents{1, 1.5, -1});
  bench.clock->sleep_for(500ms);
  bench.interlock.watch_by(bench.sensor, {});
  bench.clock->sleep_for(500ms);
  EXPECT_FALSE(bench.tripped) << bench.why;
  bench.supplies.mishap = Mishap::zero;
  bench.clock->sleep_for(200ms);
  EXPECT_TRUE(bench.tripped);
}

TEST(CurrentWatch, ASensorOfACoilThatThereIsNotIsRefused) {
  for (const int coil : {3, -1}) {
    Bench bench(false, false, {0, coil});
    try {
      bench.interlock.watch_by(bench.sensor, {});
      FAIL() << coil;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), "current_sensor.coils: there is no coil " + std::to_string(coil + 1) +
                                  ", only 1 to 3");
    }
  }
}

TEST(CoilRest, IsToldAfterEachStopAsItWasReadBack) {
  Bench bench(false, true);
  bench.interlock.set_currents(Currents{1, 1, 1});
  bench.clock->sleep_for(300ms);
  const Time stopped = bench.clock->now();
  bench.interlock.make_safe();
  bench.clock->sleep_for(500ms);
  ASSERT_EQ(bench.rests.size(), 1U);
  EXPECT_TRUE(at_zero(bench.rests[0]));
  EXPECT_GT(bench.rests[0].at, stopped);
  EXPECT_LT(bench.rests[0].at, stopped + 200ms);
  EXPECT_EQ(to_text(bench.rests[0], "12:03:11.250").find("coils 0.0"), 0U);
  EXPECT_NE(to_text(bench.rests[0], "12:03:11.250").find(" A, read back at 12:03:11.250"),
            std::string::npos);
  bench.interlock.make_safe();  // at zero already
  bench.clock->sleep_for(500ms);
  EXPECT_EQ(bench.rests.size(), 1U);
}

TEST(CoilRest, OfARigWithoutReadBackSaysSo) {
  Bench bench(false, false);
  bench.interlock.set_currents(Currents{1, 1, 1});
  bench.interlock.make_safe();
  EXPECT_EQ(to_text(bench.interlock.read_rest(), "12:03:11.250"),
            "coils set to 0 A at 12:03:11.250; this rig has no read-back");
}

TEST(CoilRest, OfASupplyThatDoesNotObeySaysWhatFlows) {
  Bench bench(true, false);
  bench.interlock.set_currents(Currents{0, 1.27, 0});
  bench.interlock.make_safe();
  bench.supplies.set = {0, 1.27, 0};  // as a foreign program would
  const std::string text = to_text(bench.interlock.read_rest(), "now");
  EXPECT_EQ(text.find("coils NOT at zero: coil 2 carries 1.2"), 0U) << text;
}

TEST(CoilRest, ByASensorIsOfEachOfItsCoils) {
  Bench bench(false, true, {0, 2});
  bench.interlock.set_currents(Currents{1.27, 0, 0});
  bench.interlock.make_safe();
  bench.supplies.set = {1.27, 0, 0};
  const std::string text = to_text(bench.interlock.read_rest(), "now");
  EXPECT_EQ(text.find("coils NOT at zero: coil 1 carries 1.2"), 0U) << text;
}

TEST(CoilRest, OfASupplyThatIsGoneIsNotKnown) {
  Bench bench(true, false);
  bench.supplies.mishap = Mishap::gone;
  const std::string text = to_text(bench.interlock.read_rest(), "now");
  EXPECT_EQ(text.find("whether the coils are at 0 A is not known at now: "), 0U) << text;
  EXPECT_NE(text.find("hung up"), std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
