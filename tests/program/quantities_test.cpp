// One formatter behind all that people read: µ and ° in print, one unit a column, no naked SI
// numbers. What programs read and what is typed back keeps the units' plain names.
// SPDX-License-Identifier: Apache-2.0

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "program.h"
#include <map>
#include <memory>
#include <regex>
#include <set>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kProtocol = R"lua(
local units = require "units"
local mm, um = units.mm, units.um
return {
  title = "Quantities",
  parameters = {
    step = { unit = "m", default = 1 * mm, min = 0, max = 5 * mm, help = "between two places" },
    near = { unit = "um", default = 100 * um, min = 1 * um, max = 900 * um, help = "is there" },
    share = { unit = "%", default = 0.125, min = 0, max = 1, help = "of the frames" },
    angle = { unit = "deg", default = 30 * units.deg, help = "of the field" },
    count = { default = 3, integer = true, help = "of places" },
  },
  run = function(rig, p, run)
    run:result("depth", 1.5 * mm, "m")
    run:result("depth_sigma", 12 * um, "m")
    run:result("error", 34 * um, "m")
    run:result("frames", 30)
    run:result("tracked", 0.125, "%")
    run:table {
      title = "Errors (um)",
      header = { "where", "error", "time", "limit, um" },
      rows = {
        { "near", format_quantity(34 * um, "m"), format_quantity(0.5, "s"), 5 },
        { "far", format_quantity(1.25 * mm, "m"), format_quantity(62, "s"), 7 },
        { "there", "12 um", "3 s", 9 },
      },
    }
    run:note(("moved by %s"):format(format_quantity(80 * um, "m")))
  end,
}
)lua";

std::string without_tags(const std::string& html) {
  return std::regex_replace(html, std::regex("<[^>]*>"), "");
}

/// What stands on a page without its scripts' sources, which are shown as they were written.
std::string without_sources(const std::string& html) {
  return html.substr(0, html.find("<h2>What was asked</h2>"));
}

/// The plain names of units that print has signs for.
std::vector<std::string> plain_units(const std::string& text) {
  static const std::regex kPlain(
      R"(([0-9] |\()(u[msTANVg](/s)?|deg(/s)?|degC|mm\^2|m\^2)(?![A-Za-z]))");
  std::vector<std::string> found;
  for (auto it = std::sregex_iterator(text.begin(), text.end(), kPlain);
       it != std::sregex_iterator(); ++it)
    found.push_back(
        it->prefix().str().substr(
            it->prefix().length() > 30 ? static_cast<std::size_t>(it->prefix().length() - 30) : 0) +
        it->str());
  return found;
}

/// The cells of each column of each table of a page.
std::vector<std::vector<std::string>> columns_of(const std::string& html) {
  static const std::regex kTable("<table[^]*?</table>"), kRow("<tr[^]*?</tr>"),
      kCell("<t[dh][^>]*>([^]*?)(?=</td>|</th>|<t[dh]|</tr>)");
  const std::sregex_iterator end;
  std::vector<std::vector<std::string>> columns;
  for (std::sregex_iterator table(html.begin(), html.end(), kTable); table != end; ++table) {
    std::vector<std::vector<std::string>> ours;
    const std::string rows = table->str();
    for (std::sregex_iterator row(rows.begin(), rows.end(), kRow); row != end; ++row) {
      const std::string cells = row->str();
      std::size_t i = 0;
      for (std::sregex_iterator cell(cells.begin(), cells.end(), kCell); cell != end; ++cell, ++i) {
        if (ours.size() <= i) ours.resize(i + 1);
        ours[i].push_back(without_tags((*cell)[1].str()));
      }
    }
    // The list of parameters is no column: each is another quantity, as it was chosen.
    if (html.substr(0, static_cast<std::size_t>(table->position()))
            .ends_with("<h2>Parameters</h2>\n"))
      continue;
    columns.insert(columns.end(), ours.begin(), ours.end());
  }
  return columns;
}

/// Units of the cells that are a number with a unit, by what they measure. A reading of its own,
/// not the program's.
std::map<std::string, std::set<std::string>> units_in(const std::vector<std::string>& cells) {
  static const std::map<std::string, std::string> kMeasures{
      {"m", "length"}, {"mm", "length"},    {"\u00b5m", "length"}, {"nm", "length"}, {"s", "time"},
      {"ms", "time"},  {"\u00b5s", "time"}, {"min", "time"},       {"h", "time"},    {"T", "field"},
      {"mT", "field"}, {"A", "current"},    {"mA", "current"}};
  static const std::regex kQuantity("^[-+]?[0-9][0-9.]*[ ](.+)$");
  std::map<std::string, std::set<std::string>> units;
  for (const std::string& cell : cells) {
    std::smatch read;
    if (!std::regex_match(cell, read, kQuantity)) continue;
    const auto found = kMeasures.find(read[1].str());
    if (found != kMeasures.end()) units[found->second].insert(found->first);
    if (cell.find(" min ") != std::string::npos && cell.ends_with(" s"))
      units["time"].insert("min s");
  }
  return units;
}

