// The simulated cameras' pictures: geometry against exact rays, blur and noise against their laws.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/renderer.h"

#include "devices/sim/defocus_wave.h"
#include "optics/maps/wide_angle_map.h"
#include "optics/rays/trace.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

const Eigen::Vector3d kEye(0, 0, -5e-3);

optics::ImageScale scale_for(const ImageSize& size) {
  optics::ImageScale scale;
  scale.center_px = {(size.width - 1) / 2.0, (size.height - 1) / 2.0};
  return scale;
}

optics::Microscope tilted_microscope() {
  optics::Microscope microscope;
  microscope.pupil_distance = 0.15;
  microscope.decenter = {0.2e-3, -0.1e-3};
  microscope.tilt = {0.01, 0.02};
  return microscope;
}

double greatest_line_error(const optics::Microscope& microscope) {
  const optics::System eye = optics::model_eye_5_3();
  const ImageSize size{1384, 1036};
  const optics::ImageScale scale = scale_for(size);
  const View view = eye_view(eye, microscope, scale, size, kEye);
  double worst = 0;
  for (int v = 7; v < size.height; v += 61) {
    for (int u = 5; u < size.width; u += 53) {
      const auto ray = optics::isopixel_line(eye, microscope, scale.m_from_pixel({u, v}));
      if (!ray) continue;
      const PixelLine& line = view.at(u, v);
      for (const double z : {0.0, 8e-3}) {
        const Eigen::Vector3d exact =
            ray->origin + (z - ray->origin.z()) / ray->direction.z() * ray->direction;
        worst = std::max(
            worst, std::hypot(line.x + z * line.dx - exact.x(), line.y + z * line.dy - exact.y()));
      }
    }
  }
  return worst;
}

TEST(View, InterpolatedLinesAreTheTracedOnes) {
  // 100 nm: a two-hundredth of a pixel
  EXPECT_LT(greatest_line_error(optics::Microscope{}), 100e-9);
  EXPECT_LT(greatest_line_error(tilted_microscope()), 100e-9);
}

TEST(View, ThePixelOfAPointLooksAtThatPoint) {
  const ImageSize size{1384, 1036};
  const View view = eye_view(optics::model_eye_5_3(), {}, scale_for(size), size, kEye);
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0, 0, 5e-3), {4e-3, 0, 2e-3}, {-3e-3, 2e-3, 8e-3}}) {
    const auto pixel = view.pixel_of(point);
    ASSERT_TRUE(pixel);
    const PixelLine& line = view.at(static_cast<int>(std::lround(pixel->x())),
                                    static_cast<int>(std::lround(pixel->y())));
    // one pixel is at most 20 um in the eye; half of it by the rounding
    EXPECT_LT(std::hypot(line.x + point.z() * line.dx - point.x(),
                         line.y + point.z() * line.dy - point.y()),
              15e-6);
  }
  EXPECT_FALSE(view.pixel_of({20e-3, 0, 5e-3})) << "outside the image";
}

TEST(View, WorldXIsToTheRightAndYUpInTheTopImage) {
  const ImageSize size{1384, 1036};
  const View view = eye_view(optics::model_eye_5_3(), {}, scale_for(size), size, kEye);
  const auto center = view.pixel_of({0, 0, 5e-3}), right = view.pixel_of({1e-3, 0, 5e-3}),
             up = view.pixel_of({0, 1e-3, 5e-3});
  EXPECT_GT(right->x(), center->x() + 30);
  EXPECT_LT(up->y(), center->y() - 30);
}

TEST(SideView, WorldXIsToTheRightAndZUp) {
  const View view = side_view(20e-6, {100, 80}, {200, 160});
  const auto center = view.pixel_of(view.point_in_view({0, 5e-3, 0}));
  ASSERT_TRUE(center);
  EXPECT_NEAR(center->x(), 100, 1e-3);
  EXPECT_NEAR(center->y(), 80, 1e-3);
  const auto moved = view.pixel_of(view.point_in_view({0.4e-3, 0, 0.2e-3}));
  EXPECT_NEAR(moved->x(), 120, 1e-3);
  EXPECT_NEAR(moved->y(), 70, 1e-3);
}

TEST(PointSpread, ItKeepsTheLightAndGrowsWithTheDefocus) {
  const Aperture aperture;
  double last = 0;
  for (const double defocus : {0.0, 1e-3, 3e-3, 6e-3}) {
    const cv::Mat kernel = point_spread(aperture, defocus);
    EXPECT_NEAR(cv::sum(kernel)[0], 1, 1e-5);
    double second = 0;
    const int half = kernel.rows / 2;
    for (int j = -half; j <= half; ++j)
      for (int i = -half; i <= half; ++i)
        second += static_cast<double>(kernel.at<float>(j + half, i + half)) * i * i;
    EXPECT_GT(second, last);
    // a disc of radius r has the second moment r^2/4; the rest is diffraction and the pixel,
    // below 1.6 px^2
    const double radius = defocus * aperture.numerical_aperture / aperture.pixel;
    EXPECT_NEAR(second, radius * radius / 4 + 0.8, 0.8 + 0.05 * radius * radius);
    last = second;
  }
}

