// Eyes at random: every prescription perturbed far beyond what eyes are, and all that is computed
// of them. Answers are finite, or there is none, or a typed error names why; no NaN travels on.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/aberrations.h"
#include "optics/analysis/field_curves.h"
#include "optics/maps/wide_angle_map.h"
#include "optics/rays/batch.h"
#include "optics/rays/trace.h"
#include "optics/system/first_order.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

class Chance {
 public:
  explicit Chance(unsigned seed) : generator_(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(generator_);
  }
  bool one_in(int n) { return std::uniform_int_distribution<int>(1, n)(generator_) == 1; }
  std::mt19937& generator() { return generator_; }

 private:
  std::mt19937 generator_;
};

/// Every parameter but one in three off by up to +-40 %, now and then one at an extreme. Nothing
/// when it is unsound, which then is said with a name.
std::optional<Prescription> wild(const Prescription& start, Chance& chance) {
  std::vector<Override> changes;
  for (const Parameter& one : parameters(start)) {
    if (one.name == "stop.surface" || chance.one_in(3) || !std::isfinite(one.value)) continue;
    double value = one.value * chance.between(0.6, 1.4);
    const bool shape = one.unit == "m" || one.name.ends_with(".conic");
    if (shape && chance.one_in(15)) value *= chance.one_in(2) ? -3 : 0.05;
    if (one.name.ends_with(".a4") && chance.one_in(5)) value = chance.between(-1, 1) * 1e6;  // m^-3
    if (one.name.ends_with(".index")) value = std::max(1.0, one.value * chance.between(0.9, 1.1));
    changes.emplace_back(one.name, value);
  }
  try {
    return with_parameters(start, changes);
  } catch (const std::invalid_argument& refusal) {
    EXPECT_GT(std::string(refusal.what()).size(), 10u);
    return std::nullopt;
  }
}

bool finite(const Ray& ray) { return ray.origin.allFinite() && ray.direction.allFinite(); }

/// Rays at random through the scalar tracer and the batch: finite whatever becomes of them, and the
/// same.
void trace_at_random(const System& system, Chance& chance) {
  RayBatch batch(64);
  std::vector<TraceResult> scalar;
  for (int i = 0; i < batch.size(); ++i) {
    const Eigen::Vector3d from(chance.between(-8, 8) * kMm, chance.between(-8, 8) * kMm,
                               chance.between(-2, 12) * kMm);
    const Eigen::Vector3d way =
        Eigen::Vector3d(chance.between(-1, 1), chance.between(-1, 1), chance.between(0.1, 1));
    const Ray ray{from, way.normalized()};
    scalar.push_back(trace_out(system, ray));
    batch.put(i, ray);
  }
  BatchTracer(system).trace_out(batch);
  for (int i = 0; i < batch.size(); ++i) {
    const TraceResult one = batch.result(i);
    ASSERT_TRUE(finite(one.ray) && finite(scalar[i].ray)) << system.name << " ray " << i;
    if (one.status != TraceStatus::ok || scalar[i].status != TraceStatus::ok) continue;
    EXPECT_LT((one.ray.origin - scalar[i].ray.origin).norm(), 1e-9) << system.name << " ray " << i;
    const TraceResult back =
        trace_in(system, {one.ray.origin + 1e-3 * one.ray.direction, -one.ray.direction});
    ASSERT_TRUE(finite(back.ray)) << system.name;
  }
}

void first_order_at_random(const System& system, Chance& chance) {
  const auto points = cardinal_points(system);
  if (points) {
    EXPECT_TRUE(std::isfinite(points->focal_length) &&
                std::isfinite(points->second_principal_point));
  }
  const double depth = chance.between(0, 0.9) * system.surfaces.front().thickness;
  const auto image = axial_image(system, depth);
  if (image) {
    EXPECT_TRUE(std::isfinite(image->distance) && std::isfinite(image->magnification));
  }
}

