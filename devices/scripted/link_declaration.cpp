// Declaration of an instrument: its link, and how messages on it are framed.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration_parts.h"

#include <utility>

namespace vitreo::scripted {
namespace {

constexpr double kLongestAnswer = 600;  // s

std::string one_byte(TableReader& reader, const std::string& key) {
  std::string text = reader.text(key, "");
  if (text.size() != 1) reader.fail(key, "must be one byte");
  return text;
}

Checksum read_checksum(TableReader& reader) {
  const std::string name = reader.text("checksum", "none");
  const std::pair<const char*, Checksum> all[] = {{"none", Checksum::none},
                                                  {"sum8", Checksum::sum8},
                                                  {"xor8", Checksum::xor8},
                                                  {"lrc", Checksum::lrc},
                                                  {"crc16_modbus", Checksum::crc16_modbus},
                                                  {"crc16_xmodem", Checksum::crc16_xmodem}};
  for (const auto& [known, checksum] : all)
    if (name == known) return checksum;
  reader.fail("checksum", "must be sum8, xor8, lrc, crc16_modbus or crc16_xmodem");
}

// modbus = { unit = 1, framing = "tcp" }: messages are PDUs, their frames the host's.
bool read_modbus(TableReader& link, Framing& framing) {
  auto modbus = link.table("modbus");
  if (!modbus) return false;
  for (const char* other : {"terminator", "message", "echo"})
    if (link.has(other)) link.fail(other, "is not of Modbus, and modbus is there too");
  framing.kind = Framing::Kind::modbus;
  framing.send_end.clear();
  framing.unit = static_cast<std::uint8_t>(modbus->number("unit", 1, 247).value_or(1));
  const std::string name = modbus->text("framing", "rtu");
  if (name != "rtu" && name != "tcp") modbus->fail("framing", "must be rtu or tcp");
  framing.modbus = name == "rtu" ? modbus::Framing::rtu : modbus::Framing::tcp;
  modbus->finish();
  return true;
}

// terminator = "\r\n", or message = { length = 7 }, { header = 6, rest = function(header) ... },
// { start = "\2", stop = "\3" }, { quiet = 0.02 }.
Framing read_framing(TableReader& link) {
  Framing framing;
  if (read_modbus(link, framing)) return framing;
  const std::string both = link.text("terminator", "\n");
  framing.send_end = link.text("send_terminator", both);
  framing.receive_end = link.text("receive_terminator", both);
  if (framing.receive_end.empty()) link.fail("receive_terminator", "must not be empty");
  framing.most = static_cast<std::size_t>(link.number("longest", 1, 1 << 20).value_or(4096));
  auto message = link.table("message");
  if (!message) return framing;
  if (link.has("terminator")) link.fail("terminator", "is of lines, and message is there too");
  framing.plain_send = link.has("send_terminator");
  if (!framing.plain_send) framing.send_end.clear();
  if (const auto length = message->number("length", 1, 65536)) {
    framing.kind = Framing::Kind::fixed;
    framing.length = static_cast<std::size_t>(*length);
  } else if (const auto header = message->number("header", 1, 256)) {
    framing.kind = Framing::Kind::header;
    framing.length = static_cast<std::size_t>(*header);
    framing.rest = message->function("rest");
    if (!framing.rest) message->fail("rest", "must be a function(header): how many bytes follow");
  } else if (message->has("start")) {
    framing.kind = Framing::Kind::brackets;
    framing.start = one_byte(*message, "start");
    framing.stop = one_byte(*message, "stop");
    framing.counted = message->whole("counted", 0, 250).value_or(-1);
    if (framing.counted >= 0 && framing.plain_send)
      message->fail("counted", "is of what is sent too, and link.send_terminator is there");
  } else {
    framing.kind = Framing::Kind::quiet;
    framing.quiet = message->seconds("quiet", 0.02, 10);
  }
  framing.checksum = read_checksum(*message);
  message->finish();
  return framing;
}

}  // namespace

LinkDeclaration read_link(TableReader& all) {
  LinkDeclaration link;
  auto reader = all.table("link");
  if (!reader) all.fail("link", "is missing: link = { baud_rate = 9600, terminator = \"\\n\" }");
  if (reader->has("buses")) link.buses = reader->texts("buses");
  SerialSettings& serial = link.serial;
  serial.baud_rate =
      static_cast<int>(reader->number("baud_rate", 50, 4e6).value_or(serial.baud_rate));
  serial.data_bits = static_cast<int>(reader->number("data_bits", 5, 8).value_or(8));
  serial.stop_bits = static_cast<int>(reader->number("stop_bits", 1, 2).value_or(1));
  serial.parity = read_enum(*reader, "parity", parity_names(), serial.parity);
  set_flow(serial, flow_names()[read_enum(*reader, "flow", flow_names(), std::size_t{0})]);
  serial.opening_lines =
      read_enum(*reader, "opening_lines", opening_lines_names(), serial.opening_lines);
  link.framing = read_framing(*reader);
  link.timeout = reader->seconds("timeout", 1, kLongestAnswer);
  link.pause = reader->seconds("pause", 0, 10);
  link.opening_pause = reader->seconds("opening_pause", 0, 30);
  link.echo = reader->flag("echo", false);
  reader->finish();
  return link;
}

}  // namespace vitreo::scripted
