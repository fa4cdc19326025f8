// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot.h"

#include "host/plot/image_plot.h"
#include "host/plot/plot_axes.h"
#include "host/plot/plot_layout.h"
#include "host/plot/plot_series.h"
#include "host/plot/plot_svg.h"
#include "host/text/markup.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Plot plot_of(std::vector<Series> series) {
  Plot plot;
  plot.title = "Error";
  plot.x = {"time", "s"};
  plot.y = {"error", "um"};
  plot.series = std::move(series);
  return plot;
}

Series series_of(std::vector<double> x, std::vector<double> y) {
  return {"one", std::move(x), std::move(y)};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

void expect_well_formed(const std::string& svg) {
  std::string what;
  EXPECT_TRUE(test::well_formed(svg, &what)) << what;
  EXPECT_FALSE(contains(svg, "nan")) << svg.substr(0, 2000);
  EXPECT_FALSE(contains(svg, "inf,") || contains(svg, "\"inf") || contains(svg, " inf"));
}

TEST(Plot, ShowsLabelsWithUnitsAsTheyArePrinted) {
  const std::string svg = to_svg(plot_of({series_of({0, 1, 2}, {1e-4, 2e-4, 3e-4})}));
  expect_well_formed(svg);
  EXPECT_TRUE(contains(svg, ">error (\u00b5m)<"));
  EXPECT_TRUE(contains(svg, ">time (s)<"));
  EXPECT_TRUE(contains(svg, ">300<"));  // the values were divided by the unit
  EXPECT_TRUE(contains(svg, ">one<"));
}

TEST(Plot, SaysWhenThereIsNothingToShow) {
  EXPECT_TRUE(contains(to_svg(plot_of({})), ">no data<"));
  EXPECT_TRUE(contains(to_svg(plot_of({series_of({}, {})})), ">no data<"));
  EXPECT_TRUE(contains(to_svg(plot_of({series_of({0, 1}, {kNothing, kInfinity})})), ">no data<"));
  EXPECT_FALSE(contains(to_svg(plot_of({series_of({0}, {0})})), "no data"));
}

TEST(Plot, TextFromScriptsCannotLeaveItsPlace) {
  Plot plot = plot_of({series_of({0, 1}, {0, 1})});
  plot.title = plot.note = plot.x.label = plot.y.label = plot.series[0].label =
      "<script>alert('\"&\")</script>\x01\xff";
  const std::string svg = to_svg(plot, 1600, 900);
  expect_well_formed(svg);
  EXPECT_FALSE(contains(svg, "<script"));
  EXPECT_TRUE(contains(svg, "&lt;script&gt;"));
  EXPECT_FALSE(contains(svg, "\x01"));
}

TEST(Plot, StandsInAPageWithOthers) {
  const std::string svg = to_svg(plot_of({series_of({0, 1}, {0, 1})}));
  EXPECT_FALSE(contains(svg, " id=") || contains(svg, "<style") || contains(svg, " class=") ||
               contains(svg, "url("));
  EXPECT_TRUE(contains(svg, "xmlns="));  // and alone, as a file
}

TEST(Plot, RefusesWhatItCannotDraw) {
  Plot plot = plot_of({series_of({0, 1}, {0})});
  EXPECT_THROW(to_svg(plot), std::invalid_argument);
  plot = plot_of({});
  plot.x.unit = "furlong";
  EXPECT_THROW(to_svg(plot), std::invalid_argument);
}

TEST(Plot, SurvivesEveryKindOfNumberAndSize) {
  const std::vector<double> odd = {0,      -0.0,  1e300, -1e300,    kInfinity, kNothing, 1e-300,
                                   5e-324, 1e149, 1,     1 + 1e-15, 1e9,       -7,       3};
  std::vector<double> other(odd.rbegin(), odd.rend());
  for (Mark mark : {Mark::line, Mark::dashed, Mark::points}) {
    for (bool equal : {false, true}) {
      for (auto [width, height] :
           {std::pair{640, 360}, {0, 0}, {-5, 3}, {300, 2000}, {4000, 200}}) {
        for (std::size_t count = 0; count <= odd.size(); ++count) {
          Plot plot = plot_of({{"s",
                                {odd.begin(), odd.begin() + count},
                                {other.begin(), other.begin() + count},
                                mark}});
          plot.equal_aspect = equal;
          plot.y.unit = "";
          expect_well_formed(to_svg(plot, width, height));
        }
      }
    }
  }
}

TEST(Plot, AMillimetreIsAsLongInBothDirections) {
  Plot plot = plot_of({series_of({-4e-3, 4e-3}, {-1e-3, 5e-3})});
  plot.x.unit = plot.y.unit = "mm";
  plot.equal_aspect = true;
  for (auto [width, height] : {std::pair{640, 360}, {300, 700}, {1200, 200}}) {
    const Drawing drawing = lay_out_plot(plot, width, height);
    EXPECT_NEAR(drawing.px(1) - drawing.px(0), drawing.py(0) - drawing.py(1), 1e-9);
    EXPECT_LE(drawing.box.right(), drawing.width);
    EXPECT_LE(drawing.py(5), drawing.box.bottom());
    EXPECT_GE(drawing.py(5), drawing.box.top);
  }
}

TEST(Plot, TheLegendStandsOutsideTheBox) {
  std::vector<Series> many;
  for (int i = 0; i < 12; ++i)
    many.push_back({"series number " + std::to_string(i), {0, 1}, {0, 1.0 * i}});
  const Plot plot = plot_of(many);
  double height = 0;
  const Drawing drawing = lay_out_plot(plot, 500, 360);
  const auto places = legend_places(plot, drawing.box.width, &height);
  EXPECT_GE(drawing.box.top, height + 20);  // title and legend fit above
  for (const PlotPoint& place : places) EXPECT_LT(place.y, height);
}

TEST(Plot, EightCoilsHaveEightColorsAndTheReferenceItsOwn) {
  std::vector<Series> series(9);
  series[3].mark = Mark::dashed;
  const auto pens = pens_for(series);
  for (std::size_t i = 0; i < pens.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(pens[i].color, pens[j].color);
  }
}

TEST(Plot, WhatWasExpectedIsABandOrALineWithItsWordsInThePlot) {
  Plot plot = plot_of({series_of({0, 1, 2}, {1e-4, 2e-4, 1.5e-4})});
  plot.expected = {{"thesis: 266 \u00b1 184 \u00b5m", 82e-6, 450e-6}, {"goal", -kInfinity, 300e-6}};
  plot.annotations = {{"bottom", 0.5}, {"here", 1, 2e-4}};
  const std::string svg = to_svg(plot, 900, 300);
  expect_well_formed(svg);
  for (const char* part :
       {">thesis: 266 \u00b1 184 \u00b5m<", ">goal<", ">bottom<", ">here<", "#E9DFCB"})
    EXPECT_TRUE(contains(svg, part)) << part;
  EXPECT_GE(lay_out_plot(plot, 900, 300).y.high, 450) << "the band is in sight";
  plot.expected = {{"elsewhere", 1, 1}};
  EXPECT_LT(lay_out_plot(plot, 900, 300).y.high, 1000) << "but does not rule the plot from afar";
}

TEST(Plot, BarsHaveCapsAndPointsAreHollowBelowLines) {
  Series measured = series_of({0, 1, 2}, {1e-4, 2e-4, 1.5e-4});
  measured.mark = Mark::points;
  measured.spread = {2e-5, 2e-5, 2e-5};
  const std::string svg = to_svg(plot_of({series_of({0, 2}, {1e-4, 2e-4}), measured}));
  expect_well_formed(svg);
  EXPECT_EQ(bars_svg({{10, 30, 20}}, {"#000000", "", 1, Mark::points}),
            "<path fill=\"none\" stroke=\"#000000\" stroke-width=\"1.2\" "
            "d=\"M6.5 20.0H13.5M10.0 20.0V30.0M6.5 30.0H13.5\"/>");
  EXPECT_TRUE(contains(svg, "<g fill=\"none\" stroke=")) << "hollow";
  EXPECT_LT(svg.find("data-series=\"1\""), svg.find("data-series=\"0\"")) << "points lie below";
  measured.spread.pop_back();
  EXPECT_THROW(to_svg(plot_of({measured})), std::invalid_argument);
}

TEST(Plot, ALogarithmicAxisShowsDecadesAndLeavesOutWhatIsNotPositive) {
  Plot plot = plot_of({series_of({1e-3, 1, 1e3}, {1e-6, 1e-4, 1e-2})});
  plot.x.logarithmic = plot.y.logarithmic = true;
  const std::string svg = to_svg(plot);
  expect_well_formed(svg);
  for (const char* tick : {">1<", ">100<", ">10\u207b\u00b3<", ">10\u2074<"})
    EXPECT_TRUE(contains(svg, tick)) << tick;
  const Drawing drawing = lay_out_plot(plot, 640, 360);
  EXPECT_NEAR(drawing.px(0) - drawing.px(-3), drawing.px(3) - drawing.px(0), 1e-9);
  EXPECT_EQ(make_decades({0, 1}, 8).labels, (std::vector<std::string>{"1", "2", "5", "10"}));
  EXPECT_EQ(make_decades({-5, -4}, 8).labels,
            (std::vector<std::string>{"10\u207b\u2075", "2\u00b710\u207b\u2075",
                                      "5\u00b710\u207b\u2075", "10\u207b\u2074"}));
  plot.series[0].y = {0, -1, 1e-3};
  EXPECT_EQ(lay_out_plot(plot, 640, 360).strokes[0].size(), 1U);
  plot.series[0].y = {0, -1, 0};
  EXPECT_TRUE(contains(to_svg(plot), ">no data<"));
}

TEST(ImagePlot, MarksStandOnThePixelsTheyName) {
  // 160 x 80 px are drawn four times as large: the center of pixel (10, 20) is 10.5 and 20.5 pixels
  // from the corner.
  ImagePlot plot{"Seen & <marked>",
                 cv::Mat(80, 160, CV_8UC1, cv::Scalar(90)),
                 {{"goal", {10}, {20}, Mark::points}},
                 20,
                 "1 mm",
                 "a note"};
  const std::string svg = to_svg(plot);
  std::string what;
  EXPECT_TRUE(test::well_formed(svg, &what)) << what;
  for (const char* part :
       {"cx=\"42.0\" cy=\"82.0\"", "Seen &amp; &lt;marked&gt;", ">goal</text>", ">u (px)</text>",
        ">v (px)</text>", ">1 mm</text>", "width=\"80.0\" height=\"4\"", ">a note</text>",
        "overflow=\"hidden\"", "data:image/jpeg;base64,"})
    EXPECT_NE(svg.find(part), std::string::npos) << part;
}

TEST(ImagePlot, AnOutlineClosesAndKeepsItsAxes) {
  const Series ring = outline("e", {{30, 40}, 20, 10, 0.5});
  EXPECT_NEAR(ring.x.front(), ring.x.back(), 1e-9);
  double farthest = 0, nearest = 1e9;
  for (std::size_t i = 0; i < ring.x.size(); ++i) {
    const double away = std::hypot(ring.x[i] - 30, ring.y[i] - 40);
    farthest = std::max(farthest, away);
    nearest = std::min(nearest, away);
  }
  EXPECT_NEAR(farthest, 20, 1e-9);
  EXPECT_NEAR(nearest, 10, 1e-9);
  EXPECT_NEAR(ring.y.front() - 40, 20 * std::sin(0.5), 1e-9) << "angles go from +u towards +v";
}

TEST(ImagePlot, RefusesWhatIsNoImageAndSurvivesOddOnes) {
  EXPECT_THROW(to_svg(ImagePlot{}), std::invalid_argument);
  EXPECT_THROW(to_svg(ImagePlot{"t", cv::Mat(8, 8, CV_16UC1), {}, 0, "", ""}),
               std::invalid_argument);
  EXPECT_THROW(
      to_svg(ImagePlot{"t", cv::Mat(8, 8, CV_8UC1), {{"s", {1}, {}, Mark::line}}, 0, "", ""}),
      std::invalid_argument);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const cv::Size size :
       {cv::Size(1, 1), cv::Size(1, 3000), cv::Size(4000, 1), cv::Size(2, 2)}) {
    const ImagePlot plot{
        "t", cv::Mat(size, CV_8UC3, cv::Scalar::all(9)), {{"s", {nan, 1, 1e300}, {0, 2, 3}}}, 0, "",
        ""};
    std::string what;
    EXPECT_TRUE(test::well_formed(to_svg(plot), &what)) << what;
    for (const char* part : {"\"nan", " nan", "\"inf", " inf"})
      EXPECT_EQ(to_svg(plot).find(part), std::string::npos);
  }
}