class Quantities : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = std::make_unique<Workplace>();
    place_->write("quantities.lua", kProtocol);
    ran_ = place_->vitreo("run ./quantities.lua step=2mm --verbose");
    place_->vitreo("run ./quantities.lua step=2mm");
  }
  static void TearDownTestSuite() { place_.reset(); }
  static std::unique_ptr<Workplace> place_;
  static Spoken ran_;
};
std::unique_ptr<Workplace> Quantities::place_;
Spoken Quantities::ran_;

TEST_F(Quantities, TheCommandLineHasPrintUnits) {
  ASSERT_EQ(ran_.exit_code, 0) << ran_.err;
  std::string text = ran_.out + ran_.err;
  for (const char* words :
       {"show last", "runs", "check ./quantities.lua", "devices --rig simulated"})
    text += place_->vitreo(words).out;
  std::string described = place_->vitreo("describe ./quantities.lua").out;
  text += described.substr(0, described.find("for instance"));
  for (const std::string& found : plain_units(text)) ADD_FAILURE() << found;
}

TEST_F(Quantities, ParametersHaveTheirUnits) {
  const std::string shown = place_->vitreo("show last").out;
  for (const char* line : {"step +2 mm\n", "near +100 \u00b5m\n", "share +12\\.5 %\n",
                           "angle +30\u00b0\n", "count +3\n"})
    EXPECT_TRUE(std::regex_search(shown, std::regex(line))) << line << shown;
  const std::string described = place_->vitreo("describe ./quantities.lua").out;
  for (const char* part :
       {"1 mm", "0 to 5 mm", "100 \u00b5m", "1 to 900 \u00b5m", "12.5 %", "0 to 100 %", "30\u00b0"})
    EXPECT_NE(described.find(part), std::string::npos) << part << described;
  EXPECT_NE(ran_.err.find("near = 100 \u00b5m"), std::string::npos) << ran_.err;
}

TEST_F(Quantities, ResultsShareAUnitAndHaveTheirUncertainty) {
  for (const std::string& text : {ran_.out, place_->vitreo("show last").out})
    for (const char* line : {"depth +1500 \u00b1 12 \u00b5m\n", "error +34 \u00b5m\n",
                             "frames +30\n", "tracked +12\\.5 %\n"})
      EXPECT_TRUE(std::regex_search(text, std::regex(line))) << line << text;
}

TEST_F(Quantities, ProgramsReadSiAndPlainNames) {
  const std::string shown = place_->vitreo("show last --json").out;
  const auto json = nlohmann::json::parse(shown);
  EXPECT_EQ(json["parameters"]["step"], 0.002);
  EXPECT_EQ(json["parameter_units"]["near"], "m");
  EXPECT_EQ(json["parameters_text"]["step"], "2 mm");
  EXPECT_EQ(json["parameters_text"]["near"], "100 um");
  EXPECT_EQ(json["parameters_text"]["angle"], "30 deg");
  EXPECT_EQ(json["results"]["depth_sigma"], 12e-6);
  EXPECT_EQ(json["results"]["tracked"], 0.125);
  EXPECT_EQ(json["result_units"]["tracked"], "") << "0.125 is a ratio and no percentage";
  EXPECT_EQ(json["result_units"]["depth"], "m");
}

TEST_F(Quantities, TheReportHasOneUnitAColumn) {
  const std::filesystem::path folder =
      std::filesystem::directory_iterator(place_->folder() / "runs")->path();
  const std::string page = without_sources(
      place_->read((std::filesystem::path("runs") / folder.filename() / "report.html").string()));
  for (const std::string& found : plain_units(without_tags(page))) ADD_FAILURE() << found;
  const auto columns = columns_of(page);
  EXPECT_GE(columns.size(), 6U);
  for (const auto& cells : columns)
    for (const auto& [dimension, units] : units_in(cells))
      EXPECT_EQ(units.size(), 1U) << dimension << ": " << testing::PrintToString(cells);
  for (const char* part : {"Errors (\u00b5m)", "limit, \u00b5m", ">1250 \u00b5m<", ">34 \u00b5m<",
                           ">62 s<", "1500 \u00b1 12"})
    EXPECT_NE(page.find(part), std::string::npos) << part;
}

TEST_F(Quantities, TheHelpTextsHavePrintUnits) {
  for (const auto& file :
       std::filesystem::directory_iterator(VITREO_SOURCE_DIR "/tests/program/golden")) {
    std::ifstream in(file.path());
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    for (const std::string& found : plain_units(text))
      ADD_FAILURE() << file.path() << ": " << found;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
