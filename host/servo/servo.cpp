// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo.h"

#include "host/servo/observation_source.h"
#include "host/servo/servo_record.h"
#include "host/servo/visibility.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr double kKeptCorrections = 30;  // s
control::CurrentLimits limits_of(const Rig& rig, const std::vector<int>& dead) {
  control::CurrentLimits limits =
      control::CurrentLimits::Constant(rig.model.field.coils(), rig.coils->current_limit());
  for (const std::vector<int>& list : {rig.model.dead_coils, dead}) {
    for (const int channel : list) {
      if (channel < 1 || channel > limits.size())
        throw std::invalid_argument(fmt::format("dead_coils: there is no coil {}", channel));
      limits[channel - 1] = 0;
    }
  }
  return limits;
}

ControllerSettings loop_settings(const Rig& rig, const ServoSettings& given, double period) {
  ControllerSettings loop;
  loop.field = given.field;
  loop.axis = given.axis;
  loop.law = given.law;
  loop.gains = given.gains;
  loop.proportional = given.proportional;
  loop.max_speed = given.max_speed;
  loop.velocity = given.velocity;
  loop.limits = limits_of(rig, given.dead_coils);
  loop.total_limit = rig.coils->total_limit();
  loop.period = period;
  loop.wall_drag = given.wall_drag;
  return loop;
}

const char* source_of(Feedback feedback) {
  switch (feedback) {
    case Feedback::none:
      return "top camera through the eye (no feedback: an operator's eye)";
    case Feedback::one_camera:
      return "top camera through the eye";
    case Feedback::two_cameras:
      return "top camera through the eye and side camera";
    case Feedback::pose_sensor:
      return "pose sensor: the simulator's truth, late and noisy";
  }
  return "?";
}

void check_coils(const Rig& rig) {
  if (rig.coils == nullptr) throw std::invalid_argument("the servo needs the role coils");
  if (rig.coils->channels() != rig.model.field.coils())
    throw std::invalid_argument(
        fmt::format("the field's model has {} coils, the amplifiers have {} channels",
                    rig.model.field.coils(), rig.coils->channels()));
}

}  // namespace

struct Servo::Loop {
  enum class Mode { holding, following, released };

  Loop(Clock& the_clock, Rig& the_rig, Recorder& the_recorder, ServoCameras given_eyes,
       const ServoSettings& given)
      : clock(the_clock),
        rig(the_rig),
        recorder(the_recorder),
        settings(given),
        sight(the_clock, the_rig, the_recorder, std::move(given_eyes), given),
        chain(the_rig.model, loop_settings(the_rig, given, sight.period())),
        archive(the_recorder, the_rig, source_of(given.feedback),
                given.law == ControlLaw::estimator) {
    recorder.event(clock.now(), "feedback",
                   fmt::format("law {}, feedback {} ({})", to_string(given.law),
                               to_string(given.feedback), source_of(given.feedback)));
  }

  void run() {
    heart.emplace(*rig.coils, "the servo loop");
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
    const auto [frame, observation] = sight.look();
    heart->beat();
    const double now = to_seconds(clock.now());
    begin(now);
    note_sight(frame, observation);
    const ControlStep step = drive(frame, now, observation);
    const control::Reference target = course.at(to_seconds(frame.exposed));
    publish(frame, target, observation, step);
    archive.sample(frame.exposed, clock.now(), observation, target, step);
    if (mode == Mode::following && status.progress * (pictures + 1) >= pictures_taken + 1 &&
        pictures_taken < pictures)
      wanted_picture =
          fmt::format("at {:.0f} % of the path", 100.0 * ++pictures_taken / (pictures + 1));
    if (!wanted_picture.empty() && !frame.image.empty())
      archive.picture(frame, observation, target, std::exchange(wanted_picture, {}));
    if (mode == Mode::following && status.progress >= 1) mode = Mode::holding;
    clock.notify(ticked);
  }

  void begin(double now) {
    if (!starting) return;
    course.begin = now;
    starting = false;
  }

