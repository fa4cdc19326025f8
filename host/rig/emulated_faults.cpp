// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulated_faults.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/files/run_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <iostream>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <utility>

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

/// How often it is asked whether the command has spoken: a thousandth of what a person would note.
constexpr auto kContactPoll = 2ms;

const std::vector<std::string> kAnyWire{"line", "usb", "hid"};
const std::vector<std::string> kAnyCable{"line", "usb", "hid", "camera"};
const std::vector<std::string> kAnyCamera{"camera"};
const std::vector<std::string> kAnyLine{"line"};
const std::vector<std::string> kAnyHid{"hid"};

/// When one fault begins or ends.
struct Moment {
  double at = 0;  // s from the first contact; of what begins at once it is 0
  std::size_t fault = 0;
  bool on = true;
};

}  // namespace

const FaultKinds& emulated_faults() {
  static const FaultKinds kinds{
      {"silent", "nothing comes from it any more; a camera hangs", kAnyCable},
      {"deaf", "what it is sent does not arrive", {"line", "hid"}},
      {"late", "what it says comes `by` later", kAnyWire, "s", 80e-3, 0, 10},
      {"late", "its images are `by` old when they come", kAnyCamera, "s", 80e-3, 0, 0.9},
      {"short", "of each answer only `by` bytes come", kAnyWire, "n", 1, 0, 1000},
      {"garbled", "the byte after the first `by` of an answer is changed", kAnyWire, "n", 0, 0,
       1000},
      {"echo", "the line sends back what it is sent", kAnyLine},
      {"blocked", "what is written to it does not get through: the writer waits", kAnyHid},
      {"unplugged", "its cable is pulled; plugged in again when the fault is over", kAnyCable},
      {"power_cycled", "switched off and, `by` later, on: what it does not keep is lost", kAnyCable,
       "s", 1, 0.02, 600},
      {"swapped", "its cable and that of the role `with` are exchanged", {"line", "camera"}},
      {"drops", "one of `by` images never comes", kAnyCamera, "n", 5, 1, 1000},
      {"torn", "of one of `by` images a fifth of the packets is lost", kAnyCamera, "n", 5, 1, 1000},
      {"packets", "one of `by` packets is lost, anywhere", kAnyCamera, "n", 20000, 2, 1e6},
      {"frozen", "the same image again and again", kAnyCamera},
      {"overexposed", "`by` times too much light: what is too bright is white", kAnyCamera, "n", 20,
       1, 1000},
      {"dark", "`by` times too little light", kAnyCamera, "n", 50, 1, 1e6},
      {"defocused", "each point of its image is a disc with a radius of `by` px", kAnyCamera, "n",
       12, 1, 100},
      {"floater", "a dark speck with a radius of `by` px drifts through its image", kAnyCamera, "n",
       10, 1, 200},
      {"saturated", "the amplifiers give no more than `by`", {"amplifiers"}, "A", 0.5, 0, 100},
      {.name = "cut_off",
       .doc = "the amplifier of `channel`, or each, gives no current",
       .roles = {"amplifiers"},
       .options = {"channel"}},
      {"stuck", "it is told to move and stands still", {"motor", "lens motor"}},
      {"limit", "its limit switch is pressed", {"lens motor"}}};
  return kinds;
}

FaultKinds faults_of(const RoleParts& parts) {
  FaultKinds found;
  for (FaultKind kind : emulated_faults()) {
    std::set<std::string> roles;
    bool channels = false;
    for (const RolePart& one : parts) {
      if (std::find(kind.roles.begin(), kind.roles.end(), one.part->type()) == kind.roles.end())
        continue;
      roles.insert(one.role);
      channels = channels || one.channel > 0;
    }
    if (kind.name == "swapped" && roles.size() < 2) continue;
    if (roles.empty()) continue;
    kind.roles.assign(roles.begin(), roles.end());
    if (kind.name == "swapped")
      kind.options.emplace_back("with");
    else if (channels)
      kind.options.emplace_back("channel");
    found.push_back(std::move(kind));
  }
  return found;
}

struct EmulatedFaults::State {
  /// One fault with the parts that it happens to.
  struct Planned {
    Fault fault;
    double by = 0;
    std::vector<EmulatedPart*> parts;
    EmulatedPart* other = nullptr;  // of a swap
    bool happened = false;
  };

  State(const std::vector<std::string>& words, RoleParts& the_parts)
      : parts(the_parts), kinds(faults_of(the_parts)) {
    for (const std::string& word : words) plan(word);
    std::stable_sort(moments.begin(), moments.end(),
                     [](const Moment& a, const Moment& b) { return a.at < b.at; });
    for (const Moment& moment : moments)
      if (moment.at == 0 && moment.on) begin(planned[moment.fault]);
    if (!moments.empty()) thread = quiet_thread([this] { work(); });
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    {
      const std::lock_guard lock(mutex);
      ended = true;
    }
    changed.notify_all();
    if (thread.joinable()) thread.join();
    for (const Planned& one : planned)
      if (!one.happened) report("never came", to_string(one.fault, kinds), std::nullopt);
  }

