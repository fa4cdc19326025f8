// Head of the report: what was done and what came out in a sentence, the verdict, the number that
// matters beside what was expected.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report_files.h"
#include "host/runs/report_parts.h"
#include "host/runs/results_text.h"
#include "host/text/columns.h"
#include "host/text/markup.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <vector>

namespace vitreo {
namespace {

constexpr std::size_t kHeadRows = 8;  // of the table beside the number

// A record without an end is "running" here: a lost run gets its report from recovery, after its
// end record.
std::string badge(const RunEnd* end) {
  if (!end) return "<span class=\"badge running\">running</span>";
  // By Outcome, distinguishable without color too.
  constexpr const char* kSigns[] = {"\u2713", "\u2715", "\u25a0", "\u25a0", "?"};
  const std::string name = to_string(end->outcome);
  return "<span class=\"badge " + name + "\">" + kSigns[static_cast<std::size_t>(end->outcome)] +
         " " + name + "</span>";
}

/// "2026-11-21 14:30" out of the folder's name, which holds the wall clock.
/// From the name and not from the start record: RunData has no date.
std::string when(const std::string& folder) {
  if (folder.size() < 17 || folder[10] != 'T') return "";
  return folder.substr(0, 10) + " " + folder.substr(11, 2) + ":" + folder.substr(13, 2);
}

std::string title_of(const RunStart& start) {
  return start.protocol_title.empty() ? start.protocol_file : start.protocol_title;
}

bool completed(const RunData& data) {
  return data.end && std::string_view(to_string(data.end->outcome)) == "completed";
}

/// Times and counts, which stand at the foot and in the table: no one of them is what matters.
/// (Records of version 0.1 count expectations.)
bool aside(const std::string& name) {
  constexpr std::array kAsides{"experiment_time",  "wall_time",           "dead_time",
                               "expectations_met", "expectations_missed", "calibrations_refused"};
  return name.starts_with("verdict_") ||
         std::find(kAsides.begin(), kAsides.end(), name) != kAsides.end();
}

std::vector<ShownResult> main_results(const RunData& data) {
  std::vector<ShownResult> results = shown_results(data.results);
  std::erase_if(results, [](const ShownResult& one) { return aside(one.name); });
  return results;
}

/// The sentence that the protocol gave (run:headline), or its title and its first result.
std::string sentence_of(const RunData& data, const std::vector<ShownResult>& results) {
  if (data.end && !completed(data))
    return title_of(data.start) + ": " + to_string(data.end->outcome);
  const auto said = std::find_if(data.events.rbegin(), data.events.rend(),
                                 [](const Event& event) { return event.kind == "headline"; });
  if (said != data.events.rend()) return said->text;
  if (results.empty()) return title_of(data.start);
  return title_of(data.start) + ": " + spaced(results[0].name) + " " + printed(results[0].value);
}

/// The comment at the protocol's top, without "-- name: " and license: at most two sentences.
std::string what_was_done(const std::string& protocol) {
  std::string text;
  for (std::size_t at = 0; protocol.compare(at, 2, "--") == 0;) {
    const std::size_t end = std::min(protocol.find('\n', at), protocol.size());
    std::string line = protocol.substr(at + 2, end - at - 2);
    line.erase(0, line.find_first_not_of(" -"));
    if (line.find("SPDX-License") == std::string::npos) text += (text.empty() ? "" : " ") + line;
    at = std::min(end + 1, protocol.size());
  }
  std::size_t cut = 0;
  for (int sentences = 0; sentences < 2; ++sentences) {
    const std::size_t stop = text.find(". ", cut);
    if (stop == std::string::npos) return text;
    cut = stop + 1;
    if (cut > 200) break;
  }
  return text.substr(0, cut);
}

/// What a failed run leaves: so many samples and frames are in the record.
std::string kept(const RunData& data) {
  std::size_t rows = 0;
  for (const Stream& stream : data.streams) rows += stream.times.size();
  return fmt::format("Kept: {} samples in {} streams, {} results, {} plots.", rows,
                     data.streams.size(), data.results.size(), data.plots.size());
}

/// The place of a column in a table; nothing where there is none of that name.
std::optional<std::size_t> column(const Table& table, std::string_view name) {
  const auto found = std::find(table.header.begin(), table.header.end(), name);
  if (found == table.header.end()) return {};
  return static_cast<std::size_t>(found - table.header.begin());
}

/// What a number is held against: "tolerance" in records of version 0.1.
std::optional<std::size_t> measure_column(const Table& table) {
  const auto at = column(table, "measure");
  return at ? at : column(table, "tolerance");
}

/// A verdict without what may follow it: "differs" of "differs, 4.8 spreads".
std::string_view word_of(std::string_view verdict) { return verdict.substr(0, verdict.find(',')); }

/// Good, bad or neither: by the words that the record's table has; a class of the style sheet.
std::string_view kind_of_verdict(std::string_view whole) {
  const std::string_view verdict = word_of(whole);
  constexpr std::array kGood{"reproduced", "better", "goal met", "agrees", "kept", "within"};
  constexpr std::array kBad{"differs", "goal missed", "worse", "no answer", "NOT within"};
  if (std::find(kGood.begin(), kGood.end(), verdict) != kGood.end()) return "good";
  if (std::find(kBad.begin(), kBad.end(), verdict) != kBad.end()) return "bad";
  return "plain";
}

/// The first table that has verdicts: here beside thesis, tolerance and verdict. Counted apart by
/// word, for "154 agree" would count goals of our own with what the thesis printed.
struct Verdicts {
  const Table* table = nullptr;
  std::size_t verdict = 0;
  std::map<std::string, int> counts{};
};

Verdicts verdicts_of(const RunData& data) {
  for (const Table& table : data.tables) {
    const auto at = column(table, "verdict");
    if (!at) continue;
    Verdicts found{&table, *at};
    for (const auto& row : table.rows)
      if (*at < row.size()) ++found.counts[std::string(word_of(row[*at]))];
    return found;
  }
  return {};
}

std::string counts_text(const Verdicts& verdicts) {
  std::string text;
  for (const auto& [word, count] : verdicts.counts)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, word);
  return text;
}

/// The same columns as the table below it, without its reasons, and its first rows only.
std::string head_table(const Verdicts& verdicts) {
  if (verdicts.table == nullptr) return "";
  const Table& table = *verdicts.table;
  Table shown{"", {}, {}};
  std::vector<std::size_t> columns;
  for (const std::string_view name : {"what", "ours", "thesis", "measure", "verdict"})
    if (const auto at = name == "measure" ? measure_column(table) : column(table, name)) {
      columns.push_back(*at);
      shown.header.emplace_back(name == "ours" ? "here" : name);
    }
  for (std::size_t i = 0; i < std::min(table.rows.size(), kHeadRows); ++i) {
    shown.rows.emplace_back();
    for (const std::size_t at : columns)
      shown.rows.back().push_back(at < table.rows[i].size() ? table.rows[i][at] : "");
  }
  std::string more = counts_text(verdicts) + ".";
  if (table.rows.size() > kHeadRows)
    more += fmt::format(" {} more rows below.", table.rows.size() - kHeadRows);
  return report_table(shown) + "<p class=\"counts\">" + escape_markup(more) + "</p>";
}

/// The verdict of the result, where a row of the table has its value as printed.
std::string verdict_of(const std::string& value, const Verdicts& verdicts) {
  if (verdicts.table == nullptr) return "";
  const Table& table = *verdicts.table;
  const auto ours = column(table, "ours"), measure = measure_column(table),
             thesis = column(table, "thesis");
  if (!ours) return "";
  for (const auto& row : table.rows) {
    if (row.size() != table.header.size() || with_print_units(row[*ours]) != value) continue;
    std::string text = verdict_html(row[verdicts.verdict]);
    if (measure) text += "<br>" + escape_markup(with_print_units(row[*measure]));
    if (thesis && row[*thesis] != "\u2013")
      text += "; in the thesis " + escape_markup(with_print_units(row[*thesis]));
    return text;
  }
  return "";
}

/// The first result, large; the others as tiles.
std::string number_block(const std::vector<ShownResult>& results, const Verdicts& verdicts) {
  if (results.empty()) return "";
  const ShownResult& first = results[0];
  const std::string number = minus_sign(first.value.number);
  std::string out = "<div class=\"main\"><div class=\"number" +
                    std::string(count_characters(number) > 8 ? " long" : "") + "\">" +
                    escape_markup(number) + " <small>" + escape_markup(first.value.unit) +
                    "</small></div><p>" + escape_markup(spaced(first.name)) + "</p>";
  const std::string verdict = verdict_of(with_unit(first.value, " "), verdicts);
  if (!verdict.empty()) out += "<p>" + verdict + "</p>";
  return out + "</div>\n";
}

std::string result_tiles(const std::vector<ShownResult>& results) {
  std::string out;
  for (std::size_t i = 1; i < results.size(); ++i) {
    const Shown shown{minus_sign(results[i].value.number), results[i].value.unit};
    out += "<div class=\"tile\"><div class=\"name\">" + escape_markup(spaced(results[i].name)) +
           "</div><div class=\"value\">" + escape_markup(shown.number);
    if (!shown.unit.empty())
      out += " <span class=\"unit\">" + escape_markup(shown.unit) + "</span>";
    out += "</div></div>\n";
  }
  return out.empty() ? "" : "<div class=\"tiles\">\n" + out + "</div>\n";
}

}  // namespace

