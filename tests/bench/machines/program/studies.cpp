// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/program/studies.h"

#include "tests/bench/machines/identified_machine.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace vitreo::machines {
namespace {

double quantile(std::vector<double> values, double part) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1) + 0.5)];
}

/// Errors of one number: median and worst of their magnitudes, and the errors over the sigmas that
/// were stated with them, root mean square.
struct Errors {
  std::vector<double> sizes;
  double normalized = 0;

  void add(double error, double sigma) {
    sizes.push_back(std::abs(error));
    normalized += std::pow(error / sigma, 2);
  }
  void print(const char* name, double unit) const {
    std::printf("  %-34s %8.2f %8.2f %8.2f   %6.2f\n", name, quantile(sizes, 0.5) / unit,
                quantile(sizes, 0.95) / unit, quantile(sizes, 1) / unit,
                std::sqrt(normalized / static_cast<double>(sizes.size())));
  }
};

control::Trajectory square() {
  return control::Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
}

void identify_from(const MachineSetting& setting, const Mistake& mistake, std::uint64_t first,
                   int count) {
  Errors delay_x, delay_z, across, along;
  std::vector<double> nominal, wrong, after;
  int failed = 0, alarms = 0, coils = 0, oscillations = 0, standstills = 0;
  double duration = 0;
  for (int k = 0; k < count; ++k) {
    MachineSetting one = setting;
    one.seed = first + static_cast<std::uint64_t>(k);
    nominal.push_back(run_machine(one, Law::now, square(), 8, 0).rms);
    one.mistake = mistake;
    wrong.push_back(run_machine(one, Law::now, square(), 8, 0).rms);
    const IdentifiedMachine found = identify_machine(one);
    if (!found.failure.empty()) {
      ++failed;
      std::printf("  failed: %s\n", found.failure.c_str());
      continue;
    }
    duration = found.duration;
    if (found.watched.alarms > 0)
      std::printf("  seed %llu: coil %d at %.1f s, oscillation %.1f, standstill %.1f\n",
                  static_cast<unsigned long long>(one.seed), found.watched.weak_coil,
                  found.watched.weak, found.watched.oscillation, found.watched.standstill);
    alarms += found.watched.alarms;
    coils += found.watched.weak_coil != 0 ? 1 : 0;
    oscillations += found.watched.oscillation >= 0 ? 1 : 0;
    standstills += found.watched.standstill >= 0 ? 1 : 0;
    delay_x.add(found.x.delay.value - found.delay, found.x.delay.sigma);
    delay_z.add(found.across.delay.value - found.delay, found.across.delay.sigma);
    across.add(found.sink_across.value / found.true_across - 1,
               found.sink_across.sigma / found.sink_across.value);
    along.add(found.sink_along.value / found.true_along - 1,
              found.sink_along.sigma / found.sink_along.value);
    one.belief = found.belief;
    after.push_back(run_machine(one, Law::now, square(), 8, 0).rms);
  }
  std::printf("\n%s: %d machines, %d failed, %.0f s each; median, 95 %%, worst; error over sigma\n",
              mistake.name.c_str(), count, failed, duration);
  std::printf("  false alarms %d; machines: weak coil %d, oscillation %d, standstill %d\n", alarms,
              coils, oscillations, standstills);
  delay_x.print("delay by steps along x, ms", 1e-3);
  delay_z.print("delay by falls (z), ms", 1e-3);
  across.print("drag over weight across, %", 1e-2);
  along.print("drag over weight along, %", 1e-2);
  std::printf("  square rms um, median: as it should be %.2f, wrong %.2f, after %.2f (x %.2f)\n",
              quantile(nominal, 0.5) * 1e6, quantile(wrong, 0.5) * 1e6, quantile(after, 0.5) * 1e6,
              quantile(after, 0.5) / quantile(nominal, 0.5));
  std::fflush(stdout);
}

/// How many of `times` are within `limit`; and the quantiles of those that are at all.
void print_times(const std::string& name, const std::vector<double>& times, double limit) {
  std::vector<double> named;
  int soon = 0;
  for (const double time : times) {
    if (time >= 0) named.push_back(time);
    soon += time >= 0 && time <= limit ? 1 : 0;
  }
  std::printf("  %-30s %3d of %3zu within %2.0f s, %3zu at all; median %.1f s, worst %.1f s\n",
              name.c_str(), soon, times.size(), limit, named.size(), quantile(named, 0.5),
              quantile(named, 1));
  std::fflush(stdout);
}

}  // namespace

