// SPDX-License-Identifier: Apache-2.0
#include "host/rig/bench_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace vitreo {
namespace {

using Of = BenchKey::Of;
using Bench = BenchUncertainty;
using Plant = sim::OpticsSigmas;
constexpr Bounds kLength{0, 5e-3, "m"};
constexpr Bounds kAngle{0, 0.2, "rad"};

constexpr std::array kBenchKeys{
    BenchKey{"pupil_power",
             &Bench::pupil_power,
             &Plant::pupil_power,
             Of::picture,
             {0, 10, "1/m"},
             "of the microscope, 1 / pupil distance"},
    BenchKey{"microscope_tilt", &Bench::microscope_tilt, &Plant::microscope_tilt, Of::picture,
             kAngle, "about x and y"},
    BenchKey{"pixel",
             &Bench::pixel,
             &Plant::pixel,
             Of::picture,
             {0, 0.1, ""},
             "relative, besides the camera's own"},
    BenchKey{"center", &Bench::center, &Plant::center, Of::picture, kLength,
             "of the aerial image, x and y"},
    BenchKey{"object_plane", &Bench::object_plane, &Plant::object_plane, Of::eye, kLength,
             "of the microscope, along the axis"},
    BenchKey{"lens_axial", &Bench::lens_axial, &Plant::lens_axial, Of::eye, kLength,
             "of the condensing lens"},
    BenchKey{"lens_aside", &Bench::lens_aside, &Plant::lens_aside, Of::eye, kLength,
             "the same, x and y"},
    BenchKey{"lens_tilt", &Bench::lens_tilt, &Plant::lens_tilt, Of::eye, kAngle,
             "the same, about x and y"},
    BenchKey{"eye_rotation", &Bench::eye_rotation, &Plant::eye_rotation, Of::eye, kAngle,
             "about the retina's center, x and y"},
    BenchKey{"inner_lens_aside", &Bench::inner_lens_aside, &Plant::inner_lens_aside, Of::eye,
             kLength, "of the eye's own lens, x and y"},
    BenchKey{"inner_lens_tilt", &Bench::inner_lens_tilt, &Plant::inner_lens_tilt, Of::eye, kAngle,
             "the same, about x and y"},
    BenchKey{"axial_length", &Bench::axial_length, &Plant::axial_length, Of::walls, kLength,
             "retina to the eye's lens"},
    BenchKey{"retina_depth", &Bench::retina_depth, &Plant::retina_depth, Of::walls, kLength,
             "where the retina stands"},
    BenchKey{"retina_curvature", &Bench::retina_curvature, &Plant::retina_curvature, Of::walls,
             kLength, "of sag, 4 mm from the axis"}};

bool is_drawn(const sim::OpticsSigmas& plant) {
  return std::any_of(kBenchKeys.begin(), kBenchKeys.end(),
                     [&](const BenchKey& key) { return plant.*key.drawn > 0; });
}

/// A microscope without an eye has scale, center, pupil and tilt; of a real one they are the
/// camera's own, `pixel` and `tilt` of model.uncertainty.
bool stands_as_believed(const BenchFacts& facts) {
  return !is_drawn(facts.plant) && (facts.simulated || !facts.shows_eye);
}

bool is_read(const BenchKey& key, const BenchFacts& facts) {
  return key.of == Of::walls || (key.of == Of::picture ? facts.pictures : facts.shows_eye);
}

}  // namespace

std::span<const BenchKey> bench_keys() { return kBenchKeys; }

BenchUncertainty read_bench(ConfigReader reader, const BenchFacts& facts,
                            std::vector<std::string>& warnings) {
  const std::string usual = stands_as_believed(facts) ? "known" : "by_hand";
  const bool by_hand = reader.choice("places", usual, {"by_hand", "known"}) == "by_hand";
  BenchUncertainty bench = by_hand ? BenchUncertainty{} : BenchUncertainty::none();
  std::vector<std::string> untold;
  for (const BenchKey& key : kBenchKeys) {
    bench.*key.sigma = reader.number(key.name, bench.*key.sigma, key.bounds);
    const bool read = is_read(key, facts);
    if (read && facts.plant.*key.drawn > 0 && bench.*key.sigma == 0) untold.push_back(key.name);
    if (!read && reader.has(key.name))
      warnings.push_back(fmt::format(
          "model.uncertainty.bench.{}: nothing reads it, for {}", key.name,
          facts.pictures ? "the top camera's view shows no eye" : "the rig has no top camera"));
  }
  reader.finish();
  if (!untold.empty())
    warnings.push_back(fmt::format(
        "model.uncertainty.bench: {} {} drawn by truth.optics and {} as known here: what is stated "
        "of positions is too small",
        fmt::join(untold, ", "), untold.size() == 1 ? "is" : "are",
        untold.size() == 1 ? "counts" : "count"));
  return bench;
}

}  // namespace vitreo
