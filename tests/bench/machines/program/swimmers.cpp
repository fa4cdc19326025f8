// Swimmers over machines that are not the loop's model: path, step-out, and what a frequency gives.
//   swim_machines FIRST_SEED MACHINES [helix|tail]
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/swim_bench.h"

#include <cstdio>
#include <cstdlib>
#include <string>

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

void print_path(unsigned first, int machines, bool tail) {
  Spread rms, mean_way, worst;
  int false_alarms = 0;
  for (int k = 0; k < machines; ++k) {
    const PathError found = path_error_of(first + static_cast<unsigned>(k), tail);
    rms.values.push_back(found.rms);
    mean_way.values.push_back(found.mean_way);
    worst.values.push_back(found.worst);
    false_alarms += found.told;
  }
  rms.print(tail ? "10.4 mm at 0.06 mm/s in 10 mT, rms" : "10.4 mm at 1 mm/s in 2 mT, rms", 1e-6,
            "um");
  mean_way.print("the same, of the mean over a second", 1e-6, "um");
  worst.print("the same, largest", 1e-6, "um");
  std::printf("false alarms on the path: %d\n", false_alarms);
}

void print_helix(unsigned first, int machines) {
  print_path(first, machines, false);
  for (const double part : {1.05, 1.1, 1.2, 1.5}) print_step_out(first, machines, part);
}

/// s after which a field cut to a quarter is told, along the path or spun at 9 Hz; below 0: not in
/// ten. `before`: what was told before it.
double cut_field(unsigned seed, bool spun, int& before) {
  SwimBench bench(seed, tail_law(seed), kTailField, tail_model());
  bench.go(10);
  if (spun)
    bench.controller().spin(Eigen::Vector3d::UnitX(), 9);
  else
    bench.path() = {centimeter(kTailSpeed, kTailAcceleration), bench.now()};
  bench.go(20);
  before += static_cast<int>(bench.found.size());
  bench.found.clear();
  const double begin = bench.now();
  bench.weaken(0.25);
  bench.go(10);
  return bench.found.empty() ? -1 : bench.found.front() - begin;
}

void print_cut_field(unsigned first, int machines) {
  for (const bool spun : {false, true}) {
    Spread told;
    int not_told = 0, before = 0;
    for (int k = 0; k < machines; ++k) {
      const double time = cut_field(first + static_cast<unsigned>(k), spun, before);
      if (time < 0)
        ++not_told;
      else
        told.values.push_back(time);
    }
    std::printf("field cut to a quarter %s: not told in 10 s %d, told before it %d\n",
                spun ? "while spun at 9 Hz" : "along the path", not_told, before);
    told.print("  told after", 1, "s");
  }
}

/// Speed over frequency, each machine's own as a laboratory measures it.
void print_tail(unsigned first, int machines) {
  print_path(first, machines, true);
  print_cut_field(first, machines);
  const std::vector<double> ladder{1, 2, 3, 4, 6, 9, 12};
  std::vector<Spread> speeds(ladder.size());
  for (int k = 0; k < machines; ++k) {
    SwimBench bench = beating(first + static_cast<unsigned>(k));
    bench.go(0.5);
    for (std::size_t i = 0; i < ladder.size(); ++i)
      speeds[i].values.push_back(beaten_speed(bench, ladder[i]));
  }
  for (std::size_t i = 0; i < ladder.size(); ++i) {
    std::printf("%5.1f Hz ", ladder[i]);
    speeds[i].print("speed", 1e-6, "um/s");
  }
}

}  // namespace
}  // namespace vitreo::machines

int main(int argc, char** argv) {
  const std::string robot = argc > 3 ? argv[3] : "helix";
  if (argc < 3 || argc > 4 || (robot != "helix" && robot != "tail")) {
    std::fprintf(stderr, "usage: swim_machines FIRST_SEED MACHINES [helix|tail]\n");
    return 2;
  }
  const auto first = static_cast<unsigned>(std::atoi(argv[1]));
  if (robot == "tail")
    vitreo::machines::print_tail(first, std::atoi(argv[2]));
  else
    vitreo::machines::print_helix(first, std::atoi(argv[2]));
  return 0;
}
