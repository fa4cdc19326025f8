// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_loop.h"

#include "control/stability.h"
#include "devices/time/error.h"
#include "host/servo/loop_settings.h"
#include "host/servo/visibility.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo {
namespace {

/// How far mean_correction() can look back.
constexpr double kKeptCorrections = 30;  // s

/// m: nearer to a wall than this the robot's motion says nothing of the coils.
constexpr double kFree = 0.3e-3;

}  // namespace

Servo::Loop::Loop(Clock& the_clock, Rig& the_rig, Recorder& the_recorder,
                  ServoCameras given_cameras, const ServoSettings& given)
    : clock(the_clock),
      rig(the_rig),
      recorder(the_recorder),
      settings(given),
      made_at(the_clock.now()),
      source(the_clock, the_rig, the_recorder, std::move(given_cameras), given),
      controller(the_rig.model, controller_settings(the_rig, given, source.period())),
      archive(the_recorder, the_rig, given.axis, source_of(given.feedback),
              given.law == ControlLaw::estimator || given.law == ControlLaw::rotating),
      reports(the_clock, the_recorder),
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

void Servo::Loop::run() {
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

/// A frame that was on its way before the loop began may show what is not there any more: the robot
/// before it was put elsewhere.
ObservationSource::ObservedFrame Servo::Loop::next() {
  for (;;) {
    ObservationSource::ObservedFrame found = source.next();
    if (found.frame.exposed >= made_at) return found;
  }
}

void Servo::Loop::tick() {
  take_offset();
  // Before the frame is waited for: the localizer takes the axis as its prior for that frame.
  expect_axis();
  const auto [frame, observation, distrusted] = next();
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
    wanted_picture = fmt::format("{}: at {:.0f} % of the path", to_string(settings.law),
                                 100.0 * ++pictures_taken / (pictures + 1));
  if (!wanted_picture.empty() && !frame.image.empty())
    archive.picture(frame, observation, target, std::exchange(wanted_picture, {}));
  if (mode == Mode::following && status.progress >= 1) mode = Mode::holding;
  clock.notify(ticked);
}

void Servo::Loop::begin(double now) {
  attitude.begin(now);
  begin_fall(now);
  if (!starting) return;
  reference.begin = now;
  starting = false;
}

void Servo::Loop::expect_axis() {
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
  } else if (!rotating && settings.feedback == Feedback::none && status.position) {
    // Constant currents turn the robot as it drifts away from where they were made for.
    const control::FieldModel& field = rig.model.field;
    const Eigen::Vector3d known = field.nearest_valid(*status.position);
    const control::Currents flowing = plant.flowing_at(to_seconds(status.time) + source.period());
    const Eigen::Vector3d made =
        (field.matrix(known) * flowing + field.background(known)).head<3>();
    if (!(made.norm() > 0)) return;
    source.expect_axis(made.normalized());
    surface.expect_axis(made.normalized(), surface.belief().axis_sigma);
  }
}

