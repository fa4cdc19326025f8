// SPDX-License-Identifier: Apache-2.0
#include "vision/object_model.h"

#include "vision/bytes.h"
#include "vision/learned_evidence.h"

#include <utility>

namespace vitreo::vision {
namespace {

constexpr std::string_view kObjectMagic = "VTOM";
constexpr std::uint32_t kObjectVersion = 7;
constexpr int kFeaturesBefore4 = 9;
constexpr int kFeaturesBefore6 = 10;
constexpr int kMostAsked = 1000000;

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

void save_audit(ByteWriter& out, const FalseBelief& audit) {
  out.u32(static_cast<std::uint32_t>(audit.asked));
  for (const FalseBelief::Asked& asked : {audit.as_trained, audit.resized}) {
    out.u32(static_cast<std::uint32_t>(asked.answered));
    out.f64(asked.most_likeness);
  }
  out.u32(static_cast<std::uint32_t>(audit.places_px.size()));
  for (const Eigen::Vector2d& place : audit.places_px) out.f64(place.x()), out.f64(place.y());
}

FalseBelief load_audit(ByteReader& in, std::uint32_t version) {
  FalseBelief audit;
  audit.asked = in.integer(0, kMostAsked);
  const auto read = [&in](FalseBelief::Asked& asked) {
    asked.answered = in.integer(0, kMostAsked);
    asked.most_likeness = in.f64(-100, 100);
  };
  read(audit.as_trained);
  if (version > 3) read(audit.resized);
  const int count = in.integer(0, kMostAsked);
  for (int k = 0; k < count; ++k) {
    const double u = in.f64(0, 1e5);
    audit.places_px.emplace_back(u, in.f64(0, 1e5));
  }
  return audit;
}

void save_light(ByteWriter& out, const TrainedLight& light) {
  out.u32(light.known ? 1 : 0);
  for (const double value : light.ground) out.f64(value);
  for (const double value : light.object) out.f64(value);
}

TrainedLight load_light(ByteReader& in) {
  TrainedLight light;
  light.known = in.integer(0, 1) == 1;
  for (double& value : light.ground) value = in.f64(-1, 6);  // ln of 0.5 to 255
  for (double& value : light.object) value = in.f64(-1, 6);
  return light;
}

// The network itself is looked at here, so that a damaged one is found with the file and not in the
// first frame.
void load_network(ByteReader& in, ObjectModel& model) {
  model.network = in.text(in.u32());
  model.network_thresholds.low = in.f64(-8, 8);
  model.network_thresholds.high = in.f64(-8, 8);
  if (model.network_thresholds.low > model.network_thresholds.high)
    in.fail("its lower threshold is above the higher");
  if (!model.network.empty()) LearnedEvidence::check(model.network);
}

// Its length first, so that the reader knows where the part ends.
void save_part(ByteWriter& out, const std::string& part) {
  out.u32(static_cast<std::uint32_t>(part.size()));
  out.text(part);
}

// Of a look in the memory of a file.
int features_in(std::uint32_t version) {
  if (version < 4) return kFeaturesBefore4;
  return version < 6 ? kFeaturesBefore6 : kLookFeatures;
}

}  // namespace

// Format "VTOM", version 7: image size, mean axes, both calibrations, then color and shape model,
// each with its length, then the look memory and the audit, which version 1 does not have, then the
// light, which version 2 does not have either. Before version 4 looks had no size, the audit asked
// for the trained size alone, and there was no head model; before version 5 no network,
// before version 6 looks had no unevenness, before version 7 gray cameras had no model of their
// own.
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
  looks.save(out);
  save_audit(out, audit);
  save_light(out, light);
  head.save(out);
  save_part(out, network);
  out.f64(network_thresholds.low);
  out.f64(network_thresholds.high);
  gray.save(out);
  return out.sealed();
}

// Throws std::invalid_argument naming the part that is damaged; every number is read with its
// bounds.
ObjectModel ObjectModel::load(std::string_view bytes) {
  std::uint32_t version = kObjectVersion;
  if (bytes.size() > 4) {
    const std::uint32_t told = static_cast<unsigned char>(bytes[4]);
    if (told >= 1 && told < kObjectVersion) version = told;
  }
  ByteReader in(bytes, kObjectMagic, version, "object model");
  ObjectModel model;
  model.image_size.width = in.integer(1, 100000);
  model.image_size.height = in.integer(1, 100000);
  for (double& value : model.semi_axes_px) value = in.f64(1, 1e4);
  model.rim = load_calibration(in);
  model.segment = load_calibration(in);
  model.color = ColorModel::load(in.text(in.u32()));
  model.shape = ShapeModel::load(in.text(in.u32()));
  if (version > 1) {
    model.looks = LookMemory::load(in, features_in(version));
    model.audit = load_audit(in, version);
  }
  if (version > 2) model.light = load_light(in);
  if (version > 3) model.head = HeadModel::load(in);
  if (version > 4) load_network(in, model);
  if (version > 6) model.gray = GrayModel::load(in);
  in.end();
  return model;
}

// r of (8.1) is 2 where the colors separate altogether; the thesis' pairs reach 1.3 to 1.7, and
// below about 1 a third of the pixels are taken for what they are not.
std::vector<std::string> ObjectModel::warnings() const {
  constexpr double kPoor = 1.0;
  constexpr int kFewImages = 3;
  constexpr double kSure = 1;  // log odds of an image
  std::vector<std::string> said;
  const auto add = [&said](std::string sentence) { said.push_back(std::move(sentence)); };
  if (color.quality().mean < kPoor)
    add("the colors hardly tell the object from the ground (quality " +
        std::to_string(color.quality().mean).substr(0, 4) +
        " of 2); choose other channels, light or paint");
  if (audit.as_trained.answered > 0)
    add("the ground alone is taken for the object in " + std::to_string(audit.as_trained.answered) +
        " of " + std::to_string(audit.asked) +
        " training images; an object found anew must move before it is believed");
  if (!head.empty() && head.sureness() < kSure)
    add("its two ends look alike: a heading is given late or not at all");
  if (looks.empty())
    add("it was not asked what its looks are worth: covariances are the rim's own; train it anew");
  if (static_cast<int>(color.quality().of_image.size()) < kFewImages)
    add("it was trained on " + std::to_string(color.quality().of_image.size()) +
        " image(s); three to five show how far the light differs");
  return said;
}

}  // namespace vitreo::vision
