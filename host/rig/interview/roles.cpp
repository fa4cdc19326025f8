// Questions of the interview about which instrument plays a role.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/steps.h"
#include "host/rig/registry.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <sstream>

namespace vitreo {
namespace {

/// An instrument that was recognized and could play the role.
struct Candidate {
  FoundInstrument found;
  ProposedRole role;
  std::string address() const {
    return found.lasting_address.empty() ? found.address : found.lasting_address;
  }
};

template <class Role>
std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const auto& entry : drivers<Role>()) all.emplace_back(entry.name);
  return all;
}

/// The drivers that can play a role and stand for an instrument: no simulated one, no images in
/// files; of operator's inputs the one that is of this kind.
std::vector<std::string> drivers_of(const std::string& role) {
  std::vector<std::string> all = role.ends_with("camera")   ? names<Camera>()
                                 : role == "coils"          ? names<CoilAmplifier>()
                                 : role == "stage"          ? names<Stage>()
                                 : role == "lens_mover"     ? names<LensMover>()
                                 : role == "lamp"           ? names<Lamp>()
                                 : role == "field_probe"    ? names<FieldProbe>()
                                 : role == "rotation_stage" ? names<RotationStage>()
                                                            : names<OperatorInput>();
  std::erase_if(all, [&](const std::string& name) {
    return name == "simulated" || name == "image_sequence" ||
           (role == "pedal" && name == "spacemouse") ||
           (role == "joystick" && name == "foot_pedal");
  });
  return all;
}

/// Of all roles so far, and of each channel.
std::vector<std::string> taken_addresses(const RigDraft& draft) {
  std::vector<std::string> taken;
  for (const DraftTable& table : draft.tables) {
    const DraftSetting* const address = table.find("address");
    if (address == nullptr) continue;
    std::istringstream list(std::get<std::string>(address->value.value.value));
    for (std::string one; std::getline(list, one, ',');)
      taken.push_back(one.substr(std::min(one.find_first_not_of(' '), one.size())));
  }
  return taken;
}

bool contains(const std::vector<std::string>& all, const std::string& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

std::vector<Candidate> candidates_for(const InterviewState& state, const std::string& role) {
  const std::vector<std::string> taken = taken_addresses(state.draft);
  std::vector<Candidate> candidates;
  for (const FoundInstrument& found : state.found)
    for (const ProposedRole& one : found.roles)
      if (const Candidate candidate{found, one};
          one.role == role && !contains(taken, candidate.address()))
        candidates.push_back(candidate);
  return candidates;
}

/// "1384" of 1384, "MEAS?" of "\"MEAS?\"": as it would be typed.
std::string typed_of(const std::string& lua) {
  return lua.size() > 1 && lua.front() == '"' ? lua.substr(1, lua.size() - 2) : lua;
}

/// What the instrument has told becomes the default of its questions. Axes of a chain come as
/// tables: "{ device = 1, axis = 2 }".
void propose(InterviewState& state, const Candidate& candidate) {
  const std::string head = candidate.role.role + ".";
  if (candidate.found.baud_rate > 0)
    state.proposed[head + "baud_rate"] = std::to_string(candidate.found.baud_rate);
  std::string axes;
  for (const ProposedSetting& one : candidate.role.settings) {
    int device = 0;
    int axis = 0;
    if (std::sscanf(one.value.c_str(), "{ device = %d, axis = %d }", &device, &axis) == 2) {
      state.proposed[head + one.key + ".device"] = std::to_string(device);
      state.proposed[head + one.key + ".axis"] = std::to_string(axis);
      axes += (axes.empty() ? "" : ", ") + one.key;
    } else {
      state.proposed[head + one.key] = typed_of(one.value);
    }
  }
  if (!axes.empty()) state.proposed[head + "axes"] = axes;
}

/// "x, z": letters of axes, each once. Throws ConfigError.
std::vector<std::string> axes_in(const std::string& typed) {
  std::vector<std::string> axes;
  for (const char letter : typed) {
    if (letter == ',' || letter == ' ') continue;
    const std::string axis(1, letter);
    if (letter < 'x' || letter > 'z' || contains(axes, axis))
      throw ConfigError("'" + typed + "': it wants x, y and z, each at most once");
    axes.push_back(axis);
  }
  std::sort(axes.begin(), axes.end());
  if (axes.empty()) throw ConfigError("it wants at least one of x, y and z");
  return axes;
}

/// Which axes a chain of Zaber's has, and what each is.
std::optional<AskedQuestion> axes_question(const InterviewState& state) {
  const auto proposed = state.proposed.find("stage.axes");
  AskedQuestion asked;
  asked.question = {
      .key = "stage.axes",
      .before = "",
      .text = "stage.axes: which axes the chain has",
      .help =
          "z focuses where the microscope stands on it; x and y go across. Which device is "
          "which axis you see when you turn its knob.",
      .options = {},
      .fallback = proposed == state.proposed.end() ? "z" : proposed->second,
      .wanted = "letters of x, y and z"};
  asked.accept = [](InterviewState& at, const std::string& typed) {
    int device = 0;
    std::vector<InterviewStep> steps;
    for (const std::string& axis : axes_in(typed)) {
      at.proposed.try_emplace("stage." + axis + ".device", std::to_string(++device));
      for (const InterviewStep& step : setting_steps("stage", zaber_axis_texts(), axis + "."))
        steps.push_back(step);
    }
    at.next(steps);
    return std::string();
  };
  return asked;
}

std::vector<InterviewStep> steps_of(const std::string& role, const std::string& driver) {
  std::vector<InterviewStep> steps;
  if (role == "stage" && driver == "zaber") steps.emplace_back(axes_question);
  for (const InterviewStep& step : setting_steps(role, setting_texts(role, driver)))
    steps.push_back(step);
  return steps;
}

/// What stands above the role's table.
std::string comment_of(const RigDraft& draft, const std::string& role, const std::string& driver) {
  std::string comment;
  for (const RoleText& one : role_texts())
    if (role == one.role) comment = std::string(one.text) + ".";
  if (const auto file = file_called(draft, driver); file && comment.empty())
    comment = file->title + ".";
  if (!comment.empty())
    comment.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(comment.front())));
  return comment;
}

