// Bindings of optical_system: other colors, and light as a wave.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/wavefront.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

/// A system of its own: the handle's stays as it is. A color outside the range of a medium's model
/// is refused by the model's name.
int in_light(Call& call) {
  optics::Prescription eye = eye_of(call);
  eye.system = optics::at_wavelength(eye.system, call.number(0));
  push_system(call.L, std::move(eye));
  return 1;
}

/// The pupil is the real stop, in whichever medium it lies, as light fills it. Strehl's ratio and
/// the coefficients belong to the distance asked for, or to the best focus of the rays; with far =
/// true to parallel light, as of an eye alone.
int wavefront(Call& call) {
  const optics::System& system = eye_of(call).system;
  const optics::PupilTracer tracer(system,
                                   optics::Pupil::of_stop(system, optics::Pupil::Kind::real_stop));
  const auto point = optics::point_at_field(system, call.number_option("angle").value_or(0),
                                            call.number_option("depth").value_or(0));
  optics::WavefrontSettings settings;
  settings.image = call.number_option("distance");
  if (call.flag_option("far")) settings.image = std::numeric_limits<double>::infinity();
  const auto wave = point ? optics::wavefront(tracer, *point, settings) : std::nullopt;
  if (!wave) return 0;
  ResultTable table(call);
  table.number("rms", wave->rms(), "m")
      .number("strehl", wave->strehl())
      .numbers("zernike", optics::zernike_coefficients(*wave), "m")
      .number("wavelength", wave->wavelength, "m");
  if (!std::isfinite(wave->image)) return 1;
  table.number("distance", wave->image, "m").number("numerical_aperture", wave->numerical_aperture);
  if (const auto frequency = call.number_option("frequency")) {
    // As far as the samples of the wave suffice, in the corners of the square.
    constexpr int kCells = 64;
    const double half_width = wave->reach / std::numbers::sqrt2;  // 3.6 wavelengths over the NA
    const Eigen::MatrixXd psf = optics::diffraction_psf(*wave, half_width, kCells);
    table.number("mtf_tangential", optics::psf_mtf(psf, half_width, {*frequency, 0}))
        .number("mtf_sagittal", optics::psf_mtf(psf, half_width, {0, *frequency}));
  }
  return 1;
}

/// Colors with their energies, all 1 where none are given; without colors the system's own.
std::vector<std::pair<double, double>> spectrum_of(const Call& call, const optics::System& system) {
  const auto wavelengths =
      call.numbers_option("wavelengths").value_or(std::vector<double>{system.wavelength});
  const auto energies =
      call.numbers_option("energies").value_or(std::vector<double>(wavelengths.size(), 1));
  if (wavelengths.empty()) throw std::invalid_argument("wavelengths: wants at least one");
  if (energies.size() != wavelengths.size())
    throw std::invalid_argument("energies: wants one for each of the wavelengths");
  std::vector<std::pair<double, double>> spectrum;
  for (std::size_t i = 0; i < wavelengths.size(); ++i)
    spectrum.emplace_back(wavelengths[i], energies[i]);
  return spectrum;
}

/// The square is as large as the waves' samples suffice for in its corners, unless one is asked
/// for.
int point_spread(Call& call) {
  constexpr int kCells = 48;
  const optics::System& system = eye_of(call).system;
  const auto point = optics::point_at_field(system, call.number_option("angle").value_or(0),
                                            call.number_option("depth").value_or(0));
  if (!point) return 0;
  const auto colors = optics::colored_waves(system, *point, spectrum_of(call, system),
                                            {.image = call.number_option("distance")});
  double reach = std::numeric_limits<double>::infinity();
  for (const optics::ColoredWave& color : colors) {
    const double aside = (color.wave.chief - colors.front().wave.chief).norm();
    reach = std::min(reach, color.wave.reach - aside);
  }
  const double half_width = call.number_option("half_width").value_or(reach / std::numbers::sqrt2);
  const auto cells = static_cast<int>(call.number_option("cells").value_or(kCells));
  const Eigen::MatrixXd psf = optics::polychromatic_psf(colors, half_width, cells);
  ResultTable table(call);
  table.number("half_width", half_width, "m")
      .number("distance", colors.front().wave.image, "m")
      .number("brightest", psf.maxCoeff())
      .matrix("intensity", psf);
  if (const auto frequency = call.number_option("frequency")) {
    table.number("mtf_tangential", optics::psf_mtf(psf, half_width, {*frequency, 0}))
        .number("mtf_sagittal", optics::psf_mtf(psf, half_width, {0, *frequency}));
  }
  return 1;
}