std::string verdict_html(const std::string& verdict) {
  return fmt::format("<b class=\"verdict {}\">{}</b>", kind_of_verdict(verdict),
                     escape_markup(verdict));
}

std::string report_head(const RunData& data) {
  const RunStart& start = data.start;
  const RunEnd* end = data.end ? &*data.end : nullptr;
  const std::vector<ShownResult> results = main_results(data);
  const std::string folder = data.folder.filename().string();
  std::string out = "<p class=\"top\"><span>Vitreo report</span>";
  for (const std::string& text :
       {when(folder), start.operator_name, start.protocol_title.empty() ? "" : start.protocol_file})
    if (!text.empty()) out += "<span>" + escape_markup(text) + "</span>";
  out += "<span class=\"run\">" + escape_markup(folder) + "</span></p>\n<header><h1>" +
         escape_markup(sentence_of(data, results)) + "</h1>" + badge(end);
  if (end && !end->reason.empty())
    out += "<p class=\"reason\">" + escape_markup(end->reason) +
           (completed(data) ? "" : "\n" + kept(data)) + "</p>";
  const std::string done = what_was_done(start.protocol_text);
  if (!done.empty()) out += "<p class=\"done\">" + escape_markup(done) + "</p>";
  out += "</header>\n";
  const Verdicts verdicts = verdicts_of(data);
  const std::string number = number_block(results, verdicts), table = head_table(verdicts);
  if (!number.empty() || !table.empty())
    out += "<div class=\"summary\">" + number + "<div>" + table + "</div></div>\n";
  return out + result_tiles(results);
}

