// Questions to an instrument of which only its address is known: `vitreo devices --ask`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/serial_link.h"
#include "devices/time/clock.h"
#include "host/rig/asked_files.h"
#include "host/rig/registry.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// One question to a port, at one rate.
struct AskingStep {
  int baud_rate = 0;                        // 0: the port has none (TCP)
  PortQuestion question;                    // its `recognize` is not used
  std::vector<IdentifiedDriver> drivers;    // those that would recognize the answer
  std::shared_ptr<const AskedFile> file{};  // it is a Lua file's question; null: a driver's
};

/// What will be sent to a port, in this order.
struct AskingPlan {
  std::string address;
  std::vector<AskingStep> steps;
  std::vector<std::string> cautions;  // what it does to instruments all the same
};

/// The questions of `drivers` in an order in which none can move or energize an instrument of
/// theirs: what holds a byte that is another's command comes after the questions of that one, which
/// then is not there. Throws std::logic_error when there is no such order.
AskingPlan plan_asking(const std::string& address, const std::vector<IdentifiedDriver>& drivers);
/// The files' questions behind those of the plan, whose instruments then are not there; for a
/// serial port, or for TCP where the file is of it.
AskingPlan with_files(AskingPlan plan, const std::vector<std::shared_ptr<const AskedFile>>& files);
/// For people: each message and rate.
std::string to_text(const AskingPlan& plan);
/// s, where nothing answers: all pauses of the plan and all waiting for a first byte.
double longest_time(const AskingPlan& plan);
/// What ask_address() would send to a serial or TCP port; without steps for the other buses. Throws
/// ConfigError for an address that is none.
AskingPlan plan_for_address(const std::string& given);

/// An instrument that was recognized, as a rig file would have it.
struct FoundInstrument {
  std::string driver;
  std::string address;
  int baud_rate = 0;   // 0: none
  std::string answer;  // its identity, for people
  std::vector<ProposedRole> roles;
  std::string lasting_address{};  // by the adapter's own name; empty: there is none
};
/// The role's table in Lua, to be put into a rig file; the answer and the note as comments. What is
/// not known yet stands there as a comment.
std::string rig_table(const FoundInstrument& found, const ProposedRole& role);

/// An answer that no driver recognizes.
struct HeardAnswer {
  int baud_rate = 0;
  std::string question;   // printable
  std::string answer;     // printable
  bool echo = false;      // it is what was sent, and nothing more
  bool readable = false;  // text: this is its rate, and it is asked at no other from then on
};

struct AskingResult {
  std::vector<FoundInstrument> found;  // several where one device can be one of several things
  std::vector<HeardAnswer> heard;      // where nothing is found
  AskingPlan plan;                     // empty where nothing was sent
};

/// Its rate is 0 where the port has none.
using OpenLine = std::function<std::unique_ptr<ByteLink>(const SerialSettings& line)>;
using TellStep = std::function<void(const std::string& line)>;

/// Sends the plan's questions until one is recognized; `tell` hears of each. Throws DeviceError
/// when the port cannot be opened or is lost, Stopped.
AskingResult ask_port(const AskingPlan& plan, const OpenLine& open, Clock& clock,
                      const TellStep& tell);

/// What is at an address of any bus: "/dev/ttyUSB0", "serial:...", "tcp:...", "hid:...", "usb:...",
/// "genicam", "genicam:...". Only ports are asked; what is on USB is known by its numbers, and a
/// camera by its discovery. `before` is told the plan before the first byte is sent. Throws
/// ConfigError for an address that is none, DeviceError.
AskingResult ask_address(const std::string& address, Clock& clock,
                         const std::function<void(const AskingPlan&)>& before, const TellStep& tell,
                         const std::vector<std::shared_ptr<const AskedFile>>& files = {});
/// The link to a serial port's node that has the adapter's name and serial number ("ttyUSB0" may be
/// another one after the next start); "" where there is none.
std::string lasting_name(const std::string& node,
                         const std::filesystem::path& links = "/dev/serial/by-id");
/// "/dev/ttyUSB0" as "serial:/dev/ttyUSB0"; others as they are. Throws ConfigError.
std::string full_address(const std::string& given);

/// For people: the tables, or what was heard; for programs.
std::string to_text(const AskingResult& result);
nlohmann::json to_json(const AskingResult& result);

}  // namespace vitreo