void field_at_random(const System& system) {
  const PupilTracer tracer(system, Pupil::of_stop(system));
  const std::vector<double> angles{0, 10 * kDegree, 25 * kDegree, 40 * kDegree, 80 * kDegree};
  try {
    for (const FieldPoint& point : field_curves(tracer, angles, disc_samples(3, 8))) {
      EXPECT_TRUE(point.transmitted >= 0 && point.transmitted <= 1);
      if (point.transmitted > 0) {
        EXPECT_TRUE(std::isfinite(point.best_focus) && std::isfinite(point.rms)) << system.name;
      }
    }
  } catch (const std::invalid_argument& none) {
    EXPECT_EQ(std::string(none.what()).rfind("depth", 0), 0u) << none.what();
  }
}

/// Points anywhere, and image places anywhere: nothing, or finite and there and back again.
void map_at_random(const System& system, Chance& chance, std::optional<Microscope> microscope,
                   int& maps) {
  WideAngleSettings settings;
  settings.microscope = microscope;
  settings.rings = 3, settings.arms = 8, settings.angle_nodes = 10, settings.depth_nodes = 8;
  settings.max_depth = chance.between(2, 9) * kMm,
  settings.max_angle = chance.between(10, 40) * kDegree;
  std::optional<WideAngleMap> map;
  try {
    map.emplace(system, settings);
  } catch (const std::invalid_argument& none) {
    EXPECT_EQ(std::string(none.what()).rfind("max_angle", 0), 0u) << none.what();
    return;
  }
  ++maps;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d p(chance.between(-10, 10) * kMm, chance.between(-10, 10) * kMm,
                            chance.between(-1, 15) * kMm);
    const auto aerial = map->image(p);
    const AerialPoint any{{chance.between(-9, 9) * kMm, chance.between(-9, 9) * kMm},
                          chance.between(-30, 30) * kMm};
    const auto from_any = map->point(any);
    if (from_any) {
      EXPECT_TRUE(from_any->allFinite());
    }
    if (!aerial) continue;
    ASSERT_TRUE(aerial->m.allFinite() && std::isfinite(aerial->focus)) << system.name;
    const auto traced = map->traced_image(p);
    ASSERT_TRUE(traced) << system.name << " " << p.transpose();
    EXPECT_LT((traced->m - aerial->m).norm() + std::abs(traced->focus - aerial->focus), 10 * kUm)
        << system.name;
    const auto back = map->point(*aerial);
    if (back) {
      EXPECT_LT((*back - p).norm(), 1e-8) << system.name;
    }
  }
}

TEST(Adversarial, EyesFarFromAnyPrescriptionGiveFiniteAnswersOrNone) {
  Chance chance(2026);
  int sound = 0, maps = 0;
  for (const std::string& name : prescription_names()) {
    for (int i = 0; i < 12; ++i) {
      const auto eye = wild(prescription(name), chance);
      if (!eye) continue;
      ++sound;
      const System& system = eye->system;
      trace_at_random(system, chance);
      first_order_at_random(system, chance);
      field_at_random(system);
      if (i % 3 != 0) continue;
      Microscope telecentric;
      map_at_random(system, chance, i % 6 == 0 ? std::optional<Microscope>() : telecentric, maps);
    }
  }
  std::cout << "eyes at random: " << sound << " sound, " << maps << " maps\n";
  EXPECT_GT(sound, 60);
  EXPECT_GT(maps, 6);
}

TEST(Adversarial, RaysThatTouchTheEdgesOfEverythingAreLostByName) {
  const double nan = std::nan(""), huge = 1e300, tiny = 1e-300;
  for (const std::string& name : prescription_names()) {
    const System system = prescription(name).system;
    const PupilTracer tracer(system, Pupil::of_stop(system));
    for (const Eigen::Vector3d& p :
         {Eigen::Vector3d(nan, 0, 0), Eigen::Vector3d(huge, 0, 0), Eigen::Vector3d(0, 0, -huge),
          Eigen::Vector3d(1, 0, 12 * kMm), Eigen::Vector3d(0, 0, 1)}) {
      EXPECT_FALSE(tracer.aim(p)) << name << " " << p.transpose();
    }
    EXPECT_TRUE(tracer.aim({tiny, 0, 0})) << name;
    for (const double slope : {1e-8, 1e-4, 0.5, 1.0, 100.0, 1e8}) {
      const Ray grazing{{0, 0, 1 * kMm}, Eigen::Vector3d(slope, 0, 1).normalized()};
      EXPECT_TRUE(finite(trace_out(system, grazing).ray)) << name << " " << slope;
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
