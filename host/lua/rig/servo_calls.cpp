// Calls of the servo: most return at once, some wait, tick by tick.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/rig/servo_calls.h"

#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/progress.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
#include "host/servo/servo.h"
#include "host/text/units.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kWithin = 100e-6;               // m
constexpr double kSettle = 0.5;                  // s
constexpr double kTurnSpeed = 0.35;              // rad/s
constexpr double kWithinAngle = 3 * M_PI / 180;  // rad

/// For errors: "(1.00, 0.00, -0.25) mm".
std::string place_text(const Eigen::Vector3d& p) {
  return fmt::format("({:.2f}, {:.2f}, {:.2f}) mm", p.x() * 1e3, p.y() * 1e3, p.z() * 1e3);
}

std::string reading_of(const ServoStatus& now) {
  return now.position ? "at " + place_text(*now.position) : "not seen";
}

/// Empty while the loop works, else why it does not.
std::string trouble(const ServoStatus& status) {
  switch (status.state) {
    case ServoState::failed:
      return "the servo failed: " + status.failure;
    case ServoState::lost:
      return "the robot is lost: the top camera has not seen it for longer than lost_timeout; the "
             "coils are at zero";
    case ServoState::closed:
      return "the servo is closed";
    default:
      return "";
  }
}

/// For calls that make no sense of a loop that has ended. A device's failure is thrown as it was.
void throw_if_troubled(const Servo& servo) {
  const ServoStatus status = servo.status();
  if (status.error)
    std::rethrow_exception(status.error);  // it stays a DeviceError: the run is aborted by it
  const std::string why = trouble(status);
  if (!why.empty()) throw std::runtime_error(why);
}

/// Shared, because a wait outlives the call, and the script may close its handle meanwhile.
std::shared_ptr<Servo> servo_of(const Call& call) {
  return std::static_pointer_cast<Servo>(call.self_pointer());
}

/// m, world: of the last frame. Throws std::runtime_error where the robot was not seen in it.
Eigen::Vector3d tracked_position(const Servo& servo) {
  throw_if_troubled(servo);
  const auto position = servo.status().position;
  if (!position) throw std::runtime_error("the robot is not seen");
  return *position;
}

/// Waits, tick by tick, until `ready` says so or the servo is in trouble: it ends in time then, and
/// `finish` has to ask which of both it was.
Wait servo_wait(const std::shared_ptr<Servo>& servo,
                std::function<bool(const ServoStatus&)> ready) {
  Wait wait;
  wait.signal = &servo->changed();
  wait.ready = [servo, is_ready = std::move(ready)] {
    const ServoStatus now = servo->status();
    return !trouble(now).empty() || is_ready(now);
  };
  return wait;
}

/// rad, between the robot's axis and its reference; nothing where it is not measured.
std::optional<double> angle_off(const ServoStatus& now) {
  if (!now.axis) return std::nullopt;
  return std::atan2(now.axis->cross(now.direction).norm(), now.axis->dot(now.direction));
}

/// At the end of the path and within `within` (m) of its goal for `settle` (s), counted in times of
/// frames without a gap: one frame outside, or without the robot, starts it anew.
struct Arrival {
  Eigen::Vector3d goal;
  double within, settle;
  std::optional<double> within_angle{};  // rad; nothing: the axis is no part of it
  std::optional<Time> since{};

  bool operator()(const ServoStatus& now) {
    const bool there = now.progress >= 1 && now.position &&
                       (*now.position - goal).norm() <= within && aligned(now);
    if (!there) since.reset();
    if (there && !since) since = now.time;
    return there && to_seconds(now.time - *since) >= settle;
  }
  bool aligned(const ServoStatus& now) const {
    return !within_angle || (now.turned && angle_off(now).value_or(0) <= *within_angle);
  }
};

/// The error of go_to: what was wanted, and how far away it is now.
std::string not_there(const ServoStatus& now, const Arrival& arrival, double timeout) {
  const std::string last =
      now.position ? "it is " + format_quantity((*now.position - arrival.goal).norm(), "m") +
                         " away, at " + place_text(*now.position)
                   : "it is not seen";
  const auto off = angle_off(now);
  const std::string askew = arrival.within_angle && off
                                ? fmt::format(", its axis {:.1f} degrees off", *off * 180 / M_PI)
                                : "";
  return "the robot was not within " + format_quantity(arrival.within, "m") + " of " +
         place_text(arrival.goal) + " for " + format_quantity(arrival.settle, "s") + " after " +
         format_quantity(timeout, "s") + ": " + last + askew;
}

