// SPDX-License-Identifier: Apache-2.0
#include "host/rig/truth_file.h"

#include "devices/time/quiet_thread.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"

#include <fmt/format.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;
using Instant = std::chrono::time_point<Steady, Time>;

constexpr Time kTruthPeriod = 20ms;
/// Rows that come later than this are not tried: the world remembers one second.
constexpr Time kRemembered = 800ms;
/// The coils' delay and a dozen of their time constants.
constexpr Time kAftermath = 500ms;

Instant next_row(Instant now) {
  const std::int64_t past = now.time_since_epoch() / kTruthPeriod;
  return Instant((past + 1) * kTruthPeriod);
}

/// Of a moment of the steady clock, by how long ago it was.
std::string utc_of(Instant moment) {
  const auto ago = std::chrono::duration_cast<Time>(Steady::now() - moment);
  return utc_text(std::chrono::system_clock::now() - ago);
}

std::string header(int coils) {
  std::string text =
      "utc,monotonic (s),x (m),y (m),z (m),axis_x,axis_y,axis_z,"
      "beyond_calibration";
  for (const char* const what : {"set_point_{} (A)", "current_{} (A)", "coil_temperature_{} (K)"})
    for (int coil = 1; coil <= coils; ++coil) text += "," + fmt::format(fmt::runtime(what), coil);
  return text + "\n";
}

std::string row_of(Instant moment, const EmulatedTruth& truth) {
  const std::int64_t ns = moment.time_since_epoch().count();
  std::string text =
      fmt::format("{},{}.{:09}", utc_of(moment), ns / 1'000'000'000, ns % 1'000'000'000);
  if (truth.robot) {
    for (const Eigen::Vector3d& v : {truth.robot->position, truth.robot->axis})
      text += fmt::format(",{:.9g},{:.9g},{:.9g}", v.x(), v.y(), v.z());
    text += truth.robot->beyond_calibration ? ",1" : ",0";
  } else {
    text += ",,,,,,,";
  }
  const sim::CoilTruth& coils = truth.coils;
  for (const control::Currents& each : {coils.set_points, coils.currents, coils.temperatures})
    for (const double value : each) text += fmt::format(",{:.7g}", value);
  return text + "\n";
}

}  // namespace

struct TruthFile::State {
  State(const std::filesystem::path& the_file, Emulation& the_emulation)
      : file(the_file), emulation(the_emulation), descriptor(create_new_file(the_file)) {
    const EmulatedTruth first = emulation.truth(Steady::now().time_since_epoch());
    write(header(static_cast<int>(first.coils.currents.size())));
    thread = quiet_thread([this] { work(); });
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { end(); }

  void write(const std::string& text) { append_whole(descriptor.number(), text, file); }

  void end() {
    ended = true;
    if (thread.joinable()) thread.join();
  }

  void work() {
    try {
      for (Instant due = next_row(std::chrono::time_point_cast<Time>(Steady::now())); !ended;
           due += kTruthPeriod) {
        std::this_thread::sleep_until(due);
        const auto late = Steady::now() - due;
        if (late > kRemembered) due = next_row(std::chrono::time_point_cast<Time>(Steady::now()));
        if (const auto truth = truth_at(due)) write(row_of(due, *truth));
      }
    } catch (...) {
      failure = std::current_exception();
    }
  }

  /// Nothing where the turn came so late that the world no longer knows.
  std::optional<EmulatedTruth> truth_at(Instant moment) {
    try {
      return emulation.truth(moment.time_since_epoch());
    } catch (const std::out_of_range&) {
      return std::nullopt;
    }
  }

  const std::filesystem::path file;
  Emulation& emulation;
  const Descriptor descriptor;
  std::atomic<bool> ended{false};
  std::exception_ptr failure;  // of the thread; read when that has ended
  std::thread thread;
};

TruthFile::TruthFile(const std::filesystem::path& file, Emulation& emulation)
    : state_(std::make_unique<State>(file, emulation)) {}
TruthFile::~TruthFile() = default;

void TruthFile::finish() {
  std::this_thread::sleep_for(kAftermath);
  state_->end();
  if (state_->failure) std::rethrow_exception(state_->failure);
}

}  // namespace vitreo