void Servo::Loop::begin_fall(double now) {
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

void Servo::Loop::beat() {
  if (!seen || let_go || to_seconds(clock.now() - taken_at) <= settings.lost_timeout)
    heartbeat->beat();
}

void Servo::Loop::let_the_robot_go(const std::string& why) {
  let_go = true;
  switch_off();
  plant.forget();
  recorder.event(clock.now(), "lost", why + "; the coils are at zero");
  recorder.alarm(clock.now(), "robot lost", AlarmPriority::medium, why);
}

void Servo::Loop::note_taken(const Observation& observation, const ControlStep& step,
                             const std::string& distrusted) {
  if (!distrusted.empty()) not_taken = distrusted;
  if (observation.position && step.passed_over)
    not_taken = "measurements were passed over: not a number, out of order, or a leap";
  if (observation.position && !step.passed_over) {
    taken_at = clock.now();
    not_taken.clear();
    if (!std::exchange(seen, true)) plant.found(to_seconds(taken_at));
  }
  if (seen && !let_go && to_seconds(clock.now() - taken_at) > settings.lost_timeout)
    let_the_robot_go(not_taken.empty()
                         ? "the robot was not seen for the time allowed"
                         : "no measurement could be used for the time allowed: " + not_taken);
}

/// A correction of the view is no motion of the robot. It may be given while a turn waits; the turn
/// ends with the view that it began with, so that no place of the one is held against the other's.
/// Of two cameras the corrected one has a share in the position that differs from frame to frame:
/// the filter finds it out.
void Servo::Loop::take_offset() {
  const Eigen::Vector3d by = offset - source.offset();
  if (by.isZero(0)) return;
  source.set_offset(offset);
  // A pose sensor's readings are not corrected.
  if (settings.feedback != Feedback::two_cameras && settings.feedback != Feedback::pose_sensor)
    controller.view_moved(by);
  plant.forget();
  walls.forget();
}

/// A robot that may touch lies on what it touches as if something held it: as long as it may be
/// there, for all that is known of where the view has it.
bool Servo::Loop::beside_a_wall(const control::WallClearance& wall) const {
  return (may_touch ? wall.bound() : wall.distance) <= kFree;
}

void Servo::Loop::watch_plant(const Frame& frame, double now, const Observation& observation,
                              const ControlStep& step) {
  const auto stands = [this] {
    if (settings.feedback == Feedback::none || may_touch || let_go) return;
    let_the_robot_go(
        "the robot is told to go and stands where it is seen: it is held, or the view is old");
  };
  if ((rotating && rotating->state().standing) || step.standing) stands();
  if (settings.law != ControlLaw::pd && settings.law != ControlLaw::estimator) return;
  // What a filter takes for a leap is what a coil that fails looks like, and is heard too.
  // What the model lacks at constant currents says nothing of it at those that follow.
  const bool constant = control_mode() == ControlMode::constant;
  const PairedView::Place place = observation.position
                                      ? pairs.hear(observation.pair_skew.has_value())
                                      : PairedView::Place::passed_over;
  if (let_go || place == PairedView::Place::begins_anew ||
      constant != std::exchange(was_constant, constant) ||
      (status.clearance && beside_a_wall(status.clearance->nearest())))
    plant.forget();
  else if (status.clearance && place == PairedView::Place::taken)
    plant.measured({to_seconds(frame.exposed), *observation.position, observation.noise(),
                    observation.systematic, observation.by_attitude},
                   step.estimate ? step.estimate->delay : 0);
  const std::vector<double> sent = rig.coils->currents();
  plant.commanded(
      now, Eigen::Map<const Eigen::VectorXd>(sent.data(), static_cast<Eigen::Index>(sent.size())),
      controller.drag_at(observation.position.value_or(goal)).inverse());
  if (!plant.fault().empty()) {
    recorder.alarm(clock.now(), "coils do not obey", AlarmPriority::high, plant.fault());
    throw DeviceError(DeviceErrorKind::protocol, "coils", plant.fault());
  }
  if (plant.standing()) stands();
}

void Servo::Loop::look_at_walls(const Observation& observation) {
  nearness.reset();
  status.position = observation.position;
  if (observation.position) {
    surface.doubt_by_attitude(observation.by_attitude);
    if (const auto seen_there = surface.at(*observation.position, observation.noise()))
      nearness = placed_at(*observation.position, *seen_there);
  }
  show_clearance();
}

void Servo::Loop::show_clearance() {
  status.clearance.reset();
  if (nearness) status.clearance = nearness->walls;
}

/// A place that the filter passes over may be anybody's: the robot may as well be where the filter
/// has it. Of each wall the nearer of both counts, until one of them is taken.
void Servo::Loop::doubt_nearness(const control::PositionEstimate& estimate) {
  const auto believed = surface.at(estimate.position, estimate.covariance.topLeftCorner<3, 3>());
  if (!believed || !nearness) return;
  nearness = nearer_of(*nearness, placed_at(estimate.position, *believed));
  show_clearance();
}

void Servo::Loop::watch_walls(const Frame& frame, const control::Reference& target,
                              const ControlStep& step) {
  // Clearance and position are of this frame, the command of this turn: what the loop knew when
  // it decided.
  reports.kept_out(step.kept_out);
  if (!status.clearance || !status.position || may_touch || let_go) return walls.forget();
  const control::Clearance& near = *status.clearance;
  const Eigen::Vector3d there =
      step.passed_over && step.estimate ? step.estimate->position : *status.position;
  const WallWatch::Verdict verdict =
      walls.see({to_seconds(frame.exposed), near, there, target.position,
                 step.kept_out || mode == Mode::released});
  if (verdict.inside && !std::exchange(was_inside, true))
    recorder.alarm(clock.now(), "keep-out margin", AlarmPriority::high,
                   "the robot's surface is " + clearance_text(near) + ": raise it");
  was_inside = verdict.inside;
  if (verdict.lying && mode != Mode::released)
    return let_the_robot_go("it has long touched the " +
                            std::string(near.at_lens() ? "lens" : "retina") +
                            ", and its loop does not bring it away");
  if (!verdict.pressed) return;
  recorder.alarm(clock.now(), "pushed against a wall", AlarmPriority::high,
                 "the robot does not come nearer to a wall, though it is told to: it is taken to "
                 "touch it, where the view shows it " +
                     clearance_text(near));
  surface.felt(near.at_lens(), near.nearest().distance);
  walls.forget();
}

void Servo::Loop::report_nearness(const control::Currents& currents) {
  if (!nearness || may_touch) return rig.coils->near(std::nullopt);
  const control::WallClearance& wall = nearness->walls.nearest();
  // Where the clearance is of: the place that is seen may be another one (doubt_nearness).
  const Eigen::Vector3d& there = nearness->nearest_place();
  const RigModel& model = rig.model;
  Eigen::Vector3d force = control::force_at(model.field, model.robot, model.medium, currents,
                                            model.field.nearest_valid(there));
  // force_at() has the weight in it; what the currents do alone is wanted here.
  force.z() += model.robot.net_weight(model.medium);
  const Eigen::Vector3d driven = controller.drag_at(there).inverse() * force;
  rig.coils->near(Interlock::Nearness{nearness->walls.at_lens() ? "lens" : "retina", wall.bound(),
                                      surface.margin(), -wall.normal.dot(driven)});
}

std::string Servo::Loop::advice() const {
  const auto stronger = controller.stronger_field();
  if (!stronger) return "; no stronger field helps";
  return ": raise the field to " + format_quantity(*stronger, "T") + " (field, field_max)";
}

ControlStep Servo::Loop::drive(const Frame& frame, double now, const Observation& observation) {
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
    reports.limits(turn, source.period(), [] { return std::string(); });
    return turn;
  }
  ControlStep step = controller.step(now, measured, reference, control_mode());
  if (observation.position) remember(to_seconds(frame.exposed), step.correction);
  if (step.passed_over && step.estimate) doubt_nearness(*step.estimate);
  // Before the first detection only the field: it turns the robot into the axis that is expected.
  const bool taken = observation.position && !step.passed_over;
  if (!seen && !taken && control_mode() != ControlMode::constant)
    send(controller.orienting_currents());
  else if (step.currents.size() > 0)
    send(step.currents);
  reports.limits(step, source.period(), [this] { return advice(); });
  return step;
}

