// Pictures of the simulated cameras: several bodies, plates, motion and color; and the arrangements
// of the top camera.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/sim/laboratory.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <thread>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

constexpr Time kMs = std::chrono::milliseconds(1);
const Eigen::Vector3d kX = Eigen::Vector3d::UnitX(), kZ = Eigen::Vector3d::UnitZ();

Sensor clean() {
  Sensor sensor;
  sensor.read_noise = 0;
  sensor.full_well = 1e9;
  sensor.vignette = 0;
  return sensor;
}

Renderer from_above(const Sensor& sensor) {
  const ImageSize size{200, 160};
  return Renderer(
      plain_view(20e-6, {99.5, 79.5}, size), {0.02, 550e-9, 20e-6},
      [](const Eigen::Vector2d&, double) { return 0.0; },
      cv::Mat(size.height, size.width, CV_32F, cv::Scalar(0.6)), 0, sensor, {}, 9);
}

BodyLook dull(double plates = 0) {
  BodyLook look{0.1, 0, 0, 1};
  look.plate_thickness = plates;
  return look;
}

DrawnBody still(const BodyState& state, const BodyLook& look) { return {state, state, look}; }

TEST(Pictures, TheNearerHidesTheFarther) {
  Renderer renderer = from_above(clean());
  BodyLook bright{0.9, 0, 0, 1};
  const BodyState low{{0, 0, -2e-3}, kZ, 0.1e-3, 0.8e-3},
      high{{0.5e-3, 0, 1e-3}, kX, 0.5e-3, 0.25e-3};
  for (const bool robot_first : {true, false}) {
    std::vector<DrawnBody> bodies{still(high, dull()), still(low, bright)};
    if (!robot_first) std::swap(bodies[0], bodies[1]);
    const cv::Mat image = renderer.render(bodies, 0);
    EXPECT_NEAR(image.at<std::uint8_t>(80, 124), 0.1 * 255, 2) << "the robot, over the disc";
    EXPECT_NEAR(image.at<std::uint8_t>(80, 80), 0.9 * 255, 2) << "the disc beside it";
  }
}

/// A pixel that a plate's rim crosses shows the plate's flat side, as dark or bright as within it:
/// its edge is a thousandth of its width. With the edge's own light, black, the drawn outline was a
/// tenth of a pixel too large, which a look on the retina took for another eye (docs/figures.md).
TEST(Plates, ALineThatJustMissesThemMeetsTheirFlatSide) {
  BodyLook look = dull(42e-6);
  const View view = plain_view(20e-6, {99.5, 79.5}, {200, 160});
  const Figure figure =
      figure_of(view, {{0, 0, 0}, kX, 1e-3, 0.5e-3, Eigen::Vector3d::UnitY()}, look);
  const Figure whole =
      figure_of(view, {{0, 0, 0}, kX, 1e-3, 0.5e-3, Eigen::Vector3d::UnitY()}, dull());
  for (double angle = 0.1; angle < 2 * M_PI; angle += 0.3) {
    for (const double distance : {0.97, 0.999, 1.005}) {
      PixelLine line{};
      line.x = static_cast<float>(distance * 1e-3 * std::cos(angle));
      line.y = static_cast<float>(distance * 0.5e-3 * std::sin(angle));
      const Hit seen = hit(figure, line);
      EXPECT_NEAR(std::sqrt(seen.closest), distance, 1e-6) << "coverage is the line's own";
      EXPECT_GT(seen.normal.z(), 0.95) << angle << ", " << distance;
      EXPECT_LT((seen.position.head<2>() - Eigen::Vector2d(line.x, line.y)).norm(), 0.03e-3);
      if (distance > 1) {
        EXPECT_LT(hit(whole, line).normal.z(), 0.05) << "a round body turns away";
      }
    }
  }
}

TEST(Plates, SeenFromTheirEndTheyAreACross) {
  Renderer renderer = from_above(clean());
  const BodyState robot{{0, 0, 0}, kZ, 1e-3, 0.5e-3};
  const cv::Mat cross = renderer.render({still(robot, dull(60e-6))}, 0);
  EXPECT_LT(cross.at<std::uint8_t>(80, 115), 80) << "on an arm, 0.3 mm out";
  EXPECT_LT(cross.at<std::uint8_t>(95, 100), 80);
  EXPECT_GT(cross.at<std::uint8_t>(91, 111), 140) << "between the arms";
  const cv::Mat whole = renderer.render({still(robot, dull())}, 0);
  EXPECT_LT(whole.at<std::uint8_t>(91, 111), 40);
}

