// SPDX-License-Identifier: Apache-2.0
#include "host/rig/field_calibration_yaml.h"

#include "host/rig/yaml_tree.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

using control::FieldCalibration;
using control::MultipoleField;
using control::MultipoleSource;
using control::Region;

// Of a direction's norm. Printed digits alone stay below the first; public calibrations have up to
// 1.4e-3 (optimized_quadrupole_5.yaml), and what is beyond the second is another quantity.
constexpr double kUnitSilently = 1e-3;
constexpr double kUnitWithWarning = 0.05;

using Kind = YamlNode::Kind;

[[noreturn]] void fail(const YamlNode& at, const std::string& what) {
  throw std::invalid_argument("line " + std::to_string(at.line) + ": " + what);
}

const YamlNode& required(const YamlNode& parent, const std::string& key, const std::string& whose) {
  const YamlNode* node = parent.find(key);
  if (!node) fail(parent, whose + key + " is missing");
  return *node;
}

// from_chars: without a locale, to the last bit, and the whole scalar; YAML's own .inf and .nan are
// refused. A leading plus is YAML's, not from_chars'.
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

// As in ETH's reader a number of a vector may stand in a list of its own: a column.
const YamlNode& element(const YamlNode& node) {
  return node.kind == Kind::sequence && node.items.size() == 1 ? node.items.front() : node;
}

Eigen::Vector3d vector(const YamlNode& node, const std::string& name) {
  if (node.kind != Kind::sequence || node.items.size() != 3)
    fail(node, name + ": three numbers are expected");
  Eigen::Vector3d result;
  for (int axis = 0; axis < 3; ++axis)
    result[axis] = number(element(node.items[static_cast<std::size_t>(axis)]), name);
  return result;
}

// One order alone is also seen without its dash.
// A_n in T m^(1-n)/A and B_n in T m^(n+2)/A for n = 1, 2, ... (control/multipole_field.h): the
// first entry is n = 1.
std::vector<double> coefficients(const YamlNode* node, const std::string& name) {
  if (!node || node->kind == Kind::null) return {};
  if (node->kind == Kind::scalar) return {number(*node, name)};
  if (node->kind != Kind::sequence) fail(*node, name + ": a list of numbers or ~ is expected");
  if (node->items.size() > control::kMaxMultipoleOrder) fail(*node, name + ": more than 12 orders");
  std::vector<double> values;
  for (const YamlNode& item : node->items) values.push_back(number(element(item), name));
  return values;
}

// A name twice would count a source, or a coil, double.
std::vector<std::string> names(const YamlNode& node, const std::string& name) {
  if (node.kind != Kind::sequence) fail(node, name + ": a list of names is expected");
  std::vector<std::string> result;
  std::set<std::string> known;
  for (const YamlNode& item : node.items) {
    if (item.kind != Kind::scalar) fail(item, name + ": a name is expected");
    if (!known.insert(item.scalar).second)
      fail(item, name + ": '" + item.scalar + "' is listed twice");
    result.push_back(item.scalar);
  }
  return result;
}

using Warnings = std::vector<std::string>;

// A unit vector. One that is unit to 1e-3 is left to the bit: MultipoleField normalizes it, and a
// file that is written and read again stays the same.
// The norm would otherwise be lost without a word, and with it a factor of the field.
Eigen::Vector3d direction(const YamlNode& node, const std::string& name, Warnings& warnings) {
  const Eigen::Vector3d axis = vector(node, name);
  const double off = std::abs(axis.norm() - 1);
  if (off < kUnitSilently) return axis;
  const std::string norm = fmt::format("{:.4g}", axis.norm());
  if (!(off <= kUnitWithWarning)) fail(node, name + ": not a unit vector, its norm is " + norm);
  warnings.push_back("line " + std::to_string(node.line) + ": " + name +
                     ": not a unit vector, its norm is " + norm + "; normalized");
  return axis.normalized();
}

