// Support of the optics tests: prescriptions for testing, and "refuses, naming the argument".
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <string>

namespace vitreo::optics {

constexpr double kMm = 1e-3, kUm = 1e-6;

inline Surface make_surface(double radius, double conic, double thickness, double index) {
  Surface surface;
  surface.radius = radius;
  surface.conic = conic;
  surface.thickness = thickness;
  surface.index = index;
  return surface;
}

/// Vitreous of index `before`, then one surface.
inline System one_surface(double radius, double conic, double before, double behind,
                          double vertex = 20 * kMm) {
  System system;
  system.surfaces = {make_surface(12 * kMm, 0, vertex, before),
                     make_surface(radius, conic, 0, behind)};
  return system;
}

/// Navarro's eye with the condensing lens of thesis table 3.3; with `asphere`, of table 3.4 (mm^-3
/// .. mm^-9 turned to m).
inline System navarro_with_condensing_lens(bool asphere) {
  System eye;
  eye.surfaces = {make_surface(12.00 * kMm, 0.00, 16.32 * kMm, 1.336),
                  make_surface(6.00 * kMm, -1.00, 4.00 * kMm, 1.420),
                  make_surface(-10.20 * kMm, -3.13, 3.05 * kMm, 1.337),
                  make_surface(-6.50 * kMm, 0.00, 0.55 * kMm, 1.376),
                  make_surface(-7.72 * kMm, -0.26, 2.31 * kMm, 1.000),
                  make_surface(11.65 * kMm, -9.24, 13.00 * kMm, 1.523),
                  make_surface(-9.48 * kMm, -1.07, 0, 1.000)};
  if (asphere)
    eye.surfaces[5].aspheric = {4.078e-5 * 1e9, -1.542e-7 * 1e15, -2.647e-9 * 1e21,
                                2.023e-11 * 1e27};
  eye.stop = Stop{3, 1.5 * kMm};
  return eye;
}

/// Expects std::invalid_argument whose text begins with `name`.
inline void expect_refused(const std::string& name, const std::function<void()>& call) {
  try {
    call();
    ADD_FAILURE() << "accepted a bad " << name;
  } catch (const std::invalid_argument& refusal) {
    EXPECT_EQ(std::string(refusal.what()).rfind(name, 0), 0u) << refusal.what();
  }
}

}  // namespace vitreo::optics