TEST(Plates, SeenFromTheSideTheirOutlineIsTheEllipsoids) {
  Renderer renderer = from_above(clean());
  const BodyState robot{{0, 0, 0}, kX, 1e-3, 0.5e-3};
  const cv::Mat plates = renderer.render({still(robot, dull(42e-6))}, 0);
  const cv::Mat whole = renderer.render({still(robot, dull())}, 0);
  const double area = cv::countNonZero(plates < 90);
  EXPECT_NEAR(area, cv::countNonZero(whole < 90), 0.01 * area);
  EXPECT_NEAR(area, M_PI * 50 * 25, 0.03 * area);
}

/// m: how far a solid reaches along a unit vector; of rod and disc as where they touch.
double reach(Solid solid, const BodyState& body, const Eigen::Vector3d& n) {
  if (solid == Solid::rod) return support(Shape::rod, body, n).dot(n);
  if (solid == Solid::disc) return support(Shape::disc, body, n).dot(n);
  const double along = std::abs(body.axis.dot(n));
  return body.semi_axis * along + body.semi_radius * std::sqrt(std::max(0.0, 1 - along * along));
}

struct SolidCase {
  const char* name;
  Solid solid;
  double semi_axis, semi_radius;
};
constexpr SolidCase kSolids[] = {{"cylinder", Solid::cylinder, 0.5e-3, 0.25e-3},
                                 {"flat disc", Solid::cylinder, 0.1e-3, 0.4e-3},
                                 {"rod", Solid::rod, 0.6e-3, 0.1e-3},
                                 {"round disc", Solid::disc, 0.1e-3, 0.5e-3}};

// A line meets a convex body where it is within the body's reach along every direction across the
// line; and where it leaves, the surface's normal is a direction in which the point is the
// farthest.
TEST(Solids, AreMetByTheLinesThatTheirSupportFunctionsSay) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> even(-1, 1);
  const auto some = [&] { return Eigen::Vector3d(even(random), even(random), even(random)); };
  const View view = plain_view(20e-6, {99.5, 79.5}, {200, 160});
  for (const SolidCase& one : kSolids) {
    BodyLook look = dull();
    look.solid = one.solid;
    int met = 0;
    for (int draw = 0; draw < 400; ++draw) {
      BodyState body{some() * 1e-4, some().normalized(), one.semi_axis, one.semi_radius};
      body.side = body.axis.unitOrthogonal();
      const Figure figure = figure_of(view, body, look);
      const Eigen::Vector3d at = figure.center + 0.8e-3 * some();
      const Eigen::Vector3d slope = 0.5 * some();
      const PixelLine line{static_cast<float>(at.x()), static_cast<float>(at.y()),
                           static_cast<float>(slope.x()), static_cast<float>(slope.y())};
      const Hit seen = hit(figure, line);
      const Eigen::Vector3d along = Eigen::Vector3d(line.dx, line.dy, 1).normalized();
      const Eigen::Vector3d from = Eigen::Vector3d(line.x, line.y, 0) - figure.center;
      const Eigen::Vector3d across = along.unitOrthogonal(), third = along.cross(across);
      double gauge = 0;
      for (int i = 0; i < 14400; ++i) {
        const double angle = M_PI * i / 7200;
        const Eigen::Vector3d n = std::cos(angle) * across + std::sin(angle) * third;
        gauge = std::max(gauge, from.dot(n) / reach(one.solid, body, n));
      }
      if (one.solid != Solid::disc && gauge * gauge < kWellOutside) {
        EXPECT_NEAR(std::sqrt(seen.closest), gauge, 2e-3) << one.name << draw;
      }
      if (std::abs(gauge - 1) > 3e-3) {
        EXPECT_EQ(seen.closest < 1, gauge < 1) << one.name << draw << " " << gauge;
      }
      if (!(gauge < 0.99)) continue;
      ++met;
      EXPECT_NEAR(seen.position.dot(seen.normal), reach(one.solid, body, seen.normal), 1e-6)
          << one.name << draw;
      EXPECT_GT(seen.normal.dot(along), -1e-9) << "towards the observer";
      const Eigen::Vector3d off = seen.position - from;
      EXPECT_LT((off - off.dot(along) * along).norm(), 1e-9) << "on the line";
    }
    EXPECT_GT(met, 20) << one.name;
  }
}

