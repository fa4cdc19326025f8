// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/laboratory.h"

#include "devices/error.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace vitreo::sim {
namespace {

/// Streams of chance for separate purposes, so that a change in one leaves the others as they were.
enum class Purpose : std::uint64_t { field = 1, moment, world, fundus, top_noise, side_noise, dac };
std::uint64_t seed_for(std::uint64_t seed, Purpose purpose) {
  std::seed_seq mixed{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                      static_cast<std::uint32_t>(purpose)};
  std::uint32_t words[2];
  mixed.generate(words, words + 2);
  return (static_cast<std::uint64_t>(words[0]) << 32) | words[1];
}

/// A camera that exposes at a steady rate whether or not anybody looks; only a frame that is pulled is rendered.
class SimulatedCamera : public Camera {
 public:
  using Draw = std::function<cv::Mat(Time exposed, std::uint64_t number)>;
  SimulatedCamera(CameraInfo info, const CameraSettings& settings, Clock& clock, Draw draw)
      : info_(std::move(info)),
        clock_(clock),
        draw_(std::move(draw)),
        period_(from_seconds(1 / settings.frame_rate)),
        latency_(from_seconds(settings.latency)) {}
  const CameraInfo& info() const override { return info_; }
  Frame grab(Time timeout) override {
    const Time deadline = timeout == kForever ? kForever : clock_.now() + timeout;
    // The newest that has arrived, if it was not yet returned; else the next one to arrive.
    const std::int64_t arrived = clock_.now() < latency_ ? -1 : (clock_.now() - latency_) / period_;
    const std::int64_t number = std::max(arrived, last_ + 1);
    const Time arrives = number * period_ + latency_;
    if (arrives > deadline) {
      clock_.sleep_until(deadline);
      throw DeviceError(DeviceErrorKind::timeout, info_.identity, "no frame in time");
    }
    clock_.sleep_until(arrives);
    last_ = number;
    return {draw_(number * period_, static_cast<std::uint64_t>(number)), static_cast<std::uint64_t>(number),
            number * period_, arrives};
  }

 private:
  CameraInfo info_;
  Clock& clock_;
  Draw draw_;
  Time period_, latency_;
  std::int64_t last_ = -1;
};

class SimulatedLensMover : public LensMover {
 public:
  SimulatedLensMover(Clock& clock, double travel, double speed) : clock_(clock), travel_(travel), speed_(speed) {}
  std::string identity() const override { return "simulated BIOM mover"; }
  double position() const override {
    const double gone = to_seconds(clock_.now() - started_) * speed_, way = target_ - start_;
    return gone >= std::abs(way) ? target_ : start_ + std::copysign(gone, way);
  }
  void move_to(double target, Time timeout) override {
    if (!(target >= travel_min() && target <= travel_max()))
      throw DeviceError(DeviceErrorKind::refused, "lens_mover", "the target is outside the travel");
    start_ = position();
    started_ = clock_.now();
    target_ = target;
    const Time needed = from_seconds(std::abs(target_ - start_) / speed_);
    if (needed > timeout) {
      clock_.sleep_for(timeout);
      make_safe();
      throw DeviceError(DeviceErrorKind::timeout, "lens_mover", "not there in time");
    }
    clock_.sleep_for(needed);
  }
  double travel_min() const override { return -travel_; }
  double travel_max() const override { return travel_; }
  void make_safe() override {
    start_ = target_ = position();
    started_ = clock_.now();
  }

 private:
  Clock& clock_;
  double travel_, speed_, start_ = 0, target_ = 0;
  Time started_{};
};

class SimulatedHands : public SampleHandler {
 public:
  SimulatedHands(World& world, Clock& clock) : world_(world), clock_(clock) {}
  std::string identity() const override { return "simulated operator's hands"; }
  void insert_robot(const Eigen::Vector3d& near) override { world_.insert_robot(clock_.now(), near); }
  void remove_robot() override { world_.remove_robot(clock_.now()); }