void identify(const MachineSetting& setting, std::uint64_t first, int count) {
  for (const Mistake& mistake :
       {Mistake{"nominal"}, Mistake{"drag - 30 %", 0, 0.7}, Mistake{"drag + 30 %", 0, 1.3},
        Mistake{"moment - 30 %", 0, 1, 0.7}, Mistake{"moment + 30 %", 0, 1, 1.3},
        Mistake{"delay - 15 ms", -15e-3}, Mistake{"delay + 15 ms", 15e-3},
        Mistake{"drag + 30 %, moment - 30 %, + 15 ms", 15e-3, 1.3, 0.7},
        Mistake{"drag - 30 %, moment + 30 %, - 15 ms", -15e-3, 0.7, 1.3}})
    identify_from(setting, mistake, first, count);
}

void watch(const MachineSetting& setting, double part, std::uint64_t first, int count) {
  const auto place = control::Trajectory::hold_at({2e-3, 0, 1e-3});
  std::printf(
      "\nOf one coil's current %.1f flows on while the robot is held%s: named (that one) after s\n",
      part, setting.turning > 0 ? " and its axis turns" : "");
  std::vector<double> all;
  int wrong = 0;
  for (int coil = 1; coil <= 8; ++coil) {
    std::vector<double> times;
    for (int k = 0; k < count; ++k) {
      MachineSetting one = setting;
      one.seed = first + static_cast<std::uint64_t>(k);
      one.fault = {coil, 15, part};
      const MachineResult found = run_machine(one, Law::now, place, 8, 17);
      const bool right = found.weak_coil == coil;
      wrong += found.weak_coil != 0 && !right ? 1 : 0;
      times.push_back(right ? found.weak - one.fault.time : -1);
      all.push_back(times.back());
    }
    print_times("coil " + std::to_string(coil), times, 5);
  }
  print_times("all", all, 5);
  std::printf("  another coil was named first: %d\n", wrong);
}

void cycles(const MachineSetting& setting, std::uint64_t first, int count) {
  // m, of the last ten of 61 s: fourteen standard deviations of the sensor, and its noise's share.
  constexpr double kCycle = 60e-6, kRest = 20e-6;
  const auto place = control::Trajectory::hold_at({2e-3, 0, 1e-3});
  std::printf("\nPD: machines that swing after a minute, and those named within 10 s of each\n");
  for (const double gain : {1.5, 6.0, 7.5, 9.0, 10.5, 12.0, 15.0}) {
    std::vector<double> cycling, rest, between, swings;
    for (int k = 0; k < count; ++k) {
      MachineSetting one = setting;
      one.seed = first + static_cast<std::uint64_t>(k);
      one.proportional = gain;
      const MachineResult found = run_machine(one, Law::pd, place, 8, 53);
      const double swing = found.swings.empty() ? 0 : found.swings.back();
      swings.push_back(swing);
      (swing > kCycle ? cycling : swing < kRest ? rest : between).push_back(found.oscillation);
    }
    std::printf("%.1f /s: swing um, median %.1f, most %.1f\n", gain, quantile(swings, 0.5) * 1e6,
                quantile(swings, 1) * 1e6);
    print_times("in a limit cycle", cycling, 10);
    print_times("between", between, 10);
    print_times("that ring down", rest, 10);
  }
}

void false_alarms(const MachineSetting& setting, std::uint64_t first, int count) {
  double hours = 0;
  int alarms = 0, coils = 0;
  for (int k = 0; k < count; ++k)
    for (const bool around : {false, true}) {
      MachineSetting one = setting;
      one.seed = first + static_cast<std::uint64_t>(k);
      std::vector<Eigen::Vector3d> points;
      for (int lap = 0; around && lap < 10; ++lap)
        for (const Eigen::Vector3d& corner :
             {Eigen::Vector3d(-4e-3, 0, -3e-3), Eigen::Vector3d(4e-3, 0, -3e-3),
              Eigen::Vector3d(4e-3, 0, 3e-3), Eigen::Vector3d(-4e-3, 0, 3e-3)})
          points.push_back(corner);
      const auto path = around ? control::Trajectory::waypoints(points, {})
                               : control::Trajectory::hold_at({2e-3, 0, 1e-3});
      const double after = around ? 0 : 600;
      const MachineResult found = run_machine(one, Law::now, path, 8, after);
      hours += (8 + path.duration() + after) / 3600;
      alarms += found.alarms;
      coils += found.weak_coil != 0 ? 1 : 0;
      if (found.alarms > 0)
        std::printf(
            "  seed %llu %s: %d alarms; coil %d at %.0f s, oscillation %.0f (%.0f um), standstill "
            "%.0f; off by %.0f um at most, at a limit in %.1f %%\n",
            static_cast<unsigned long long>(one.seed), around ? "square" : "hold", found.alarms,
            found.weak_coil, found.weak, found.oscillation, found.swing * 1e6, found.standstill,
            found.largest * 1e6, 100 * found.limited);
    }
  std::printf("\nHealthy machines: %d alarms, %d coils named, in %.1f h\n", alarms, coils, hours);
}

}  // namespace vitreo::machines