// Parallel lines: a cylinder's shadow is two halves of an ellipse and a rectangle between them, a
// rod's two half discs and a rectangle.
TEST(Solids, CoverAsManyPixelsAsTheirShadowHasArea) {
  Renderer renderer = from_above(clean());
  const double empty = cv::sum(renderer.render(nullptr, 0))[0];
  for (const SolidCase& one : {kSolids[0], kSolids[1], kSolids[2]}) {
    for (const double tilt : {0.0, 0.4, 1.1, 1.45, M_PI / 2}) {
      BodyLook look{0, 0, 0, 1};
      look.solid = one.solid;
      const Eigen::Vector3d axis(std::sin(tilt) * 0.8, std::sin(tilt) * 0.6, std::cos(tilt));
      const cv::Mat image = renderer.render(
          {still({{3e-6, 7e-6, 0}, axis, one.semi_axis, one.semi_radius}, look)}, 0);
      const double a = one.semi_axis, b = one.semi_radius;
      const double sine = std::sin(tilt), cosine = std::cos(tilt);
      const double area = one.solid == Solid::rod ? M_PI * b * b + 4 * (a - b) * b * sine
                                                  : M_PI * b * b * cosine + 4 * a * b * sine;
      const double dark = (empty - cv::sum(image)[0]) / (0.6 * 255) * 20e-6 * 20e-6;
      EXPECT_NEAR(dark, area, 0.005 * area) << one.name << " at " << tilt;
    }
  }
}

TEST(Solids, ACylinderHasCornersWhereASpheroidIsRound) {
  Renderer renderer = from_above(clean());
  BodyLook look = dull();
  look.solid = Solid::cylinder;
  const BodyState body{{0, 0, 0}, kX, 0.5e-3, 0.25e-3};
  const cv::Mat flat = renderer.render({still(body, look)}, 0);
  const cv::Mat round = renderer.render({still(body, dull())}, 0);
  EXPECT_LT(flat.at<std::uint8_t>(89, 122), 40) << "0.45 mm along, 0.19 mm aside";
  EXPECT_GT(round.at<std::uint8_t>(89, 122), 140);
  EXPECT_GT(flat.at<std::uint8_t>(89, 127), 140) << "beyond the end";
}

TEST(Exposure, MotionSmearsWithoutTakingLight) {
  Renderer renderer = from_above(clean());
  const BodyState start{{-0.1e-3, 0, 0}, kX, 0.3e-3, 0.3e-3};
  BodyState end = start;
  end.position.x() = 0.1e-3;  // ten pixels
  const cv::Mat sharp = renderer.render({still(start, dull())}, 0),
                smeared = renderer.render({{start, end, dull()}}, 0);
  const double missing = 0.6 * 255 * 200 * 160 - cv::sum(sharp)[0];
  EXPECT_NEAR(0.6 * 255 * 200 * 160 - cv::sum(smeared)[0], missing, 0.03 * missing);
  cv::Mat slopes[2];
  cv::Sobel(sharp, slopes[0], CV_32F, 1, 0);
  cv::Sobel(smeared, slopes[1], CV_32F, 1, 0);
  EXPECT_LT(cv::norm(slopes[1], cv::NORM_INF), 0.4 * cv::norm(slopes[0], cv::NORM_INF));
}

TEST(Color, ARedDiscIsRedAndTheGroundKeepsItsTint) {
  Sensor sensor = clean();
  sensor.color = SensorColor::bayer;
  sensor.ground_tint = {1, 0.5, 0.25};
  Renderer renderer = from_above(sensor);
  BodyLook red{1, 0, 0, 1};
  red.color = {0.8, 0.2, 0.1};
  const cv::Mat image = renderer.render({still({{0, 0, 0}, kZ, 0.1e-3, 0.6e-3}, red)}, 0);
  ASSERT_EQ(image.type(), CV_8UC3);
  const auto disc = image.at<cv::Vec3b>(80, 100), ground = image.at<cv::Vec3b>(20, 20);
  EXPECT_NEAR(disc[2], 0.8 * 255, 2);
  EXPECT_NEAR(disc[1], 0.2 * 255, 2);
  EXPECT_NEAR(disc[0], 0.1 * 255, 2);
  EXPECT_NEAR(ground[2], 0.6 * 255, 2);
  EXPECT_NEAR(ground[0], 0.15 * 255, 2);
}

LaboratorySettings small() {
  LaboratorySettings settings;
  settings.top.size = {320, 240};
  settings.top_image.center_px = {159.5, 119.5};
  settings.side.size = {160, 120};
  settings.side_center_px = {79.5, 59.5};
  settings.world.placement_scatter = 0;
  return settings;
}