  void note_sight(const Frame& frame, const Observation& observation) {
    if (observation.position) {
      last_seen = frame.exposed;
      seen = true;
    } else if (seen && !let_go && to_seconds(frame.exposed - last_seen) > settings.lost_timeout) {
      let_go = true;  // better let it sink than drive it blind
      switch_off();
      recorder.event(clock.now(), "lost",
                     "the robot was not seen for the time allowed; the coils are at zero");
      recorder.alarm(clock.now(), "robot lost", AlarmPriority::medium,
                     "it was not seen for the time allowed");
    }
  }

  ControlStep drive(const Frame& frame, double now, const Observation& observation) {
    // What was let go is not taken up again until somebody says where to.
    if (let_go) {
      chain.reset();
      return {};
    }
    std::optional<control::PositionMeasurement> measured;
    if (observation.position)
      measured = control::PositionMeasurement{to_seconds(frame.exposed), *observation.position,
                                              observation.covariance};
    ControlStep step = chain.step(now, measured, course, aim());
    if (observation.position) remember(to_seconds(frame.exposed), step.correction);
    if (!seen && aim() != Aim::constant)
      send(chain.orienting_currents());
    else if (step.currents.size() > 0)
      send(step.currents);
    tell_limits(step);
    return step;
  }

  Aim aim() const {
    if (mode != Mode::released) return Aim::follow;
    if (settings.feedback == Feedback::none) return Aim::constant;
    return canceling ? Aim::cancel : Aim::leave;
  }

  /// Degraded, and says so: once for each time that it begins.
  void tell_limits(const ControlStep& step) {
    const auto tell = [this](bool is, bool& was, const char* what) {
      if (is && !was) recorder.event(clock.now(), "degraded", what);
      was = is;
    };
    tell(step.limited, was_limited,
         "a current limit cuts field or lateral force; the vertical force comes first");
    tell(step.outside, was_outside,
         "the robot is outside the region of the field's model: the field of the nearest place in "
         "it is used");
    tell(step.passed_over, was_passed_over,
         "a measurement was passed over: not a number, out of order, or a leap");
  }

  void send(const control::Currents& wanted) {
    rig.coils->set_currents({wanted.data(), static_cast<std::size_t>(wanted.size())});
  }

  void switch_off() {
    rig.coils->set_currents(
        std::vector<double>(static_cast<std::size_t>(rig.coils->channels()), 0.0));
  }

  void remember(double time, const Eigen::Vector3d& correction) {
    corrections.emplace_back(time, correction);
    while (corrections.front().first < time - kKeptCorrections) corrections.pop_front();
  }

  void publish(const Frame& frame, const control::Reference& target, const Observation& observation,
               const ControlStep& step) {
    status.time = frame.exposed;
    status.position = observation.position;
    status.disturbance.reset();
    if (step.estimate) status.disturbance = step.estimate->disturbance;
    status.target = target.position;
    status.headroom = step.headroom;
    status.limited = step.limited;
    status.progress = 1;
    const double since = to_seconds(frame.exposed) - course.begin;
    if (mode == Mode::following)
      status.progress = std::clamp(since / std::max(course.path.duration(), 1e-9), 0.0, 1.0);
    if (!seen)
      status.state = ServoState::searching;
    else if (let_go)
      status.state = ServoState::lost;
    else if (mode == Mode::released)
      status.state = ServoState::released;
    else
      status.state = mode == Mode::following && status.progress < 1 ? ServoState::following
                                                                    : ServoState::holding;
  }

  void aim_at(Mode wanted, const control::Trajectory& path, int wanted_pictures) {
    check_reach(rig.model, path);
    if (settings.feedback == Feedback::one_camera || settings.feedback == Feedback::two_cameras)
      check_visible(rig.model, rig.top_camera->info(), settings.view.image_scale, path);
    course = {path, course.begin};
    starting = true;
    goal = path.at(path.duration()).position;
    pictures = wanted_pictures;
    pictures_taken = 0;
    mode = wanted;
    let_go = false;
    corrections.clear();
  }