TEST(PlotTicks, StandAtOneTwoAndFive) {
  for (double span = 1e-12; span < 1e12; span *= 1.37) {
    const double step = nice_step(span, 6);
    const double lead = step / std::pow(10, std::floor(std::log10(step) + 1e-9));
    EXPECT_TRUE(std::fabs(lead - 1) < 1e-9 || std::fabs(lead - 2) < 1e-9 ||
                std::fabs(lead - 5) < 1e-9)
        << lead;
    EXPECT_LE(span / step, 6 + 1e-6);
    EXPECT_GE(span / step, 6 / 2.5 - 1e-6);  // the widest gap of the series is from 2 to 5
    EXPECT_LE(make_ticks({0, span}, step).at.size(), 8u);
  }
}

TEST(PlotTicks, LabelsAreExactAndDifferent) {
  const Ticks ticks = make_ticks({-0.31, 0.3}, 0.1);
  EXPECT_EQ(ticks.labels, (std::vector<std::string>{"\u22120.3", "\u22120.2", "\u22120.1", "0.0",
                                                    "0.1", "0.2", "0.3"}));
  const Ticks tiny = make_ticks({0, 3e-9}, 1e-9);
  EXPECT_EQ(tiny.exponent, -9);
  EXPECT_EQ(tiny.labels, (std::vector<std::string>{"0", "1", "2", "3"}));
  EXPECT_EQ(axis_title("flux", "T", -9), "flux (10\u207b\u2079 T)");
}

