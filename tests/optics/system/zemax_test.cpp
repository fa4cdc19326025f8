// The import of Zemax files: what it reads, what it refuses and how it says so, and thousands of
// broken files.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/zemax.h"

#include "optics/rays/trace.h"
#include "optics/system/first_order.h"
#include "optics/system/frames.h"
#include "tests/optics/support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

/// Navarro's eye as it is usually modeled: light comes from infinity, the image is the retina.
std::string navarro_file() {
  return R"(VERS 140124 258 36214
MODE SEQ
NAME Navarro, relaxed
NOTE 0 wide-angle schematic eye
PFIL 0 0 0
UNIT MM X W X CM MR CPMM
ENPD 3.0E+0
ENVD 2.0E+1 1 0
GFAC 0 0
FTYP 0 0 1 3 0 0 0
WAVM 1 5.893E-1 1
WAVM 2 5.46E-1 1
PWAV 1
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ INFINITY
  DIAM 0 0 0 0 1 ""
SURF 1
  COMM cornea, front
  TYPE STANDARD
  CURV 1.295336787564767E-1 0 0 0 0 ""
  CONI -2.6E-1
  DISZ 0.55
  GLAS ___BLANK 1 0 1.376 56.0 0 0 0 0 0 0
  DIAM 5.5 1 0 0 1 ""
SURF 2
  TYPE STANDARD
  CURV 1.538461538461538E-1 0 0 0 0 ""
  DISZ 3.05
  GLAS ___BLANK 1 0 1.337 50.0
SURF 3
  STOP
  TYPE EVENASPH
  CURV 9.80392156862745E-2 0 0 0 0 ""
  CONI -3.13
  PARM 1 0
  PARM 2 -1.0E-5
  DISZ 4.0
  GLAS ___BLANK 1 0 1.42 48.0
  DIAM 1.5 0 0 0 1 ""
SURF 4
  TYPE STANDARD
  CURV -1.666666666666667E-1 0 0 0 0 ""
  CONI -1
  DISZ 16.32
  GLAS ___BLANK 1 0 1.336 50.0
SURF 5
  TYPE STANDARD
  CURV -8.33333333333333E-2 0 0 0 0 ""
  DISZ 0
  DIAM 10 0 0 0 1 ""
TOL TOFF 0 0 0 0 0 0 0
MNUM 1 1
)";
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string utf16(const std::string& text, bool big_endian) {
  std::string bytes = big_endian ? "\xFE\xFF" : "\xFF\xFE";
  for (char c : text) {
    if (big_endian) bytes += '\0';
    bytes += c;
    if (!big_endian) bytes += '\0';
  }
  return bytes;
}

TEST(Zemax, AnEyeTurnedRoundIsNavarrosEye) {
  const ZemaxFile file = parse_zemax(navarro_file());
  EXPECT_EQ(file.title, "Navarro, relaxed");
  EXPECT_EQ(file.comments[1], "cornea, front");
  ASSERT_EQ(file.wavelengths.size(), 2u);
  EXPECT_NEAR(file.wavelengths[0], 589.3e-9, 1e-18);
  const Prescription eye = prescription_from_zemax(file, ZemaxDirection::image_is_retina);
  const System expected = prescription("navarro").system;
  ASSERT_EQ(eye.system.size(), 5);
  for (int i = 0; i < 5; ++i) {
    const Surface &ours = eye.system.surfaces[i], &table = expected.surfaces[i];
    EXPECT_NEAR(ours.radius / table.radius, 1, 1e-14)
        << i;  // the file has 16 digits of the curvature
    EXPECT_EQ(ours.conic, table.conic) << i;
    EXPECT_NEAR(ours.thickness, table.thickness, 1e-17) << i;
    EXPECT_EQ(ours.index, table.index) << i;
  }
  EXPECT_NEAR(eye.system.surfaces[2].aspheric[0], 1e-5 * 1e9, 1e-6);  // turned with its surface
  EXPECT_NEAR(eye.system.surfaces[4].semi_diameter, 5.5 * kMm, 1e-17);
  EXPECT_TRUE(std::isinf(
      eye.system.surfaces[2].semi_diameter));  // the file's own computed diameter clips nothing
  ASSERT_TRUE(eye.system.stop);
  EXPECT_EQ(eye.system.stop->surface, 3);
}

