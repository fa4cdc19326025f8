// A USB-3103 that another program, or a reset, sets to zero: it cannot tell, but shunts on a data
// logger can. Both are doubles by another hand.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/safety/guardian/guardian_bench.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cstdio>
#include <sys/wait.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using nlohmann::json;

/// 0.5 V/A at the interface, and as much at the shunts.
struct SensedUsb : DoubledUsb {
  SensedUsb() {
    testbed->add_node("/dev/ttyLogger", logger.address().substr(std::string("serial:").size()));
  }
  std::string rig() const override {
    return DoubledUsb::rig() + R"(, current_sensor = { driver = "scpi_logger",
              address = "serial:/dev/ttyLogger", line_cycles = 0.02, amperes_per_volt = { 2 },
              channels = { 101, 102, 103, 104, 105, 106, 107, 108 } })";
  }
  /// What the shunts carry follows what the interface puts out.
  double output() override {
    const json volts = json::parse(interface.order(R"({"get": "volts"})")).at("volts");
    json shunts;
    for (int i = 0; i < 8; ++i) shunts[std::to_string(101 + i)] = volts.at(i);
    logger.order(json{{"set", {{"volts", shunts}}}}.dump());
    return DoubledUsb::output();
  }
  /// The shunts first: they are the coils, and the test may be kept waiting between the two.
  void zero_from_outside() {
    json shunts;
    for (int i = 0; i < 8; ++i) shunts[std::to_string(101 + i)] = 0.0;
    logger.order(json{{"set", {{"volts", shunts}}}}.dump());
    interface.order(
        R"({"set": {"counts": [32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768]}})");
  }
  DoubleProcess logger{"scpi_logger"};
};

/// s: what the far clock of a double is ahead of this process'.
double ahead(DoubleProcess& instrument) {
  double best = 1e9, offset = 0;
  for (int i = 0; i < 20; ++i) {
    const auto before = Steady::now();
    const double there = json::parse(instrument.order(R"({"now": true})")).at("now");
    const auto after = Steady::now();
    const double trip = std::chrono::duration<double>(after - before).count();
    if (trip > best) continue;
    best = trip;
    offset = there - std::chrono::duration<double>(before.time_since_epoch()).count() - trip / 2;
  }
  return offset;
}

/// ms after the zeroing.
struct Noticing {
  double first_sweep = 0;   ///< the end of the first that is at zero, as the logger has it
  double second_sweep = 0;  ///< of that which decides
  double zeroed = 0;        ///< the host's own first zero
};

/// From the histories of both doubles.
Noticing noticing(SensedUsb& coils) {
  const double shift = ahead(coils.interface) - ahead(coils.logger);
  const json logger = json::parse(coils.logger.order(R"({"history": true})")).at("history");
  const json interface = json::parse(coils.interface.order(R"({"history": true})")).at("history");
  double began = -1;
  for (const json& line : logger)
    if (line[1] == "volts" && line[2].at("101") == 0.0 && began < 0 && line[0].get<double>() > 0.5)
      began = line[0];
  Noticing seen;
  for (const json& line : logger) {
    const double after = (line[0].get<double>() - began) * 1e3;
    if (line[1] != "readings" || after < 0) continue;
    (seen.first_sweep == 0 ? seen.first_sweep : seen.second_sweep) = after;
    if (seen.second_sweep != 0) break;
  }
  for (const json& line : interface) {
    const double after = (line[0].get<double>() - shift - began) * 1e3;
    if (after < 0 || line[1] != "report" || line[2].get<std::string>().rfind("14 ", 0) != 0)
      continue;
    seen.zeroed = after;
    break;
  }
  EXPECT_GE(began, 0);
  EXPECT_GT(seen.zeroed, 0);
  return seen;
}

using ForeignZeroing = GuardianTest;

TEST_F(ForeignZeroing, OfAUsb3103IsNoticedWithin200MsByACurrentSensor) {
  std::vector<Noticing> took;
  for (int i = 0; i < std::max(3, trials() / 4) && !HasFailure(); ++i) {
    SensedUsb coils;
    const std::unique_ptr<Host> host = energize(coils, kHeld);
    ASSERT_NE(host, nullptr);
    time_until(drawn(0.3, 0.4), [&] { return coils.output() < 0; });
    ASSERT_TRUE(coils.enabled()) << "noticed before it happened: " << log();
    coils.zero_from_outside();
    ASSERT_TRUE(time_until(5s, [&] { return !coils.enabled(); })) << log();
    took.push_back(noticing(coils));
    std::optional<int> status;
    ASSERT_TRUE(time_until(20s, [&] {
      coils.output();
      return (status = host->status()).has_value();
    })) << log();
    EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
    EXPECT_TRUE(guardian_says("by the current sensor")) << log();
  }
  if (took.empty()) return;
  std::sort(took.begin(), took.end(),
            [](const Noticing& a, const Noticing& b) { return a.zeroed < b.zeroed; });
  std::printf("foreign zeroing, by a current sensor: %zu\n", took.size());
  for (const auto& [name, one] :
       {std::pair{"median", took[took.size() / 2]}, std::pair{"largest", took.back()}})
    std::printf("%s: first sweep after %.0f ms, second after %.0f, the host's zero after %.0f ms\n",
                name, one.first_sweep, one.second_sweep, one.zeroed);
  EXPECT_LT(took.back().zeroed, 200);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
