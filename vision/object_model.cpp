// SPDX-License-Identifier: Apache-2.0
#include "vision/object_model.h"

#include "vision/bytes.h"

namespace vitreo::vision {
namespace {

constexpr std::string_view kObjectMagic = "VTOM";
constexpr std::uint32_t kObjectVersion = 1;

void save_calibration(ByteWriter& out, const Calibration& calibration) {
  for (const double value : calibration.semi_axes_px) out.f64(value);
  for (const double value : calibration.covariance.reshaped()) out.f64(value);
}

Calibration load_calibration(ByteReader& in) {
  Calibration calibration;
  for (double& value : calibration.semi_axes_px) value = in.f64(-100, 100);
  for (double& value : calibration.covariance.reshaped()) value = in.f64(-1e4, 1e4);
  return calibration;
}

// Its length first, so that the reader knows where the part ends.
void save_part(ByteWriter& out, const std::string& part) {
  out.u32(static_cast<std::uint32_t>(part.size()));
  out.text(part);
}

}  // namespace

// Format "VTOM", version 1: image size, mean axes, both calibrations, then color and shape model,
// each with its length.
std::string ObjectModel::save() const {
  ByteWriter out;
  out.text(kObjectMagic);
  out.u32(kObjectVersion);
  out.u32(static_cast<std::uint32_t>(image_size.width));
  out.u32(static_cast<std::uint32_t>(image_size.height));
  for (const double value : semi_axes_px) out.f64(value);
  save_calibration(out, rim);
  save_calibration(out, segment);
  save_part(out, color.save());
  save_part(out, shape.save());
  return out.sealed();
}

// Throws std::invalid_argument naming the part that is damaged; every number is read with its
// bounds.
ObjectModel ObjectModel::load(std::string_view bytes) {
  ByteReader in(bytes, kObjectMagic, kObjectVersion, "object model");
  ObjectModel model;
  model.image_size.width = in.integer(1, 100000);
  model.image_size.height = in.integer(1, 100000);
  for (double& value : model.semi_axes_px) value = in.f64(1, 1e4);
  model.rim = load_calibration(in);
  model.segment = load_calibration(in);
  model.color = ColorModel::load(in.text(in.u32()));
  model.shape = ShapeModel::load(in.text(in.u32()));
  in.end();
  return model;
}

}  // namespace vitreo::vision