// Psi = sum_n (A_n r^n + B_n r^-(n+1)) P_n(cos th), B = + grad Psi (MPEM: Petruska & Nelson;
// control/multipole_field.h). `whose` names the place in errors, "Coil_3/Src_0".
MultipoleSource source_from(const YamlNode& node, const std::string& whose, Warnings& warnings) {
  if (node.kind != Kind::mapping) fail(node, whose + ": a source has keys");
  MultipoleSource source;
  source.position =
      vector(required(node, "Source_Position", whose + "/"), whose + "/Source_Position");
  source.axis = direction(required(node, "Source_Direction", whose + "/"),
                          whose + "/Source_Direction", warnings);
  source.regular = coefficients(node.find("A_Coeff"), whose + "/A_Coeff");
  source.irregular = coefficients(node.find("B_Coeff"), whose + "/B_Coeff");
  if (source.regular.empty() && source.irregular.empty())
    fail(node, whose + ": neither A_Coeff nor B_Coeff");
  return source;
}

MultipoleField::Sources coil_from(const YamlNode& root, const std::string& coil,
                                  Warnings& warnings) {
  const YamlNode& node = required(root, coil, "");
  if (node.kind != Kind::mapping) fail(node, coil + ": a coil has keys");
  const YamlNode& list = required(node, "Source_List", coil + "/");
  MultipoleField::Sources sources;
  for (const std::string& name : names(list, coil + "/Source_List")) {
    sources.push_back(source_from(required(node, name, coil + "/"), coil + "/" + name, warnings));
  }
  if (sources.empty()) fail(list, coil + "/Source_List: empty");
  return sources;
}

// Required: outside of the box in which it was fitted the model does not hold, and nothing in the
// numbers says so.
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

// The shortest form that reads back as the same double, without a locale.
std::string text_of(double value) {
  char buffer[32];  // the longest shortest form of a double has 24 characters
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, value);
  return {buffer, end};
}

// A name may be a block scalar, with line ends; it is shown within one line.
std::string one_line(std::string name) {
  for (char& c : name) c = static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  const std::size_t end = name.find_last_not_of(' ');
  return end == std::string::npos ? "" : name.substr(0, end + 1);
}

// In YAML's double quotes a backslash and a quote are escaped.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + '"';
}

// "~", YAML's null, stands for no coefficients.
template <typename Values>
std::string list_of(const Values& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + text_of(value);
  return text.empty() ? "~" : text + "]";
}

// A source is named by its number: the names of the file that was read are not kept.
void write_coil(std::string& text, const std::string& name,
                const MultipoleField::Sources& sources) {
  std::string list;
  std::string bodies;
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

// Coils come in the order of Coil_List and not of the keys, since that order is the wiring.
FieldCalibration parse_field_calibration(std::string_view text) {
  const YamlNode root = parse_yaml(text);
  if (root.kind != Kind::mapping)
    throw std::invalid_argument("line 1: not a field calibration: no keys");
  const YamlNode& list = required(root, "Coil_List", "");
  const std::vector<std::string> coil_names = names(list, "Coil_List");
  // Counted before anything is read: with aliases each of the coils may be large.
  const auto is_offset = [](const std::string& name) {
    return name.find("Offset") != std::string::npos;
  };
  const auto offsets = std::count_if(coil_names.begin(), coil_names.end(), is_offset);
  const auto count = std::ssize(coil_names) - offsets;
  if (count < 1 || count > control::kMaxCoils)
    fail(list, "Coil_List: " + std::to_string(count) + " coils; 1 to 8 are expected");
  if (offsets > 1) fail(list, "Coil_List: more than one Offset");
  std::vector<MultipoleField::Sources> coils;
  MultipoleField::Sources background;
  Warnings warnings;
  for (const std::string& name : coil_names) {
    MultipoleField::Sources sources = coil_from(root, name, warnings);
    if (is_offset(name)) {
      background = std::move(sources);
    } else {
      coils.push_back(std::move(sources));
    }
  }
  const YamlNode* name = root.find("System_Name");
  const Region region = region_from(root);
  return {name ? one_line(name->scalar) : "",
          MultipoleField(std::move(coils), std::move(background), region), std::move(warnings)};
}

std::string field_calibration_text(const FieldCalibration& calibration) {
  const MultipoleField& field = calibration.field;
  std::string text;
  if (!calibration.system_name.empty())
    text = "System_Name: " + quoted(one_line(calibration.system_name)) + "\n";
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

}  // namespace vitreo
