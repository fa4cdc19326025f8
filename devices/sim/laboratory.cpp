// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/laboratory.h"

#include "control/robots.h"
#include "control/vitreous.h"
#include "devices/sim/checks.h"
#include "devices/sim/hardware_sample.h"
#include "devices/sim/lens_groups.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <utility>

namespace vitreo::sim {
namespace {

/// Hands that need no time. What they place is a body of the rig file.
class SimulatedSampleHandler : public SampleHandler {
 public:
  SimulatedSampleHandler(Laboratory& laboratory, World& world, std::recursive_mutex& acting,
                         Clock& clock)
      : laboratory_(laboratory), world_(world), acting_(acting), clock_(clock) {}
  std::string identity() const override { return "simulated operator's hands"; }
  void insert_robot(const Eigen::Vector3d& near) override {
    const Time now = clock_.now();
    const std::lock_guard lock(acting_);
    world_.insert_robot(now, near);
  }
  void remove_robot() override {
    const Time now = clock_.now();
    const std::lock_guard lock(acting_);
    world_.remove_robot(now);
  }
  void place_target(const Eigen::Vector3d& position) override {
    laboratory_.move_body("target", position);
  }
  void remove_target() override { place_target({kOutOfSight, kOutOfSight, kOutOfSight}); }
  void change_vial(const std::string& robot, const std::string& gel) override {
    const auto medium = gel.empty() ? std::nullopt : std::optional(control::gel_named(gel));
    laboratory_.change(control::robot_named(robot), medium);
    insert_robot({0, 0, 0});
  }

