// Swimmers over machines that are not the loop's model: path, step-out, and what a frequency gives.
//   swim_machines FIRST_SEED MACHINES
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/swim_bench.h"

#include <cstdio>
#include <cstdlib>

namespace vitreo::machines {
namespace {

constexpr double kField = 1e-3;  // T, in which the robot steps out

struct Spread {
  std::vector<double> values;
  double at(double part) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
  }
  void print(const char* what, double unit, const char* name) {
    if (values.empty()) return;
    std::printf("%s: median %.2f, 95 %% %.2f, worst %.2f %s, of %zu\n", what, at(0.5) / unit,
                at(0.95) / unit, at(1) / unit, name, values.size());
  }
};

/// From half the true step-out to `part` of it, by an amplifier of 250 updates/s.
struct Overrun {
  double told = -1;  // s
  double found = 0;  // Hz
  bool recovered = false;
};
Overrun overrun(unsigned seed, double part) {
  RotatingSettings law;
  law.frequency = 30;
  SwimBench bench(seed, law, kField, helix_model(), {-4e-3, 0, 0}, milliseconds(4));
  bench.go(2);
  const double step_out = bench.true_step_out(kField);
  bench.controller().spin(Eigen::Vector3d::UnitX(), 0.5 * step_out);
  bench.go(1.5);
  const double begin = bench.now();
  bench.controller().spin(Eigen::Vector3d::UnitX(), part * step_out);
  bench.go(2.5);
  Overrun result;
  if (bench.found.empty()) return result;
  result.told = bench.found.front() - begin;
  result.found = bench.controller().state().response.step_out / step_out;
  result.recovered = !bench.recovered.empty();
  return result;
}

void print_step_out(unsigned first, int machines, double part) {
  Spread told, step_out;
  int not_told = 0, not_recovered = 0;
  for (int k = 0; k < machines; ++k) {
    const Overrun one = overrun(first + static_cast<unsigned>(k), part);
    if (one.told < 0) {
      ++not_told;
      continue;
    }
    told.values.push_back(one.told);
    step_out.values.push_back(one.found);
    not_recovered += one.recovered ? 0 : 1;
  }
  std::printf("at %.2f of the step-out: not told %d, not recovered %d\n", part, not_told,
              not_recovered);
  told.print("  told after", 1, "s");
  step_out.print("  step-out found over the true", 1, "");
}

void print(unsigned first, int machines) {
  Spread rms, worst;
  int false_alarms = 0;
  for (int k = 0; k < machines; ++k) {
    double largest = 0;
    int alarms = 0;
    rms.values.push_back(path_error(first + static_cast<unsigned>(k), &largest, &alarms));
    worst.values.push_back(largest);
    false_alarms += alarms;
  }
  rms.print("10.4 mm at 1 mm/s in 2 mT, rms", 1e-6, "um");
  worst.print("the same, largest", 1e-6, "um");
  std::printf("false alarms on the path: %d\n", false_alarms);
  for (const double part : {1.05, 1.1, 1.2, 1.5}) print_step_out(first, machines, part);
}

}  // namespace
}  // namespace vitreo::machines

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: swim_machines FIRST_SEED MACHINES\n");
    return 2;
  }
  vitreo::machines::print(static_cast<unsigned>(std::atoi(argv[1])), std::atoi(argv[2]));
  return 0;
}
