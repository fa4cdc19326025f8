// SPDX-License-Identifier: Apache-2.0
#include "host/servo/observers.h"

#include "devices/roles/gray.h"
#include "host/record/meaning.h"
#include "host/servo/side_outline.h"
#include "host/servo/simulated_side.h"
#include "vision/blob_tracker.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <utility>

namespace vitreo {
namespace {

constexpr std::size_t kKept = 64;  // frames
constexpr Time kTemperaturePeriod = std::chrono::milliseconds(500);
// Cameras with one trigger, and the mapping of their clocks.
constexpr Time kInStep = std::chrono::milliseconds(1);

}  // namespace

/// Called by the side camera's task, once a frame, whether or not the robot was seen in it.
void SideObservationBuffer::add(const Frame& frame, std::optional<SideObservation> seen) {
  lately_.push_back({frame.exposed, seen});
  if (lately_.size() > kKept) lately_.pop_front();
  clock_.notify(added_);
}

/// Entries come in the order of exposure: once the newest has reached `exposed`, the one that is
/// wanted has come or will never come.
std::optional<SideObservation> SideObservationBuffer::at(Time exposed, Time deadline) {
  const auto there = [&] {
    return !lately_.empty() && lately_.back().exposed >= exposed - kInStep;
  };
  // Whether it came in time is not asked: what is there by then may do.
  clock_.wait(added_, there, deadline);
  const auto nearest =
      std::min_element(lately_.begin(), lately_.end(), [exposed](const Entry& a, const Entry& b) {
        return std::chrono::abs(a.exposed - exposed) < std::chrono::abs(b.exposed - exposed);
      });
  if (nearest == lately_.end()) return std::nullopt;
  const Time skew = nearest->exposed - exposed;
  std::optional<SideObservation> view =
      std::chrono::abs(skew) <= kInStep ? nearest->seen : between(exposed);
  if (view) view->skew = skew;
  return view;
}

/// Linear in time through the observations a and b at t_a < t_b: p(t) = (1 - w) p_a + w p_b with
/// w = (t - t_a) / (t_b - t_a), whose covariance is (1 - w)^2 C_a + w^2 C_b: beyond b it grows.
std::optional<SideObservation> SideObservationBuffer::between(Time exposed) const {
  std::optional<SideObservation> before;
  std::optional<SideObservation>
      last;  // the newest at or before `exposed`, then the first after it
  for (const Entry& entry : lately_) {
    if (!entry.seen) continue;
    before = std::exchange(last, entry.seen);
    if (entry.exposed >= exposed) break;
  }
  if (!before || !last || last->exposed - before->exposed > 3 * period_ ||
      exposed < before->exposed || exposed - last->exposed > 2 * period_)
    return std::nullopt;
  const double w =
      to_seconds(exposed - before->exposed) / to_seconds(last->exposed - before->exposed);
  SideObservation view;
  view.exposed = exposed;
  view.position = (1 - w) * before->position + w * last->position;
  view.direction = last->direction;
  view.direction_sigma = last->direction_sigma;
  view.covariance = (1 - w) * (1 - w) * before->covariance + w * w * last->covariance;
  // What stays is the same in both: it is not averaged.
  // The first sum weighed the systematic parts as if they were independent: these are replaced.
  const Eigen::Matrix2d stays = (1 - w) * before->systematic + w * last->systematic;
  view.covariance += stays - (1 - w) * (1 - w) * before->systematic - w * w * last->systematic;
  view.systematic = stays;
  return view;
}

void record_machine(Recorder& recorder, Time now, const sim::Laboratory& laboratory) {
  nlohmann::json drawn = nlohmann::json::object();
  for (const auto& [name, value] : laboratory.drawn()) drawn[name] = value;
  recorder.event(now, "machine", drawn.dump());
}

std::unique_ptr<Task> observe_truth(Clock& clock, sim::Laboratory& laboratory, double period,
                                    Recorder& recorder) {
  const int stream =
      recorder.add_stream({"truth",
                           "the simulator's truth, which the loop never sees",
                           {{"x", "m", "true position of the robot", kWorld},
                            {"y", "m", "true position of the robot", kWorld},
                            {"z", "m", "true position of the robot", kWorld},
                            {"axis_x", "1", "unit vector of the robot's true axis", kWorld},
                            {"axis_y", "1", "unit vector of the robot's true axis", kWorld},
                            {"axis_z", "1", "unit vector of the robot's true axis", kWorld}},
                           kExposure});
  return clock.spawn(
      "truth", [&clock, &laboratory, period = from_seconds(period), &recorder, stream] {
        // At multiples of the period, as the camera exposes: the rows have the servo's times.
        int machines = laboratory.machines();
        for (std::int64_t number = clock.now() / period + 1;; ++number) {
          const Time exposed = number * period;
          clock.sleep_until(exposed);
          if (laboratory.machines() != machines) record_machine(recorder, exposed, laboratory);
          machines = laboratory.machines();
          const auto truth = laboratory.truth(exposed);
          if (!truth) continue;
          const Eigen::Vector3d& p = truth->position;
          const Eigen::Vector3d& a = truth->axis;
          recorder.sample(stream, exposed, std::array{p.x(), p.y(), p.z(), a.x(), a.y(), a.z()});
        }
      });
}

std::unique_ptr<Task> observe_coil_temperatures(Clock& clock, Interlock& coils,
                                                Recorder& recorder) {
  const std::size_t count = coils.temperatures().size();
  if (count == 0) return nullptr;
  StreamInfo info{"coil_temperature", "the interlock's model of the coils", {}, kHostClock};
  for (std::size_t coil = 1; coil <= count; ++coil)
    info.channels.push_back({"t" + std::to_string(coil), "K", "estimated temperature of the coil"});
  return clock.spawn("coil temperatures",
                     [&clock, &coils, &recorder, stream = recorder.add_stream(info)] {
                       while (true) {
                         clock.sleep_for(kTemperaturePeriod);
                         recorder.sample(stream, clock.now(), coils.temperatures());
                       }
                     });
}

std::unique_ptr<Task> observe_side(Clock& clock, Rig& rig, vision::Background background,
                                   Recorder& recorder, SideObservationBuffer& watch) {
  const int stream = recorder.add_stream(side_stream("the side camera's view, orthographic"));
  return clock.spawn(
      "side camera", [&rig, &recorder, &watch, stream, learnt = std::move(background)] {
        vision::BlobTracker tracker(learnt, {});
        std::optional<Time> last;
        while (true) {
          // Beyond any frame period: a camera that is silent for so long throws, and ends the task.
          const Frame frame = rig.side_camera->grab(from_seconds(5));
          // Its clock is wrong: no stream's time goes back.
          if (last && frame.exposed <= *last) continue;
          last = frame.exposed;
          const auto seen = tracker.update(as_gray(frame.image));
          if (!seen) {
            watch.add(frame, std::nullopt);
            continue;
          }
          const SideObservation side = side_observation(rig.model, frame.exposed, *seen);
          watch.add(frame, side);
          recorder.sample(stream, frame.exposed,
                          std::array{side.position.x(), side.position.y(),
                                     seen->ellipse.semi_major_px, seen->ellipse.semi_minor_px});
        }
      });
}

}  // namespace vitreo