std::string report_facts(const RunData& data) {
  const RunStart& start = data.start;
  const RunEnd* end = data.end ? &*data.end : nullptr;
  std::string out;
  const auto fact = [&out](const char* name, const std::string& value) {
    if (!value.empty()) out += fmt::format("<span>{} <b>{}</b></span>", name, escape_markup(value));
  };
  fact("When", when(data.folder.filename().string()));
  fact("Operator", start.operator_name);
  fact("Protocol", start.protocol_file);
  if (start.rig.is_object())
    fact("Rig", start.rig.contains("file") ? text_of(start.rig["file"]) : "");
  fact("Seed", std::to_string(start.seed));
  if (end && end->experiment_time > 0)
    fact("Experiment", printed(show_quantity(end->experiment_time, "s")));
  if (end && end->wall_time > 0) fact("Took", printed(show_quantity(end->wall_time, "s")));
  for (const ShownResult& one : shown_results(data.results))
    if (one.name == "dead_time") fact("Stood idle", printed(one.value));
  const auto labels = [&fact](const nlohmann::json& values) {
    if (values.is_object())
      for (const auto& [name, value] : values.items()) fact(name.c_str(), text_of(value));
  };
  labels(start.sample);
  labels(start.tags);
  if (end && end->cause.by != "protocol") fact("Ended by", cause_text(end->cause));
  fact("At the end", coil_rest_text(data));
  return "<section><h2>The run</h2><div class=\"facts\">" + out + "</div></section>\n";
}

}  // namespace vitreo