TEST(Zemax, TheStopFollowsFromTheEntrancePupil) {
  const System eye =
      prescription_from_zemax(parse_zemax(navarro_file()), ZemaxDirection::image_is_retina).system;
  // The cornea magnifies the iris by 1.13: an entrance pupil of 3 mm belongs to a stop of 2.65.
  EXPECT_NEAR(eye.stop->radius, 1.5 * kMm / 1.13, 0.01 * kMm);
  const System by_diameter =
      prescription_from_zemax(parse_zemax(replaced(navarro_file(), "ENPD 3.0E+0\n", "")),
                              ZemaxDirection::image_is_retina)
          .system;
  EXPECT_EQ(by_diameter.stop->radius, 1.5 * kMm);
}

TEST(Zemax, TheSameLightOutAndIn) {
  const std::string finite = replaced(navarro_file(), "DISZ INFINITY", "DISZ 250");
  const ZemaxFile file = parse_zemax(finite);
  const auto in =
      cardinal_points(prescription_from_zemax(file, ZemaxDirection::object_is_retina).system);
  const auto out =
      cardinal_points(prescription_from_zemax(file, ZemaxDirection::image_is_retina).system);
  ASSERT_TRUE(in && out);
  EXPECT_NEAR(in->focal_length, out->focal_length, 1e-15);
  EXPECT_NEAR(in->first_principal_point, -out->second_principal_point, 1e-15);
}

TEST(Zemax, AllEncodingsAndLineEndsReadTheSame) {
  const std::string text = navarro_file();
  std::string dos;
  for (char c : text) dos += c == '\n' ? std::string("\r\n") : std::string(1, c);
  for (const std::string& bytes :
       {dos, "\xEF\xBB\xBF" + text, utf16(text, false), utf16(dos, false), utf16(text, true)}) {
    const ZemaxFile file = parse_zemax(bytes);
    EXPECT_EQ(file.surfaces.size(), 6u);
    EXPECT_EQ(file.title, "Navarro, relaxed");
    EXPECT_EQ(file.surfaces[3].conic, -3.13);
  }
}

TEST(Zemax, UnitsScaleEveryLength) {
  const auto radius = [](const char* unit) {
    return parse_zemax(replaced(navarro_file(), "UNIT MM", std::string("UNIT ") + unit))
        .surfaces[1]
        .radius;
  };
  EXPECT_NEAR(radius("MM"), 7.72e-3, 1e-16);
  EXPECT_NEAR(radius("CM"), 7.72e-2, 1e-15);
  EXPECT_NEAR(radius("IN"), 7.72 * 0.0254, 1e-14);
  EXPECT_NEAR(radius("M"), 7.72, 1e-13);
  const ZemaxFile inches = parse_zemax(replaced(navarro_file(), "UNIT MM", "UNIT IN"));
  EXPECT_NEAR(inches.surfaces[3].aspheric[0] * std::pow(0.0254, 3), -1e-5, 1e-18);
}

TEST(Zemax, GlassesOfTheTableAreKnownAndOthersGetSuggestions) {
  const char* blank = "GLAS ___BLANK 1 0 1.376 56.0 0 0 0 0 0 0";
  EXPECT_EQ(parse_zemax(replaced(navarro_file(), blank, "GLAS N-BK7 0 0 1.5 40")).surfaces[1].index,
            1.51680);
  try {
    parse_zemax(replaced(navarro_file(), blank, "GLAS N-BK8 0 0 1.5 40"));
    FAIL();
  } catch (const std::invalid_argument& refusal) {
    EXPECT_NE(std::string(refusal.what()).find("N-BK7"), std::string::npos) << refusal.what();
  }
}

TEST(Zemax, WhatIsNotSupportedIsRefusedWithItsLineAndOperand) {
  const auto refused = [](const std::string& where, const std::string& from,
                          const std::string& to) {
    expect_refused(where, [&] { (void)parse_zemax(replaced(navarro_file(), from, to)); });
  };
  refused("line 2: MODE", "MODE SEQ", "MODE NSC");
  refused("line 6: UNIT", "UNIT MM", "UNIT FURLONG");
  refused("line 7: ENPD", "ENPD 3.0E+0", "ENPD -3");
  refused("line 21: TYPE", "front\n  TYPE STANDARD", "front\n  TYPE TOROIDAL");
  refused("line 22: CURV", "CURV 1.295336787564767E-1", "CURV nan");
  refused("line 22: CURV", "CURV 1.295336787564767E-1", "CURV 1.2abc");
  refused("line 23: CONI", "CONI -2.6E-1", "CONI");
  refused("line 25: GLAS", "GLAS ___BLANK 1 0 1.376", "GLAS MIRROR 0 0 1.376");
  refused("line 25: GLAS", "GLAS ___BLANK 1 0 1.376", "GLAS ___BLANK 1 0 0.5");
  refused("line 25: XDAT", "GLAS ___BLANK 1 0 1.376", "XDAT 1 2.0 0");
  refused("line 37: PARM", "PARM 1 0", "PARM 1 1e-3");
  refused("line 37: PARM", "PARM 1 0", "PARM 7 1e-9");
  refused("line 27: SURF", "SURF 2", "SURF 4");
  refused("line 26: SQAP", "DIAM 5.5 1 0", "SQAP 3 3 0");
  refused("line 26: CLAP", "DIAM 5.5 1 0", "CLAP 1 5 0");
  refused("line 54: MNUM", "MNUM 1 1", "MNUM 3 1");
  refused("line 54: WIBBLE", "MNUM 1 1", "WIBBLE 1");
  refused("line 15: TYPE", "SURF 0", "NOTE");
}

