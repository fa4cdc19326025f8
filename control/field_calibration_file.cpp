// From the nodes of a calibration file to a multipole field, and back to text.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_calibration_file.h"

#include "control/yaml_text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace {

using Kind = YamlNode::Kind;

[[noreturn]] void fail(const YamlNode& at, const std::string& what) {
  throw std::invalid_argument("line " + std::to_string(at.line) + ": " + what);
}

const YamlNode& required(const YamlNode& parent, const std::string& key, const std::string& whose) {
  const YamlNode* node = parent.find(key);
  if (!node) fail(parent, whose + key + " is missing");
  return *node;
}

double number(const YamlNode& node, const std::string& name) {
  if (node.kind != Kind::scalar) fail(node, name + ": a number is expected");
  const char* begin = node.scalar.data();
  const char* end = begin + node.scalar.size();
  if (begin != end && *begin == '+') ++begin;
  double value = 0;
  const auto [stop, error] = std::from_chars(begin, end, value);
  if (error != std::errc() || stop != end)
    fail(node, name + ": '" + node.scalar.substr(0, 40) + "' is not a number");
  if (!std::isfinite(value)) fail(node, name + ": not finite");
  return value;
}

Eigen::Vector3d vector(const YamlNode& node, const std::string& name) {
  if (node.kind != Kind::sequence || node.items.size() != 3)
    fail(node, name + ": three numbers are expected");
  return {number(node.items[0], name), number(node.items[1], name), number(node.items[2], name)};
}

// One order alone is also seen without its dash.
std::vector<double> coefficients(const YamlNode* node, const std::string& name) {
  if (!node || node->kind == Kind::null) return {};
  if (node->kind == Kind::scalar) return {number(*node, name)};
  if (node->kind != Kind::sequence) fail(*node, name + ": a list of numbers or ~ is expected");
  if (node->items.size() > kMaxMultipoleOrder) fail(*node, name + ": more than 12 orders");
  std::vector<double> values;
  for (const YamlNode& item : node->items) values.push_back(number(item, name));
  return values;
}

std::vector<std::string> names(const YamlNode& node, const std::string& name) {
  if (node.kind != Kind::sequence) fail(node, name + ": a list of names is expected");
  std::vector<std::string> result;
  for (const YamlNode& item : node.items) {
    if (item.kind != Kind::scalar) fail(item, name + ": a name is expected");
    if (std::find(result.begin(), result.end(), item.scalar) != result.end()) {
      fail(item, name + ": '" + item.scalar + "' is listed twice");
    }
    result.push_back(item.scalar);
  }
  return result;
}

MultipoleSource source_from(const YamlNode& node, const std::string& whose) {
  if (node.kind != Kind::mapping) fail(node, whose + ": a source has keys");
  MultipoleSource source;
  source.position =
      vector(required(node, "Source_Position", whose + "/"), whose + "/Source_Position");
  const YamlNode& direction = required(node, "Source_Direction", whose + "/");
  source.axis = vector(direction, whose + "/Source_Direction");
  if (!(std::abs(source.axis.norm() - 1) < 1e-3))
    fail(direction, whose + "/Source_Direction: not a unit vector");
  source.regular = coefficients(node.find("A_Coeff"), whose + "/A_Coeff");
  source.irregular = coefficients(node.find("B_Coeff"), whose + "/B_Coeff");
  if (source.regular.empty() && source.irregular.empty())
    fail(node, whose + ": neither A_Coeff nor B_Coeff");
  return source;
}

MultipoleField::Sources coil_from(const YamlNode& root, const std::string& coil) {
  const YamlNode& node = required(root, coil, "");
  if (node.kind != Kind::mapping) fail(node, coil + ": a coil has keys");
  const YamlNode& list = required(node, "Source_List", coil + "/");
  MultipoleField::Sources sources;
  for (const std::string& name : names(list, coil + "/Source_List")) {
    sources.push_back(source_from(required(node, name, coil + "/"), coil + "/" + name));
  }
  if (sources.empty()) fail(list, coil + "/Source_List: empty");
  return sources;
}