  void plan(const std::string& word) {
    Planned one{parse_fault(word, kinds), 0, {}};
    try {
      const FaultKind& kind = kind_of(one.fault, kinds);
      check_amounts(one.fault, kind);
      one.by = one.fault.by.value_or(kind.usual);
      find_parts(one);
      if (one.fault.kind == "power_cycled" && one.fault.lasting > 0)
        throw std::invalid_argument("lasting: it is off for `by`");
    } catch (const std::invalid_argument& problem) {
      throw ConfigError("fault " + word + ": " + problem.what());
    }
    const double lasting = one.fault.kind == "power_cycled" ? one.by : one.fault.lasting;
    moments.push_back({one.fault.after, planned.size(), true});
    if (lasting > 0) moments.push_back({one.fault.after + lasting, planned.size(), false});
    planned.push_back(std::move(one));
  }

  /// Those of the role whose type knows the kind.
  void find_parts(Planned& one) {
    const Fault& fault = one.fault;
    const auto knows = [&fault](const RolePart& part) {
      const auto& all = emulated_faults();
      return std::any_of(all.begin(), all.end(), [&](const FaultKind& kind) {
        return kind.name == fault.kind && std::find(kind.roles.begin(), kind.roles.end(),
                                                    part.part->type()) != kind.roles.end();
      });
    };
    bool numbered = fault.kind == "cut_off";  // the amplifiers are one part with channels
    for (const RolePart& part : parts) {
      if (!knows(part)) continue;
      if (part.role == fault.with) one.other = part.part.get();
      if (part.role != fault.role) continue;
      if (fault.channel && part.channel > 0 && part.channel != *fault.channel) continue;
      numbered = numbered || part.channel > 0;
      one.parts.push_back(part.part.get());
    }
    if (fault.channel && !one.parts.empty() && !numbered)
      throw std::invalid_argument("channel is no option of " + fault.role + ": it has one cable");
    if (one.parts.empty()) throw std::invalid_argument("channel: there is none of that number");
    if (fault.kind == "swapped") check_pair(one);
  }

  static void check_pair(const Planned& one) {
    if (one.fault.with.empty())
      throw std::invalid_argument("with: wants the other role, as in stage:swapped:with=lamp");
    if (one.other == nullptr || one.other == one.parts.front() ||
        std::string(one.other->type()) != one.parts.front()->type())
      throw std::invalid_argument("with: " + one.fault.with + " has no cable of the same kind");
  }

  /// Nothing for what is there from the beginning.
  void report(const std::string& what, const std::string& fault,
              std::optional<Steady::time_point> moment) const {
    std::string when;
    if (moment)
      when = fmt::format(", {:.3f} s after the first word, {}",
                         std::chrono::duration<double>(*moment - contact).count(),
                         utc_text(std::chrono::system_clock::now()));
    std::cerr << fmt::format("vitreo: fault {}: {}{}\n", what, fault, when) << std::flush;
  }

  void begin(Planned& one, std::optional<Steady::time_point> moment = {}) {
    Fault begun = one.fault;
    begun.after = 0;
    one.happened = true;
    report("begins", to_string(begun, kinds), moment);
    change(one, true);
  }
  void change(Planned& one, bool on) {
    try {
      if (one.other != nullptr) return one.parts.front()->exchange(*one.other);
      for (EmulatedPart* const part : one.parts) part->set(one.fault, one.by, on);
    } catch (const std::exception& error) {
      report("failed", to_string(one.fault, kinds) + ": " + error.what(), std::nullopt);
    }
  }

  bool wait_until(Steady::time_point due) {
    std::unique_lock lock(mutex);
    return !changed.wait_until(lock, due, [this] { return ended; });
  }
  bool wait_for_contact() {
    const auto touched = [](const RolePart& part) { return part.part->touched(); };
    while (std::none_of(parts.begin(), parts.end(), touched))
      if (!wait_until(Steady::now() + kContactPoll)) return false;
    contact = Steady::now();
    return true;
  }

  void work() {
    if (!wait_for_contact()) return;
    for (const Moment& moment : moments) {
      if (moment.at == 0 && moment.on) continue;  // it is there already
      const auto in = std::chrono::duration<double>(moment.at);
      if (!wait_until(contact + std::chrono::duration_cast<Steady::duration>(in))) return;
      Planned& one = planned[moment.fault];
      const auto now = Steady::now();
      if (moment.on) {
        begin(one, now);
      } else {
        change(one, false);
        report("is over", one.fault.role + " " + one.fault.kind, now);
      }
    }
  }

  RoleParts& parts;
  const FaultKinds kinds;
  std::vector<Planned> planned;
  std::vector<Moment> moments;
  Steady::time_point contact;
  std::mutex mutex;
  std::condition_variable changed;
  bool ended = false;
  std::thread thread;
};

EmulatedFaults::EmulatedFaults(const std::vector<std::string>& words, RoleParts& parts)
    : state_(std::make_unique<State>(words, parts)) {}
EmulatedFaults::~EmulatedFaults() = default;

}  // namespace vitreo
