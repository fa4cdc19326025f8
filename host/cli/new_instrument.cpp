// SPDX-License-Identifier: Apache-2.0
#include "host/cli/new_instrument.h"

#include "devices/scripted/declaration.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/rig/rig_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>

namespace vitreo::cli {
namespace {

/// A link's declaration, with its comment, and an address of it.
struct LinkText {
  std::string declaration;
  std::string address;
};
const std::map<std::string, LinkText>& link_texts() {
  const std::string lines = "terminator = \"\\n\" },";
  const auto over = [&](const std::string& bus) {
    return "link = { buses = { \"" + bus + "\" }, " + lines;
  };
  static const std::map<std::string, LinkText> all{
      {"serial",
       {"link = { baud_rate = 9600, " + lines +
            " -- data_bits, parity, stop_bits, flow, timeout, pause",
        "serial:/dev/ttyUSB0"}},
      {"tcp", {over("tcp") + " -- timeout, pause", "tcp:192.168.1.7:5025"}},
      {"udp", {over("udp") + " -- timeout, pause", "udp:192.168.1.7:5025"}},
      {"usbtmc", {over("usbtmc") + " -- by its numbers, as lsusb has them", "usbtmc:1bfa:0498"}},
      {"vxi11", {over("vxi11"), "vxi11:192.168.1.7"}},
      {"hislip", {over("hislip"), "hislip:192.168.1.7"}},
      {"modbus",
       {"link = { baud_rate = 9600, modbus = { unit = 1 } }, -- framing = \"tcp\" of Modbus TCP",
        "serial:/dev/ttyUSB0"}},
  };
  return all;
}

bool is_of_modbus(const std::string& kind) { return kind == "sensor" || kind == "actuator"; }

template <class List>
[[noreturn]] void fail_choice(const std::string& what, const std::string& given,
                              const List& known) {
  const std::string near = nearest(given, known);
  throw ConfigError(fmt::format("new instrument: '{}' is no {}: {}{}", given, what,
                                fmt::join(known, ", "),
                                near.empty() ? "" : "; did you mean " + near + "?"));
}

}  // namespace

const std::vector<std::string>& instrument_links() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& [name, text] : link_texts()) all.push_back(name);
    return all;
  }();
  return names;
}

std::string role_of_instrument(const std::string& name, const std::string& kind) {
  return scripted::is_free(kind) ? name : kind;
}

std::string instrument_text(const std::string& name, const std::string& kind,
                            const std::string& link) {
  const auto& kinds = scripted::kinds();
  if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end())
    fail_choice("kind of instrument", kind, kinds);
  const auto found = link_texts().find(link);
  if (found == link_texts().end()) fail_choice("link", link, instrument_links());
  if (link == "modbus" && !is_of_modbus(kind))
    throw ConfigError("new instrument: with Modbus it begins as a sensor or an actuator");
  const auto& roles = role_names();
  if (std::find(roles.begin(), roles.end(), name) != roles.end())
    throw ConfigError("new instrument: " + name + " is a role's name: give it another one");
  const std::string file =
      "templates/instruments/" + std::string(link == "modbus" ? "modbus_" : "") + kind + ".lua";
  std::ifstream in(Program::in_data_folder(file));
  if (!in) throw ConfigError(file + ": the template is missing from the installation");
  std::string text;
  for (std::string line; std::getline(in, line); text += line + "\n") {
    if (line.find("-- @LINK@") != std::string::npos) line = "  " + found->second.declaration;
    for (std::size_t at = 0; (at = line.find("@NAME@", at)) != std::string::npos; at += name.size())
      line.replace(at, 6, name);
  }
  return text;
}

std::string instrument_rig_text(const std::string& name, const std::string& kind,
                                const std::string& link) {
  return fmt::format(
      "-- A rig with {0} alone, emulated. Its real address: \"{2}\".\n"
      "-- SPDX-License-Identifier: Apache-2.0\n"
      "return {{\n"
      "  title = \"{0}\",\n"
      "{3}"
      "  {1} = {{ driver = \"{0}\", address = \"emulated\" }},\n"
      "}}\n",
      name, role_of_instrument(name, kind), link_texts().at(link).address,
      kind == "current_sensor"  // it measures those of a rig
          ? "  coils = { driver = \"usb3103\", address = \"emulated\" },\n"
          : "");
}

}  // namespace vitreo::cli
