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

}  // namespace

// A text from a device may hold any byte; the record must not fail for it.
std::string dumped(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

nlohmann::json plot_json(const Plot& plot) {
  nlohmann::json series = nlohmann::json::array();
  for (const Series& one : plot.series)
    series.push_back({{"label", one.label},
                      {"x", one.x},
                      {"y", one.y},
                      {"mark", kMarks[static_cast<std::size_t>(one.mark)]}});
  const auto axis = [](const Axis& one) {
    return nlohmann::json{{"label", one.label}, {"unit", one.unit}};
  };
  return {{"title", plot.title}, {"x", axis(plot.x)},
          {"y", axis(plot.y)},   {"equal_aspect", plot.equal_aspect},
          {"series", series},    {"note", plot.note}};
}

Plot plot_from_json(const nlohmann::json& json) {
  const auto axis = [](const nlohmann::json& one) {
    return Axis{one.at("label").get<std::string>(), one.at("unit").get<std::string>()};
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
    plot.series.push_back(std::move(series));
  }
  return plot;
}

}  // namespace vitreo