TEST(Jitter, FramesAreLateByChanceButInOrderAndTheSameForOneSeed) {
  LaboratorySettings settings = small();
  settings.side.jitter = 20e-3;
  const auto lateness = [&](std::uint64_t seed) {
    const auto clock = virtual_clock();
    Laboratory laboratory(settings, *clock, seed);
    std::vector<double> late;
    Time last{-1};
    for (int k = 0; k < 12; ++k) {
      const Frame frame = laboratory.side_camera().grab(kForever);
      EXPECT_EQ(frame.number, static_cast<std::uint64_t>(k));
      EXPECT_GT(frame.received, last);
      last = frame.received;
      late.push_back(to_seconds(frame.received - frame.exposed) - settings.side.latency);
    }
    return late;
  };
  const std::vector<double> first = lateness(3);
  EXPECT_EQ(first, lateness(3));
  EXPECT_NE(first, lateness(4));
  EXPECT_GE(*std::min_element(first.begin(), first.end()), 0);
  EXPECT_GT(*std::max_element(first.begin(), first.end()), 10e-3);
}

/// The steepest edge in the picture's middle with the bare sensor there: that of the dark body over
/// the retina.
double sharpness(Laboratory& laboratory, Clock& clock, double z) {
  laboratory.carry_sensor([z](Time) { return z; });
  clock.sleep_for(200 * kMs);
  cv::Mat picture = laboratory.top_camera().grab(kForever).image, slope;
  cv::Sobel(picture, slope, CV_32F, 1, 0);
  return cv::norm(slope(cv::Rect(110, 70, 100, 100)), cv::NORM_INF);
}

TEST(BareSensor, ItIsSharpWhereTheAerialImageIsAndBlursBothWays) {
  LaboratorySettings settings = small();
  settings.top_view = TopView::bare_sensor;
  settings.top_image.pixel = 40e-6;
  settings.sensor_aperture = 0.08;
  settings.top.sensor = clean();
  const auto clock = virtual_clock();
  BodySettings ball;
  ball.name = "ball";
  ball.shape = Shape::spheroid;
  ball.semi_axis = ball.semi_radius = 0.5e-3;
  ball.color = {0, 0, 0};
  ball.fixed = true;
  settings.world.bodies = {ball};
  Laboratory laboratory(settings, *clock, 1);
  // the aerial image of the center lies 11.832 mm behind the last vertex (facts/optics 2), the
  // sensor's 0 at 12.3 mm
  const double at = sharpness(laboratory, *clock, -0.47e-3),
               before = sharpness(laboratory, *clock, -3.5e-3),
               behind = sharpness(laboratory, *clock, 3e-3);
  EXPECT_GT(at, 1.5 * before);
  EXPECT_GT(at, 1.5 * behind);
}

TEST(RotatingSensor, HalfATurnTurnsThePictureRound) {
  LaboratorySettings settings = small();
  settings.top_view = TopView::bare_sensor;
  settings.sensor_aperture = 0.02;
  settings.top.sensor = clean();
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 1);
  const cv::Mat upright = laboratory.top_camera().grab(kForever).image;
  laboratory.turn_sensor([](Time) { return M_PI; });
  clock->sleep_for(200 * kMs);
  cv::Mat turned = laboratory.top_camera().grab(kForever).image;
  cv::rotate(turned, turned, cv::ROTATE_180);
  EXPECT_LT(cv::norm(upright, turned, cv::NORM_L1) / static_cast<double>(upright.total()), 1);
}

TEST(Microscope, IsFocusedByWhatCarriesIt) {
  LaboratorySettings settings = small();
  settings.top.sensor = clean();
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 1), moved(settings, *clock, 1);
  moved.carry_sensor([](Time time) { return time > 1000 * kMs ? 2e-3 : 0.0; });
  EXPECT_EQ(cv::norm(laboratory.top_image(1000 * kMs, 1), moved.top_image(1000 * kMs, 1)), 0);
  EXPECT_GT(cv::norm(laboratory.top_image(1100 * kMs, 2), moved.top_image(1100 * kMs, 2)), 0);
}

TEST(SimulatedCamera, KeepsTheContractOfACamera) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  for (Camera* const camera : {&laboratory.top_camera(), &laboratory.side_camera()})
    EXPECT_EQ(contract::check(*camera, *clock), std::vector<std::string>{});
}