/// From the reference's direction now to the one that is asked for; nothing where none is.
std::optional<control::DirectionPath> turn_of(const Call& call, const Servo& servo) {
  const auto direction = call.vector_option("direction");
  const auto speed = call.number_option("turn_speed");
  if (!direction) {
    if (speed) throw std::invalid_argument("turn_speed: wants a direction to turn to");
    return std::nullopt;
  }
  return control::DirectionPath::through({servo.direction(), *direction},
                                         speed.value_or(kTurnSpeed));
}

/// One direction for each position of the list, reached with it; no arc is faster than turn_speed.
std::optional<control::DirectionPath> turns_of(Call& call, const Servo& servo) {
  const bool given = call.push_option("directions");
  if (!given) {
    lua_pop(call.L, 1);
    return turn_of(call, servo);
  }
  const std::vector<Eigen::Vector3d> directions =
      points_at(call.L, lua_gettop(call.L), "directions");
  lua_pop(call.L, 1);
  const int at = call.index(0);
  if (call.vector_option("direction") || handle_class(call.L, at) == &trajectory_class())
    throw std::invalid_argument("directions: goes with a list of positions, without direction");
  const std::vector<Eigen::Vector3d> points = points_at(call.L, at, "points");
  if (directions.size() != points.size())
    throw std::invalid_argument(
        fmt::format("directions: wants one for each of {} positions, got {}", points.size(),
                    directions.size()));
  std::vector<double> times{0};
  for (std::size_t k = 1; k < points.size(); ++k)
    times.push_back(
        times.back() +
        control::Trajectory::line(points[k - 1], points[k], motion_limits(call)).duration());
  // The times are those at which waypoints() rests at each point: one line's duration after
  // another.
  const control::DirectionPath path = control::DirectionPath::timed(directions, times);
  const double most = call.number_option("turn_speed").value_or(kTurnSpeed);
  if (path.fastest() > most)
    throw std::invalid_argument(
        fmt::format("directions: {:.2f} rad/s on the way are more than turn_speed, {:.2f} rad/s; "
                    "go more slowly",
                    path.fastest(), most));
  return path;
}

/// A trajectory of the script's own, or straight lines through its points. Speed and acceleration
/// are those of the lines: beside a trajectory, which has its own, they would be ignored, so they
/// are refused.
control::Trajectory way_of(Call& call) {
  const int at = call.index(0);
  if (handle_class(call.L, at) == &trajectory_class()) {
    for (const char* name : {"speed", "acceleration"})
      if (call.number_option(name))
        throw std::invalid_argument(std::string(name) + ": the trajectory has its own");
    return call.handle<control::Trajectory>(0);
  }
  if (!lua_istable(call.L, at))
    throw std::invalid_argument("path: wants a trajectory or a list of positions, got " +
                                kind_of(call.L, at));
  return control::Trajectory::waypoints(points_at(call.L, at, "points"), motion_limits(call));
}

/// Before the loop is told anything: a law that cannot turn the robot refuses the whole motion.
void check_turn(const Servo& servo, bool wanted) {
  if (wanted && servo.rotation())
    throw std::invalid_argument("direction: the law \"rotating\" steers by the axis itself");
}

}  // namespace

int servo_calls::position(Call& call) {
  return call.result(tracked_position(call.self<Servo>()), "m");
}

// Replaces the trim, it does not add to it; what mean_correction() has gathered so far was for the
// old one and is dropped.
int servo_calls::set_trim(Call& call) {
  call.self<Servo>().set_trim(call.vector(0));
  return 0;
}

int servo_calls::set_offset(Call& call) {
  call.self<Servo>().set_offset(call.vector(0));
  return 0;
}

int servo_calls::force_for(Call& call) {
  return call.result(call.self<Servo>().force_for(call.vector(0)), "N");
}