 private:
  static constexpr double kOutOfSight = 0.5;  // m: beyond every field of view
  Laboratory& laboratory_;
  World& world_;
  std::recursive_mutex& acting_;
  Clock& clock_;
};

// Offset errors of the output channels, N(0, offset) in counts.
usb3103::EmulatorSettings sampled_dac(double offset, std::uint64_t seed) {
  usb3103::EmulatorSettings dac;
  std::mt19937_64 random(seed_for(seed, Purpose::dac));
  std::normal_distribution<double> normal;
  for (double& channel : dac.offset) channel = offset * normal(random);
  return dac;
}

// Thickness t of two crossed elliptical plates with the robot's outline and volume, which share a
// bar of 2 a t^2 along the axis: the smaller root of V = 2 pi a b t - 2 a t^2. 0 where the outline
// is too small.
// Each plate is an elliptical cylinder of pi a b t.
double plate_thickness(const control::Robot& robot) {
  const double a = robot.semi_axis;
  const double flat = 2 * M_PI * a * robot.semi_radius;
  const double root = flat * flat - 8 * a * robot.solid_volume;
  return root > 0 ? (flat - std::sqrt(root)) / (4 * a) : 0;
}

/// Flat surfaces are drawn dull: as a mirror a whole end or plate would shine at once, as bright as
/// the ground.
BodyLook look_of(const LaboratorySettings& settings) {
  BodyLook look;
  const control::Robot& robot = settings.world.robot;
  if (!settings.plates) return look;
  // A helix is the spheroid about it.
  const bool flat_ends =
      robot.shape == control::BodyShape::cylinder || robot.shape == control::BodyShape::disc;
  if (flat_ends && !robot.helix) {
    look.solid = Solid::cylinder;
    look.specular = 0.05;
    return look;
  }
  if (robot.hard) return look;
  look.plate_thickness = plate_thickness(settings.world.robot);
  look.specular = 0.05;  // electroplated, not polished; a whole plate would shine at once
  return look;
}

BodyLook look_of(const BodySettings& body) {
  BodyLook look{0.35, 0.55, 0.05, 20, body.color};
  if (body.dotted) look.dot_pitch = body.dot_pitch;
  if (body.shape != Shape::spheroid)
    look.solid = body.shape == Shape::rod ? Solid::rod : Solid::disc;
  return look;
}

// Red, green and blue of a retina whose gray is 1.
constexpr std::array<double, 3> kFundusTint = {1.45, 0.9, 0.25};

constexpr const char* kNoCondensingLens =
    "eye: wants a retina, a lens, a cornea of two surfaces and, in air, a condensing lens of two";

// m of lens travel per microstep.
double ustep(const pololu_tic::Settings& lens) { return lens.step_length / lens.usteps_per_step; }

// A motor that was homed before the run and stands at the nominal position, 0.
pololu_tic::EmulatorSettings homed_motor(const pololu_tic::Settings& lens) {
  pololu_tic::EmulatorSettings motor;
  motor.position_known = true;
  motor.position = static_cast<std::int32_t>(std::lround(-lens.home_position / ustep(lens)));
  motor.home_usteps = -motor.position;
  motor.step_mode = static_cast<std::uint8_t>(std::lround(std::log2(lens.usteps_per_step)));
  return motor;
}

// A backlit chamber: even light, a little brighter below.
cv::Mat side_ground(int width, int height) {
  cv::Mat ground(height, width, CV_32F);
  for (int v = 0; v < height; ++v)
    ground.row(v).setTo(0.62F + 0.08F * static_cast<float>(v) / static_cast<float>(height));
  return ground;
}

// The cameras are those of the laboratory, whichever machine is in it.
CameraSettings sampled_camera(CameraSettings camera, const PlantSample& sample) {
  // An image arrives when its exposure is over.
  camera.latency = std::max(sampled_latency(sample, camera.latency), camera.exposure / 2);
  camera.jitter = std::max(camera.jitter, std::min(sample.jitter, 0.1 / camera.frame_rate));
  // A stamp is of the past when the frame comes.
  camera.stamp = std::clamp(sample.stamp, -camera.latency / 2, camera.latency / 2);
  return camera;
}

// How cameras and eye really stand. Of the laboratory too: another machine leaves them.
LaboratorySettings with_sampled_views(LaboratorySettings settings, std::uint64_t seed) {
  const PlantSample sample = sample_plant(settings.sigmas, seed);
  settings.top_image.pixel *= sample.top_pixel;
  settings.side_pixel *= sample.side_pixel;
  settings.side_turn += sample.side_turn;
  settings.microscope.tilt += sample.tilt;
  settings.world.cavity.vertex += sample.eye;
  return settings;
}

}  // namespace

// The true plant: the settings with their perturbations sampled, each from a stream of its own, so
// that a change of one sigma leaves the other samples as they were.
// The operator tunes last, on the plant as it was sampled.
WorldSettings sampled_world(const LaboratorySettings& settings, std::uint64_t seed) {
  const auto stream = [seed](Purpose purpose) { return std::mt19937_64(seed_for(seed, purpose)); };
  WorldSettings world = settings.world;
  auto field = stream(Purpose::field);
  auto moment = stream(Purpose::moment);
  auto roll = stream(Purpose::roll);
  auto tuning = stream(Purpose::tuning);
  std::normal_distribution<double> normal;
  world.field = perturbed(world.field, settings.field_perturbation, field);
  apply(sample_plant(settings.sigmas, seed), world);
  world.moment_gain *= 1 + settings.moment_sigma * std::normal_distribution<double>()(moment);
  world.roll += settings.roll_sigma * normal(roll);
  if (settings.hand_tuning)
    world.extra_force +=
        force_left_by_tuning(*settings.hand_tuning, world, settings.believed_field, tuning);
  return world;
}

struct Laboratory::State {
  State(Laboratory& owner, const LaboratorySettings& given, Clock& the_clock,
        std::uint64_t the_seed)
      : settings(with_sampled_views(given, the_seed)),
        clock(the_clock),
        seed(the_seed),
        world(sampled_world(settings, the_seed), seed_for(the_seed, Purpose::world)),
        lens(pololu_tic::make_emulator(homed_motor(given.lens), the_clock)),
        hands(owner, world, acting, the_clock),
        probe(
            given.probe,
            [this](Time time, const Eigen::Vector3d& position) { return field(position, time); },
            [this] {
              return probe_position ? probe_position(clock.now()) : Eigen::Vector3d(0, 0, 0);
            },
            the_clock, seed_for(the_seed, Purpose::probe)) {
    set_points = control::Currents::Zero(given.world.field.coils());
    if (!given.fundus.empty()) fundus = Fundus::photograph(given.fundus, given.fundus_width);
  }

  /// Made with the first picture: it takes a tenth of a second, for which a prompt need not wait.
  /// Its reach is just short of the equator, which is pi / 2 = 1.571 radii of arc from the vertex.
  const Fundus& retina() {
    if (!fundus)
      fundus = Fundus::drawn(seed_for(seed, Purpose::fundus), 1.55 * settings.world.cavity.radius);
    return *fundus;
  }