/// Puts the role's table into the draft, and its settings next. Throws ConfigError where the
/// address is none of the driver's, or another role's.
void begin_role(InterviewState& state, const std::string& role, const std::string& driver,
                const std::string& address, const std::string& comment) {
  DraftTable& table = state.draft.table(role);
  table.comments = {comment_of(state.draft, role, driver)};
  table.set({"driver", written_text(driver)});
  table.set({"address", written_text(address), comment});
  check_draft(state.draft);
  state.next(file_setting_steps(state.draft, role, driver));
  state.next(steps_of(role, driver));
}

/// The next one after the last: tcp:10.0.0.11:5025 to tcp:10.0.0.12:5025, ttyUSB2 to ttyUSB3.
std::string next_address(const std::string& last) {
  const bool tcp = last.starts_with("tcp:");
  std::size_t end = tcp ? last.rfind(':') : last.size();
  std::size_t begin = end;
  while (begin > 0 && last[begin - 1] >= '0' && last[begin - 1] <= '9') --begin;
  if (tcp && last.starts_with("tcp:127.")) {  // several on this machine differ in their port
    end = last.size();
    begin = last.rfind(':') + 1;
  }
  if (begin == end || end - begin > 6) return "";
  return last.substr(0, begin) + std::to_string(std::stol(last.substr(begin, end - begin)) + 1) +
         last.substr(end);
}

std::optional<AskedQuestion> supply_question(const InterviewState& state,
                                             std::vector<std::string> before, std::size_t count) {
  const std::size_t number = before.size() + 1;
  std::string proposed;
  for (const Candidate& one : candidates_for(state, "coils"))
    if (one.found.driver == "kepco_bop" && proposed.empty() && !contains(before, one.address()))
      proposed = one.address();
  if (proposed.empty() && !before.empty()) proposed = next_address(before.back());
  AskedQuestion asked;
  asked.question = {
      .key = fmt::format("coils.supply {}", number),
      .before = "",
      .text = fmt::format("coils.supply {}: address of the supply that drives coil {} of {}",
                          number, number, count),
      .help =
          "The order decides which current flows in which coil: coil 1 of the field's model, or "
          "of its calibration, is fed by the first address. Follow the cable from the coil.",
      .options = {},
      .fallback = proposed,
      .wanted = "an address such as " + example_address("kepco_bop")};
  asked.accept = [before, count](InterviewState& at, const std::string& typed) {
    std::vector<std::string> all = before;
    all.push_back(full_address(typed));
    const bool whole = all.size() == count;
    // Checked with those before it: an address given twice is told at once.
    InterviewState trial = at;
    begin_role(whole ? at : trial, "coils", "kepco_bop", fmt::format("{}", fmt::join(all, ", ")),
               "of coil 1, 2, ... in this order");
    if (!whole)
      at.next(
          {[all, count](const InterviewState& now) { return supply_question(now, all, count); }});
    return std::string();
  };
  return asked;
}