// All fields are of one moment, since nothing runs between the reads: the loop is another task of
// the clock. The two settings are as last set, not as of the frame behind the rest.
int servo_calls::status(Call& call) {
  const Servo& servo = call.self<Servo>();
  const ServoStatus now = servo.status();
  ResultTable table(call);
  table.text("state", to_string(now.state))
      .number("time", to_seconds(now.time), "s")
      .number("progress", now.progress)
      .number("field", now.field, "T")
      .number("headroom", now.headroom)
      .flag("limited", now.limited)
      .vector("target", now.target, "m")
      .vector("trim", servo.trim(), "N")
      .vector("offset", servo.offset(), "m");
  if (now.position) table.vector("position", *now.position, "m");
  table.vector("direction", now.direction, "");
  if (now.axis) table.vector("axis", *now.axis, "");
  if (now.disturbance) table.vector("disturbance", *now.disturbance, "m/s");
  if (!now.failure.empty()) table.text("failure", now.failure);
  return 1;
}

int servo_calls::margins(Call& call) {
  const auto found = call.self<Servo>().margins();
  if (!found) {
    lua_pushnil(call.L);
    return 1;
  }
  const control::PositionEstimate& known = found->estimate;
  ResultTable(call)
      .flag("stable", found->margins.stable)
      .number("gain_up", found->margins.gain_up)
      .number("gain_down", found->margins.gain_down)
      .number("delay_more", found->margins.delay_more, "s")
      .number("delay_less", found->margins.delay_less, "s")
      .number("proportional", found->schedule.proportional, "1/s")
      .number("bandwidth", found->schedule.bandwidth, "1/s")
      .number("gain", 1 + known.gain)
      .number("gain_sigma", known.gain_sigma)
      .number("delay", known.delay, "s")
      .number("delay_sigma", known.delay_sigma, "s")
      .number("innovation", found->innovation)
      .number("correlation", found->correlation);
  return 1;
}

int servo_calls::rotation(Call& call) {
  const auto now = call.self<Servo>().rotation();
  if (!now) {
    lua_pushnil(call.L);
    return 1;
  }
  ResultTable table(call);
  table.number("frequency", now->rotation.frequency, "Hz")
      .vector("axis", now->rotation.axis, "")
      .number("field", now->rotation.field, "T")
      .number("limit", now->limit, "Hz")
      .number("set_points", now->set_points, "Hz")
      .number("response", now->response.now)
      .number("response_before", now->response.before)
      .number("response_sigma", now->response.sigma)
      .flag("stepped_out", now->response.stepped_out)
      .flag("unresponsive", now->unresponsive);
  if (now->rotation.swing)
    table.number("swing", *now->rotation.swing, "rad");
  else
    table.number("believed_step_out", now->believed_step_out, "Hz");
  if (now->response.step_out > 0) table.number("step_out", now->response.step_out, "Hz");
  return 1;
}

int servo_calls::spin(Call& call) {
  throw_if_troubled(call.self<Servo>());
  const Eigen::Vector3d axis = *call.vector_option("axis");
  if (!(axis.norm() > 1e-9)) throw std::invalid_argument("axis: must be a direction");
  call.self<Servo>().spin(axis.normalized(), *call.number_option("frequency"));
  return 0;
}

int servo_calls::clearance(Call& call) {
  const ServoStatus now = call.self<Servo>().status();
  if (!now.clearance) {
    lua_pushnil(call.L);
    return 1;
  }
  const control::WallClearance& wall = now.clearance->nearest();
  ResultTable(call)
      .number("bound", wall.bound(), "m")
      .number("distance", wall.distance, "m")
      .number("uncertainty", wall.uncertainty, "m")
      .text("wall", now.clearance->at_lens() ? "lens" : "retina")
      .number("retina", now.clearance->retina.distance, "m")
      .number("lens", now.clearance->lens.distance, "m")
      .vector("away", wall.normal, "")
      .number("margin", call.self<Servo>().margin(), "m")
      .flag("kept_out", now.kept_out);
  return 1;
}

