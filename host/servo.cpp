// SPDX-License-Identifier: Apache-2.0
#include "host/servo.h"

#include "control/allocation.h"
#include "host/loop.h"
#include "vision/draw.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr double kKeptCorrections = 30;  // s

StreamInfo servo_stream() {
  return {"servo",
          "top camera through the eye, and the loop's own numbers",
          {{"x", "m"},
           {"y", "m"},
           {"z", "m"},
           {"target_x", "m"},
           {"target_y", "m"},
           {"target_z", "m"},
           {"u_px", ""},
           {"v_px", ""},
           {"semi_major_px", ""},
           {"semi_minor_px", ""},
           {"angle", "rad"},
           {"residual_px", ""},
           {"sigma_x", "m"},
           {"sigma_y", "m"},
           {"sigma_z", "m"},
           {"force_scale", ""}}};
}

StreamInfo current_stream(int coils) {
  StreamInfo info{"currents", "set-points of the coil amplifiers", {}};
  for (int coil = 1; coil <= coils; ++coil) info.channels.push_back({"i" + std::to_string(coil), "A"});
  return info;
}

int stream_of(Recorder& recorder, const StreamInfo& info) {
  for (std::size_t i = 0; i < recorder.streams().size(); ++i)
    if (recorder.streams()[i].info.name == info.name) return static_cast<int>(i);
  return recorder.add_stream(info);
}

}  // namespace

const char* to_string(ServoState state) {
  switch (state) {
    case ServoState::searching:
      return "searching";
    case ServoState::holding:
      return "holding";
    case ServoState::following:
      return "following";
    case ServoState::released:
      return "released";
    case ServoState::lost:
      return "lost";
    case ServoState::failed:
      return "failed";
    case ServoState::closed:
      return "closed";
  }
  return "?";
}

void ServoSettings::check() const {
  if (!(field >= 1e-3 && field <= 40e-3)) throw std::invalid_argument("field must be in [1 mT, 40 mT]");
  if (!(std::abs(axis.norm() - 1) < 1e-6)) throw std::invalid_argument("axis must be a unit vector");
  if (!(lost_timeout > 0 && lost_timeout <= 10)) throw std::invalid_argument("lost_timeout must be in (0, 10] s");
  gains.check();
}

struct Servo::Loop {
  Loop(Clock& the_clock, Rig& the_rig, Recorder& the_recorder, vision::Background background,
       const ServoSettings& given)
      : clock(the_clock),
        rig(the_rig),
        recorder(the_recorder),
        settings(given),
        chain(the_rig.model, std::move(background), {given.field, given.axis, given.gains},
              the_rig.coils->current_limit()),
        samples(stream_of(the_recorder, servo_stream())),
        currents(stream_of(the_recorder, current_stream(the_rig.coils->channels()))) {}

  void run() {
    try {
      while (true) tick();
    } catch (const Stopped&) {
      shut(ServoState::closed, "");
    } catch (const std::exception& error) {
      status.error = std::current_exception();
      shut(ServoState::failed, error.what());
    }
  }

  void tick() {
    const Frame frame = rig.top_camera->grab(from_seconds(std::max(1.0, 5 * rig.top_camera->info().frame_period)));
    const control::Reference reference = reference_at(frame.exposed);
    const LoopStep step = chain.step(frame.image, to_seconds(frame.exposed), reference, mode != Mode::released);
    if (step.position) {
      last_seen = frame.exposed;
      seen = true;
      remember(to_seconds(frame.exposed), step.correction);
      // What was let go is not taken up again until somebody says where to.
      if (!let_go) send(step.currents);
    } else if (!seen) {
      send(chain.orienting_currents());
    } else if (!let_go && to_seconds(frame.exposed - last_seen) > settings.lost_timeout) {
      let_go = true;  // better let it sink than drive it blind
      switch_off();
      recorder.event(clock.now(), "lost", "the robot was not seen for the time allowed; the coils are at zero");
    }
    publish(frame, reference, step);
    record(frame, reference, step);
    if (mode == Mode::following && status.progress * (pictures + 1) >= pictures_taken + 1 && pictures_taken < pictures)
      wanted_picture = fmt::format("at {:.0f} % of the path", 100.0 * ++pictures_taken / (pictures + 1));
    if (!wanted_picture.empty()) take_picture(frame, step, reference);
    clock.notify(ticked);
  }