/// How many supplies there are, and then which drives which coil.
std::optional<AskedQuestion> supplies_question(const InterviewState& state) {
  std::size_t found = 0;
  for (const Candidate& one : candidates_for(state, "coils"))
    if (one.found.driver == "kepco_bop") ++found;
  AskedQuestion asked;
  asked.question = {.key = "coils.supplies",
                    .before = "",
                    .text = "coils.supplies: how many supplies there are, one a coil",
                    .help = "Each coil has a supply with an address of its own.",
                    .options = {},
                    .fallback = std::to_string(found > 0 ? found : 8),
                    .wanted = "a whole number, 1 to 16"};
  asked.accept = [](InterviewState& at, const std::string& typed) {
    const bool digits =
        !typed.empty() && typed.find_first_not_of("0123456789") == std::string::npos;
    const std::size_t count = digits && typed.size() < 3 ? std::stoul(typed) : 0;
    if (count < 1 || count > 16) throw ConfigError("'" + typed + "' is not 1 to 16");
    at.next({[count](const InterviewState& now) { return supply_question(now, {}, count); }});
    return std::string();
  };
  return asked;
}

/// Of a Lua file, by the first bus that it takes.
std::string example_of(const RigDraft& draft, const std::string& driver) {
  const auto file = file_called(draft, driver);
  if (!file) return example_address(driver);
  static const std::map<std::string, std::string> examples{
      {"serial", "serial:/dev/ttyUSB0"}, {"tcp", "tcp:10.0.0.7:5025"},
      {"udp", "udp:10.0.0.7:5025"},      {"usbtmc", "usbtmc:/dev/usbtmc0"},
      {"vxi11", "vxi11:10.0.0.7"},       {"hislip", "hislip:10.0.0.7"}};
  const auto found = examples.find(file->buses.empty() ? "" : file->buses.front());
  return found == examples.end() ? example_address(driver) : found->second;
}

/// A serial port that has not answered, or was not asked, and that the driver could take.
std::string likely_address(const InterviewWorld& world, const InterviewState& state,
                           const std::string& driver) {
  const std::vector<std::string> taken = taken_addresses(state.draft);
  for (const FoundInstrument& one : state.found)
    if (const std::string address = one.lasting_address.empty() ? one.address : one.lasting_address;
        one.driver == driver && !contains(taken, address))
      return address;
  for (const auto& row : world.plugged_in) {
    const std::string address = row.value("address", "");
    const auto possible = row.value("candidates", std::vector<std::string>{});
    const bool known =
        std::any_of(state.found.begin(), state.found.end(),
                    [&](const FoundInstrument& one) { return one.address == address; });
    if (!contains(taken, address) && !known &&
        (contains(possible, driver) ||
         (row.value("driver", "") == driver && row.value("bus", "") == "serial")))
      return address;
  }
  return "";
}

}  // namespace

InterviewStep address_step(const InterviewWorld& world, const std::string& role,
                           const std::string& driver) {
  return [&world, role, driver](const InterviewState& state) -> std::optional<AskedQuestion> {
    AskedQuestion asked;
    asked.question = {
        .key = role + ".address",
        .before = "",
        .text = role + ".address: where it is plugged in",
        .help =
            "As `vitreo devices` prints it. A name in /dev/serial/by-id stays the same when "
            "cables are put in in another order. emulated: an emulator in its place, for trying.",
        .options = {},
        .fallback = likely_address(world, state, driver),
        .wanted = "an address such as " + example_of(state.draft, driver)};
    asked.accept = [role, driver](InterviewState& at, const std::string& typed) {
      begin_role(at, role, driver, full_address(typed), "");
      return std::string();
    };
    return asked;
  };
}

namespace {

std::vector<AnswerOption> options_for(const InterviewState& state,
                                      const std::vector<Candidate>& candidates,
                                      const std::string& role) {
  std::vector<AnswerOption> options;
  std::size_t supplies = 0;
  for (const Candidate& one : candidates) {
    if (one.found.driver == "kepco_bop")
      ++supplies;
    else
      options.push_back({one.address(), one.found.answer + " (" + one.found.driver + ")"});
  }
  for (const std::string& driver : drivers_of(role)) {
    const bool several = driver == "kepco_bop";
    options.push_back({driver, !several        ? "this driver, at an address that you type"
                               : supplies == 0 ? "this driver, at addresses that you type"
                                               : fmt::format("{} found", supplies)});
  }
  for (const AnswerOption& file : file_options(state.draft, role)) options.push_back(file);
  options.push_back({"none", "leave this role out"});
  return options;
}

/// One candidate is taken by Enter; among several a person must choose.
std::string usual_option(const std::vector<Candidate>& candidates) {
  if (candidates.empty()) return "none";
  const bool supplies = std::all_of(candidates.begin(), candidates.end(), [](const Candidate& one) {
    return one.found.driver == "kepco_bop";
  });
  if (supplies) return "kepco_bop";
  return candidates.size() == 1 ? candidates.front().address() : "";
}

void choose(const InterviewWorld& world, InterviewState& state, const std::string& role,
            const std::string& word) {
  if (word == "none") return;
  for (const Candidate& one : candidates_for(state, role)) {
    if (one.address() != word || one.found.driver == "kepco_bop") continue;
    propose(state, one);
    const std::string node = one.found.lasting_address.empty() ? "" : "; " + one.found.address;
    begin_role(state, role, one.found.driver, word, one.found.answer + node);
    return;
  }
  if (word == "kepco_bop")
    state.next({supplies_question});
  else
    state.next({address_step(world, role, word)});
}

}  // namespace