// "good", or what was wrong, by the names of the alarms where there is one.
int servo_calls::quality(Call& call) {
  const LoopQuality found = call.self<Servo>().quality();
  std::string verdict;
  const auto name = [&verdict](bool is, const std::string& what) {
    if (is) verdict += (verdict.empty() ? "" : ", ") + what;
  };
  name(found.oscillating, "oscillation");
  name(found.standing, "standstill");
  name(found.off_target, "off target");
  name(found.rests_off > 0, "off at rest by " + format_quantity(found.rests_off, "m"));
  name(found.kept_out, "keep-out margin");
  name(found.capped, "speed cap");
  name(found.clamped, "disturbance clamp");
  name(found.weak_coil != 0, fmt::format("weak coil {}", found.weak_coil));
  ResultTable result(call);
  result.flag("good", found.good())
      .flag("oscillating", found.oscillating)
      .flag("standing", found.standing)
      .flag("off_target", found.off_target)
      .number("rests_off", found.rests_off, "m")
      .flag("kept_out", found.kept_out)
      .flag("capped", found.capped)
      .flag("clamped", found.clamped)
      .text("verdict", verdict.empty() ? "good" : verdict);
  if (found.weak_coil != 0) result.integer("weak_coil", found.weak_coil);
  return 1;
}

int servo_calls::let_fall(Call& call) {
  const auto servo = servo_of(call);
  const double duration = call.number(0);
  throw_if_troubled(*servo);
  call.check_can_wait();
  servo->let_fall(duration);
  Wait wait =
      servo_wait(servo, [servo](const ServoStatus&) { return servo->last_fall().has_value(); });
  // A fall begins and ends with a frame: some seconds without one are a camera that is silent.
  wait.deadline = later(session_of(call.L).clock.now(), from_seconds(2 * duration + 5));
  wait.finish = [servo, duration](Call& done, bool in_time) {
    throw_if_troubled(*servo);
    const auto fell = servo->last_fall();
    if (!in_time || !fell)
      throw std::runtime_error("the servo did not tick for " + format_quantity(duration, "s"));
    ResultTable(done).number("off", fell->first, "s").number("on", fell->second, "s");
    return 1;
  };
  return call.wait(std::move(wait));
}

// The loop's own state is in the error, for `lost` and `searching` ask for different remedies.
int servo_calls::wait_until_tracked(Call& call) {
  const auto servo = servo_of(call);
  const double timeout = call.number_option("timeout").value_or(10);
  Clock& clock = session_of(call.L).clock;
  // A frame from before the call may show the robot where it is not any more.
  Wait wait = servo_wait(servo, [since = clock.now()](const ServoStatus& now) {
    return now.position.has_value() && now.time >= since;
  });
  wait.deadline = later(clock.now(), from_seconds(timeout));
  wait.finish = [servo, timeout](Call& done, bool in_time) {
    if (!in_time)
      throw std::runtime_error("no robot was seen by the servo, which is " +
                               std::string(to_string(servo->status().state)) + "; " +
                               waited_text("a sight of it", reading_of(servo->status()), timeout));
    return done.result(tracked_position(*servo), "m");
  };
  return call.wait(std::move(wait));
}

// From where the robot is, not from where it should be: the path then starts without a step of the
// error. The usual timeout is twice the way's time, and 20 s to settle. Whether the call may wait
// is checked before the loop is told anything: an error must not leave the robot on its way.
int servo_calls::go_to(Call& call) {
  const auto servo = servo_of(call);
  Arrival arrival{call.vector(0), call.number_option("within").value_or(kWithin),
                  call.number_option("settle").value_or(kSettle)};
  const auto turn = turn_of(call, *servo);
  if (turn) arrival.within_angle = call.number_option("within_angle").value_or(kWithinAngle);
  const control::Trajectory path =
      control::Trajectory::waypoints({tracked_position(*servo), arrival.goal}, motion_limits(call));
  const double way = std::max(path.duration(), turn ? turn->duration() : 0);
  const double timeout = call.number_option("timeout").value_or(2 * way + 20);
  call.check_can_wait();
  check_turn(*servo, turn.has_value());
  servo->follow(path);
  if (turn) servo->turn(*turn);
  // A copy of `arrival` goes into the wait and counts there; the one in `finish` has the limits.
  Wait wait = servo_wait(servo, arrival);
  wait.deadline = later(session_of(call.L).clock.now(), from_seconds(timeout));
  wait.finish = [servo, arrival, timeout](Call&, bool in_time) {
    throw_if_troubled(*servo);
    if (!in_time) throw std::runtime_error(not_there(servo->status(), arrival, timeout));
    return 0;
  };
  return call.wait(std::move(wait));
}

