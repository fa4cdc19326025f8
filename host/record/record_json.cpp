// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_json.h"

#include <cmath>
#include <limits>
#include <vector>

namespace vitreo {
namespace {

/// JSON knows no NaN: it is null.
std::vector<double> numbers(const nlohmann::json& list) {
  std::vector<double> values;
  for (const nlohmann::json& one : list)
    values.push_back(one.is_null() ? std::numeric_limits<double>::quiet_NaN() : one.get<double>());
  return values;
}

// By Mark.
// Part of the file format: a mark that is renamed would change old records' plots.
constexpr const char* kMarks[] = {"line", "dashed", "points"};

/// A number that may be infinite or none: null then.
nlohmann::json ends_json(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

double end_of(const nlohmann::json& json, double otherwise) {
  return json.is_null() ? otherwise : json.get<double>();
}

nlohmann::json series_json(const Series& series) {
  nlohmann::json json{{"label", series.label},
                      {"x", series.x},
                      {"y", series.y},
                      {"mark", kMarks[static_cast<std::size_t>(series.mark)]}};
  if (!series.spread.empty()) json["spread"] = series.spread;
  return json;
}

/// What plots have beyond their series; a record of before it has none of it.
void read_expected(const nlohmann::json& json, Plot& plot) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const nlohmann::json& one : json.value("expected", nlohmann::json::array()))
    plot.expected.push_back({one.at("label").get<std::string>(), end_of(one.at("low"), -kInfinity),
                             end_of(one.at("high"), kInfinity)});
  for (const nlohmann::json& one : json.value("annotations", nlohmann::json::array()))
    plot.annotations.push_back({one.at("text").get<std::string>(), one.at("x").get<double>(),
                                end_of(one.at("y"), std::numeric_limits<double>::quiet_NaN())});
}

}  // namespace

// A text from a device may hold any byte; the record must not fail for it.
std::string dumped(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

nlohmann::json plot_json(const Plot& plot) {
  nlohmann::json series = nlohmann::json::array();
  for (const Series& one : plot.series) series.push_back(series_json(one));
  const auto axis = [](const Axis& one) {
    nlohmann::json json{{"label", one.label}, {"unit", one.unit}};
    if (one.logarithmic) json["logarithmic"] = true;
    return json;
  };
  nlohmann::json json{{"title", plot.title}, {"x", axis(plot.x)},
                      {"y", axis(plot.y)},   {"equal_aspect", plot.equal_aspect},
                      {"series", series},    {"note", plot.note}};
  for (const Expected& one : plot.expected)
    json["expected"].push_back(
        {{"label", one.label}, {"low", ends_json(one.low)}, {"high", ends_json(one.high)}});
  for (const Annotation& one : plot.annotations)
    json["annotations"].push_back({{"text", one.text}, {"x", one.x}, {"y", ends_json(one.y)}});
  return json;
}

Plot plot_from_json(const nlohmann::json& json) {
  const auto axis = [](const nlohmann::json& one) {
    return Axis{one.at("label").get<std::string>(), one.at("unit").get<std::string>(),
                one.value("logarithmic", false)};
  };
  Plot plot{json.at("title").get<std::string>(),
            axis(json.at("x")),
            axis(json.at("y")),
            json.at("equal_aspect").get<bool>(),
            {},
            json.at("note").get<std::string>()};
  for (const nlohmann::json& one : json.at("series")) {
    Series series{one.at("label").get<std::string>(), numbers(one.at("x")), numbers(one.at("y"))};
    for (std::size_t i = 0; i < std::size(kMarks); ++i)
      if (one.at("mark") == kMarks[i]) series.mark = static_cast<Mark>(i);
    if (one.contains("spread")) series.spread = numbers(one.at("spread"));
    plot.series.push_back(std::move(series));
  }
  read_expected(json, plot);
  return plot;
}

}  // namespace vitreo
