// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo.h"

#include "control/stability.h"
#include "devices/time/error.h"
#include "host/servo/attitude_loop.h"
#include "host/servo/observation_source.h"
#include "host/servo/plant_watch.h"
#include "host/servo/rotating_drive.h"
#include "host/servo/servo_cameras.h"
#include "host/servo/servo_record.h"
#include "host/servo/visibility.h"
#include "host/servo/wall_watch.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// How far mean_correction() can look back.
constexpr double kKeptCorrections = 30;  // s

/// How far the law estimator may raise the field where nothing else is said, and T, the most.
constexpr double kRaised = 3;
constexpr double kStrongestField = 40e-3;

/// m: nearer to a wall than this the robot's motion says nothing of the coils.
constexpr double kFree = 0.3e-3;

/// A per coil; 0 for those that are dead by the rig file or by the script.
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

/// What the controller needs of the settings, with the limits of the rig's coils.
ControllerSettings controller_settings(const Rig& rig, const ServoSettings& given, double period) {
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
  loop.tone = given.coil_tone;
  // Without a lens there are no walls to know of.
  loop.wall_drag = given.wall_drag && rig.model.eye.size() > 2;
  loop.field_max = given.field_max.value_or(
      std::max(given.field, std::min(kRaised * given.field, kStrongestField)));
  return loop;
}

control::AttitudeGains attitude_gains(const Rig& rig) {
  control::AttitudeGains gains;
  gains.either_end = !rig.model.robot.hard;
  return gains;
}

RotatingControllerSettings rotating_settings(const Rig& rig, const ServoSettings& given,
                                             double period) {
  RotatingControllerSettings settings;
  settings.law = given.rotating;
  settings.field = given.field;
  settings.axis = given.axis;
  settings.limits.currents = limits_of(rig, given.dead_coils);
  settings.limits.total = rig.coils->total_limit();
  settings.limits.lag = 1 / (2 * M_PI * rig.model.command_bandwidth);
  settings.period = period;
  return settings;
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
    case Feedback::color:
      return "top camera through the eye, by colors and shape";
    case Feedback::color_and_background:
      return "top camera through the eye, by colors and shape or by the background";
  }
  return "?";
}

