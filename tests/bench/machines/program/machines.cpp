// Benchmark of the servo laws over machines that are not their model: fresh machines of the
// simulator's plant, single mistakes and worst corners, the law before beside the law now and the
// thesis' PD. Usage: control_machines [first seed] [machines] [field_max in mT] [studies...]
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/machine_loop.h"
#include "tests/bench/machines/program/studies.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace vitreo::machines {
namespace {

const control::Trajectory& hold() {
  static const control::Trajectory path = control::Trajectory::hold_at({2e-3, 0, 1e-3});
  return path;
}

// The thesis' 8 mm x 6 mm at 0.5 mm/s.
const control::Trajectory& square() {
  static const control::Trajectory path =
      control::Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  return path;
}

double quantile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1) + 0.5)];
}

// Each machine is a run of its own, whichever thread it is on.
std::vector<MachineResult> run_all(const MachineSetting& setting, Law law, bool around,
                                   std::uint64_t first, int count) {
  constexpr int kThreads = 6;
  std::vector<MachineResult> results(static_cast<std::size_t>(count));
  const control::Trajectory& path = around ? square() : hold();
  std::vector<std::jthread> threads;
  for (int thread = 0; thread < kThreads; ++thread)
    threads.emplace_back([&, thread] {
      for (int k = thread; k < count; k += kThreads) {
        MachineSetting one = setting;
        one.seed = first + static_cast<std::uint64_t>(k);
        results[static_cast<std::size_t>(k)] = run_machine(one, law, path, 8, around ? 0 : 20);
      }
    });
  threads.clear();  // joined
  return results;
}

std::vector<double> rms_of(const std::vector<MachineResult>& results) {
  std::vector<double> values;
  for (const MachineResult& one : results)
    values.push_back(one.failure.empty() ? one.rms * 1e6 : 1e6);
  return values;
}

int lost_of(const std::vector<MachineResult>& results) {
  return static_cast<int>(
      std::count_if(results.begin(), results.end(), [](const auto& one) { return one.lost(); }));
}

double mean(const std::vector<MachineResult>& results, double MachineResult::*member) {
  double sum = 0;
  for (const MachineResult& one : results) sum += one.*member;
  return sum / static_cast<double>(results.size());
}

/// One row: median, 95th percentile, worst and lost, of each law; then the filter's consistency.
void row(const std::string& name, const MachineSetting& setting, bool around, std::uint64_t first,
         int count, bool with_pd) {
  const auto before = run_all(setting, Law::before, around, first, count);
  const auto now = run_all(setting, Law::now, around, first, count);
  const auto b = rms_of(before), n = rms_of(now);
  std::printf("| %-44s | %7.1f %7.1f %7.1f %3d | %6.2f %6.2f %6.2f %3d", name.c_str(),
              quantile(b, 0.5), quantile(b, 0.95), quantile(b, 1), lost_of(before),
              quantile(n, 0.5), quantile(n, 0.95), quantile(n, 1), lost_of(now));
  if (with_pd) {
    const auto pd = rms_of(run_all(setting, Law::pd, around, first, count));
    int worse = 0;
    for (std::size_t k = 0; k < pd.size(); ++k) worse += n[k] > pd[k] ? 1 : 0;
    std::printf(" | %6.0f %6.0f %3d", quantile(pd, 0.5), quantile(pd, 1), worse);
  }
  double gain = 1e9, delay = 1e9;
  for (const MachineResult& one : now) {
    gain = std::min(gain, one.gain_margin);
    delay = std::min(delay, one.delay_margin);
  }
  std::printf(" | %4.1f %4.0f | %4.2f %4.2f %5.2f |\n", 20 * std::log10(gain), delay * 1e3,
              mean(now, &MachineResult::consistency), mean(now, &MachineResult::innovation),
              mean(now, &MachineResult::correlation));
  for (const MachineResult& one : now)
    if (!one.failure.empty()) std::printf("  failed: %s\n", one.failure.c_str());
  std::fflush(stdout);
}

std::vector<Mistake> singles() {
  return {{"nominal"},
          {"delay - 50 ms", -50e-3},
          {"delay + 60 ms", 60e-3},
          {"drag 0.5", 0, 0.5},
          {"drag 2", 0, 2},
          {"moment - 30 %", 0, 1, 0.7},
          {"moment + 30 %", 0, 1, 1.3},
          {"mass + 50 %", 0, 1, 1, 1.5}};
}

std::vector<Mistake> corners() {
  return {{"drag 2, moment -30, +60 ms, mass +50", 60e-3, 2, 0.7, 1.5},
          {"drag 2, moment -30, -50 ms", -50e-3, 2, 0.7, 1},
          {"drag 0.5, moment +30, +60 ms, mass +50", 60e-3, 0.5, 1.3, 1.5},
          {"drag 0.5, moment +30, -50 ms", -50e-3, 0.5, 1.3, 1}};
}

void header(const char* title, bool with_pd) {
  std::printf(
      "\n%s\n| %-44s | before: median p95 worst lost | now: median p95 worst lost%s | "
      "least margins: dB ms | NEES/3, NIS/3, lag-1 correlation |\n",
      title, "um rms", with_pd ? " | PD: median worst, now is worse in" : "");
}