  control::Reference reference_at(Time time) {
    if (mode != Mode::following) return {goal, {0, 0, 0}};
    if (starting) {
      path_start = time;
      starting = false;
    }
    const double since = to_seconds(time - path_start);
    if (since >= path->duration()) {
      goal = path->waypoints().back();
      mode = Mode::holding;
    }
    return path->at(since);
  }

  void send(const control::Currents& wanted) {
    rig.coils->set_currents({wanted.data(), static_cast<std::size_t>(wanted.size())});
  }

  void switch_off() {
    rig.coils->set_currents(std::vector<double>(static_cast<std::size_t>(rig.coils->channels()), 0.0));
  }

  void remember(double time, const Eigen::Vector3d& correction) {
    corrections.push_back({time, correction});
    while (corrections.front().first < time - kKeptCorrections) corrections.pop_front();
  }

  void publish(const Frame& frame, const control::Reference& reference, const LoopStep& step) {
    status.time = frame.exposed;
    status.position = step.position;
    status.target = reference.position;
    status.progress = 1;
    if (!seen)
      status.state = ServoState::searching;
    else if (let_go)
      status.state = ServoState::lost;
    else if (mode == Mode::released)
      status.state = ServoState::released;
    else
      status.state = mode == Mode::following ? ServoState::following : ServoState::holding;
    if (mode == Mode::following)
      status.progress = std::clamp(to_seconds(frame.exposed - path_start) / std::max(path->duration(), 1e-9), 0.0, 1.0);
    double largest = 0;
    for (const double current : rig.coils->currents()) largest = std::max(largest, std::abs(current));
    status.headroom = 1 - largest / rig.coils->current_limit();
  }

  void record(const Frame& frame, const control::Reference& reference, const LoopStep& step) {
    const Eigen::Vector3d nowhere = Eigen::Vector3d::Constant(std::nan(""));
    const Eigen::Vector3d p = step.position.value_or(nowhere), t = reference.position;
    const vision::Ellipse e =
        step.ellipse ? step.ellipse->ellipse : vision::Ellipse{nowhere.head<2>(), p.x(), p.x(), p.x()};
    const Eigen::Vector3d sigma = step.position ? step.covariance.diagonal().cwiseSqrt().eval() : nowhere;
    const std::array<double, 16> row{p.x(),           p.y(),           p.z(),           t.x(),
                                     t.y(),           t.z(),           e.centre_px.x(), e.centre_px.y(),
                                     e.semi_major_px, e.semi_minor_px, e.angle,         step.residual_px,
                                     sigma.x(),       sigma.y(),       sigma.z(),       step.force_scale};
    recorder.sample(samples, frame.exposed, row);
    recorder.sample(currents, clock.now(), rig.coils->currents());
    if (step.ellipse) {
      trail.push_back(e.centre_px);
      if (trail.size() > 150) trail.pop_front();  // 10 s at 15 fps
    }
  }

  void take_picture(const Frame& frame, const LoopStep& step, const control::Reference& reference) {
    vision::Overlay overlay;
    if (step.ellipse) overlay.tracked = step.ellipse->ellipse;
    overlay.trail_px.assign(trail.begin(), trail.end());
    const Eigen::Vector3d target_in_eye = reference.position - rig.model.eye_in_world;
    if (const auto m = rig.model.projection.project(target_in_eye))
      overlay.target_px = rig.model.top_image.pixel_from_m(*m);
    overlay.scale_bar_px = 1e-3 / rig.model.top_image.pixel;
    overlay.scale_bar_label = "1 mm of aerial image";
    recorder.picture("frame_" + std::to_string(frame.number), wanted_picture,
                     vision::draw_overlay(frame.image, overlay));
    wanted_picture.clear();
  }