  void shut(ServoState state, const std::string& failure) {
    const StopShield shield(clock);
    heart.reset();
    try {
      if (state == ServoState::closed && rig.coils->enabled())
        switch_off();
      else
        rig.coils
            ->make_safe();  // after a failure the interlock stays open until somebody closes it
    } catch (const std::exception& error) {
      recorder.event(clock.now(), "error",
                     std::string("coils could not be set to zero: ") + error.what());
    }
    sight.tell();
    status.state = state;
    status.failure = failure;
    status.position.reset();
    if (!failure.empty()) recorder.event(clock.now(), "servo failed", failure);
    clock.notify(ticked);
  }

  Clock& clock;
  Rig& rig;
  Recorder& recorder;
  const ServoSettings settings;
  ObservationSource sight;
  ServoController chain;
  ServoRecord archive;
  std::optional<Interlock::Heartbeat> heart;  // while the loop runs
  Mode mode = Mode::holding;
  ReferencePath course;
  Eigen::Vector3d goal{0, 0, 0};  // the end of the course
  bool starting = false, seen = false, let_go = false, canceling = false;
  bool was_limited = false, was_outside = false, was_passed_over = false;
  Time last_seen{};
  ServoStatus status;
  Signal ticked;
  std::deque<std::pair<double, Eigen::Vector3d>> corrections;  // s, m/s
  std::string wanted_picture;
  int pictures = 0, pictures_taken = 0;  // along the path that is being followed
  std::unique_ptr<Task> task;            // last: it ends before what it uses
};

Servo::Servo(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras eyes,
             const ServoSettings& settings) {
  settings.check();
  check_coils(rig);
  loop_ = std::make_unique<Loop>(clock, rig, recorder, std::move(eyes), settings);
  const Eigen::Vector3d& axis = settings.axis;  // a replay of the frames needs it
  recorder.event(clock.now(), "servo",
                 nlohmann::json{{"axis", {axis.x(), axis.y(), axis.z()}},
                                {"axis_sigma", settings.axis_uncertainty()},
                                {"field", settings.field}}
                     .dump());
  loop_->task = clock.spawn("servo", [loop = loop_.get()] { loop->run(); });
}

Servo::~Servo() { close(); }

ServoStatus Servo::status() const { return loop_->status; }
Signal& Servo::changed() { return loop_->ticked; }
const ServoSettings& Servo::settings() const { return loop_->settings; }

void Servo::follow(const control::Trajectory& path, int pictures) {
  loop_->aim_at(Loop::Mode::following, path, pictures);
  loop_->status.progress = 0;
}

void Servo::hold(const Eigen::Vector3d& position) {
  loop_->aim_at(Loop::Mode::holding, control::Trajectory::hold_at(position), 0);
}

void Servo::release(bool cancel) {
  if (cancel && loop_->settings.law != ControlLaw::estimator)
    throw std::invalid_argument("cancel: only the law \"estimator\" knows what pushes the robot");
  loop_->canceling = cancel;
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

void Servo::set_trim(const Eigen::Vector3d& force) {
  loop_->chain.set_trim(force, loop_->goal);
  loop_->corrections.clear();
}

Eigen::Vector3d Servo::trim() const { return loop_->chain.trim(); }

void Servo::set_offset(const Eigen::Vector3d& offset) {
  constexpr double kLargest = 1e-3;  // m: more is no bias but another place
  if (!(offset.norm() <= kLargest))
    throw std::invalid_argument("offset: must be finite and at most 1 mm");
  loop_->sight.set_offset(offset);
  loop_->recorder.event(loop_->clock.now(), "offset",
                        nlohmann::json{offset.x(), offset.y(), offset.z()}.dump());
}

Eigen::Vector3d Servo::offset() const { return loop_->sight.offset(); }

Eigen::Vector3d Servo::force_for(const Eigen::Vector3d& velocity) const {
  return loop_->chain.force_of(velocity);
}

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
