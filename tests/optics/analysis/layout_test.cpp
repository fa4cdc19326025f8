// The layout drawing: well-formed, safe, everything inside, and refusing what cannot be drawn.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/layout.h"

#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <regex>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

std::size_t count_of(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1))
    ++count;
  return count;
}

/// Opens equal closes, in order; the drawing uses no comments or sections.
bool well_formed(const std::string& svg) {
  std::vector<std::string> open;
  const std::regex tag(R"(<(/?)([a-zA-Z]+)((?:[^<>"]|"[^"<]*")*?)(/?)>)");
  std::size_t covered = 0;
  for (std::sregex_iterator at(svg.begin(), svg.end(), tag), end; at != end; ++at) {
    ++covered;
    if ((*at)[1].length() != 0) {
      if (open.empty() || open.back() != (*at)[2].str()) return false;
      open.pop_back();
    } else if ((*at)[4].length() == 0) {
      open.push_back((*at)[2].str());
    }
  }
  return open.empty() && covered == count_of(svg, "<");
}

TEST(Layout, OfEveryPrescriptionIsWellFormedAndFreeOfScriptsAndNonNumbers) {
  for (const std::string& name : prescription_names()) {
    const Prescription eye = prescription(name);
    const std::vector<double> angles{0, 15 * kDegree, -25 * kDegree};
    const double end = eye.system.vertex(eye.system.size()) + 12 * kMm;
    LayoutOptions options;
    options.media = eye.media;
    const std::string svg = layout_svg(eye.system, field_fans(eye.system, angles, end), options);
    EXPECT_TRUE(well_formed(svg)) << name;
    for (const char* bad : {"script", "href", "onload"}) {
      EXPECT_EQ(svg.find(bad), std::string::npos) << name << " " << bad;
    }
    // As words: Brennan is a name.
    EXPECT_FALSE(std::regex_search(svg, std::regex("\\b(nan|inf)\\b"))) << name;
    // One line per surface and at least the axial fan.
    EXPECT_GE(count_of(svg, "<polyline"), static_cast<std::size_t>(eye.system.size() + 5)) << name;
    EXPECT_NE(svg.find(" mm</text>"), std::string::npos) << name;
  }
}

TEST(Layout, RaysRunThroughAllSurfacesAndEndWhereAsked) {
  const System eye = prescription("navarro_condensing").system;
  const double end = eye.vertex(7) + 14 * kMm;
  const auto rays = field_fans(eye, std::vector<double>{0, 35 * kDegree}, end, 3);
  ASSERT_EQ(rays.size(), 6u);
  for (const LayoutRay& ray : rays) {
    ASSERT_EQ(ray.path.size(), 8u);
    EXPECT_NEAR(ray.path.back().x(), end, 1e-15);
    for (std::size_t i = 1; i < 7; ++i) {
      const double vertex = eye.vertex(static_cast<int>(i) + 1);
      EXPECT_NEAR(ray.path[i].x(), vertex + eye.surfaces[i].sag(std::abs(ray.path[i].y())), 1e-12);
    }
  }
  EXPECT_NEAR(rays[0].path[2].y(), -rays[2].path[2].y(), 1e-12);  // the axial fan is symmetric
  EXPECT_EQ(rays[0].group, 0);
  EXPECT_EQ(rays[5].group, 1);
}

TEST(Layout, ALostRayEndsWhereItIsLost) {
  const System eye = prescription("navarro_condensing").system;
  const LayoutRay ray = ray_path(eye, {{0, 0, 0}, Eigen::Vector3d(0.6, 0, 1).normalized()}, 0.1);
  EXPECT_LT(ray.path.size(), 8u);
  EXPECT_GE(ray.path.size(), 1u);
}

TEST(Layout, TitlesAndLabelsAreEscaped) {
  LayoutOptions options;
  options.title = "<script>alert(\"&\")</script>";
  options.media = {"a<b"};
  options.marks.push_back({5 * kMm, 1 * kMm, "\"x\"&<y>"});
  const std::string svg = layout_svg(model_eye_5_3(), {}, options);
  EXPECT_TRUE(well_formed(svg));
  EXPECT_EQ(svg.find("<script"), std::string::npos);
}

TEST(Layout, SemiDiametersThatAreGivenAreTheOnesDrawn) {
  System eye = model_eye_5_3();
  const std::string before = layout_svg(eye, {});
  eye.surfaces[5].semi_diameter = eye.surfaces[6].semi_diameter = 3 * kMm;
  EXPECT_NE(layout_svg(eye, {}), before);
}

TEST(Layout, WhatCannotBeDrawnIsRefused) {
  const System eye = model_eye_5_3();
  const double nan = std::nan("");
  LayoutOptions options;
  options.width_px = nan;
  expect_refused("width_px", [&] { (void)layout_svg(eye, {}, options); });
  options = {};
  options.marks.push_back({nan, 0, ""});
  expect_refused("marks", [&] { (void)layout_svg(eye, {}, options); });
  const std::vector<LayoutRay> rays{{{{0, nan}}, 0}};
  expect_refused("rays", [&] { (void)layout_svg(eye, rays); });
  expect_refused("count", [&] { (void)field_fans(eye, std::vector<double>{0}, 0.1, 0); });
  expect_refused("end_z", [&] { (void)ray_path(eye, {{0, 0, 0}, {0, 0, 1}}, nan); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