/// Fields that hang on an option are optional.
std::vector<ResultField> point_spread_fields() {
  const char* const transfer = "with diffraction, at the frequency";
  return {{"half_width", "m", "of the square about the first color's chief ray"},
          {"distance", "m", "of the image from the last vertex"},
          {"brightest", "", "the largest intensity"},
          {"intensity", "", "rows along y; 1: the middle without aberrations"},
          {.name = "mtf_tangential", .unit = "", .help = transfer, .optional = true},
          {.name = "mtf_sagittal", .unit = "", .help = transfer, .optional = true}};
}

Argument frequency_option() {
  return {.name = "frequency",
          .type = Type::number,
          .unit = "1/m",
          .optional = true,
          .min = 0,
          .max = 1e9,
          .help = "for mtf_tangential, mtf_sagittal"};
}

Binding point_spread_row() {
  const auto list = [](const char* name, const char* unit, const char* help) {
    return Argument{
        .name = name, .type = Type::numbers, .unit = unit, .optional = true, .help = help};
  };
  return {"point_spread",
          {options_of({list("wavelengths", "m", "in vacuum (the system's own)"),
                       list("energies", "", "of each color, positive, in any unit (all alike)"),
                       {.name = "angle",
                        .type = Type::number,
                        .unit = "rad",
                        .optional = true,
                        .min = -1.5,
                        .max = 1.5,
                        .help = "of the field (0)"},
                       length_option("depth", 0, 1, "before the retina (0)"),
                       length_option("distance", -10, 10,
                                     "from the last vertex (best focus of the first color)"),
                       length_option("half_width", 1e-9, 1, "of the square (as large as can be)"),
                       {.name = "cells",
                        .type = Type::integer,
                        .optional = true,
                        .min = 1,
                        .max = 512,
                        .help = "of a side (48)"},
                       frequency_option()})},
          Returned("table", point_spread_fields()).or_nil("outside"),
          "the diffraction image of a point of the retina in light of several colors",
          point_spread,
          "eye:point_spread { wavelengths = { 486.1e-9, 589.3e-9, 656.3e-9 } }"};
}

}  // namespace

/// Fields that hang on an option or on where the image lies are optional.
std::vector<Binding> system_wave_rows() {
  const auto lit = [](const char* name, const char* unit, const char* help) {
    return ResultField{.name = name, .unit = unit, .help = help, .optional = true};
  };
  return {{"in_light",
           {{.name = "wavelength",
             .type = Type::number,
             .unit = "m",
             .min = 300e-9,
             .max = 1200e-9,
             .help = "in vacuum; the tables are for 589.3 nm"}},
           "optical_system",
           "the same system in light of another color, by the dispersion of its media",
           in_light,
           "eye:in_light(486.1e-9)"},
          {"wavefront",
           {options_of({{.name = "angle",
                         .type = Type::number,
                         .unit = "rad",
                         .optional = true,
                         .min = -1.5,
                         .max = 1.5,
                         .help = "of the field (0)"},
                        length_option("depth", 0, 1, "before the retina (0)"),
                        length_option("distance", -10, 10, "from the last vertex (best focus)"),
                        {.name = "far",
                         .type = Type::flag,
                         .optional = true,
                         .help = "the image is far away, as of an eye alone (false)"},
                        frequency_option()})},
           Returned("table",
                    std::vector<ResultField>{
                        {"rms", "m", "of the optical path differences"},
                        {"strehl", "", "ratio, where the image is brightest"},
                        {"zernike", "m", "coefficients of ANSI Z80.28, j = 0 first, to order 6"},
                        {"wavelength", "m", "of the system"},
                        lit("distance", "m", "of the image from the last vertex"),
                        lit("numerical_aperture", "", "of the bundle, on the image's side"),
                        lit("mtf_tangential", "", "with diffraction, at the frequency"),
                        lit("mtf_sagittal", "", "with diffraction, at the frequency")})
               .or_nil("when no light comes through"),
           "the wave of a point of the retina: aberrations, and what diffraction leaves",
           wavefront,
           "eye:wavefront { angle = 10 * deg }"},
          point_spread_row()};
}

}  // namespace vitreo::lua
