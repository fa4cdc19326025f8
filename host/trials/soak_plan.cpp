// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_plan.h"

#include "host/trials/soak_script.h"

#include <fmt/format.h>

#include <cmath>
#include <random>

namespace vitreo {
namespace {

/// Draws that are the same with every standard library: std::mt19937_64 is specified to the bit,
/// the standard's distributions are not.
class Dice {
 public:
  // Weyl's constant, 2^64 over the golden ratio, spreads consecutive seeds.
  explicit Dice(std::uint64_t seed) : random_(seed * 0x9E3779B97F4A7C15U + 0x50AC) {}
  /// Uniform: the upper 53 bits, as many as a double has, over 2^53.
  double between(double least, double most) {
    return least + (most - least) * (static_cast<double>(random_() >> 11U) * 0x1p-53);
  }
  // The modulo favors small results by count / 2^64, which is nothing here.
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(random_() % count); }
  bool falls(double part) { return between(0, 1) < part; }

 private:
  std::mt19937_64 random_;
};

/// Rounded to what people can type again.
double rounded(double value) { return std::round(value * 1e3) / 1e3; }

/// The fault's amount in its own unit (FaultKind::unit), half of them small and half of them gross;
/// nothing for a kind without one.
/// The ranges lie within FaultKind's least and most, or check() would refuse the fault.
std::optional<double> draw_amount(const FaultKind& kind, Dice& dice) {
  if (kind.unit.empty()) return std::nullopt;
  if (kind.name == "late")
    return rounded(dice.falls(0.5) ? dice.between(0.001, 0.1) : dice.between(0.1, 1.5));
  if (kind.name == "jump")
    return rounded(dice.falls(0.5) ? dice.between(-1, 1) : dice.between(-3600, 3600));
  if (kind.name == "saturated") return rounded(dice.falls(0.3) ? 0 : dice.between(0, 2));
  if (kind.name == "weak") return rounded(dice.between(0, 1));
  if (kind.name == "turned") return rounded(dice.between(-1, 1));
  if (kind.name == "drift") return rounded(dice.between(-0.05, 0.05));
  if (kind.name == "knocked") return static_cast<double>(dice.below(200)) - 100;
  if (kind.name == "slow") return rounded(dice.between(0.02, 0.2));  // wall time, so not for long
  if (kind.name == "short" || kind.name == "garbled") return static_cast<double>(dice.below(6));
  return static_cast<double>(1 + dice.below(10));  // one of so many
}

constexpr std::size_t kCoils = 8;  // the simulated rig's

/// Without a channel all coils would have it, which is one case of many.
bool is_of_a_coil(const std::string& kind) {
  return kind == "shorted" || kind == "reversed" || kind == "weak";
}

/// Every kind on every role that this rig simulates.
/// The same check() as for a fault of the command line decides, so a plan never holds a fault that
/// the injector would refuse.
std::vector<Fault> possible_faults(const SimulatedRoles& roles) {
  std::vector<Fault> possible;
  for (const FaultKind& kind : fault_kinds()) {
    for (const std::string& role : kind.roles) {
      try {
        check(Fault{role, kind.name}, roles);
        possible.push_back({role, kind.name});
      } catch (const std::invalid_argument&) {  // not on this rig
      }
    }
  }
  return possible;
}

}  // namespace

// The order of the draws is part of the seed's meaning: a draw that is inserted changes every plan
// after it.
SoakPlan draw_plan(std::uint64_t seed, const SimulatedRoles& roles, double horizon) {
  Dice dice(seed);
  SoakPlan plan;
  const std::vector<Fault> possible = possible_faults(roles);
  const double many = dice.between(0, 1);
  // 20 % of the runs without a fault, 50 % with one, 25 % with two, 5 % with three.
  const int faults = many < 0.2 ? 0 : many < 0.7 ? 1 : many < 0.95 ? 2 : 3;
  for (int i = 0; i < faults; ++i) {
    Fault fault = possible[dice.below(possible.size())];
    for (const FaultKind& kind : fault_kinds())
      if (kind.name == fault.kind) fault.by = draw_amount(kind, dice);
    fault.after = rounded(dice.between(0, horizon));
    if (fault.kind == "cut_off" ? dice.falls(0.6) : is_of_a_coil(fault.kind))
      fault.channel = 1 + static_cast<int>(dice.below(kCoils));
    if (dice.falls(0.5)) fault.lasting = rounded(dice.between(0.01, dice.falls(0.5) ? 0.3 : 3));
    plan.faults.push_back(fault);
  }
  // 20 % stopped, 15 % aborted, 10 % emergency stops, 6 % killed; the others run to their end.
  const double end = dice.between(0, 1);
  plan.tier = end < 0.2    ? StopTier::stop
              : end < 0.35 ? StopTier::abort
              : end < 0.45 ? StopTier::emergency
                           : StopTier::none;
  plan.kill = end >= 0.45 && end < 0.51;
  // Up to 2 % beyond the end: a stop that comes too late is a case as well.
  if (plan.kill || plan.tier != StopTier::none) plan.at = rounded(dice.between(0, 1.02 * horizon));
  // Half of the runs on the reference's machine, to which they are compared to the bit.
  if (dice.falls(0.5)) plan.machine = 1 + dice.below(1'000'000);
  // Of the others 40 % have a script that misbehaves.
  const std::vector<std::string> scripts = misbehaviors();
  if (plan.machine != 0 && dice.falls(0.4)) plan.script = scripts[dice.below(scripts.size())];
  return plan;
}

std::string to_string(const SoakPlan& plan) {
  std::vector<std::string> parts;
  for (const Fault& fault : plan.faults) parts.push_back(to_string(fault));
  const char* const word = plan.kill ? "kill" : to_string(plan.tier);
  if (plan.kill || plan.tier != StopTier::none)
    parts.push_back(fmt::format("{} at {:.3f} s", word, plan.at));
  if (plan.machine != 0) parts.push_back(fmt::format("machine {}", plan.machine));
  if (!plan.script.empty()) parts.push_back("a script that " + plan.script);
  return parts.empty() ? "left alone" : fmt::format("{}", fmt::join(parts, "; "));
}

// Twelve digits of the digest are enough to compare two soaks by eye.
std::string to_text(const SoakedSeed& one) {
  std::string text = fmt::format("seed {}: {} -> {}", one.seed, one.plan, one.ending);
  if (!one.digest.empty()) text += " [" + one.digest.substr(0, 12) + "]";
  for (const std::string& violation : one.violations) text += "\n  VIOLATION: " + violation;
  return text + "\n";
}

nlohmann::json to_json(const SoakedSeed& one) {
  return {{"seed", one.seed},       {"plan", one.plan},     {"ending", one.ending},
          {"outcome", one.outcome}, {"digest", one.digest}, {"violations", one.violations}};
}

}  // namespace vitreo