// Progress is of the run: from what was told last to `progress_to`, in proportion to the path's
// own. The time that is returned is that of frames, so it does not depend on when the script woke
// up.
int servo_calls::follow(Call& call) {
  const auto servo = servo_of(call);
  throw_if_troubled(*servo);
  const control::Trajectory path = way_of(call);
  const double timeout = call.number_option("timeout").value_or(2 * path.duration() + 20);
  const auto turn = turns_of(call, *servo);
  call.check_can_wait();
  check_turn(*servo, turn.has_value());
  servo->follow(path, static_cast<int>(call.number_option("pictures").value_or(0)));
  if (turn) servo->turn(*turn);
  Context& context = call.context();
  const double from = context.fraction,
               to = std::max(from, call.number_option("progress_to").value_or(1));
  const std::string label = call.text_option("label").value_or("following the path");
  // Times of exposures, as those at the end.
  const double start = to_seconds(servo->status().time);
  Wait wait = servo_wait(servo, [&context, from, to, label](const ServoStatus& now) {
    tell_progress(context, from + (to - from) * now.progress, label);
    return now.progress >= 1;
  });
  wait.deadline = later(session_of(call.L).clock.now(), from_seconds(timeout));
  wait.finish = [servo, timeout, start](Call& done, bool in_time) {
    throw_if_troubled(*servo);
    if (!in_time)
      throw std::runtime_error(fmt::format(
          "the path's end was not reached after {}: {:.0f} % of it is done; the robot is {}",
          format_quantity(timeout, "s"), servo->status().progress * 100,
          reading_of(servo->status())));
    return done.result(to_seconds(servo->status().time) - start, "s");
  };
  return call.wait(std::move(wait));
}

int servo_calls::refusal(Call& call) {
  const std::string why = call.self<Servo>().refusal(way_of(call));
  if (!why.empty()) return call.result(why);
  lua_pushnil(call.L);
  return 1;
}

// A robot that was lost is searched anew: a person may have put it back.
int servo_calls::hold(Call& call) {
  if (call.self<Servo>().status().state != ServoState::lost) throw_if_troubled(call.self<Servo>());
  call.self<Servo>().hold(call.vector(0),
                          call.vector_option("velocity").value_or(Eigen::Vector3d::Zero()));
  return 0;
}

int servo_calls::release(Call& call) {
  throw_if_troubled(call.self<Servo>());
  call.self<Servo>().release(call.flag_option("cancel"), call.flag_option("touch"));
  return 0;
}

int servo_calls::snapshot(Call& call) {
  call.self<Servo>().snapshot(call.text(0));
  return 0;
}

// The mean is over what was gathered since now alone; the loop throws where a new
// goal or trim came meanwhile, for these drop it. Twice the duration and 5 s without enough ticks:
// no frames come.
int servo_calls::mean_correction(Call& call) {
  const auto servo = servo_of(call);
  const double duration = call.number(0);
  const double start = to_seconds(servo->status().time);
  Wait wait = servo_wait(
      servo, [=](const ServoStatus& now) { return to_seconds(now.time) - start >= duration; });
  wait.deadline = later(session_of(call.L).clock.now(), from_seconds(2 * duration + 5));
  wait.finish = [servo, duration](Call& done, bool in_time) {
    throw_if_troubled(*servo);
    if (!in_time)
      throw std::runtime_error("the servo did not tick; " +
                               waited_text(format_quantity(duration, "s") + " of it",
                                           reading_of(servo->status()), 2 * duration + 5));
    return done.result(servo->mean_correction(duration), "N");
  };
  return call.wait(std::move(wait));
}

// Closing again does nothing, so that <close> may follow servo:close(). The handle is emptied, and
// every other call on it is an error from here on.
int servo_calls::close(Call& call) {
  if (!call.self_pointer()) return 0;
  call.self<Servo>().close();
  close_handle(call);
  return 0;
}

}  // namespace vitreo::lua