void holds(const MachineSetting& setting, std::uint64_t first, int count, const char* title) {
  header(title, true);
  for (const auto& list : {singles(), corners()})
    for (const Mistake& mistake : list) {
      MachineSetting one = setting;
      one.mistake = mistake;
      row(mistake.name, one, false, first, count, true);
    }
}

/// Every machine of the worst corner, and what the filter made of it.
void worst_corner(const MachineSetting& setting, std::uint64_t first, int count) {
  MachineSetting corner = setting;
  corner.mistake = corners().front();
  std::printf("\nHold, %s, machine by machine\n", corner.mistake.name.c_str());
  for (int k = 0; k < count; ++k) {
    corner.seed = first + static_cast<std::uint64_t>(k);
    const MachineResult one = run_machine(corner, Law::now, hold(), 8, 20);
    std::printf(
        "%6llu: rms %8.2f um, gain %5.2f, delay %4.0f ms, limited %3.0f %%, headroom %4.2f, "
        "NEES/3 %6.2f %s\n",
        static_cast<unsigned long long>(corner.seed), one.rms * 1e6, one.gain, one.delay * 1e3,
        one.limited * 100, one.headroom, one.consistency, one.failure.c_str());
  }
}

void squares(const MachineSetting& setting, std::uint64_t first, int count, const char* title,
             bool mistakes) {
  header(title, false);
  MachineSetting upright = setting;
  upright.robot = "ndfeb_cylinder_1mm";
  upright.axis = {0, 0, 1};
  row("CoNi along x", setting, true, first, count, false);
  row("NdFeB cylinder, upright", upright, true, first, count, false);
  if (!mistakes) return;
  MachineSetting nickel = setting;
  nickel.robot = "ni_500um";
  row("Ni 0.5 mm along x", nickel, true, first, count, false);
  for (const auto& list : {singles(), corners()})
    for (const Mistake& mistake : list) {
      MachineSetting one = setting;
      one.mistake = mistake;
      row(mistake.name, one, true, first, count, false);
    }
}

/// Each coil dead in turn, and known.
void dead_coils(const MachineSetting& setting, std::uint64_t first, int count) {
  header("Square with a dead coil that the loop knows of", false);
  for (int coil = 1; coil <= 8; ++coil) {
    MachineSetting one = setting;
    one.dead = {coil};
    row("coil " + std::to_string(coil), one, true, first, count, false);
  }
}

}  // namespace
}  // namespace vitreo::machines

int main(int argc, char** argv) {
  using namespace vitreo::machines;
  const std::uint64_t first = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  const int count = argc > 2 ? std::atoi(argv[2]) : 20;
  const double field_max = argc > 3 ? std::atof(argv[3]) * 1e-3 : 30e-3;
  std::set<std::string> studies(argv + std::min(argc, 4), argv + argc);
  const auto wanted = [&studies](const char* name) {
    return studies.empty() || studies.contains(name);
  };
  std::printf("machines %llu to %llu\n", static_cast<unsigned long long>(first),
              static_cast<unsigned long long>(first) + static_cast<unsigned long long>(count) - 1);
  MachineSetting drawn;
  drawn.field_max = field_max;
  MachineSetting model;
  model.drawn = false;
  model.walls = false;
  if (wanted("hold")) holds(drawn, first, count, "Hold, the simulated rig's plant");
  if (wanted("hold_model"))
    holds(model, first, count, "Hold, the model's plant (coils and moment drawn, no walls)");
  if (studies.contains("corners")) {
    header("Hold, the worst corners", true);
    for (const Mistake& mistake : corners()) {
      MachineSetting one = drawn;
      one.mistake = mistake;
      row(mistake.name, one, false, first, count, true);
    }
  }
  if (studies.contains("corner")) worst_corner(drawn, first, count);
  if (wanted("square")) squares(drawn, first, count, "Square, the simulated rig's plant", false);
  if (wanted("square_mistakes"))
    squares(drawn, first, count, "Square, the simulated rig's plant, with mistakes", true);
  if (studies.contains("nickel")) {
    header("Square with the nickel robot", false);
    MachineSetting nickel = drawn;
    nickel.robot = "ni_500um";
    row("Ni 0.5 mm along x", nickel, true, first, count, false);
  }
  if (wanted("dead")) dead_coils(drawn, first, count);
  if (wanted("square_model")) squares(model, first, count, "Square, the model's plant", false);
  if (studies.contains("identify")) identify(drawn, first, count);
  MachineSetting turning = drawn;
  turning.turning = 0.3;
  if (studies.contains("watch")) watch(drawn, 0, first, count);
  if (studies.contains("watch_turning")) watch(turning, 0, first, count);
  if (studies.contains("watch_weak"))
    for (const double part : {0.3, 0.5, -1.0}) watch(drawn, part, first, count);
  if (studies.contains("cycles")) cycles(drawn, first, count);
  if (studies.contains("false_alarms")) false_alarms(drawn, first, count);
  if (studies.contains("false_alarms_by_camera"))
    for (const double lever : {0.5e-3, 2.5e-3}) {
      MachineSetting camera = drawn;
      camera.view_lever = lever;
      std::printf("\nThe view errs by %.1f mm per radian of pitch", 1e3 * lever);
      false_alarms(camera, first, count);
    }
  if (studies.contains("false_alarms_turning")) false_alarms(turning, first, count);
  if (studies.contains("field")) field_study(drawn, first, count);
  return 0;
}