  /// Pose of the imaging parts: condensing lens (of now), microscope or bare sensor (of the
  /// exposure).
  struct Pose {
    double lens = 0;
    double sensor = 0;
    double turn = 0;
    bool operator==(const Pose&) const = default;
  };
  double lens_position() const { return lens->motor_usteps() * ustep(settings.lens); }
  Pose pose(Time time) const {
    if (settings.top_view == TopView::plain) return {};
    const bool turns = settings.top_view == TopView::bare_sensor && sensor_angle;
    return {lens_position(), sensor_position ? sensor_position(time) : 0,
            turns ? sensor_angle(time) : 0};
  }

  double top_brightness(double lit) const {
    return settings.top.sensor.brightness * std::max(lit, kDarkest);
  }

  /// Makes the top camera's renderer for a pose. Tracing the view takes most of the time of a
  /// picture, so it is done again only when the pose has changed.
  void prepare_top(const Pose& now, double lit) {
    const std::uint64_t noise = seed_for(seed, Purpose::top_noise);
    const BodyLook robot = look_of(settings);
    rendered_pose = now;
    rendered_light = lit;
    Sensor sensor = settings.top.sensor;
    sensor.brightness = top_brightness(lit);
    const ImageSize& size = settings.top.size;
    const optics::ImageScale& image = settings.top_image;
    if (settings.top_view == TopView::plain) {
      top_renderer.emplace(
          plain_view(image.pixel, image.center_px, size, settings.plain),
          Aperture{settings.microscope.numerical_aperture, 550e-9, image.pixel},
          [plane = settings.plain.plane](const Eigen::Vector2d&, double z) { return z - plane; },
          side_ground(size.width, size.height), 0, sensor, robot, noise);
      return;
    }
    // The mover shifts the condensing lens by `lens`: the air before it grows, and the observer,
    // whose position is counted from the last surface, stays where it is.
    optics::System eye = settings.eye;
    eye.surfaces[static_cast<std::size_t>(lens_groups(eye)->cornea) - 1].thickness += now.lens;
    optics::Microscope observer = settings.microscope;
    observer.focus += now.sensor - now.lens;
    if (settings.top_view == TopView::bare_sensor)
      observer = bare_sensor(eye, observer.focus, settings.sensor_aperture);
    constexpr int kGridStep = 16;
    View view =
        eye_view(eye, observer, image, size, settings.world.cavity.vertex, kGridStep, now.turn);
    const Aperture aperture{observer.numerical_aperture, 550e-9, image.pixel};
    const auto defocus = eye_defocus(eye, observer, image);
    retina_seen = retina_points(view, settings.world.cavity.radius);
    // One kernel for the whole ground, that of the retina half-way out to the side.
    const Eigen::Vector2d half_way = image.center_px + Eigen::Vector2d(size.width / 4.0, 0);
    retina_defocus = defocus(half_way, 0);
    // A photograph before a color sensor has its own colors.
    if (!color_ground()) sensor.ground_tint = kFundusTint;
    top_renderer.emplace(std::move(view), aperture, defocus, ground_at(Time{}), retina_defocus,
                         sensor, robot, noise);
  }

  bool color_ground() {
    return settings.top.sensor.color != SensorColor::gray && retina().has_color();
  }

  /// To and fro along a Lissajous figure, at most at the speed of the settings along x.
  cv::Mat ground_at(Time time) {
    constexpr double kReach = 1.5e-3;  // m
    const double phase = static_cast<double>(settings.fundus_drift) * to_seconds(time) / kReach;
    const Eigen::Vector2d shift =
        settings.fundus_drift > 0
            ? kReach * Eigen::Vector2d(std::sin(phase), 0.5 * std::sin(0.7 * phase))
            : Eigen::Vector2d(0, 0);
    return painted_ground(retina_seen, retina(), shift, color_ground());
  }

  // Gathered now; drawn under a lock of the camera's own, so that neither another picture of it nor
  // a change of eye or robot comes between.
  Picture expose_top(Time exposed, std::uint64_t number) {
    return [this, now = pose(exposed), lit = light, bodies = bodies_seen(settings.top, exposed),
            exposed, number] {
      const std::lock_guard lock(drawing_top);
      if (!top_renderer || !(now == rendered_pose)) prepare_top(now, lit);
      if (lit != rendered_light) {
        top_renderer->set_brightness(top_brightness(lit));
        rendered_light = lit;
      }
      if (settings.fundus_drift > 0 && settings.top_view != TopView::plain)
        top_renderer->set_ground(ground_at(exposed), retina_defocus);
      return top_renderer->render(bodies, number);
    };
  }