 private:
  World& world_;
  Clock& clock_;
};

WorldSettings drawn_world(const LaboratorySettings& settings, std::uint64_t seed) {
  WorldSettings world = settings.world;
  std::mt19937_64 field(seed_for(seed, Purpose::field)), moment(seed_for(seed, Purpose::moment));
  world.field = world.field.perturbed(settings.field_perturbation, field);
  world.moment_gain *= 1 + settings.moment_sigma * std::normal_distribution<double>()(moment);
  return world;
}

usb3103::EmulatorSettings drawn_dac(double offset, std::uint64_t seed) {
  usb3103::EmulatorSettings dac;
  std::mt19937_64 random(seed_for(seed, Purpose::dac));
  std::normal_distribution<double> normal;
  for (double& channel : dac.offset) channel = offset * normal(random);
  return dac;
}

/// A backlit chamber: even light, a little brighter below.
cv::Mat side_ground(int width, int height) {
  cv::Mat ground(height, width, CV_32F);
  for (int v = 0; v < height; ++v)
    ground.row(v).setTo(0.62F + 0.08F * static_cast<float>(v) / static_cast<float>(height));
  return ground;
}

}  // namespace

void CameraSettings::check() const {
  if (!(frame_rate > 0 && frame_rate <= 10000)) throw std::invalid_argument("frame_rate must be in (0, 10000] Hz");
  if (!(latency >= 0 && latency < 0.4)) throw std::invalid_argument("latency must be in [0, 0.4) s");
  sensor.check();
}

struct Laboratory::State {
  State(const LaboratorySettings& given, Clock& the_clock, std::uint64_t the_seed)
      : settings(given),
        clock(the_clock),
        seed(the_seed),
        world(drawn_world(given, the_seed), seed_for(the_seed, Purpose::world)),
        lens(the_clock, given.lens_travel, given.lens_speed),
        hands(world, the_clock),
        fundus(given.fundus.empty()
                   ? Fundus::drawn(seed_for(the_seed, Purpose::fundus), 1.55 * given.world.retina_radius)
                   : Fundus::photograph(given.fundus, given.fundus_width)) {}

  /// The eye with the condensing lens where the mover has put it; the microscope stays where it is.
  void look_through(double lens_position) {
    optics::System eye = settings.eye;
    eye.surfaces[static_cast<std::size_t>(kBeforeCondensingLens - 1)].thickness += lens_position;
    optics::Microscope microscope = settings.microscope;
    microscope.focus -= lens_position;
    View view = eye_view(eye, microscope, settings.top_image, settings.top.size, settings.world.eye_in_world);
    const Aperture aperture{microscope.numerical_aperture, 550e-9, settings.top_image.pixel};
    const auto defocus = eye_defocus(eye, microscope, settings.top_image);
    cv::Mat ground = retina_ground(view, fundus, settings.world.retina_radius);
    // One kernel for the whole ground, that of the retina half-way out to the side.
    const Eigen::Vector2d half_way = settings.top_image.centre_px + Eigen::Vector2d(settings.top.size.width / 4.0, 0);
    const double ground_defocus = defocus(half_way, 0);
    top_renderer.emplace(std::move(view), aperture, defocus, ground, ground_defocus, settings.top.sensor, RobotLook{},
                         seed_for(seed, Purpose::top_noise));
    drawn_lens_position = lens_position;
  }

  cv::Mat draw_top(Time exposed, std::uint64_t number) {
    const double position = lens.position();
    if (!top_renderer || position != drawn_lens_position) look_through(position);
    return draw(*top_renderer, exposed, number);
  }

  cv::Mat draw_side(Time exposed, std::uint64_t number) {
    if (!side_renderer) {
      const Aperture aperture{0.02, 550e-9, settings.side_pixel};
      side_renderer.emplace(
          side_view(settings.side_pixel, settings.side_centre_px, settings.side.size), aperture,
          [](const Eigen::Vector2d&, double z) { return z; },
          side_ground(settings.side.size.width, settings.side.size.height), 0, settings.side.sensor, RobotLook{},
          seed_for(seed, Purpose::side_noise));
    }
    return draw(*side_renderer, exposed, number);
  }

