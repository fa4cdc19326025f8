// Questions of the interview about single settings, checked by the rig's own readers.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/setting_answer.h"
#include "host/rig/interview/steps.h"
#include "host/rig/rig_settings.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace vitreo {
namespace {

using Kind = KnownSetting::Kind;

/// A stand-in's value, which says by itself of what kind it is.
WrittenValue stand_in_value(const std::string& typed) {
  KnownSetting setting;
  const auto last = parse_quantity(typed.substr(typed.rfind(',') + 1));
  setting.kind = !last                                  ? Kind::text
                 : typed.find(',') != std::string::npos ? Kind::numbers
                                                        : Kind::number;
  if (last) setting.unit = last->dimension;
  return read_setting(setting, typed);
}

/// A table of the draft gets stand-ins for what is not answered yet: for what must be there, and
/// for `key`, which may be known only where it is there.
class StandIns {
 public:
  StandIns(DraftTable& table, const std::string& key) : table_(table), key_(key) {}

  void add(const std::vector<SettingText>& texts, const std::string& below) {
    for (const SettingText& text : texts) {
      const bool wanted = text.need == Need::typed || table_.name + "." + below + text.key == key_;
      if (wanted && !text.stand_in.empty()) set(below + text.key, stand_in_value(text.stand_in));
    }
  }

  /// An axis that is begun, or asked for, is a device of its own until it is known which: two that
  /// are one would be refused. A chain has at least one.
  void add_axes() {
    int device = 99;
    for (const std::string axis : {"x.", "y.", "z."}) {
      const bool begun =
          key_.starts_with(table_.name + "." + axis) ||
          std::any_of(table_.settings.begin(), table_.settings.end(),
                      [&](const DraftSetting& one) { return one.key.starts_with(axis); });
      if (!begun && !(axis == "z." && device == 99)) continue;
      set(axis + "device", written_number(device--));
      add(zaber_axis_texts(), axis);
    }
  }

 private:
  void set(const std::string& path, const WrittenValue& value) {
    if (table_.find(path) == nullptr) table_.set({path, value});
  }
  DraftTable& table_;
  const std::string& key_;
};

RigDraft with_stand_ins(RigDraft draft, const std::string& key) {
  for (DraftTable& table : draft.tables) {
    const DraftSetting* const driver = table.find("driver");
    const std::string name =
        driver == nullptr ? "" : std::get<std::string>(driver->value.value.value);
    StandIns stand_ins(table, key);
    stand_ins.add(setting_texts(table.name, name), "");
    if (table.name == "stage" && name == "zaber") stand_ins.add_axes();
  }
  return draft;
}

std::optional<KnownSetting> known_setting(const RigDraft& draft, const std::string& key) {
  for (const KnownSetting& one : known_settings(description_of(with_stand_ins(draft, key))))
    if (one.key == key) return one;
  return std::nullopt;
}

/// "none" leaves out what is a list, a text, or optional. Of a choice it may be one of the words.
bool leaves_out(const SettingText& text, const KnownSetting& known, const std::string& typed) {
  return typed == "none" &&
         (text.need == Need::optional || known.kind == Kind::text || known.kind == Kind::numbers);
}

std::string origin_of(const std::string& typed, const std::string& proposed,
                      const std::string& usual) {
  if (typed == proposed) return " (as identified)";
  return typed == usual ? " (default)" : "";
}

/// Relative names are those beside the rig file, as its reader takes them.
void check_file(const RigDraft& draft, const std::string& name) {
  const std::filesystem::path beside = std::filesystem::path(draft.file).parent_path() / name;
  if (!std::filesystem::is_regular_file(beside))
    throw ConfigError(beside.string() + ": there is no such file");
}

std::string take_setting(InterviewState& state, const std::string& table, const SettingText& text,
                         const std::string& below, const KnownSetting& known,
                         const std::string& typed) {
  if (leaves_out(text, known, typed)) return "";
  const std::string path = below + text.key;
  const std::string key = table + "." + path;
  const auto proposed = state.proposed.find(key);
  const std::string told =
      proposed == state.proposed.end() ? "" : as_typed(known, proposed->second);
  state.draft.table(table).set(
      {path, read_setting(known, typed),
       text.text +
           origin_of(typed, told, text.need == Need::confirmed ? typed_default(known) : "")});
  if (key == "model.calibration") check_file(state.draft, typed);
  check_draft(state.draft);
  return "";
}

std::optional<AskedQuestion> ask_setting(const InterviewState& state, const std::string& table,
                                         const SettingText& text, const std::string& below) {
  const std::string key = table + "." + below + text.key;
  const auto known = known_setting(state.draft, key);
  if (!known) return std::nullopt;  // this driver has no such thing at this address
  AskedQuestion asked;
  asked.question = {.key = key, .before = "", .text = key + ": " + text.text, .help = text.help};
  const auto proposed = state.proposed.find(key);
  if (proposed != state.proposed.end())
    asked.question.fallback = as_typed(*known, proposed->second);
  else if (text.need == Need::optional)
    asked.question.fallback = "none";
  else if (text.need == Need::confirmed)
    asked.question.fallback = typed_default(*known);
  if (known->kind == Kind::choice)
    for (const std::string& word : known->choices) asked.question.options.push_back({word, ""});
  else
    asked.question.wanted = wanted_answer(*known);
  asked.accept = [table, text, below, known = *known](InterviewState& at,
                                                      const std::string& typed) {
    return take_setting(at, table, text, below, known, typed);
  };
  return asked;
}

}  // namespace

// The file's name in front would lead to a file that is not there yet.
void check_draft(const RigDraft& draft) {
  try {
    check_rig(description_of(with_stand_ins(draft, "")));
  } catch (const ConfigError& problem) {
    const std::string what = problem.what();
    const std::string head = draft.file + ": ";
    throw ConfigError(what.starts_with(head) ? what.substr(head.size()) : what);
  }
}

std::vector<InterviewStep> setting_steps(const std::string& table,
                                         const std::vector<SettingText>& texts,
                                         const std::string& below) {
  std::vector<InterviewStep> steps;
  for (const SettingText& text : texts)
    steps.push_back([table, text, below](const InterviewState& state) {
      return ask_setting(state, table, text, below);
    });
  return steps;
}

InterviewStep calibration_step(const InterviewWorld& world) {
  return [&world](const InterviewState& state) -> std::optional<AskedQuestion> {
    const DraftTable* const model = state.draft.find("model");
    const DraftSetting* const file = model == nullptr ? nullptr : model->find("calibration");
    if (file == nullptr) return std::nullopt;
    AskedQuestion asked;
    asked.question = {.key = "calibrations.field.date",
                      .before = "",
                      .text = "calibrations.field.date: day on which the field was measured",
                      .help = "Calibrations grow old: from half a year on `vitreo check` warns.",
                      .fallback = world.today,
                      .wanted = "a date such as " + world.today};
    asked.accept = [file = file->value](InterviewState& at, const std::string& typed) {
      DraftTable& table = at.draft.table("calibrations");
      table.comments = {"How old the measured numbers are: `vitreo check` warns of old ones."};
      table.set({"field.file", file});
      table.set({"field.date", written_text(typed)});
      table.set({"field.valid_days", written_number(180)});
      check_draft(at.draft);
      return std::string();
    };
    return asked;
  };
}

}  // namespace vitreo