InterviewStep role_step(const InterviewWorld& world, const RoleText& role) {
  return [&world, role](const InterviewState& state) -> std::optional<AskedQuestion> {
    const std::vector<Candidate> candidates = candidates_for(state, role.role);
    AskedQuestion asked;
    asked.question = {
        .key = role.role,
        .before = "\n",
        .text = fmt::format("{}: {}. Which instrument is it?", role.role, role.text),
        .help =
            "A protocol that needs a role which the rig has not is refused before it begins. An "
            "instrument that was recognized tells its settings itself.",
        .options = options_for(state, candidates, role.role),
        .fallback = usual_option(candidates)};
    asked.accept = [&world, name = std::string(role.role)](InterviewState& at,
                                                           const std::string& word) {
      choose(world, at, name, word);
      return std::string();
    };
    return asked;
  };
}

InterviewStep sample_step() {
  return [](const InterviewState&) -> std::optional<AskedQuestion> {
    AskedQuestion asked;
    asked.question = {
        .key = "sample",
        .before = "\n",
        .text = "sample: how robot, target and eye get to their places. Who does it?",
        .help =
            "Protocols ask the operator by questions at the terminal or on the page: put the robot "
            "in, take the target out. Without the role they cannot, and most want it.",
        .options = {{"operator", "a person, who is asked"}, {"none", "leave this role out"}},
        .fallback = "operator"};
    asked.accept = [](InterviewState& at, const std::string& word) {
      if (word == "none") return std::string();
      at.draft.table("sample").comments = {
          "The operator's hands: protocols ask for the robot, the target and the vials."};
      at.draft.table("sample").set({"driver", written_text("operator")});
      check_draft(at.draft);
      return std::string();
    };
    return asked;
  };
}

InterviewStep name_step(const InterviewWorld& world) {
  return [&world](const InterviewState&) -> std::optional<AskedQuestion> {
    AskedQuestion asked;
    asked.question = {
        .key = "name",
        .before = "",
        .text = "Name of the rig, which becomes its file",
        .help =
            "bench becomes bench.lua in this folder; another folder may stand before it. A file "
            "that is there already is never written over.",
        .options = {},
        .fallback = "",
        .wanted = "small letters, digits and _"};
    asked.accept = [&world](InterviewState& at, const std::string& typed) {
      at.draft.file = world.file_for(typed);
      return std::string();
    };
    return asked;
  };
}

InterviewStep title_step() {
  return [](const InterviewState& state) -> std::optional<AskedQuestion> {
    const std::size_t slash = state.draft.file.rfind('/') + 1;  // 0 where there is none
    AskedQuestion asked;
    asked.question = {
        .key = "title",
        .before = "",
        .text = "Title, for reports",
        .help = "It stands in each report and record: name the laboratory, and what is particular.",
        .options = {},
        .fallback = state.draft.file.substr(slash, state.draft.file.rfind(".lua") - slash),
        .wanted = "a text"};
    asked.accept = [](InterviewState& at, const std::string& typed) {
      at.draft.title = typed;
      return std::string();
    };
    return asked;
  };
}

InterviewStep write_step(const InterviewWorld& world) {
  return [&world](const InterviewState& state) -> std::optional<AskedQuestion> {
    const std::string lua = to_lua(state.draft);
    AskedQuestion asked;
    asked.question = {.key = "write",
                      .before = "\n" + lua + "\n",
                      .text = "Write this to " + state.draft.file + "?",
                      .help = "Nothing is written before. back changes an answer.",
                      .options = {{"yes", "check it once more, and write it"},
                                  {"no", "ask me again; back changes an answer, quit leaves"}},
                      .fallback = "yes"};
    asked.accept = [&world, lua](InterviewState& at, const std::string& word) {
      if (word == "no") throw ConfigError("nothing is written yet: back, or quit");
      world.check(at.draft.file, lua);
      at.done = true;
      return std::string();
    };
    return asked;
  };
}

}  // namespace vitreo