  cv::Mat draw(Renderer& renderer, Time exposed, std::uint64_t number) {
    const BodyState* robot = world.robot(exposed);
    if (robot == nullptr) return renderer.render(nullptr, number);
    BodyState drawn = *robot;
    drawn.position += settings.drawn_shift;
    return renderer.render(&drawn, number);
  }

  static constexpr int kBeforeCondensingLens = 5;  // the surface whose thickness is the air before the lens
  LaboratorySettings settings;
  Clock& clock;
  std::uint64_t seed;
  World world;
  SimulatedLensMover lens;
  SimulatedHands hands;
  Fundus fundus;
  std::optional<Renderer> top_renderer, side_renderer;
  double drawn_lens_position = 0;
  std::unique_ptr<SimulatedCamera> top, side;
  std::unique_ptr<usb3103::Emulator> outputs;
};

Laboratory::Laboratory(const LaboratorySettings& settings, Clock& clock, std::uint64_t seed) {
  settings.top.check();
  settings.side.check();
  settings.eye.check();
  if (settings.eye.size() <= State::kBeforeCondensingLens)
    throw std::invalid_argument("eye: a system with a condensing lens before surface 6 is wanted");
  state_ = std::make_unique<State>(settings, clock, seed);
  State& state = *state_;
  const auto& top = settings.top;
  const auto& side = settings.side;
  state.top = std::make_unique<SimulatedCamera>(
      CameraInfo{"simulated microscope camera", top.size.width, top.size.height, 1 / top.frame_rate,
                 settings.top_image.pixel},
      top, clock, [&state](Time exposed, std::uint64_t number) { return state.draw_top(exposed, number); });
  state.side = std::make_unique<SimulatedCamera>(
      CameraInfo{"simulated side camera", side.size.width, side.size.height, 1 / side.frame_rate, settings.side_pixel},
      side, clock, [&state](Time exposed, std::uint64_t number) { return state.draw_side(exposed, number); });
  state.outputs =
      usb3103::make_emulator(drawn_dac(settings.dac_offset, seed), [&state](const usb3103::Voltages& volts) {
        control::Currents commands(state.settings.world.field.coils());
        for (int coil = 0; coil < commands.size(); ++coil)
          commands[coil] = volts[static_cast<std::size_t>(coil)] * state.settings.amperes_per_volt;
        state.world.set_coil_commands(state.clock.now(), commands);
      });
}

Laboratory::~Laboratory() = default;
Camera& Laboratory::top_camera() { return *state_->top; }
Camera& Laboratory::side_camera() { return *state_->side; }
LensMover& Laboratory::lens_mover() { return state_->lens; }
SampleHandler& Laboratory::sample() { return state_->hands; }
usb3103::Emulator& Laboratory::coil_outputs() { return *state_->outputs; }

void Laboratory::drive_coils(Time now, const std::vector<double>& currents) {
  control::Currents commands(state_->settings.world.field.coils());
  if (currents.size() != static_cast<std::size_t>(commands.size()))
    throw std::invalid_argument("currents: the machine has " + std::to_string(commands.size()) + " coils, not " +
                                std::to_string(currents.size()));
  std::copy(currents.begin(), currents.end(), commands.data());
  state_->world.set_coil_commands(now, commands);
}

Eigen::Vector3d Laboratory::field(const Eigen::Vector3d& place, Time time) {
  World& world = state_->world;
  const control::FieldGradient field = world.settings().field.matrix(place) * world.currents(time);
  return field.head<3>();
}

std::optional<Truth> Laboratory::truth(Time time) {
  const BodyState* robot = state_->world.robot(time);
  if (robot == nullptr) return std::nullopt;
  return Truth{robot->position + state_->settings.truth_shift, robot->axis, state_->world.currents(time)};
}

}  // namespace vitreo::sim
