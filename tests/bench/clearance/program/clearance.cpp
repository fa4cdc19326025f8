// Benchmark of the clearance: what the loop shows on its way to the retina against the true
// distance of the true surface, and whether it touches, under faults, at a margin. Usage:
// clearance_approaches STUDY [first seed] [runs] [margin in mm]; STUDY: lying, upright,
// uncalibrated, driven, faults, camera_faults, sampled, sampled_untold, sampled_upright. After a
// look on the retina: calibrated_approaches.py.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/clearance/approach.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

namespace vitreo::approaches {
namespace {

ApproachSetting setting_of(const std::string& study) {
  ApproachSetting setting;
  setting.sink = true;
  if (study == "upright") setting.upright = true;
  if (study.starts_with("sampled")) setting.sampled_bench = true;
  if (study == "sampled_untold") setting.told = false;
  if (study == "sampled_upright") setting.upright = true;
  if (study == "uncalibrated") setting.perturbed_eye = true;
  if (study == "driven" || study == "driven_camera" || study == "faults" ||
      study == "camera_faults")
    setting.sink = false;
  if (study == "driven" || study == "faults") setting.feedback = Feedback::pose_sensor;
  if (study == "faults" || study == "camera_faults") setting.faults = 1;
  return setting;
}

std::vector<double> sorted(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values;
}

void quantiles(const char* what, const std::vector<double>& values, double unit) {
  if (values.empty()) return;
  const std::vector<double> all = sorted(values);
  std::printf("%-44s least %8.3f, median %8.3f, most %8.3f\n", what, all.front() / unit,
              all[all.size() / 2] / unit, all.back() / unit);
}

void study(const std::string& name, std::uint64_t first, int count, double margin) {
  std::vector<double> optimism;
  std::vector<double> least;
  std::vector<double> driven;
  std::vector<double> uncertainty;
  std::vector<double> bias;
  std::vector<double> end;
  std::vector<double> excess;
  std::vector<double> below;
  std::vector<double> cautious;
  std::vector<double> sigmas;
  int good = 0;
  int touched = 0;
  int late = 0;
  int pushed = 0;
  int ended = 0;
  int alarms = 0;
  int not_run = 0;
  std::map<std::string, int> endings;
  for (int k = 0; k < count; ++k) {
    ApproachSetting setting = setting_of(name);
    setting.seed = first + static_cast<std::uint64_t>(k);
    setting.margin = margin;
    if (name == "faults" || name == "driven") setting.upright = k % 2 == 1;
    const ApproachResult one = run_approach(setting);
    if (one.optimism < -0.5) {
      ++not_run;
      std::printf("seed %llu: %s\n", static_cast<unsigned long long>(setting.seed),
                  one.ending.c_str());
      continue;
    }
    optimism.push_back(one.optimism);
    least.push_back(one.least_true);
    if (one.least_driven < 0.9) driven.push_back(one.least_driven);
    uncertainty.push_back(one.uncertainty);
    bias.push_back(one.bias);
    end.push_back(one.end_true);
    excess.push_back(one.excess);
    below.push_back(one.below);
    good += one.optimism <= 50e-6 ? 1 : 0;
    touched += one.touched ? 1 : 0;
    late += one.touched && !one.red_first ? 1 : 0;
    pushed += one.touched && one.driven ? 1 : 0;
    ended += one.touched && one.ended ? 1 : 0;
    alarms += one.alarm ? 1 : 0;
    ++endings[one.ending.substr(0, one.ending.find(':'))];
    if (one.optimism > 50e-6 || (one.touched && one.driven && !setting.sink) ||
        (one.touched && !one.red_first && setting.faults == 0))
      std::printf("seed %llu: optimism %.0f um, least %.3f mm%s%s; %s; %s\n",
                  static_cast<unsigned long long>(setting.seed), one.optimism * 1e6,
                  one.least_true * 1e3, one.touched ? ", touched" : "",
                  one.driven ? ", driven" : "", one.plan.c_str(), one.ending.c_str());
    std::fflush(stdout);
  }
  std::printf("\n%s, seeds %llu to %llu, margin %.2f mm: %d of %zu shown <= true + 0.05 mm\n",
              name.c_str(), static_cast<unsigned long long>(first),
              static_cast<unsigned long long>(first) + static_cast<unsigned long long>(count) - 1,
              margin * 1e3, good, optimism.size());
  std::printf(
      "touched %d, not red before %d; driven into it %d; after the loop had ended %d; while the "
      "coils did something else %d; alarms %d; not run %d\n",
      touched, late, pushed, ended, touched - pushed - ended, alarms, not_run);
  quantiles("shown less true, the most of each run, um", optimism, 1e-6);
  quantiles("true less shown bound, median of each run, mm", below, 1e-3);
  quantiles("error over half width, the most of each run", excess, 1);
  quantiles("uncertainty at the end, mm", uncertainty, 1e-3);
  quantiles("shown distance less the true one then, mm", bias, 1e-3);
  quantiles("least true clearance, mm", least, 1e-3);
  quantiles("the same while the coils obeyed, mm", driven, 1e-3);
  quantiles("true clearance at the end, mm", end, 1e-3);
  for (const auto& [ending, times] : endings) std::printf("  %4d %s\n", times, ending.c_str());
}

}  // namespace
}  // namespace vitreo::approaches

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "lying";
  const std::uint64_t first = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const int count = argc > 3 ? std::atoi(argv[3]) : 20;
  const double margin = argc > 4 ? std::atof(argv[4]) * 1e-3 : 0.2e-3;
  vitreo::approaches::study(name, first, count, margin);
  return 0;
}