  Picture expose_side(Time exposed, std::uint64_t number) {
    return [this, bodies = bodies_seen(settings.side, exposed), number] {
      const std::lock_guard lock(drawing_side);
      if (!side_renderer) prepare_side();
      return side_renderer->render(bodies, number);
    };
  }

  void prepare_side() {
    const Aperture aperture{0.02, 550e-9, settings.side_pixel};
    side_renderer.emplace(
        side_view(settings.side_pixel, settings.side_center_px, settings.side.size,
                  settings.side_turn),
        aperture, [](const Eigen::Vector2d&, double z) { return z; },
        side_ground(settings.side.size.width, settings.side.size.height), 0, settings.side.sensor,
        look_of(settings), seed_for(seed, Purpose::side_noise));
  }

  Eigen::Vector3d field(const Eigen::Vector3d& position, Time time) {
    const std::lock_guard lock(acting);
    return world.field(time, position).head<3>();
  }

  /// Bodies at the start and the end of the exposure, the middle of which is `exposed`.
  /// Only the robot is smeared: the other bodies are drawn as they are in the middle of the
  /// exposure.
  std::vector<DrawnBody> bodies_seen(const CameraSettings& camera, Time exposed) {
    const std::lock_guard lock(acting);
    const Time half = from_seconds(camera.exposure / 2);
    std::vector<DrawnBody> bodies;
    const auto shifted = [this](BodyState state) {
      state.position += settings.drawn_shift;
      return state;
    };
    if (const BodyState* robot = world.robot(exposed - half); robot != nullptr) {
      const BodyState start = shifted(*robot);
      const BodyState* later = world.robot(exposed + half);
      bodies.push_back({start, later != nullptr ? shifted(*later) : start, look_of(settings)});
    }
    const std::vector<BodyState> others = world.bodies(exposed);
    for (std::size_t k = 0; k < others.size(); ++k)
      bodies.push_back({others[k], others[k], look_of(settings.world.bodies[k])});
    return bodies;
  }

  /// What the amplifiers give: set-points clamped by the injected saturation, none where one is cut
  /// off.
  void drive(Time now, control::Currents commands) {
    const std::lock_guard lock(acting);
    if (commands.size() == 0) return;  // nothing was set yet
    set_points = commands;
    for (int channel = 1; channel <= commands.size(); ++channel) {
      const auto wrong = faults.coil_response.find(channel);
      world.set_coil_response(now, channel,
                              wrong == faults.coil_response.end() ? 1 : wrong->second);
    }
    for (double& command : commands)
      command = std::clamp(command, -faults.saturation, faults.saturation);
    for (int channel = 1; channel <= commands.size(); ++channel)
      if (faults.cut_off.contains(channel)) commands[channel - 1] = 0;
    world.set_coil_commands(now, commands);
  }