ControlMode Servo::Loop::control_mode() const {
  if (mode == Mode::falling) return ControlMode::off;
  if (mode != Mode::released) return ControlMode::follow;
  if (settings.feedback == Feedback::none) return ControlMode::constant;
  return canceling ? ControlMode::cancel : ControlMode::leave;
}

void Servo::Loop::send(const control::Currents& wanted) {
  const std::vector<double> sent =
      rig.coils->reachable({wanted.data(), static_cast<std::size_t>(wanted.size())});
  const Eigen::Map<const Eigen::VectorXd> currents(sent.data(),
                                                   static_cast<Eigen::Index>(sent.size()));
  report_nearness(currents);
  expect_motion(currents);
  rig.coils->set_currents(sent);
}

void Servo::Loop::expect_motion(const control::Currents& currents) {
  if (status.position) expected_at = *status.position;
  if (!source.gated() || !expected_at) return;
  const RigModel& model = rig.model;
  const Eigen::Vector3d force = control::force_at(model.field, model.robot, model.medium, currents,
                                                  model.field.nearest_valid(*expected_at));
  source.expect_motion(to_seconds(clock.now()) + model.command_delay,
                       controller.drag_at(*expected_at).inverse() * force);
}

void Servo::Loop::switch_off() {
  if (rotating) rotating->stop();
  expect_motion(control::Currents::Zero(rig.model.field.coils()));
  rig.coils->set_currents(
      std::vector<double>(static_cast<std::size_t>(rig.coils->channels()), 0.0));
}

void Servo::Loop::remember(double time, const Eigen::Vector3d& correction) {
  corrections.emplace_back(time, correction);
  while (corrections.front().first < time - kKeptCorrections) corrections.pop_front();
}

void Servo::Loop::publish(const Frame& frame, const control::Reference& target,
                          const Observation& observation, const ControlStep& step) {
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

void Servo::Loop::check_goal(const control::Trajectory& path) const {
  check_reach(rig.model, path, status.position);
  if (!settings.may_touch) surface.check(path);
  if (looks(settings.feedback) || settings.stays_in_sight)
    check_visible(rig.model, rig.top_camera->info(),
                  {settings.view.image_scale, offset, settings.axis}, path);
}

void Servo::Loop::set_goal(Mode wanted, const control::Trajectory& path, int wanted_pictures) {
  check_goal(path);
  reference = {path, reference.begin};
  starting = true;
  goal = path.at(path.duration()).position;
  if (rotating) rotating->steer();
  pictures = wanted_pictures;
  pictures_taken = 0;
  mode = wanted;
  // Behind the checks: a goal that is refused does not take a lost robot up again. Where it is to
  // be held it is searched as at the beginning: until it is seen only the field that turns it
  // flows.
  if (let_go && wanted == Mode::holding) {
    seen = false;
    status.state = ServoState::searching;
  }
  let_go = false;
  corrections.clear();
  reports.forget_worst();
  allow_touch(settings.may_touch);
}

void Servo::Loop::allow_touch(bool allowed) {
  walls.forget();
  keep_out(!allowed);
  controller.may_touch(allowed);
  if (allowed != std::exchange(may_touch, allowed))
    recorder.event(clock.now(), "keep-out margin", allowed ? "off: the robot may touch" : "on");
}

void Servo::Loop::keep_out(bool keeps) {
  const RobotClearance* const walls_of = keeps ? &surface : nullptr;
  controller.keep_out(walls_of);
  if (rotating) rotating->keep_out(walls_of);
}

void Servo::Loop::shut(ServoState state, const std::string& failure) {
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

}  // namespace vitreo