TEST(PlotThinning, KeepsEveryExtremeOfEveryColumn) {
  Stroke all;
  for (int i = 0; i < 100000; ++i)
    all.push_back({i * 600.0 / 100000, 100 + 50 * std::sin(i * 0.7) * std::sin(i * 1e-4)});
  all[77777].y = 900;
  all[12345].y = -900;
  const Stroke thin = thinned(all);
  EXPECT_LE(thin.size(), 4u * 600);
  for (int column = 0; column < 600; ++column) {
    Range whole, kept;
    for (const PlotPoint& point : all) {
      if (std::floor(point.x) == column) whole.include(point.y);
    }
    for (const PlotPoint& point : thin) {
      if (std::floor(point.x) == column) kept.include(point.y);
    }
    ASSERT_EQ(whole.low, kept.low);
    ASSERT_EQ(whole.high, kept.high);
  }
  EXPECT_EQ(thin.front().x, all.front().x);
  EXPECT_EQ(thin.back().x, all.back().x);
}

TEST(PlotThinning, LeavesShortSeriesAlone) {
  const Stroke few = {{0, 1}, {5, 2}, {3, 7}, {3.5, 2}};
  EXPECT_EQ(thinned(few).size(), few.size());
  EXPECT_TRUE(thinned({}).empty());
}