/// A lens of two spheres in air between coordinate breaks: the second undoes the first.
std::string tilted_file(const std::string& order) {
  return R"(MODE SEQ
UNIT MM
SURF 0
  TYPE STANDARD
  DISZ 20
SURF 1
  TYPE COORDBRK
  PARM 1 0.5
  PARM 2 -0.25
  PARM 3 10
  PARM 4 -5
  PARM 5 30
  PARM 6 )" +
         order +
         R"(
  DISZ 0
SURF 2
  TYPE STANDARD
  CURV 0.1
  DISZ 4
  GLAS ___BLANK 1 0 1.5 60
SURF 3
  TYPE BICONICX
  CURV -0.08
  CONI -0.5
  PARM 1 -15
  PARM 2 -0.25
  DISZ 3
SURF 4
  TYPE STANDARD
  DISZ 0
)";
}

TEST(Zemax, CoordinateBreaksBecomeDecentersAndTilts) {
  const Prescription lens =
      prescription_from_zemax(parse_zemax(tilted_file("0")), ZemaxDirection::object_is_retina);
  const System& system = lens.system;
  ASSERT_EQ(system.size(), 3);
  const SurfaceFrame first = surface_frame(system, 2);
  EXPECT_NEAR(first.origin.x(), 0.5 * kMm, 1e-15);  // decentered before it is turned
  EXPECT_NEAR(first.origin.y(), -0.25 * kMm, 1e-15);
  EXPECT_NEAR(first.origin.z(), 20 * kMm, 1e-15);
  // OpticStudio's matrix Rx Ry Rz: its third column is the new axis.
  constexpr double kDegree = std::numbers::pi / 180;
  EXPECT_NEAR(first.axes(0, 2), std::sin(-5 * kDegree), 1e-15);
  EXPECT_NEAR(first.axes(1, 2), -std::sin(10 * kDegree) * std::cos(5 * kDegree), 1e-15);
  EXPECT_NEAR(first.axes(0, 0), std::cos(5 * kDegree) * std::cos(30 * kDegree), 1e-15);
  // The next surface lies 4 mm along the turned axis.
  const SurfaceFrame second = surface_frame(system, 3);
  EXPECT_LT((second.origin - first.origin - 4 * kMm * first.axes.col(2)).norm(), 1e-15);
  EXPECT_LT((second.axes - first.axes).norm(), 1e-14);
  EXPECT_NEAR(system.surfaces[2].radius, -15 * kMm, 1e-15);
  EXPECT_NEAR(system.surfaces[2].radius_y, -12.5 * kMm, 1e-15);
  EXPECT_NEAR(system.surfaces[2].conic, -0.25, 1e-15);
  EXPECT_NEAR(system.surfaces[2].conic_y, -0.5, 1e-15);
}

TEST(Zemax, TheOrderFlagTiltsFirst) {
  const Prescription lens =
      prescription_from_zemax(parse_zemax(tilted_file("1")), ZemaxDirection::object_is_retina);
  const SurfaceFrame first = surface_frame(lens.system, 2);
  const Eigen::Vector3d moved = first.axes * Eigen::Vector3d(0.5, -0.25, 0) * kMm;
  EXPECT_LT((first.origin - Eigen::Vector3d(0, 0, 20 * kMm) - moved).norm(), 1e-15);
  // Rz Ry Rx: the first row of it is (cos z cos y, ..).
  constexpr double kDegree = std::numbers::pi / 180;
  EXPECT_NEAR(first.axes(2, 0), -std::sin(-5 * kDegree), 1e-15);
}