TEST(PointSpread, TheDefocusedWaveHasItsClosedFormsOnTheAxisAndAtTheDiscsRim) {
  for (const double u : {0.5, 2.0, 3.83, 8.0, 30.0, 60.0}) {
    const double x = u / 4;
    EXPECT_NEAR(defocused_intensity(u, 0), std::pow(std::sin(x) / x, 2), 1e-5) << u;
    // Born & Wolf 8.8, at the edge of the shadow, v = u.
    const double j = std::cyl_bessel_j(0.0, u);
    EXPECT_NEAR(defocused_intensity(u, u), (1 - 2 * j * std::cos(u) + j * j) / (u * u), 1e-5) << u;
  }
  for (const double v : {0.5, 2.0, 5.0}) {  // in focus it is Airy's
    const double airy = std::pow(2 * std::cyl_bessel_j(1.0, v) / v, 2);
    EXPECT_NEAR(defocused_intensity(0, v), airy, 1e-5) << v;
  }
}

/// Of two kernels: half of what lies elsewhere in one than in the other; 1 where they share
/// nothing.
double apart(const cv::Mat& a, const cv::Mat& b) {
  const int half = std::max(a.rows, b.rows) / 2;
  double sum = 0;
  for (int j = -half; j <= half; ++j)
    for (int i = -half; i <= half; ++i) {
      const auto of = [&](const cv::Mat& k) {
        const int h = k.rows / 2;
        return std::abs(i) > h || std::abs(j) > h ? 0.0F : k.at<float>(j + h, i + h);
      };
      sum += std::abs(of(a) - of(b));
    }
  return sum / 2;
}

TEST(PointSpread, WithinTheDepthOfFieldDefocusHardlyBlurs) {
  // NA 0.01: an Airy radius of 34 um. Geometry's disc is half as large 1.7 mm out of focus, where
  // the wave's middle has lost 7 %: sinc^2(u / 4), u = 1.9.
  const Aperture aperture;
  const cv::Mat sharp = point_spread(aperture, 0);
  const cv::Mat near = point_spread(aperture, 1.7e-3);
  const int half = sharp.rows / 2;
  const int half_near = near.rows / 2;
  const double middle = near.at<float>(half_near, half_near) / sharp.at<float>(half, half);
  EXPECT_NEAR(middle, 0.93, 0.03);
  EXPECT_LT(apart(sharp, near), 0.08);
}

TEST(PointSpread, WaveAndGeometryMeetWhereOneTakesOverFromTheOther) {
  const Aperture aperture{0.05, 550e-9, 14.3e-6};
  const double airy_radius = 0.61 * aperture.wavelength / aperture.numerical_aperture;
  const double change = 16 * airy_radius / aperture.numerical_aperture;
  const double difference =
      apart(point_spread(aperture, 0.999 * change), point_spread(aperture, 1.001 * change));
  // 0.12: the rings that the band's 9 % leaves in the disc, and how fast its rim falls off.
  EXPECT_LT(difference, 0.15);
}

TEST(Blur, ItsSeparableKernelsEqualTheWholeOne) {
  const Aperture aperture;
  Blur blur(aperture);
  cv::Mat point = cv::Mat::zeros(61, 61, CV_32F);
  point.at<float>(30, 30) = 1;
  blur.apply(point, 3e-3);
  const cv::Mat kernel = point_spread(aperture, 3e-3);
  const int half = kernel.rows / 2;
  const cv::Mat middle = point(cv::Rect(30 - half, 30 - half, kernel.cols, kernel.rows));
  EXPECT_LT(cv::norm(middle, kernel, cv::NORM_INF),
            0.05 * cv::norm(kernel, cv::NORM_INF));  // 0.2 % of the energy is left out
  EXPECT_NEAR(cv::sum(point)[0], 1, 1e-4);
}

Renderer flat_renderer(double level, const Sensor& sensor) {
  const ImageSize size{256, 200};
  return Renderer(
      side_view(20e-6, {127.5, 99.5}, size), {0.01, 550e-9, 20e-6},
      [](const Eigen::Vector2d&, double) { return 0.0; },
      cv::Mat(size.height, size.width, CV_32F, cv::Scalar(level)), 0, sensor, {}, 9);
}

