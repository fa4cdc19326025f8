// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/bench_sample.h"

#include "devices/sim/checks.h"
#include "devices/sim/hardware_sample.h"

#include <array>

namespace vitreo::sim {
namespace {

bool shows_the_eye(const LaboratorySettings& settings) {
  if (settings.top_view != TopView::microscope) return true;
  const double width = settings.top.size.width, height = settings.top.size.height;
  constexpr std::array<std::array<double, 2>, 5> kParts{
      {{0.5, 0.5}, {0.25, 0.5}, {0.75, 0.5}, {0.5, 0.25}, {0.5, 0.75}}};
  for (const auto& part : kParts) {
    const Eigen::Vector2d pixel(part[0] * width, part[1] * height);
    if (!optics::isopixel_line(settings.eye, settings.microscope,
                               settings.top_image.m_from_pixel(pixel)))
      return false;
  }
  return true;
}

}  // namespace

OpticsSample sample_bench(const LaboratorySettings& settings, const OpticsSigmas& sigmas,
                          std::uint64_t seed) {
  constexpr std::uint64_t kMost = 100;
  constexpr std::uint64_t kRow = 2001;  // a stream of its own, beside those of the sample
  OpticsSample sample = sample_optics(sigmas, seed);
  // A view that does not show it as it is believed is another one's business.
  if (!shows_the_eye(settings)) return sample;
  for (std::uint64_t k = 1; k <= kMost; ++k) {
    if (shows_the_eye(with_optics(settings, sample))) return sample;
    sample = sample_optics(sigmas, mix(seed, kRow, k));
  }
  require(false, "optics: none of a hundred benches shows the inside of the eye");
  return sample;
}

}  // namespace vitreo::sim