TEST(Zemax, ABrokenLensTracesTheSameOutAndTurnedRound) {
  const ZemaxFile file = parse_zemax(tilted_file("0"));
  const System out = prescription_from_zemax(file, ZemaxDirection::object_is_retina).system;
  const System in = prescription_from_zemax(file, ZemaxDirection::image_is_retina).system;
  const TraceResult forward =
      trace_out(out, {{0, 0, 0}, Eigen::Vector3d(0.01, 0.02, 1).normalized()});
  ASSERT_EQ(forward.status, TraceStatus::ok);
  // The retina of the second is the file's image, whose axes are those behind the breaks, turned by
  // pi about y.
  const SurfaceFrame last = surface_frame(out, 3);
  const Eigen::Vector3d image = last.origin + 3 * kMm * last.axes.col(2);
  const Eigen::Matrix3d to_in =
      Eigen::Vector3d(-1, 1, -1).asDiagonal() * Eigen::Matrix3d(last.axes.transpose());
  const Eigen::Vector3d start = to_in * (forward.ray.origin - image);
  const Eigen::Vector3d direction = to_in * forward.ray.direction;
  const Ray back{start + 3 * kMm * direction, -direction};
  const TraceResult traced = trace_out(in, back);
  ASSERT_EQ(traced.status, TraceStatus::ok);
  const Eigen::Vector3d object = to_in * (-image);
  const Eigen::Vector3d off = traced.ray.origin - object;
  EXPECT_LT(off.cross(traced.ray.direction).norm(), 1e-12);
}

TEST(Zemax, EmptyAndBinaryFilesAreRefused) {
  for (const std::string& bytes :
       {std::string(), std::string("\n\n"), std::string("SURF 0\nSURF 1\n"),
        std::string("\xFF\xFE", 2), std::string(100, '\0'), std::string("\xFF\xFEx", 3),
        std::string(9 << 20, ' ')}) {
    expect_refused("line 1", [&] { (void)parse_zemax(bytes); });
  }
}

TEST(Zemax, ARetinaAtInfinityAndACrossedSystemAreRefused) {
  const ZemaxFile file = parse_zemax(navarro_file());
  expect_refused("direction",
                 [&] { (void)prescription_from_zemax(file, ZemaxDirection::object_is_retina); });
  const ZemaxFile crossed = parse_zemax(replaced(navarro_file(), "DISZ 3.05", "DISZ -3.05"));
  expect_refused("surface",
                 [&] { (void)prescription_from_zemax(crossed, ZemaxDirection::image_is_retina); });
}

/// One random change: a byte, a cut, a line lost, doubled or swapped, a number made strange.
std::string mutated(std::string text, std::mt19937& random) {
  const auto below = [&](std::size_t limit) { return random() % std::max<std::size_t>(limit, 1); };
  const std::size_t at = below(text.size());
  const std::size_t begin = text.rfind('\n', at) + 1;  // npos + 1 is 0
  const std::size_t length =
      std::min(text.find('\n', at), text.size()) - std::min(begin, text.size());
  static const std::vector<std::string> kStrange{"INFINITY", "nan",   "-1e308", "1e-308", "0",
                                                 "-0",       "1e999", "\"\"",   "SURF",   "GLAS",
                                                 "-3",       "\t",    "7",      "1.5"};
  switch (below(6)) {
    case 0:
      if (!text.empty()) text[at] = static_cast<char>(random());
      break;
    case 1:
      text.resize(at);
      break;
    case 2:
      text.erase(std::min(begin, text.size()), length + 1);
      break;
    case 3:
      text.insert(std::min(begin, text.size()),
                  text.substr(std::min(begin, text.size()), length + 1));
      break;
    case 4: {
      const std::size_t word = text.find(' ', at);
      if (word == std::string::npos) break;
      const std::size_t end = std::min(text.find_first_of(" \n", word + 1), text.size());
      text.replace(word + 1, end - word - 1, kStrange[below(kStrange.size())]);
      break;
    }
    default:
      text.insert(at, std::string(1, static_cast<char>(random())));
      break;
  }
  return text;
}

TEST(Zemax, BrokenFilesGiveASoundSystemOrARefusalAndNothingElse) {
  std::mt19937 random(1);
  int read = 0, sound = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string text = navarro_file();
    for (auto changes = random() % 6 + 1; changes > 0; --changes)
      text = mutated(std::move(text), random);
    if (i % 5 == 0) text = utf16(text, i % 2 == 0);
    try {
      const ZemaxFile file = parse_zemax(text);
      ++read;
      const Prescription eye = prescription_from_zemax(file, ZemaxDirection::image_is_retina);
      eye.check();
      ++sound;
    } catch (const std::invalid_argument& refusal) {
      EXPECT_GT(std::string(refusal.what()).size(), 5u);
    }
  }
  EXPECT_GT(read, 1000);  // or the mutations are too wild to test anything behind the first lines
  EXPECT_GT(sound, 500);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