TEST(Renderer, NoiseIsThatOfTheCountedElectrons) {
  Sensor sensor;
  sensor.vignette = 0;
  Renderer renderer = flat_renderer(0.5, sensor);
  double sum = 0, squares = 0, count = 0;
  for (int frame = 0; frame < 20; ++frame) {
    const cv::Mat image = renderer.render(nullptr, frame);
    cv::Scalar mean, deviation;
    cv::meanStdDev(image, mean, deviation);
    sum += mean[0];
    squares += deviation[0] * deviation[0];
    ++count;
  }
  EXPECT_NEAR(sum / count, 127.5, 0.05);
  const double electrons = sensor.full_well / 2,
               shot = std::sqrt(electrons + 15 * 15) * 255 / sensor.full_well;
  EXPECT_NEAR(squares / count, shot * shot + 1.0 / 12,
              0.03 * shot * shot);  // rounding to gray levels adds 1/12
}

TEST(Renderer, FramesDifferAndEachIsRepeatable) {
  Renderer renderer = flat_renderer(0.5, {}), other = flat_renderer(0.5, {});
  const cv::Mat first = renderer.render(nullptr, 1), second = renderer.render(nullptr, 2);
  EXPECT_GT(cv::norm(first, second, cv::NORM_L1), 1000);
  EXPECT_EQ(cv::norm(first, other.render(nullptr, 1), cv::NORM_INF), 0);
}

TEST(Renderer, NothingOfTheRobotStaysBehindWhenItIsGone) {
  Renderer renderer = flat_renderer(0.5, {}), fresh = flat_renderer(0.5, {});
  const BodyState robot{{0, 0, 0}, Eigen::Vector3d::UnitX(), 1e-3, 0.5e-3};
  renderer.render(&robot, 1);
  EXPECT_EQ(cv::norm(renderer.render(nullptr, 2), fresh.render(nullptr, 2), cv::NORM_INF), 0);
}

TEST(Renderer, ASilhouetteHasTheRobotsSizeToATenthOfAPixel) {
  Sensor clean;
  clean.read_noise = 0;
  clean.full_well = 1e9;
  clean.vignette = 0;
  Renderer renderer = flat_renderer(0.6, clean);
  const BodyState robot{{0, 0, 0}, Eigen::Vector3d::UnitX(), 1e-3, 0.5e-3};
  const cv::Mat with = renderer.render(&robot, 0), without = renderer.render(nullptr, 0);
  // The area of the part that is darker than half-way to the robot's own rim, which is nearly
  // black.
  cv::Mat darker;
  cv::subtract(without, with, darker);
  const double threshold = 0.5 * (0.6 - 0.06) * 255;
  int area = 0;
  for (int v = 70; v < 130; ++v)
    for (int u = 60; u < 196; ++u) area += darker.at<std::uint8_t>(v, u) > threshold;
  // the highlight in the middle is brighter than the threshold: fill it
  cv::Mat mask = darker > threshold;
  for (int v = 0; v < mask.rows; ++v) {
    int first = -1, last = -1;
    for (int u = 0; u < mask.cols; ++u)
      if (mask.at<std::uint8_t>(v, u) != 0) {
        if (first < 0) first = u;
        last = u;
      }
    if (first >= 0) mask.row(v).colRange(first, last + 1).setTo(255);
  }
  const double expected = M_PI * 50 * 25;  // px^2: 1 mm and 0.5 mm at 20 um
  // 0.3 px all round would be 74 px^2: the blur moves the half-way line inwards by about sigma^2 /
  // 2R there
  EXPECT_NEAR(cv::countNonZero(mask), expected, 0.3 * M_PI * 75);
}

TEST(EyeDefocus, ABareSensorGoesThroughFocusAtEveryAngleWhereTheMapHasTheImage) {
  const optics::System eye = optics::model_eye_5_3();
  const optics::WideAngleMap map(eye);
  for (const double aside : {0.0, 1.5e-3, 3e-3, 5.5e-3}) {
    const Eigen::Vector3d point(aside, 0, 1.47e-3 + aside * aside / 23e-3);  // along the retina
    const auto image = map.image(point);
    ASSERT_TRUE(image) << aside;
    constexpr double kAperture = 0.12, kApart = 0.1e-3;
    double least = 1, best = 0, farthest = 0;
    for (int i = -10; i <= 10; ++i) {
      const optics::Microscope sensor = bare_sensor(eye, image->focus + i * kApart, kAperture);
      optics::ImageScale scale = scale_for({1760, 160});
      scale.pixel = 9.9e-6;
      const double blur = eye_defocus(eye, sensor, scale)(scale.pixel_from_m(image->m), point.z());
      if (blur < least) least = blur, best = i * kApart;
      farthest = std::max(farthest, blur);
    }
    EXPECT_NEAR(best, 0, 0.35e-3)
        << aside << ": rim rays and the whole bundle differ by spherical aberration";
    EXPECT_GT(farthest, 2 * least)
        << aside << ": astigmatism leaves half a millimeter at 5.5 mm, a millimeter off adds";
  }
}

