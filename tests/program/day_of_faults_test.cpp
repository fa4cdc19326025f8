// A day of one rig at the prompt: protocols one after the other in one process and one record, most
// of them with a fault. Each ends as it does, the coils are at zero before the next begins, and the
// rig works again: the run after a fault that has passed completes.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <iomanip>
#include <iostream>
#include <map>
#include <random>
#include <sstream>
#include <sys/resource.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct Fault {
  const char *role, *kind;
  bool of_a_channel = false;
};
constexpr std::array<Fault, 21> kFaults{{
    {"coils", "silent"},
    {"coils", "late"},
    {"coils", "short"},
    {"coils", "garbled"},
    {"coils", "unplugged"},
    {"coils", "saturated"},
    {"coils", "cut_off", true},
    {"coils", "shorted", true},
    {"coils", "reversed", true},
    {"coils", "weak", true},
    {"pose_sensor", "silent"},
    {"pose_sensor", "late"},
    {"pose_sensor", "drops"},
    {"pose_sensor", "torn"},
    {"pose_sensor", "frozen"},
    {"pose_sensor", "stale"},
    {"pose_sensor", "nan"},
    {"pose_sensor", "jump"},
    {"pose_sensor", "drift"},
    {"pose_sensor", "unplugged"},
    {"pose_sensor", "alternating"},
}};
constexpr double kMoment = 24;   // s, until which a fault begins
constexpr double kLongest = 5;   // s, that it lasts
constexpr double kAnswer = 0.5;  // s, by which a question that was asked meanwhile has failed
constexpr double kPause = 15;    // s, in which the rig rests

/// As often as an amplifier that does not answer may abort a wait, each after a twentieth of a
/// second or more.
constexpr int kWaits = 120;

/// Statements for run `number`: waits until the last fault has passed, which may abort them; what
/// the coils carry after a pause; then a hold, with a fault or not.
std::string statements(int number, const Fault* fault, std::mt19937& random) {
  std::uniform_real_distribution<double> unit;
  const double after = fault == nullptr ? 0 : kMoment * unit(random);
  const double lasting = fault == nullptr ? 0 : 0.05 + (kLongest - 0.05) * unit(random);
  std::ostringstream text;
  if (number == 1) text << "over = 0\n";
  for (int k = 0; k < kWaits; ++k)
    text << "if over > run:now() then run:wait(over - run:now()) end\n";
  text << "do run:wait(" << kPause
       << ") local most = 0 for _, i in ipairs(rig.coils:currents()) do "
       << "most = math.max(most, math.abs(i)) end print('REST', " << number
       << ", run:now() // 1, most) rig.coils:enable() end\n";
  text << "do over = run:now() + " << after + lasting + kAnswer << " ";
  if (fault != nullptr) {
    text << "rig.simulation:fault('" << fault->role << "', '" << fault->kind
         << "', { after = " << after << ", lasting = " << lasting;
    if (fault->of_a_channel) text << ", channel = " << 1 + static_cast<int>(8 * unit(random));
    text << " }) ";
  }
  text << "local ok, why = pcall(run, 'hold', { feedback = 'pose_sensor', compare = false, settle "
          "= 1, hold = 10, width = 2e-3, depth = 2e-3, speed = 1e-3 }) print('RUN', "
       << number << ", ok, why) end\n";
  return text.str();
}

/// The lines that begin with `word`: its columns by the number behind it.
std::map<int, std::vector<std::string>> lines(const std::string& text, const std::string& word) {
  std::map<int, std::vector<std::string>> found;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with(word + "\t")) continue;
    std::istringstream columns(line);
    std::vector<std::string> cells;
    for (std::string cell; std::getline(columns, cell, '\t');) cells.push_back(cell);
    found[std::stoi(cells.at(1))] = cells;
  }
  return found;
}

TEST(DayOfFaults, EndsWithTheRigAtRestAndAtWork) {
  const double hours = long_or_short(24, 0) + 1.0 / 12;
  const auto seed = static_cast<unsigned>(long_or_short(4, 3));
  std::mt19937 random(seed);
  std::map<int, const Fault*> faults;
  std::string input;
  int count = 0;
  for (double begun = 0; begun < hours * 3600; begun += kPause + 20) {  // s, at the least
    ++count;
    const bool healthy = count % 3 == 0 || begun + kPause + 20 >= hours * 3600;
    faults[count] = healthy ? nullptr : &kFaults.at(random() % kFaults.size());
    input += statements(count, faults[count], random);
  }
  const Workplace place;
  const Spoken said = place.vitreo("--out runs --seed " + std::to_string(seed), input);

  const auto rests = lines(said.out, "REST"), runs = lines(said.out, "RUN");
  EXPECT_EQ(rests.size(), static_cast<std::size_t>(count)) << said.err;
  std::map<std::string, std::map<std::string, int>> table;
  for (const auto& [number, cells] : rests)
    EXPECT_EQ(std::stod(cells.at(3)), 0) << "A flow before run " << number;
  for (const auto& [number, fault] : faults) {
    const auto run = runs.find(number);
    // What ends a statement (an instrument that is broken) leaves no line of its own.
    const std::string outcome = run == runs.end()             ? "aborted"
                                : run->second.at(2) == "true" ? "completed"
                                                              : "failed";
    ++table[fault == nullptr ? "none" : std::string(fault->role) + " " + fault->kind][outcome];
    if (fault == nullptr) {
      EXPECT_EQ(outcome, "completed")
          << "run " << number << ": " << (run == runs.end() ? "" : run->second.back());
    }
  }
  for (const auto& [kind, outcomes] : table) {
    std::cout << std::left << std::setw(26) << kind;
    for (const auto& [outcome, times] : outcomes) std::cout << "  " << times << " " << outcome;
    std::cout << "\n";
  }
  rusage used{};
  getrusage(RUSAGE_CHILDREN, &used);
  std::cout << rests.rbegin()->second.at(2) << " s of the rig's time, " << count << " runs, "
            << used.ru_maxrss / 1024 << " MB at most\n";
  EXPECT_EQ(place.vitreo("verify last").exit_code, 0);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