  void shut(ServoState state, const std::string& failure) {
    const StopShield shield(clock);
    try {
      if (state == ServoState::closed && rig.coils->enabled())
        switch_off();
      else
        rig.coils->make_safe();  // after a failure the interlock stays open until somebody closes it
    } catch (const std::exception& error) {
      recorder.event(clock.now(), "error", std::string("coils could not be set to zero: ") + error.what());
    }
    status.state = state;
    status.failure = failure;
    status.position.reset();
    if (!failure.empty()) recorder.event(clock.now(), "servo failed", failure);
    clock.notify(ticked);
  }

  enum class Mode { holding, following, released };
  Clock& clock;
  Rig& rig;
  Recorder& recorder;
  const ServoSettings settings;
  FrameToCurrents chain;
  const int samples, currents;
  Mode mode = Mode::holding;
  Eigen::Vector3d goal{0, 0, 0};
  std::optional<control::Path> path;
  bool starting = false, seen = false, let_go = false;
  Time path_start{}, last_seen{};
  ServoStatus status;
  Signal ticked;
  std::deque<std::pair<double, Eigen::Vector3d>> corrections;  // s, m/s
  std::deque<Eigen::Vector2d> trail;
  std::string wanted_picture;
  int pictures = 0, pictures_taken = 0;  // along the path that is being followed
  std::unique_ptr<Task> task;            // last: it ends before what it uses
};

Servo::Servo(Clock& clock, Rig& rig, Recorder& recorder, vision::Background background, const ServoSettings& settings) {
  settings.check();
  if (rig.top_camera == nullptr) throw std::invalid_argument("the servo needs the role top_camera");
  if (rig.coils == nullptr) throw std::invalid_argument("the servo needs the role coils");
  loop_ = std::make_unique<Loop>(clock, rig, recorder, std::move(background), settings);
  loop_->task = clock.spawn("servo", [loop = loop_.get()] { loop->run(); });
}

Servo::~Servo() { close(); }

ServoStatus Servo::status() const { return loop_->status; }
Signal& Servo::changed() { return loop_->ticked; }

void Servo::follow(const control::Path& path, int pictures) {
  loop_->path = path;
  loop_->pictures = pictures;
  loop_->pictures_taken = 0;
  loop_->starting = true;
  loop_->let_go = false;
  loop_->mode = Loop::Mode::following;
  loop_->status.progress = 0;
  loop_->corrections.clear();
}

void Servo::hold(const Eigen::Vector3d& position) {
  loop_->goal = position;
  loop_->mode = Loop::Mode::holding;
  loop_->let_go = false;
  loop_->corrections.clear();
}

void Servo::release() {
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

void Servo::set_trim(const Eigen::Vector3d& force) {
  if (!force.allFinite()) throw std::invalid_argument("trim: a force that is a number is wanted");
  loop_->chain.set_trim(force);
  loop_->corrections.clear();
}

Eigen::Vector3d Servo::trim() const { return loop_->chain.trim(); }

Eigen::Vector3d Servo::mean_correction(double duration) const {
  const auto& corrections = loop_->corrections;
  if (corrections.empty() || corrections.back().first - corrections.front().first < duration * 0.9)
    throw std::logic_error("mean_correction: the servo has not held this place for that long");
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const auto& [time, correction] : corrections) {
    if (time < corrections.back().first - duration) continue;
    sum += correction;
    ++count;
  }
  return loop_->chain.force_of(sum / count);
}

void Servo::snapshot(const std::string& caption) { loop_->wanted_picture = caption; }

void Servo::close() {
  if (!loop_->task) return;
  const StopShield shield(loop_->clock);
  loop_->task->request_stop();
  loop_->task->join();
  loop_->task.reset();
}

}  // namespace vitreo
