// SPDX-License-Identifier: Apache-2.0
#include "host/rig/asked_files.h"

#include "devices/links/modbus_frames.h"
#include "devices/links/printable.h"
#include "devices/scripted/conversion.h"
#include "devices/scripted/framing.h"
#include "host/config/config.h"
#include "host/rig/instrument_file.h"

#include <algorithm>
#include <set>
#include <utility>

namespace vitreo {
namespace {

/// s, for the first byte of an answer: there are many files, and a port may be silent to each.
constexpr double kPatience = 0.5;

using scripted::Declaration;
using scripted::Framing;

/// The first whole message of what has come, without frame and checksum; nothing where there is
/// none.
std::optional<std::string> first_message(const Framing& framing, const ByteString& heard) {
  const std::string text = text_of_bytes(heard);
  switch (framing.kind) {
    case Framing::Kind::line: {
      const std::size_t end = text.find(framing.receive_end);
      return end == std::string::npos ? std::nullopt : std::optional(text.substr(0, end));
    }
    case Framing::Kind::brackets: {
      const std::size_t begin = text.find(framing.start);
      const std::size_t end = text.find(framing.stop, begin);
      if (begin == std::string::npos || end == std::string::npos) return std::nullopt;
      return text.substr(begin + 1, end - begin - 1);
    }
    case Framing::Kind::modbus:
      if (heard.size() < 4 || heard[0] != framing.unit || !modbus::has_right_crc(heard))
        return std::nullopt;
      return text.substr(1, text.size() - 3);
    case Framing::Kind::quiet:
      return text;
    default:
      return std::nullopt;
  }
}

bool can_be_asked(const Declaration& declared) {
  const Framing& framing = declared.link.framing;
  const bool known = framing.kind != Framing::Kind::fixed &&
                     framing.kind != Framing::Kind::header && framing.counted < 0;
  return std::holds_alternative<std::string>(declared.identity) &&
         !declared.identity_match.empty() && known &&
         framing.checksum == scripted::Checksum::none && framing.modbus == modbus::Framing::rtu;
}

std::optional<Recognized> recognized(scripted::Loaded& loaded, const std::string& name,
                                     const std::vector<ByteString>& answers) {
  const Declaration& declared = loaded.declaration;
  try {
    const auto said = first_message(declared.link.framing, answers.back());
    const auto parts =
        said ? scripted::captures(*loaded.sandbox, *said, declared.identity_match) : std::nullopt;
    if (!parts) return std::nullopt;
    Recognized found{{declared.title, "", ""}, {}};
    for (std::size_t i = 0; i < std::min(parts->size(), declared.identity_fields.size()); ++i) {
      const std::string& field = declared.identity_fields[i];
      if (field == "name") found.identity.name = (*parts)[i];
      if (field == "serial") found.identity.serial = (*parts)[i];
      if (field == "firmware") found.identity.firmware = (*parts)[i];
    }
    found.roles.push_back({scripted::is_free(declared.kind) ? name : declared.kind,
                           {},
                           "vitreo docs instrument " + name});
    return found;
  } catch (const scripted::ScriptFault&) {
    return std::nullopt;
  }
}

/// Plain messages that set or start something.
std::set<std::string> commands_of(const Declaration& declared) {
  std::set<std::string> all(declared.setup.begin(), declared.setup.end());
  all.insert(declared.safe.begin(), declared.safe.end());
  for (const auto& one : declared.properties)
    if (const auto* text = std::get_if<std::string>(&one.set)) all.insert(*text);
  for (const auto& one : declared.commands)
    if (const auto* text = std::get_if<std::string>(&one.send)) all.insert(*text);
  return all;
}

std::shared_ptr<const AskedFile> asked(const std::string& name, scripted::Loaded loaded) {
  const auto shared = std::make_shared<scripted::Loaded>(std::move(loaded));
  const auto file = std::make_shared<AskedFile>();
  file->name = name;
  file->line = shared->declaration.link.serial;
  file->buses = shared->declaration.link.buses;
  const std::string question = scripted::framed(
      shared->declaration.link.framing, std::get<std::string>(shared->declaration.identity));
  file->question.baud_rates = {file->line.baud_rate};
  // Twice: the first one ends what questions at other rates have left, or power-up has.
  file->question.messages.assign(
      static_cast<std::size_t>(std::max(2, shared->declaration.identity_tries)),
      bytes_of_text(question));
  file->question.may_begin_silent = true;
  file->question.opening_pause = to_seconds(shared->declaration.link.opening_pause);
  file->question.patience = std::min(kPatience, to_seconds(shared->declaration.link.timeout));
  file->recognize = [shared, name](const std::vector<ByteString>& answers) {
    return recognized(*shared, name, answers);
  };
  return file;
}

}  // namespace

std::vector<std::shared_ptr<const AskedFile>> asked_files(const std::vector<std::string>& folders) {
  RigDescription none;
  none.folders = folders;
  std::vector<std::pair<std::string, scripted::Loaded>> loaded;
  for (const std::string& name : instrument_file_names(none)) {
    try {
      const auto file = find_instrument_file(none, "/nowhere/", name);
      if (file) loaded.emplace_back(name, load_instrument(*file));
    } catch (const ConfigError&) {  // vitreo docs instrument NAME tells what is wrong with it
    }
  }
  std::set<std::string> commands;
  for (const auto& [name, one] : loaded) commands.merge(commands_of(one.declaration));
  std::vector<std::shared_ptr<const AskedFile>> files;
  for (auto& [name, one] : loaded)
    if (can_be_asked(one.declaration) &&
        !commands.contains(std::get<std::string>(one.declaration.identity)))
      files.push_back(asked(name, std::move(one)));
  return files;
}

}  // namespace vitreo
