// Declaration of an instrument: what its one Lua file says of link, identity, quantities, commands
// and role, checked whole before anything is opened.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/serial_link.h"
#include "devices/roles/instrument.h"
#include "devices/scripted/framing.h"
#include "devices/scripted/registers.h"
#include "devices/scripted/sandbox.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace vitreo::scripted {

/// A unit that a file declares: SI = number * factor + offset.
struct DeclaredUnit {
  std::string symbol{};
  std::string si{};
  double factor = 1;
  double offset = 0;
  double to_si(double number) const { return number * factor + offset; }
  double from_si(double in_si) const { return (in_si - offset) / factor; }
};
/// Finds a unit by its symbol; nothing where it is none. The host's table is above this room.
using UnitLookup = std::function<std::optional<DeclaredUnit>(std::string_view)>;

/// A setting that a rig file may give the instrument, in the unit that the file declares.
struct SettingDeclaration {
  std::string name;
  QuantityType type = QuantityType::number;  ///< number, flag or text
  DeclaredUnit unit{};
  QuantityValue fallback{};  ///< in that unit
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices{};
  std::string help{};
};
/// In the declared units.
using SettingValues = std::map<std::string, QuantityValue>;

struct LinkDeclaration {
  std::vector<std::string> buses{"serial", "tcp"};  ///< what an address may begin with
  SerialSettings serial{};
  Framing framing{};
  Time timeout = std::chrono::seconds(1);  ///< for an answer
  Time pause{};                            ///< from one message, or its answer, to the next
  Time opening_pause{};                    ///< after the link was opened
  bool echo = false;                       ///< what is sent comes back first
};

struct PropertyDeclaration {
  QuantityInfo info;
  DeclaredUnit unit{};
  Action ask{};
  Action set{};  ///< a message with one directive of string.format, or none for texts and flags
  std::string answer{};   ///< Lua pattern whose capture is the value; empty: the usual one
  std::string expects{};  ///< Lua pattern that the answer to `set` has; empty: there is no answer
  std::map<std::string, std::string> choices{};  ///< name: what the instrument calls it
  std::optional<RegisterDeclaration> held{};     ///< it is a Modbus register
};

struct CommandDeclaration {
  CommandInfo info;
  std::vector<DeclaredUnit> units{};  ///< of its arguments
  /// Of its arguments; name: what the instrument calls it.
  std::vector<std::map<std::string, std::string>> choices{};
  Action send{};
  std::string expects{};
  Reference done{};  ///< function(io): whether it has ended; not there: at once
};

struct AxisDeclaration {
  std::string name;
  DeclaredUnit unit{};
  double travel_min = 0, travel_max = 0, max_speed = 0, speed = 0, resolution = 0;  ///< SI
};

/// Bytes that bring an output to zero without Lua: for the guardian, when the host is dead.
struct RescueDeclaration {
  std::vector<std::string> identify{};  ///< a question, and what its answer begins with
  std::vector<std::string> send{};      ///< whole messages, ends and checksums included
  std::vector<std::pair<std::string, std::string>> check{};  ///< question, and the answer wanted
};

struct Declaration {
  std::string title;
  std::string kind;      ///< a role's class ("stage", "coils", ...) or a free kind
  std::string measures;  ///< "temperature"
  std::vector<SettingDeclaration> settings{};
  LinkDeclaration link{};
  Action identity{};
  std::string identity_match{};
  std::vector<std::string> identity_fields{};  ///< name, serial, firmware: of its captures
  int identity_tries = 1;  ///< of an instrument whose first answer after power-up is another one
  std::vector<std::string> setup{};  ///< messages after the identity is known
  Reference start_up{};
  Action errors{};  ///< asked after each command: a message whose answer must have `no_error`
  std::string no_error{};
  Action make_safe{};  ///< also the messages of `safe`, in order
  std::vector<std::string> safe{};
  std::vector<std::pair<std::size_t, QuantityValue>> safe_values{};  ///< of properties, as declared
  Reference unasked{};  ///< function(message) for what comes without a question
  OnSilence on_silence = OnSilence::alarm;
  std::vector<PropertyDeclaration> properties{};
  std::vector<CommandDeclaration> commands{};
  /// Of a role: position, set_off, moving, halt, home, measure, set_currents, set_level, ...
  std::map<std::string, Reference> functions{};
  std::vector<AxisDeclaration> axes{};      ///< of stages
  Time starts_within{};                     ///< after a command to move it may still say it stands
  DeclaredUnit unit{};                      ///< of what a role measures or sets
  std::map<std::string, double> numbers{};  ///< of a role, SI: channels, current_limit, range
  std::vector<int> coils{};                 ///< of a current sensor, from 1
  RescueDeclaration rescue{};
  Reference emulator{};
};

/// The kinds that a file may declare.
const std::vector<std::string>& kinds();
/// Those whose handle is made from its properties and commands alone.
bool is_free(std::string_view kind);
/// Whether it declares what make_safe does; a stage without it is halted.
bool has_safe_state(const Declaration& declaration);

/// A file that was run and checked, with the sandbox in which its functions live.
struct Loaded {
  std::unique_ptr<Sandbox> sandbox;
  Declaration declaration;
};

/// `file`: how errors call it. `values` are of settings; what is not among them has its default.
/// Throws ScriptFault with the file's line or key.
Loaded load(const std::string& file, const std::string& text, const UnitLookup& units,
            const SettingValues& values = {});

}  // namespace vitreo::scripted