TEST(PlotSeries, BreaksAtWhatIsNotThere) {
  const auto strokes =
      strokes_of(series_of({0, 1, 2, 3, kNothing, 5}, {1, 2, kNothing, 4, 5, 6}), 1, 1);
  ASSERT_EQ(strokes.size(), 3u);
  EXPECT_EQ(strokes[0].size(), 2u);
  EXPECT_EQ(strokes[1].size(), 1u);
  EXPECT_EQ(strokes[2].size(), 1u);
}

TEST(Markup, EscapesWhatHasMeaningAndMendsWhatIsBroken) {
  EXPECT_EQ(escape_markup("a<b>&\"'\u00b5"), "a&lt;b&gt;&amp;&quot;&#39;\u00b5");
  EXPECT_EQ(escape_markup(std::string_view("\0\x1b\xc3", 3)), "\uFFFD\uFFFD\uFFFD");
  EXPECT_EQ(escape_markup("\xed\xa0\x80"), "\uFFFD\uFFFD\uFFFD");  // a lone surrogate
  EXPECT_EQ(escape_markup("\xc0\xbc"), "\uFFFD\uFFFD");            // '<' spelt too long
  EXPECT_EQ(escape_markup("\U0001F41F"), "\U0001F41F");
}

TEST(Markup, Base64IsAsInRfc4648) {
  const auto encoded = [](std::string_view text) {
    return base64({reinterpret_cast<const unsigned char*>(text.data()), text.size()});
  };
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
