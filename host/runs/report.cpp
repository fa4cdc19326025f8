// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report.h"

#include "host/files/digest.h"
#include "host/files/png_image.h"
#include "host/record/parameter_text.h"
#include "host/runs/report_files.h"
#include "host/runs/report_page.h"
#include "host/runs/report_parts.h"
#include "host/text/columns.h"
#include "host/text/markup.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <string_view>

namespace vitreo {
namespace {

constexpr std::size_t kEventsShown = 60;

// Empty bodies leave no heading behind.
std::string section(const std::string& title, const std::string& body) {
  return body.empty() ? "" : "<section><h2>" + title + "</h2>\n" + body + "</section>\n";
}

std::string row_of(const std::string& name, const std::string& value) {
  return "<tr><th scope=\"row\">" + escape_markup(name) + "</th><td>" + value + "</td></tr>\n";
}

/// The record keeps every pixel; a page that is mailed round need not.
std::vector<unsigned char> small_jpeg(const std::vector<unsigned char>& png) {
  constexpr int kWidest = 1000;  // px
  constexpr int kQuality = 88;
  if (png.empty()) return {};
  cv::Mat image = cv::imdecode(png, cv::IMREAD_COLOR);
  if (image.empty()) return {};  // a damaged one: the report is still made
  if (image.cols > kWidest)
    // INTER_AREA averages what falls on a pixel: other filters would alias a detector's noise into
    // patterns.
    cv::resize(image, image, cv::Size(kWidest, image.rows * kWidest / image.cols), 0, 0,
               cv::INTER_AREA);
  std::vector<unsigned char> jpeg;
  cv::imencode(".jpg", image, jpeg, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return jpeg;
}

// Data URLs: the page has no other files, and can be mailed.
std::string picture_grid(const RunData& data) {
  std::string out;
  for (const Picture& picture : data.pictures) {
    const std::string caption = picture.caption.empty() ? picture.name : picture.caption;
    out += "<figure><img alt=\"" + escape_markup(picture.name) +
           "\" src=\"data:image/jpeg;base64," + base64(small_jpeg(picture.png->bytes())) +
           "\"><figcaption>" + escape_markup(caption) + "</figcaption></figure>\n";
  }
  return section("Pictures", out.empty() ? "" : "<div class=\"pictures\">\n" + out + "</div>\n");
}

/// Each column in one unit; the thesis' numbers and ours, which are compared, in the same one.
/// Tables hold shown cells, "12 mm": cells_in_one_unit() reads them back, and leaves those that are
/// no quantities as they are. Rows may be shorter than the header.
Table in_one_unit(Table table) {
  std::map<std::string, std::vector<std::size_t>> groups;
  for (std::size_t i = 0; i < table.header.size(); ++i) {
    const std::string& header = table.header[i];
    const bool compared =
        header == "thesis" || header == "ours" || header == "measure" || header == "tolerance";
    groups[compared ? "compared" : std::to_string(i)].push_back(i);
  }
  for (const auto& [name, columns] : groups) {
    std::vector<std::string> cells;
    for (const auto& row : table.rows)
      for (const std::size_t i : columns) cells.push_back(i < row.size() ? row[i] : "");
    cells = cells_in_one_unit(std::move(cells));
    std::size_t next = 0;
    for (auto& row : table.rows)
      for (const std::size_t i : columns) {
        if (i < row.size()) row[i] = cells[next];
        ++next;
      }
  }
  return table;
}

/// A column stands to the right when all its cells begin like numbers.
/// U+2212, the minus sign, has three bytes in UTF-8. A dash alone stands for "none".
bool numeric_column(const Table& table, std::size_t column) {
  return std::all_of(table.rows.begin(), table.rows.end(), [&](const auto& row) {
    if (column >= row.size() || row[column].empty()) return true;
    std::string_view cell = row[column];
    if (cell.starts_with("\u2212")) cell.remove_prefix(3);
    if (cell.starts_with('-') || cell.starts_with('+')) cell.remove_prefix(1);
    return cell == "-" || cell == "\u2013" || cell.empty() || (cell[0] >= '0' && cell[0] <= '9') ||
           cell[0] == '.';
  });
}

/// Such a column is never broken into lines.
bool short_column(const Table& table, std::size_t column) {
  constexpr std::size_t kShort = 18;  // characters
  return std::all_of(table.rows.begin(), table.rows.end(), [&](const auto& row) {
    return column >= row.size() || count_characters(row[column]) <= kShort;
  });
}

std::string table_section(const RunData& data) {
  std::string out;
  for (const Table& table : data.tables) out += report_table(table);
  return section("Results", out);
}

// The digits with which it can be typed back (kParameterDigits), unlike results, whose digits
// follow their size.
std::string parameter_section(const RunData& data) {
  const RunStart& start = data.start;
  std::string out;
  if (!start.parameters.is_object()) return "";
  for (const auto& [name, value] : start.parameters.items()) {
    const std::string text =
        value.is_number() ? printed(show_quantity(value.get<double>(), parameter_unit(start, name),
                                                  kParameterDigits))
                          : parameter_text(start, name, value);
    const std::string shown = text.empty() ? "\u2013" : text;  // nothing was chosen
    out += row_of(spaced(name), escape_markup(shown));
  }
  return section("Parameters", out.empty() ? "" : "<table>" + out + "</table>\n");
}

// What is needed to make the run again: seed, versions, and the hash of the text that ran.
std::string version_section(const RunData& data) {
  const RunStart& start = data.start;
  std::string out = row_of("seed", std::to_string(start.seed));
  if (start.versions.is_object()) {
    for (const auto& [name, value] : start.versions.items())
      out += row_of(name, escape_markup(text_of(value)));
  }
  out += row_of("protocol SHA-256", "<code>" + sha256(start.protocol_text) + "</code>");
  return section("Made with", "<table>" + out + "</table>\n");
}

std::string event_rows(const std::vector<Event>& events, std::size_t from, std::size_t to) {
  std::string out;
  for (std::size_t i = from; i < to; ++i) {
    const Event& event = events[i];
    const bool bad = event.kind == "error" || event.kind == "alarm";
    out += fmt::format(
        "<tr><td class=\"right\">{:.2f}\u00a0s</td><td><span "
        "class=\"mark{}\">{}</span></td><td>{}</td></tr>\n",
        to_seconds(event.time), bad ? " error" : "", escape_markup(event.kind),
        escape_markup(with_print_units(event_text(event.text))));
  }
  return out;
}

/// Raised, acknowledged, cleared: before everything else that happened.
std::string alarm_section(const RunData& data) {
  std::vector<Event> alarms;
  std::copy_if(data.events.begin(), data.events.end(), std::back_inserter(alarms),
               [](const Event& event) { return event.kind.starts_with("alarm"); });
  if (alarms.empty()) return "";
  return section("Alarms",
                 "<table class=\"events\">" + event_rows(alarms, 0, alarms.size()) + "</table>\n");
}

// The first ones are open, the rest is folded: a long run has thousands, and the report should
// print on a few pages.
std::string event_section(const RunData& data) {
  const std::vector<Event>& events = data.events;
  if (events.empty()) return "";
  const std::size_t shown = std::min(events.size(), kEventsShown);
  std::string out = timeline_svg(data) + "\n<table class=\"events\">" +
                    event_rows(events, 0, shown) + "</table>\n";
  if (shown < events.size()) {
    out += fmt::format("<details><summary>{} more events</summary><table class=\"events\">",
                       events.size() - shown) +
           event_rows(events, shown, events.size()) + "</table></details>\n";
  }
  return section("What happened", out);
}

// For the reader who opens run.sqlite next: tables, columns and units as they are there.
std::string stream_section(const RunData& data) {
  if (data.streams.empty()) return "";
  Table table{"", {"stream", "samples", "source", "channels"}, {}};
  for (const Stream& stream : data.streams) {
    std::string channels;
    for (const Channel& channel : stream.info.channels) {
      channels += (channels.empty() ? "" : ", ") + channel.name +
                  (channel.unit.empty() ? "" : "\u00a0(" + print_unit(channel.unit) + ")");
    }
    table.rows.push_back(
        {stream.info.name, std::to_string(stream.times.size()), stream.info.source, channels});
  }
  return section("Recorded in run.sqlite (SI units)", report_table(table));
}

/// "top_camera.focus = 0.0123", one a line: shorter and easier to search than nested braces.
void flatten(const nlohmann::json& value, const std::string& path, std::string& out) {
  if (!value.is_object() || value.empty()) {
    out += path + " = " + text_of(value) + "\n";
    return;
  }
  for (const auto& [key, inner] : value.items()) {
    // The files as they were written stand beside.
    if (path.empty() && (key == "text" || key == "bases")) continue;
    flatten(inner, path.empty() ? key : fmt::format("{}.{}", path, key), out);
  }
}

std::string fold(const std::string& title, const std::string& text) {
  if (text.empty()) return "";
  return "<details><summary>" + escape_markup(title) + "</summary><pre>" + escape_markup(text) +
         "</pre></details>\n";
}

std::string source_section(const RunData& data) {
  const RunStart& start = data.start;
  std::string resolved;
  std::string files;
  if (start.rig.is_object()) {
    flatten(start.rig, "", resolved);
    if (start.rig.contains("text")) files = fold("Rig file", text_of(start.rig["text"]));
    for (const nlohmann::json& base : start.rig.value("bases", nlohmann::json::array()))
      if (base.is_object())
        files += fold("It builds on " + base.value("file", ""), base.value("text", ""));
    for (const nlohmann::json& one : start.rig.value("instruments", nlohmann::json::array()))
      if (one.is_object())
        files += fold("Instrument " + one.value("file", ""), one.value("text", ""));
  }
  return section("What was asked",
                 fold("Rig as resolved (SI units)", resolved) + files +
                     fold("Protocol " + start.protocol_file, start.protocol_text));
}

}  // namespace

// Nine digits: what the rig file says comes back as it was typed, without the tail of binary
// fractions.
std::string text_of(const nlohmann::json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number()) return format_number(value.get<double>(), 9);
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string minus_sign(const std::string& number) {
  return number.starts_with('-') ? "\u2212" + number.substr(1) : number;
}

// A no-break space (U+00A0) between them.
std::string printed(Shown shown) {
  shown.number = minus_sign(shown.number);
  return with_unit(shown, "\u00a0");
}

std::string spaced(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string report_table(const Table& written) {
  const Table table = in_one_unit(written);
  std::vector<std::string> kinds(table.header.size());
  for (const auto& row : table.rows) kinds.resize(std::max(kinds.size(), row.size()));
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const std::string kind = std::string(i > 0 && numeric_column(table, i) ? "right " : "") +
                             (short_column(table, i) ? "short " : "");
    if (!kind.empty()) kinds[i] = " class=\"" + kind.substr(0, kind.size() - 1) + "\"";
  }
  const auto cell = [&](const char* tag, const std::string& text, std::size_t column) {
    const bool verdict =
        tag[1] == 'd' && column < table.header.size() && table.header[column] == "verdict";
    return fmt::format("<{0}{1}>{2}</{0}>", tag, kinds[column],
                       verdict ? verdict_html(text) : escape_markup(with_print_units(text)));
  };
  // Longer ones may be broken by a page of paper; the style sheet keeps the others whole.
  constexpr std::size_t kOnePage = 20;  // rows that are surely kept together on paper
  std::string out =
      table.rows.size() > kOnePage ? "<div class=\"scroll long\">" : "<div class=\"scroll\">";
  // No <caption>: that would be no wider than a narrow table.
  const std::string title = escape_markup(with_print_units(table.title));
  if (!title.empty()) out += "<p class=\"caption\">" + title + "</p>";
  out += title.empty() ? "<table>" : "<table aria-label=\"" + title + "\">";
  out += "<thead><tr>";
  for (std::size_t i = 0; i < table.header.size(); ++i) out += cell("th", table.header[i], i);
  out += "</tr></thead>\n<tbody>";
  for (const auto& row : table.rows) {
    out += "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i) out += cell("td", row[i], i);
    out += "</tr>\n";
  }
  return out + "</tbody></table></div>\n";
}

// A pure function of the record: no clock, no file. Sections in the order in which they are asked
// for: outcome and results first, then how the run was made and what happened, its sources last.
std::string report_html(const RunData& data) {
  const RunStart& start = data.start;
  const std::string sections = report_head(data) + report_plots(data) + picture_grid(data) +
                               table_section(data) + report_facts(data) +
                               "<div class=\"columns\">" + parameter_section(data) +
                               version_section(data) + "</div>\n" + alarm_section(data) +
                               event_section(data) + stream_section(data) + source_section(data);
  // The page's Content-Security-Policy makes the promise hold even for what a script managed to
  // smuggle in: nothing is loaded, and
  // nothing runs but the page's own script.
  return filled_page(
      {.title = start.protocol_title.empty() ? start.protocol_file : start.protocol_title,
       .sections = sections,
       .foot = data.folder.filename().string()});
}

}  // namespace vitreo