/// Throws std::invalid_argument: a field model of another number of coils would set currents of the
/// wrong ones.
void check_coils(const Rig& rig) {
  if (rig.coils == nullptr) throw std::invalid_argument("the servo needs the role coils");
  if (rig.coils->channels() != rig.model.field.coils())
    throw std::invalid_argument(
        fmt::format("the field's model has {} coils, the amplifiers have {} channels",
                    rig.model.field.coils(), rig.coils->channels()));
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

/// All of the loop's state. Its task and the script's calls hold the clock's one baton in turn,
/// which changes hands only where one of them waits, so no lock is needed.
struct Servo::Loop {
  enum class Mode { holding, following, released, falling };

  /// Source and controller check their own settings and throw naming them.
  Loop(Clock& the_clock, Rig& the_rig, Recorder& the_recorder, ServoCameras given_cameras,
       const ServoSettings& given)
      : clock(the_clock),
        rig(the_rig),
        recorder(the_recorder),
        settings(given),
        source(the_clock, the_rig, the_recorder, std::move(given_cameras), given),
        controller(the_rig.model, controller_settings(the_rig, given, source.period())),
        archive(the_recorder, the_rig, given.axis, source_of(given.feedback),
                given.law == ControlLaw::estimator || given.law == ControlLaw::rotating),
        attitude(the_recorder, given.axis, attitude_gains(the_rig)),
        surface(the_rig.model, given.clearance_belief()),
        plant(the_rig.model),
        walls(the_rig.model.keep_out.margin) {
    if (given.law == ControlLaw::rotating)
      rotating.emplace(clock, rig, recorder, rotating_settings(rig, given, source.period()));
    keep_out(!given.may_touch);
    recorder.event(clock.now(), "feedback",
                   fmt::format("law {}, feedback {} ({})", to_string(given.law),
                               to_string(given.feedback), source_of(given.feedback)));
  }

  /// The loop's task: a turn for each frame until it is stopped or something fails.
  /// A stop of the loop sets the coils to zero; any other end makes the interlock open (shut()).
  /// Nothing leaves this function, as it is a task's body.
  void run() {
    heartbeat.emplace(*rig.coils, "the servo loop");
    try {
      while (true) tick();
    } catch (const Stopped&) {
      shut(ServoState::closed, "");
    } catch (const std::exception& error) {
      status.error = std::current_exception();
      shut(ServoState::failed, error.what());
    }
  }

  /// One turn: measurement, control, publication, record.
  /// The record comes after the currents, so that writing never delays them.
  void tick() {
    // Before the frame is waited for: the localizer takes the axis as its prior for that frame.
    expect_axis();
    const auto [frame, observation, distrusted] = source.next();
    const Time decided = clock.now();
    const double now = to_seconds(decided);
    beat();
    begin(now);
    look_at_walls(observation);
    const ControlStep step = drive(frame, now, observation);
    note_taken(observation, step, distrusted);
    watch_plant(frame, now, observation, step);
    const control::Reference target = reference.at(to_seconds(frame.exposed));
    watch_walls(frame, target, step);
    publish(frame, target, observation, step);
    archive.sample(frame.exposed, decided, clock.now(), observation, target, step);
    archive.clearance(frame.exposed, status.clearance, surface, step);
    // Picture k of n is due at the fraction k / (n + 1) of the way.
    if (mode == Mode::following && status.progress * (pictures + 1) >= pictures_taken + 1 &&
        pictures_taken < pictures)
      wanted_picture =
          fmt::format("at {:.0f} % of the path", 100.0 * ++pictures_taken / (pictures + 1));
    if (!wanted_picture.empty() && !frame.image.empty())
      archive.picture(frame, observation, target, std::exchange(wanted_picture, {}));
    if (mode == Mode::following && status.progress >= 1) mode = Mode::holding;
    clock.notify(ticked);
  }

  /// A path that was given between two frames begins with the next one.
  void begin(double now) {
    attitude.begin(now);
    begin_fall(now);
    if (!starting) return;
    reference.begin = now;
    starting = false;
  }

  /// What the next frame will show of the robot's axis; it is exposed a period after the last one.
  void expect_axis() {
    // Of a swimmer: it is at most half a radian behind the field, half of that in the mean.
    constexpr double kBehind = 0.25;  // rad
    if (rotating && rotating->shows_axis()) {
      const Eigen::Vector3d& axis = rotating->state().rotation.axis;
      source.expect_axis(axis);
      surface.expect_axis(axis, kBehind);
    } else if (!rotating && attitude.active()) {
      const Eigen::Vector3d axis = attitude.wanted(to_seconds(status.time) + source.period());
      source.expect_axis(axis);
      surface.expect_axis(axis, surface.belief().axis_sigma);
    }
  }

  /// A fall begins and ends with a turn: the times are those of its commands.
  void begin_fall(double now) {
    if (mode != Mode::falling) return;
    if (!fall.begun) {
      fall.off = now;
      fall.begun = true;
    } else if (now - fall.off >= fall.duration) {
      fall.on = now;
      fall.over = true;
      mode = Mode::holding;
    }
  }

  /// Seen means used: the dead-man is refreshed only while what moves the robot is steered by
  /// measurements that the controller took, or there is nothing that moves it yet, or any more.
  void beat() {
    if (!seen || let_go || to_seconds(clock.now() - taken_at) <= settings.lost_timeout)
      heartbeat->beat();
  }

  /// Better let it sink than drive it blind.
  void let_the_robot_go(const std::string& why) {
    let_go = true;
    switch_off();
    plant.forget();
    recorder.event(clock.now(), "lost", why + "; the coils are at zero");
    recorder.alarm(clock.now(), "robot lost", AlarmPriority::medium, why);
  }

  /// When a measurement was last taken, and what follows when that is too long ago; by the run's
  /// clock, as a stamp may be wrong. A robot that was let go counts as seen where it is seen.
  void note_taken(const Observation& observation, const ControlStep& step,
                  const std::string& distrusted) {
    if (!distrusted.empty()) not_taken = distrusted;
    if (observation.position && step.passed_over)
      not_taken = "measurements were passed over: not a number, out of order, or a leap";
    if (observation.position && !step.passed_over) {
      taken_at = clock.now();
      not_taken.clear();
      seen = true;
    }
    if (seen && !let_go && to_seconds(clock.now() - taken_at) > settings.lost_timeout)
      let_the_robot_go(not_taken.empty()
                           ? "the robot was not seen for the time allowed"
                           : "no measurement could be used for the time allowed: " + not_taken);
  }

  /// Amplifiers and coils, by what the robot does. Not by the laws for media that the model does
  /// not know, nor beside a wall, where contact holds the robot.
  void watch_plant(const Frame& frame, double now, const Observation& observation,
                   const ControlStep& step) {
    if (settings.law != ControlLaw::pd && settings.law != ControlLaw::estimator) return;
    // What a filter takes for a leap is what a coil that fails looks like, and is heard too.
    if (let_go || (status.clearance && status.clearance->nearest().distance <= kFree))
      plant.forget();
    else if (status.clearance && observation.position)
      plant.measured(to_seconds(frame.exposed), *observation.position, observation.noise(),
                     step.estimate ? step.estimate->delay : 0);
    const std::vector<double> sent = rig.coils->currents();
    plant.commanded(
        now, Eigen::Map<const Eigen::VectorXd>(sent.data(), static_cast<Eigen::Index>(sent.size())),
        controller.drag_at(observation.position.value_or(goal)).inverse());
    if (!plant.fault().empty()) {
      recorder.alarm(clock.now(), "coils do not obey", AlarmPriority::high, plant.fault());
      throw DeviceError(DeviceErrorKind::protocol, "coils", plant.fault());
    }
    if (plant.standing() && settings.feedback != Feedback::none && !may_touch)
      let_the_robot_go(
          "the robot is told to go and stands where it is seen: it is held, or the view is old");
  }

  void look_at_walls(const Observation& observation) {
    status.clearance.reset();
    status.position = observation.position;
    if (observation.position)
      status.clearance = surface.at(*observation.position, observation.noise());
  }

  /// Alarms: inside the margin, and pushed against a wall that the position does not show. In that
  /// case the view is wrong by what it shows there, and is believed so from then on.
  void watch_walls(const Frame& frame, const control::Reference& target, const ControlStep& step) {
    // Clearance and position are of this frame, the command of this turn: what the loop knew when
    // it decided.
    report(step.kept_out, was_kept_out,
           "the keep-out margin changes the command: the robot would come nearer to a wall");
    if (!status.clearance || !status.position || may_touch || let_go) return walls.forget();
    const control::Clearance& near = *status.clearance;
    const WallWatch::Verdict verdict =
        walls.see({to_seconds(frame.exposed), near, *status.position, target.position,
                   step.kept_out || mode == Mode::released});
    if (verdict.inside && !std::exchange(was_inside, true))
      recorder.alarm(clock.now(), "keep-out margin", AlarmPriority::high,
                     "the robot's surface is " + clearance_text(near) + ": raise it");
    was_inside = verdict.inside;
    if (!verdict.pressed) return;
    recorder.alarm(clock.now(), "pushed against a wall", AlarmPriority::high,
                   "the robot does not come nearer to a wall, though it is told to: it is taken to "
                   "touch it, where the view shows it " +
                       clearance_text(near));
    surface.felt(near.at_lens(), near.nearest().distance);
    walls.forget();
  }

  /// What the interlock judges by: the speed at which these currents alone drive the robot towards
  /// the nearest wall, by the model.
  void report_nearness(const control::Currents& currents) {
    if (!status.clearance || !status.position || may_touch) return rig.coils->near(std::nullopt);
    const control::WallClearance& wall = status.clearance->nearest();
    const RigModel& model = rig.model;
    Eigen::Vector3d force = control::force_at(model.field, model.robot, model.medium, currents,
                                              model.field.nearest_valid(*status.position));
    // force_at() has the weight in it; what the currents do alone is wanted here.
    force.z() += model.robot.net_weight(model.medium);
    const Eigen::Vector3d driven = controller.drag_at(*status.position).inverse() * force;
    rig.coils->near(Interlock::Nearness{status.clearance->at_lens() ? "lens" : "retina",
                                        wall.bound(), surface.margin(), -wall.normal.dot(driven)});
  }

  /// What helps where a limit cuts: a soft robot's moment grows with its field.
  std::string advice() const {
    if (rotating) return "";
    const auto stronger = controller.stronger_field();
    if (!stronger) return "; no stronger field helps";
    return ": raise the field to " + format_quantity(*stronger, "T") + " (field, field_max)";
  }

  void report(bool is, bool& was, const std::string& what) {
    if (is && !was) recorder.event(clock.now(), "degraded", what);
    was = is;
  }

  /// The measurement keeps the time of its exposure; what became of the robot since then is the
  /// law's to predict.
  ControlStep drive(const Frame& frame, double now, const Observation& observation) {
    // What was let go is not taken up again until a new goal is given.
    if (let_go) {
      controller.reset();
      return {};
    }
    std::optional<control::PositionMeasurement> measured;
    if (observation.position)
      measured = control::PositionMeasurement{to_seconds(frame.exposed), *observation.position,
                                              observation.noise()};
    attitude.observe(frame.exposed, observation);
    // The field set now acts after the coils' delay.
    if (attitude.active()) {
      controller.set_axis(attitude.field_direction(now + rig.model.command_delay));
      archive.set_axis(attitude.wanted(now));
    }
    if (rotating) {
      const ControlStep turn =
          rotating->step(now, measured, reference, control_mode(), frame.exposed);
      if (observation.position) remember(to_seconds(frame.exposed), turn.correction);
      report_limits(turn);
      return turn;
    }
    ControlStep step = controller.step(now, measured, reference, control_mode());
    if (observation.position) remember(to_seconds(frame.exposed), step.correction);
    // Before the first detection only the field: it turns the robot into the axis that is expected.
    const bool taken = observation.position && !step.passed_over;
    if (!seen && !taken && control_mode() != ControlMode::constant)
      send(controller.orienting_currents());
    else if (step.currents.size() > 0)
      send(step.currents);
    report_limits(step);
    return step;
  }

  /// Released, the field follows the robot, except where no camera is in the loop: then the
  /// currents stay as they are (thesis 6.1, case a).
  ControlMode control_mode() const {
    if (mode == Mode::falling) return ControlMode::off;
    if (mode != Mode::released) return ControlMode::follow;
    if (settings.feedback == Feedback::none) return ControlMode::constant;
    return canceling ? ControlMode::cancel : ControlMode::leave;
  }

  /// An event "degraded" each time that a limitation begins.
  void report_limits(const ControlStep& step) {
    report(step.limited, was_limited,
           "a current limit cuts field or lateral force; the vertical force comes first" +
               (step.limited && !was_limited ? advice() : ""));
    report(
        step.outside, was_outside,
        "the robot is outside the region of the field's model: the field of the nearest place in "
        "it is used");
    // Touched now and then while the robot rests, when nothing shows the delay: that says nothing.
    constexpr double kBoundMemory = 2;  // s
    bounded += ((step.at_bound ? 1 : 0) - bounded) * std::min(1.0, source.period() / kBoundMemory);
    report(bounded > 0.5, was_at_bound,
           "the robot's response or the loop's delay is farther from the model than the loop's "
           "filter can follow");
    report(step.inconsistent, was_inconsistent,
           "the robot does not move as the loop's filter expects: its innovations are more than "
           "twice as large as it says");
    report_quality(step.quality);
    report(step.passed_over, was_passed_over,
           "a measurement was passed over: not a number, out of order, or a leap");
  }

  /// What is wrong with the control: an event "control" when it begins, and an alarm of that name.
  void report_quality(const LoopQuality& now) {
    const auto report = [this](bool is, bool was, const char* name, const std::string& what) {
      if (!is || was) return;
      recorder.event(clock.now(), "control", std::string(name) + ": " + what);
      recorder.alarm(clock.now(), name, AlarmPriority::medium, what);
    };
    report(now.oscillating, quality.oscillating, "oscillation",
           fmt::format("the robot goes to and fro about its target by {} in {}",
                       format_quantity(now.amplitude, "m"), format_quantity(now.period, "s")));
    report(now.standing, quality.standing, "standstill",
           "the robot is told to move and stands: it is held, or at a wall");
    report(now.capped, quality.capped, "speed cap",
           "for seconds the robot has been farther away than the largest speed of the feedback "
           "makes good");
    report(now.clamped, quality.clamped, "disturbance clamp",
           "what pushes the robot is more than a free robot shows: it is held fast, or the field "
           "is not as commanded");
    report(now.weak_coil != 0, quality.weak_coil == now.weak_coil, "weak coil",
           fmt::format("coil {} seems to carry {:.0f} % of what it is given", now.weak_coil,
                       100 * std::max(0.0, 1 - now.lack)));
    worst.oscillating |= now.oscillating;
    worst.standing |= now.standing;
    worst.capped |= now.capped;
    worst.clamped |= now.clamped;
    if (now.weak_coil != 0) worst.weak_coil = now.weak_coil;
    quality = now;
  }

  void send(const control::Currents& wanted) {
    const std::vector<double> sent =
        rig.coils->reachable({wanted.data(), static_cast<std::size_t>(wanted.size())});
    const Eigen::Map<const Eigen::VectorXd> currents(sent.data(),
                                                     static_cast<Eigen::Index>(sent.size()));
    report_nearness(currents);
    expect_motion(currents);
    rig.coils->set_currents(sent);
  }

  /// Where these currents take the robot, by the model, weight included.
  void expect_motion(const control::Currents& currents) {
    if (status.position) expected_at = *status.position;
    if (!source.gated() || !expected_at) return;
    const RigModel& model = rig.model;
    const Eigen::Vector3d force = control::force_at(
        model.field, model.robot, model.medium, currents, model.field.nearest_valid(*expected_at));
    source.expect_motion(to_seconds(clock.now()) + model.command_delay,
                         controller.drag_at(*expected_at).inverse() * force);
  }

  void switch_off() {
    if (rotating) rotating->stop();
    expect_motion(control::Currents::Zero(rig.model.field.coils()));
    rig.coils->set_currents(
        std::vector<double>(static_cast<std::size_t>(rig.coils->channels()), 0.0));
  }

  /// For mean_correction(): a sliding window of the velocities asked for.
  void remember(double time, const Eigen::Vector3d& correction) {
    corrections.emplace_back(time, correction);
    while (corrections.front().first < time - kKeptCorrections) corrections.pop_front();
  }

  /// "searching" and "lost" outrank the mode: no path is being followed that cannot be seen.
  void publish(const Frame& frame, const control::Reference& target, const Observation& observation,
               const ControlStep& step) {
    status.time = frame.exposed;
    status.position = observation.position;
    status.disturbance.reset();
    if (step.estimate) status.disturbance = step.estimate->unexplained();
    status.target = target.position;
    status.direction = attitude.wanted(to_seconds(frame.exposed));
    status.axis = observation.position ? attitude.measured() : std::nullopt;
    status.turned = attitude.turned(to_seconds(frame.exposed));
    if (step.currents.size() > 0) status.field = step.field;
    status.headroom = step.headroom;
    status.limited = step.limited;
    status.kept_out = step.kept_out;
    status.progress = 1;
    // By the exposure: what the robot had reached then is compared with what it was to reach then.
    const double since = to_seconds(frame.exposed) - reference.begin;
    // A path that was given while this turn's currents were on their way begins with the next turn;
    // measured from the begin of the path before it might count as done already.
    if (mode == Mode::following && starting)
      status.progress = 0;
    else if (mode == Mode::following)
      status.progress = std::clamp(since / std::max(reference.path.duration(), 1e-9), 0.0, 1.0);
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

  /// Checked before anything is changed, so a path that is refused leaves the loop as it was.
  void set_goal(Mode wanted, const control::Trajectory& path, int wanted_pictures) {
    check_reach(rig.model, path);
    if (!settings.may_touch) surface.check(path);
    if (looks(settings.feedback) || settings.stays_in_sight)
      check_visible(rig.model, rig.top_camera->info(), settings.view.image_scale, path);
    reference = {path, reference.begin};
    starting = true;
    goal = path.at(path.duration()).position;
    if (rotating) rotating->steer();
    pictures = wanted_pictures;
    pictures_taken = 0;
    mode = wanted;
    // Behind the checks: a goal that is refused does not take a lost robot up again.
    let_go = false;
    corrections.clear();
    worst = {};
    allow_touch(settings.may_touch);
  }

  /// A robot that is laid on the retina on purpose; the record says so.
  void allow_touch(bool allowed) {
    walls.forget();
    keep_out(!allowed);
    if (allowed != std::exchange(may_touch, allowed))
      recorder.event(clock.now(), "keep-out margin", allowed ? "off: the robot may touch" : "on");
  }

  /// Of the law in use; the other has no say.
  void keep_out(bool keeps) {
    const RobotClearance* const walls_of = keeps ? &surface : nullptr;
    controller.keep_out(walls_of);
    if (rotating) rotating->keep_out(walls_of);
  }

  /// The end of the loop: zero current, and the interlock open after a failure until it is enabled
  /// again. A failure of that does not hide the first one.
  void shut(ServoState state, const std::string& failure) {
    // The heartbeat goes first: a loop that is about to end must not trip the interlock's dead-man
    // while it sets the coils to zero.
    const StopShield shield(clock);  // a stop of the run does not interrupt this
    heartbeat.reset();
    if (rotating) rotating->stop();
    try {
      if (state == ServoState::closed && rig.coils->enabled())
        switch_off();
      else
        rig.coils->make_safe();
    } catch (const std::exception& error) {
      recorder.event(clock.now(), "error",
                     std::string("coils could not be set to zero: ") + error.what());
    }
    source.report_counts();
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
  ObservationSource source;
  ServoController controller;
  ServoRecord archive;
  AttitudeLoop attitude;
  std::optional<RotatingDrive> rotating;          // of that law, in the controller's place
  std::optional<Interlock::Heartbeat> heartbeat;  // while the loop runs
  Mode mode = Mode::holding;
  ReferencePath reference;
  Eigen::Vector3d goal{0, 0, 0};  // m, the end of the reference
  bool starting = false;          // the reference's time has not begun
  bool seen = false;              // once at least
  bool let_go = false;            // lost for longer than the timeout: zero current
  bool canceling = false;         // of mode released
  bool was_limited = false;
  bool was_outside = false;
  bool was_passed_over = false;
  bool was_at_bound = false;
  double bounded = 0;  // part of the last turns in which the filter met a bound
  bool was_inconsistent = false;
  RobotClearance surface;
  PlantWatch plant;
  WallWatch walls;
  bool may_touch = false;
  bool was_kept_out = false;
  bool was_inside = false;
  LoopQuality quality;  // of the last turn
  LoopQuality worst;    // of all since the last goal
  struct {
    double duration = 0;  // s
    double off = 0;       // s, of the command
    double on = 0;        // s, of the first command after it
    bool begun = false;
    bool over = true;
  } fall;
  Time taken_at{};                             // when a measurement was last taken
  std::string not_taken;                       // why the last one was not
  std::optional<Eigen::Vector3d> expected_at;  // m, world: where the robot was seen last
  ServoStatus status;
  Signal ticked;
  std::deque<std::pair<double, Eigen::Vector3d>> corrections;  // s, m/s
  std::string wanted_picture;
  int pictures = 0;  // wanted along the path that is being followed
  int pictures_taken = 0;
  std::unique_ptr<Task> task;  // last: it ends before what it uses
};

/// The task is started last, with all in place that it uses.
Servo::Servo(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras cameras,
             const ServoSettings& settings) {
  settings.check();
  check_coils(rig);
  loop_ = std::make_unique<Loop>(clock, rig, recorder, std::move(cameras), settings);
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

/// The progress is 0 at once: a script may wait for it before the next frame has come.
void Servo::follow(const control::Trajectory& path, int pictures) {
  loop_->set_goal(Loop::Mode::following, path, pictures);
  loop_->status.progress = 0;
}

void Servo::hold(const Eigen::Vector3d& position) {
  loop_->set_goal(Loop::Mode::holding, control::Trajectory::hold_at(position), 0);
}

void Servo::turn(const control::DirectionPath& path) {
  if (loop_->rotating)
    throw std::invalid_argument("direction: the law \"rotating\" steers by the axis itself");
  loop_->attitude.turn(path);
  loop_->status.turned = false;
}

Eigen::Vector3d Servo::direction() const {
  return loop_->attitude.wanted(to_seconds(loop_->clock.now()));
}

/// Throws std::invalid_argument for another law, which has no estimate of a disturbance.
void Servo::release(bool cancel, bool touch) {
  if (cancel && loop_->settings.law != ControlLaw::estimator)
    throw std::invalid_argument("cancel: only the law \"estimator\" knows what pushes the robot");
  if (loop_->rotating) loop_->rotating->steer();
  loop_->canceling = cancel;
  loop_->allow_touch(touch || loop_->settings.may_touch);
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

void Servo::spin(const Eigen::Vector3d& axis, double frequency) {
  if (!loop_->rotating) throw std::invalid_argument("only the law \"rotating\" turns the field");
  loop_->rotating->spin(axis, frequency);
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

std::optional<RotationState> Servo::rotation() const {
  if (!loop_->rotating) return std::nullopt;
  return loop_->rotating->state();
}

/// Corrections from before belong to another trim and would falsify the mean.
void Servo::set_trim(const Eigen::Vector3d& force) {
  loop_->controller.set_trim(force, loop_->goal);
  loop_->corrections.clear();
}

Eigen::Vector3d Servo::trim() const { return loop_->controller.trim(); }

/// An event of the record, since positions differ by it from there on.
void Servo::set_offset(const Eigen::Vector3d& offset) {
  constexpr double kLargest = 1e-3;  // m: more is no bias but another position
  if (!(offset.norm() <= kLargest))
    throw std::invalid_argument("offset: wants at most " + format_quantity(kLargest, "m") +
                                ", got " + format_quantity(offset.norm(), "m"));
  loop_->source.set_offset(offset);
  loop_->recorder.event(loop_->clock.now(), "offset",
                        nlohmann::json{offset.x(), offset.y(), offset.z()}.dump());
}

Eigen::Vector3d Servo::offset() const { return loop_->source.offset(); }

Eigen::Vector3d Servo::force_for(const Eigen::Vector3d& velocity) const {
  return loop_->controller.force_of(velocity);
}

/// The robot stands still on average, so the velocity asked for balances what the model lacks:
/// f = R mean(v) (the thesis trims by hand, 6.1).
Eigen::Vector3d Servo::mean_correction(double duration) const {
  const auto& corrections = loop_->corrections;
  // Nine tenths: samples come with the frames, not at the ends of the time asked for.
  if (corrections.empty() || corrections.back().first - corrections.front().first < duration * 0.9)
    throw std::logic_error("mean_correction: the servo has not held this place for that long");
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const auto& [time, correction] : corrections) {
    if (time < corrections.back().first - duration) continue;
    sum += correction;
    ++count;
  }
  return loop_->controller.force_of(sum / count);
}

std::optional<ServoMargins> Servo::margins() const { return loop_->controller.margins(); }

double Servo::margin() const { return loop_->surface.margin(); }
/// Throws std::invalid_argument for a duration out of bounds, std::logic_error for a law that would
/// not know of the fall.
void Servo::let_fall(double duration) {
  constexpr double kLongest = 1;  // s
  if (!(duration > 0 && duration <= kLongest))
    throw std::invalid_argument("duration: wants more than 0 s and at most " +
                                format_quantity(kLongest, "s"));
  if (loop_->settings.law != ControlLaw::estimator)
    throw std::logic_error("let_fall: only the law \"estimator\" reckons with a fall");
  loop_->fall = {duration, 0, 0, false, false};
  loop_->mode = Loop::Mode::falling;
}

std::optional<std::pair<double, double>> Servo::last_fall() const {
  if (!loop_->fall.over || !loop_->fall.begun) return std::nullopt;
  return std::pair{loop_->fall.off, loop_->fall.on};
}

LoopQuality Servo::quality() const { return loop_->worst; }

/// The next frame with an image takes it; a caption that is still waiting is replaced.
void Servo::snapshot(const std::string& caption) { loop_->wanted_picture = caption; }

/// With the caller's own stop deferred, as the coils must be at zero before it goes on. Also called
/// by the destructor.
void Servo::close() {
  if (!loop_->task) return;
  const StopShield shield(loop_->clock);
  loop_->task->request_stop();
  loop_->task->join();
  loop_->task.reset();
}

}  // namespace vitreo