  // Least part of the light: a sensor's brightness must be above 0.
  static constexpr double kDarkest = 1e-6;
  LaboratorySettings settings;
  Clock& clock;
  std::uint64_t seed;                 // of everything
  std::uint64_t machine_seed = seed;  // of the machine, which redraw() changes
  int machines = 1;
  Faults faults;
  double light = 1;
  control::Currents set_points;  // A, of the amplifiers; as they were told
  std::function<double(Time)> sensor_position, sensor_angle;
  std::function<Eigen::Vector3d(Time)> probe_position;
  /// Of the world and what it is told. Tasks take turns, but a watchdog zeroes the coils from a
  /// thread of its own while a task computes. Nothing that waits for the clock is done under it.
  std::recursive_mutex acting;
  World world;
  std::unique_ptr<pololu_tic::Emulator> lens;
  SimulatedSampleHandler hands;
  SimulatedProbe probe;
  std::optional<Fundus> fundus;
  std::mutex drawing_top, drawing_side;  // of what follows, and of the settings' eye and robot
  std::optional<Renderer> top_renderer;
  cv::Mat retina_seen;        // retina_points() of its view
  double retina_defocus = 0;  // m
  std::optional<Renderer> side_renderer;
  Pose rendered_pose;
  double rendered_light = 1;
  std::unique_ptr<SimulatedCamera> top;
  std::unique_ptr<SimulatedCamera> side;
  std::unique_ptr<usb3103::Emulator> outputs;
};

Laboratory::Laboratory(const LaboratorySettings& settings, Clock& clock, std::uint64_t seed) {
  settings.top.check();
  settings.side.check();
  settings.sigmas.check();
  settings.eye.check();
  require(settings.sensor_aperture > 0 && settings.sensor_aperture < 1,
          "sensor_aperture must be in (0, 1)");
  settings.lens.check();
  require(settings.fundus_drift >= 0 && settings.fundus_drift <= 0.1,
          "fundus_drift must be in [0, 0.1] m/s");
  require(lens_groups(settings.eye).has_value(), kNoCondensingLens);
  state_ = std::make_unique<State>(*this, settings, clock, seed);
  State& state = *state_;
  const PlantSample sample = sample_plant(settings.sigmas, seed);
  const CameraSettings top = sampled_camera(settings.top, sample);
  const CameraSettings side = sampled_camera(settings.side, sample);
  state.top = std::make_unique<SimulatedCamera>(
      CameraInfo{"simulated microscope camera", top.size.width, top.size.height, 1 / top.frame_rate,
                 settings.top_image.pixel},
      top, clock, seed_for(seed, Purpose::top_jitter),
      [&state](Time exposed, std::uint64_t number) { return state.expose_top(exposed, number)(); },
      state.faults.looks["top_camera"]);
  state.side = std::make_unique<SimulatedCamera>(
      CameraInfo{"simulated side camera", side.size.width, side.size.height, 1 / side.frame_rate,
                 settings.side_pixel},
      side, clock, seed_for(seed, Purpose::side_jitter),
      [&state](Time exposed, std::uint64_t number) { return state.expose_side(exposed, number)(); },
      state.faults.looks["side_camera"]);
  state.outputs = usb3103::make_emulator(
      sampled_dac(settings.dac_offset, seed),
      [&state](const usb3103::Voltages& volts) {
        control::Currents commands(state.settings.world.field.coils());
        for (int coil = 0; coil < commands.size(); ++coil)
          commands[coil] = volts[static_cast<std::size_t>(coil)] * state.settings.amperes_per_volt;
        state.drive(state.clock.now(), commands);
      },
      [this](int line, bool high) {
        if (line == state_->settings.enable_line) set_enable_line(high);
      });
}

Laboratory::~Laboratory() = default;
Camera& Laboratory::top_camera() { return *state_->top; }
Camera& Laboratory::side_camera() { return *state_->side; }
pololu_tic::Emulator& Laboratory::lens_motor() { return *state_->lens; }
SampleHandler& Laboratory::sample() { return state_->hands; }
void Laboratory::carry_sensor(std::function<double(Time)> position) {
  auto play = std::make_shared<StagePlay>(state_->settings.stage_play,
                                          seed_for(state_->seed, Purpose::stage));
  state_->sensor_position = [play = std::move(play), motor = std::move(position)](Time time) {
    return play->carried(motor(time));
  };
}
void Laboratory::turn_sensor(std::function<double(Time)> angle) {
  state_->sensor_angle = std::move(angle);
}
void Laboratory::carry_probe(std::function<Eigen::Vector3d(Time)> position) {
  state_->probe_position = std::move(position);
}
FieldProbe& Laboratory::field_probe() { return state_->probe; }
usb3103::Emulator& Laboratory::coil_outputs() { return *state_->outputs; }
Faults& Laboratory::faults() { return state_->faults; }

void Laboratory::apply_lens_faults() {
  state_->lens->set_jammed(state_->faults.lens.stuck);
  state_->lens->set_kill_switch(state_->faults.lens.limit);
}

void Laboratory::apply_coil_faults() { state_->drive(state_->clock.now(), state_->set_points); }

void Laboratory::set_light(double level) {
  require(std::isfinite(level), "level: must be finite");
  state_->light = std::max(level, 0.0);
}

void Laboratory::drive_coils(Time now, const std::vector<double>& currents) {
  control::Currents commands(state_->settings.world.field.coils());
  if (currents.size() != static_cast<std::size_t>(commands.size()))
    throw std::invalid_argument("currents: the machine has " + std::to_string(commands.size()) +
                                " coils, not " + std::to_string(currents.size()));
  std::copy(currents.begin(), currents.end(), commands.data());
  state_->drive(now, commands);
}

void Laboratory::set_enable_line(bool high) {
  const Time now = state_->clock.now();
  const std::lock_guard lock(state_->acting);
  state_->world.set_enable_line(now, high);
}

Eigen::Vector3d Laboratory::field(const Eigen::Vector3d& position, Time time) {
  return state_->field(position, time);
}

void Laboratory::use_field(const control::FieldModel& field) {
  const int coils = state_->settings.world.field.coils();
  if (field.coils() != coils)
    throw std::invalid_argument("it has " + std::to_string(field.coils()) + " coils, the machine " +
                                std::to_string(coils));
  const Eigen::Vector3d background = state_->settings.world.field.uniform_background();
  state_->settings.world.field = field;
  state_->settings.world.field.set_uniform_background(background);
  state_->settings.field_perturbation = {0, 0, 0};
  redraw(state_->machine_seed);
}

void Laboratory::redraw(std::uint64_t seed) {
  const std::lock_guard lock(state_->acting);
  state_->machine_seed = seed;
  ++state_->machines;
  state_->world = World(sampled_world(state_->settings, seed), seed_for(seed, Purpose::world));
}

void Laboratory::set_eye(const optics::System& eye) {
  eye.check();
  require(lens_groups(eye).has_value(), kNoCondensingLens);
  State& state = *state_;
  const std::lock_guard lock(state.drawing_top);
  state.settings.eye = eye;
  state.top_renderer.reset();  // made again with the next picture
}

void Laboratory::change(const control::Robot& robot, const std::optional<control::Gel>& gel) {
  State& state = *state_;
  {
    const std::scoped_lock lock(state.drawing_top, state.drawing_side);
    state.settings.world.robot = robot;
    state.settings.world.gel = gel;
    state.top_renderer.reset();
    state.side_renderer.reset();
  }
  redraw(state.machine_seed);
}

void Laboratory::move_body(const std::string& name, const Eigen::Vector3d& position) {
  State& state = *state_;
  const Time now = state.clock.now();
  const std::lock_guard lock(state.acting);
  std::vector<BodySettings>& bodies = state.settings.world.bodies;
  for (std::size_t k = 0; k < bodies.size(); ++k) {
    if (bodies[k].name != name) continue;
    if (!position.allFinite())
      throw std::invalid_argument("position: of '" + name + "' is not finite");
    bodies[k].position = position;
    state.world.place_body(now, k, position);
    return;
  }
  throw std::invalid_argument("body: the rig file has none called '" + name + "'");
}

Picture Laboratory::expose_top(Time exposed, std::uint64_t number) {
  return state_->expose_top(exposed, number);
}

Picture Laboratory::expose_side(Time exposed, std::uint64_t number) {
  return state_->expose_side(exposed, number);
}

cv::Mat Laboratory::top_image(Time exposed, std::uint64_t number) {
  return expose_top(exposed, number)();
}

cv::Mat Laboratory::side_image(Time exposed, std::uint64_t number) {
  return expose_side(exposed, number)();
}

std::optional<Truth> Laboratory::truth(Time time) {
  const std::lock_guard lock(state_->acting);
  const BodyState* robot = state_->world.robot(time);
  if (robot == nullptr) return std::nullopt;
  World& world = state_->world;
  return Truth{robot->position + state_->settings.truth_shift, robot->axis, world.currents(time),
               world.coil_temperatures(time), !world.settings().field.valid_at(robot->position)};
}

CoilTruth Laboratory::coils(Time time) {
  const std::lock_guard lock(state_->acting);
  World& world = state_->world;
  return {state_->set_points, world.currents(time), world.coil_temperatures(time)};
}

// The moment is the product of the rig file's factor and what was drawn.
std::vector<std::pair<std::string, double>> Laboratory::drawn() const {
  auto values = sample_plant(state_->settings.sigmas, state_->machine_seed).named();
  values.emplace_back("moment_factor", state_->world.settings().moment_gain);
  const auto& bench = state_->settings.drawn_bench;
  values.insert(values.end(), bench.begin(), bench.end());
  return values;
}

int Laboratory::machines() const { return state_->machines; }

double Laboratory::latency_of(double latency) const {
  return sampled_latency(sample_plant(state_->settings.sigmas, state_->seed), latency);
}

}  // namespace vitreo::sim