Region region_from(const YamlNode& root) {
  const std::string name = "Workspace_Dimensions";
  const YamlNode& node = required(root, name, "");
  if (node.kind != Kind::sequence || node.items.size() != 3)
    fail(node, name + ": [low, high] for x, y and z expected");
  Region region;
  for (int axis = 0; axis < 3; ++axis) {
    const YamlNode& pair = node.items[static_cast<std::size_t>(axis)];
    if (pair.kind != Kind::sequence || pair.items.size() != 2)
      fail(pair, name + ": [low, high] expected");
    region.low[axis] = number(pair.items[0], name);
    region.high[axis] = number(pair.items[1], name);
    if (!(region.low[axis] < region.high[axis])) fail(pair, name + ": low must be below high");
  }
  return region;
}

std::string text_of(double value) {
  char buffer[32];  // the longest shortest form of a double has 24 characters
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, value);
  return {buffer, end};
}

template <typename Values>
std::string list_of(const Values& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + text_of(value);
  return text.empty() ? "~" : text + "]";
}

void write_coil(std::string& text, const std::string& name,
                const MultipoleField::Sources& sources) {
  std::string list, bodies;
  for (std::size_t k = 0; k < sources.size(); ++k) {
    const std::string source = "Src_" + std::to_string(k);
    list += (k ? ", " : "[") + source;
    bodies += "  " + source + ":\n    A_Coeff: " + list_of(sources[k].regular) +
              "\n    B_Coeff: " + list_of(sources[k].irregular) +
              "\n    Source_Position: " + list_of(sources[k].position) +
              "\n    Source_Direction: " + list_of(sources[k].axis) + "\n";
  }
  text += name + ":\n  Source_List: " + list + "]\n" + bodies;
}

}  // namespace

FieldCalibrationFile parse_field_calibration(std::string_view text) {
  const YamlNode root = parse_yaml(text);
  if (root.kind != Kind::mapping)
    throw std::invalid_argument("line 1: not a field calibration: no keys");
  const YamlNode& list = required(root, "Coil_List", "");
  std::vector<MultipoleField::Sources> coils;
  MultipoleField::Sources background;
  for (const std::string& name : names(list, "Coil_List")) {
    MultipoleField::Sources sources = coil_from(root, name);
    if (name == "Offset") {
      background = std::move(sources);
    } else {
      coils.push_back(std::move(sources));
    }
  }
  if (coils.empty() || coils.size() > kMaxCoils) {
    fail(list, "Coil_List: " + std::to_string(coils.size()) + " coils; 1 to 8 are expected");
  }
  const YamlNode* name = root.find("System_Name");
  const Region region = region_from(root);
  return {name ? name->scalar : "",
          MultipoleField(std::move(coils), std::move(background), region)};
}

std::string field_calibration_text(const FieldCalibrationFile& file) {
  const MultipoleField& field = file.field;
  std::string name = file.system_name, text;
  std::replace(name.begin(), name.end(), '"', '\'');
  if (!name.empty()) text = "System_Name: \"" + name + "\"\n";
  text += "Coil_List: [";
  for (int k = 0; k < field.coils(); ++k) text += (k ? ", Coil_" : "Coil_") + std::to_string(k);
  text += field.background_sources().empty() ? "]\n" : ", Offset]\n";
  for (int k = 0; k < field.coils(); ++k) {
    write_coil(text, "Coil_" + std::to_string(k), field.sources()[static_cast<std::size_t>(k)]);
  }
  if (!field.background_sources().empty()) write_coil(text, "Offset", field.background_sources());
  text += "Workspace_Dimensions:\n";
  for (int axis = 0; axis < 3; ++axis) {
    text += "  - " +
            list_of(std::vector<double>{field.region().low[axis], field.region().high[axis]}) +
            "\n";
  }
  return text;
}

}  // namespace vitreo::control