TEST(SimulatedCamera, DrawsWhatWasExposedWhateverHappensUntilItIsDrawn) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1), same(small(), *clock, 1);
  for (Laboratory* const one : {&laboratory, &same}) one->sample().insert_robot({0, 0, 0});
  clock->sleep_for(300 * kMs);
  const Picture top = laboratory.expose_top(200 * kMs, 1);
  const Picture side = laboratory.expose_side(200 * kMs, 1);
  const cv::Mat seen_by_top = same.top_image(200 * kMs, 1),
                seen_by_side = same.side_image(200 * kMs, 1);
  laboratory.sample().remove_robot();
  laboratory.set_light(0.5);
  cv::Mat drawn;
  std::thread([&] { drawn = top(); }).join();
  EXPECT_EQ(cv::norm(drawn, seen_by_top), 0);
  EXPECT_EQ(cv::norm(side(), seen_by_side), 0);
  EXPECT_GT(cv::norm(laboratory.top_image(200 * kMs, 1), seen_by_top), 0) << "in half the light";
}

TEST(Lamp, ThePictureIsAsBrightAsTheLight) {
  LaboratorySettings settings = small();
  settings.top.sensor = clean();
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 1);
  const double full = cv::mean(laboratory.top_image(Time(0), 1))[0];
  laboratory.set_light(0.5);
  EXPECT_NEAR(cv::mean(laboratory.top_image(Time(0), 1))[0], full / 2,
              1);  // of rounding to gray levels
  laboratory.set_light(0);
  EXPECT_LT(cv::mean(laboratory.top_image(Time(0), 1))[0], 1);
}

TEST(Lamp, AfterAChangeThePictureIsTheOneOfThatLightFromTheStart) {
  for (const TopView view : {TopView::microscope, TopView::plain}) {
    LaboratorySettings settings = small();
    settings.top_view = view;
    const auto clock = virtual_clock();
    Laboratory changed(settings, *clock, 1), dim(settings, *clock, 1);
    for (Laboratory* const one : {&changed, &dim}) one->sample().insert_robot({0, 0, 0});
    const cv::Mat full = changed.top_image(Time(0), 1);
    for (Laboratory* const one : {&changed, &dim}) one->set_light(0.3);
    const cv::Mat seen = changed.top_image(Time(0), 2);
    EXPECT_EQ(cv::norm(seen, dim.top_image(Time(0), 2)), 0);
    EXPECT_LT(cv::mean(seen)[0], 0.5 * cv::mean(full)[0]);
    changed.set_light(1);
    EXPECT_EQ(cv::norm(changed.top_image(Time(0), 1), full), 0);
  }
}

TEST(BareSensor, ItsLightComesThroughTheMiddleOfTheStop) {
  const optics::System eye = optics::model_eye_5_3();
  const optics::Microscope sensor = bare_sensor(eye, 12.3e-3, 0.159);
  for (const double m : {10e-6, 0.5e-3, 2e-3}) {
    const auto ray = optics::isopixel_line(eye, sensor, {m, 0});
    ASSERT_TRUE(ray);
    // The stop, 4 mm behind surface 2, seems 3.80 mm behind it: 1.403 / (1.492 / 4 mm - 0.089
    // / 24.73 mm).
    const double across = ray->origin.x() + 3.798e-3 * ray->direction.x() / ray->direction.z();
    EXPECT_LT(std::abs(across), 0.1 * m) << "the pupil's own aberration grows with m";
  }
}

TEST(PlainView, ThereIsNoEyeInIt) {
  LaboratorySettings settings = small();
  settings.top_view = TopView::plain;
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 1);
  laboratory.sample().insert_robot({0.5e-3, 0, 0});
  clock->sleep_for(150 * kMs);
  const cv::Mat image = laboratory.top_camera().grab(kForever).image;
  const cv::Moments dark = cv::moments(image < 100, true);
  EXPECT_NEAR(dark.m10 / dark.m00, 159.5 + 0.5e-3 / 14.3e-6, 1);
  EXPECT_NEAR(dark.m00, M_PI * 70 * 35, 0.1 * M_PI * 70 * 35);
}

TEST(Pictures, ABodyShowsInTheSideView) {
  LaboratorySettings settings = small();
  BodySettings disc;
  disc.name = "disc";
  disc.fixed = true;
  disc.semi_radius = 0.8e-3;
  disc.color = {0, 0, 0};
  settings.world.bodies = {disc};
  const auto clock = virtual_clock();
  Laboratory with(settings, *clock, 1), without(small(), *clock, 1);
  cv::Mat difference;
  cv::absdiff(with.side_camera().grab(kForever).image, without.side_camera().grab(kForever).image,
              difference);
  // From its side a disc with a round edge: a rectangle with half a circle at each end.
  const double area = cv::countNonZero(difference > 60),
               expected = (4 * 0.7e-3 * 0.1e-3 + M_PI * 0.1e-3 * 0.1e-3) / (20.4e-6 * 20.4e-6);
  EXPECT_NEAR(area, expected, 0.06 * expected);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