TEST(EyeDefocus, ItIsTheDistanceOfTheAerialImageFromTheFocus) {
  const optics::System eye = optics::model_eye_5_3();
  optics::ImageScale scale = scale_for({1384, 1036});
  const auto defocus = eye_defocus(eye, {}, scale);
  // the paraxial aerial images of facts section 2: 8.985 mm for the retina, 11.832 at 5 mm, against
  // the focus at 12.3 mm; 2 % for the aperture's own aberration
  EXPECT_NEAR(defocus(scale.center_px, 0), 12.3e-3 - 8.985e-3, 0.02 * 3.3e-3);
  EXPECT_NEAR(defocus(scale.center_px, 5e-3), 12.3e-3 - 11.832e-3, 0.02 * 3.3e-3);
}

TEST(Fundus, ItHasVesselsAndAnOpticDisc) {
  const Fundus fundus = Fundus::drawn(3, 15e-3);
  EXPECT_GT(fundus.reflectance(4.3e-3, 0.6e-3), 0.5F) << "the disc is bright";
  double least = 1, most = 0;
  for (int i = 0; i < 2000; ++i) {
    const float value = fundus.reflectance(-6e-3 + i * 6e-6, 3e-3);
    least = std::min<double>(least, value);
    most = std::max<double>(most, value);
  }
  EXPECT_GT(most - least, 0.1) << "a line across the arcades crosses vessels";
  EXPECT_EQ(fundus.reflectance(1, 1), 0) << "outside";
  EXPECT_NE(cv::norm(fundus.map(), Fundus::drawn(4, 15e-3).map(), cv::NORM_L1), 0)
      << "the seed decides";
}

TEST(Fundus, APhotographLiesOnTheRetinaTheRightWayRound) {
  const std::string file = testing::TempDir() + "vitreo_fundus_test.png";
  cv::Mat picture(100, 200, CV_8UC3, cv::Scalar(0, 51, 0));
  picture(cv::Rect(150, 0, 50, 50)).setTo(cv::Scalar(0, 204, 0));  // the upper right corner
  ASSERT_TRUE(cv::imwrite(file, picture));
  const Fundus fundus = Fundus::photograph(file, 20e-3);  // 0.1 mm a pixel
  std::remove(file.c_str());
  EXPECT_NEAR(fundus.reflectance(7e-3, 3e-3), 0.8, 1e-3);
  EXPECT_NEAR(fundus.reflectance(-7e-3, 3e-3), 0.2, 1e-3);
  EXPECT_NEAR(fundus.reflectance(7e-3, -3e-3), 0.2, 1e-3);
  EXPECT_EQ(fundus.reflectance(7e-3, 6e-3), 0) << "beyond its edge";
}

TEST(Fundus, APhotographHasItsColorsAndLiesWhereItIsMovedTo) {
  const std::string file = testing::TempDir() + "vitreo_fundus_color_test.png";
  cv::Mat picture(100, 200, CV_8UC3, cv::Scalar(0, 51, 0));
  picture(cv::Rect(150, 0, 50, 50)).setTo(cv::Scalar(102, 204, 51));  // blue, green, red
  ASSERT_TRUE(cv::imwrite(file, picture));
  const Fundus fundus = Fundus::photograph(file, 20e-3);
  std::remove(file.c_str());
  ASSERT_TRUE(fundus.has_color());
  EXPECT_FALSE(Fundus::drawn(3, 15e-3).has_color());
  EXPECT_NEAR(fundus.color(7e-3, 3e-3)[0], 0.4, 1e-3);
  EXPECT_NEAR(fundus.color(7e-3, 3e-3)[2], 0.2, 1e-3);
  cv::Mat points(1, 2, CV_64FC2);
  points.at<cv::Vec2d>(0, 0) = {7e-3, 3e-3};
  points.at<cv::Vec2d>(0, 1) = {std::nan(""), 0};
  EXPECT_NEAR(painted_ground(points, fundus, {0, 0}, false).at<float>(0, 0), 0.8, 1e-3);
  EXPECT_NEAR(painted_ground(points, fundus, {14e-3, 0}, false).at<float>(0, 0), 0.2, 1e-3)
      << "moved to the right, its left side lies there";
  const cv::Mat color = painted_ground(points, fundus, {0, 0}, true);
  EXPECT_NEAR(color.at<cv::Vec3f>(0, 0)[2], 0.2, 1e-3);
  EXPECT_EQ(color.at<cv::Vec3f>(0, 1), cv::Vec3f(0, 0, 0)) << "a line that misses the retina";
}

TEST(Fundus, APhotographThatCannotBeReadIsNamed) {
  EXPECT_THROW(Fundus::photograph("no_such_file.png", 30e-3), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
