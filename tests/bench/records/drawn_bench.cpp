// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/records/drawn_bench.h"

#include "devices/sim/bench_sample.h"
#include "devices/sim/plant_sample.h"
#include "optics/system/tolerance.h"

#include <Eigen/Geometry>

#include <random>
#include <string>

namespace vitreo::records {
namespace {

constexpr double kThickness = 42e-6;  // m, of CoNi's plates
constexpr double kReach = 8e-3;       // m of aerial image, of the projection

/// The cameras of thesis 5.5.
RigDescription rig_of(const BenchKind& kind) {
  RigDescription rig;
  rig.file = "records";
  rig.table["top_camera"] = ConfigValue{ConfigTable{{"width_px", {656.0}},
                                                    {"height_px", {490.0}},
                                                    {"effective_pixel", {20.7e-6}},
                                                    {"projection", {std::string("exact")}},
                                                    {"projection_reach", {kReach}}}};
  const std::string bench = kind.sampled ? "sampled" : "believed";
  const ConfigTable places{{"places", {std::string("by_hand")}}};
  rig.table["model"] =
      ConfigValue{ConfigTable{{"uncertainty", {ConfigTable{{"bench", {places}}}}}}};
  rig.table["truth"] = ConfigValue{ConfigTable{{"machine", {std::string("sampled")}},
                                               {"optics", {ConfigTable{{"bench", {bench}}}}}}};
  if (kind.perturbed_eye)
    rig.table["keep_out"] = ConfigValue{ConfigTable{{"eye", {std::string("table_5_1")}}}};
  return rig;
}

RigSettings settings_of(const BenchKind& kind) {
  const RigDescription rig = rig_of(kind);
  ConfigReader reader(rig);
  return read_rig_settings(reader);
}

RigModel model_of(const BenchKind& kind) {
  RigModel model = settings_of(kind).model;
  model.projection = optics::fit_single_viewpoint(model.eye, model.microscope, kReach);
  model.exact.emplace(model.eye, model.microscope, kReach);
  return model;
}

/// The laboratory of that seed, as devices/sim/laboratory draws its views and its robot.
sim::LaboratorySettings truth_of(const BenchKind& kind, std::uint64_t seed) {
  const RigSettings settings = settings_of(kind);
  sim::LaboratorySettings truth = settings.laboratory;
  if (kind.perturbed_eye) {
    std::mt19937_64 random(seed * 7919 + 3);
    const optics::Prescription eye = optics::prescription(settings.model.eye_name);
    truth.eye = optics::monte_carlo(eye, optics::applicable(optics::table_5_1(), eye), 1, random)[0]
                    .prescription.system;
  }
  truth = sim::with_optics(truth, sim::sample_bench(settings.laboratory, settings.optics, seed));
  const sim::PlantSample plant = sim::sample_plant(truth.sigmas, seed);
  truth.top_image.pixel *= plant.top_pixel;
  truth.microscope.tilt += plant.tilt;
  truth.world.cavity.vertex += plant.eye;
  return truth;
}

}  // namespace

DrawnBench::DrawnBench(const BenchKind& kind, std::uint64_t seed)
    : model_(model_of(kind)), truth_(truth_of(kind, seed)), renderer_(renderer()) {
  const sim::PlantSample plant = sim::sample_plant(truth_.sigmas, seed);
  size_ = plant.size;
  side_scale_ = 1 / plant.side_pixel;
  side_turn_ = plant.side_turn;
}

sim::Renderer DrawnBench::renderer() {
  sim::View view = sim::eye_view(truth_.eye, truth_.microscope, truth_.top_image, truth_.top.size,
                                 truth_.world.cavity.vertex);
  const cv::Mat ground(view.height, view.width, CV_32F, cv::Scalar(0.5));
  const sim::Aperture aperture{truth_.microscope.numerical_aperture, 550e-9,
                               truth_.top_image.pixel};
  return sim::Renderer(std::move(view), aperture,
                       sim::eye_defocus(truth_.eye, truth_.microscope, truth_.top_image), ground, 0,
                       truth_.top.sensor, {}, 9);
}

vision::Background DrawnBench::background() {
  vision::Background learnt;
  for (int k = 0; k < 15; ++k) learnt.learn(renderer_.render(nullptr, ++frame_));
  return learnt;
}

cv::Mat DrawnBench::picture(const Eigen::Vector3d& place, const Eigen::Vector3d& axis) {
  sim::BodyLook look;
  look.plate_thickness = kThickness * size_;
  look.specular = 0.05;
  const Eigen::Vector3d level = Eigen::Vector3d::UnitZ().cross(axis).normalized();
  const sim::BodyState body{place, axis, model_.robot.semi_axis * size_,
                            model_.robot.semi_radius * size_, level};
  return renderer_.render({{body, body, look}}, ++frame_);
}

Eigen::Vector3d DrawnBench::by_side_camera(const Eigen::Vector3d& place) const {
  return side_scale_ * (Eigen::AngleAxisd(side_turn_, Eigen::Vector3d::UnitY()) * place);
}

Eigen::Vector3d DrawnBench::on_the_retina() const {
  return truth_.world.cavity.vertex + Eigen::Vector3d(0, 0, model_.robot.semi_radius * size_);
}

}  // namespace vitreo::records
