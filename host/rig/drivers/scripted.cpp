// Instruments of one Lua file as a rig file describes them: { driver = "kdc101", address =
// "serial:/dev/ttyUSB0" }, and the settings that the file declares.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/message_bytes.h"
#include "devices/scripted/emulator.h"
#include "devices/scripted/instrument.h"
#include "host/rig/drivers/carried.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reloadable.h"
#include "host/rig/drivers/serial.h"
#include "host/rig/instrument_file.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {
namespace {

/// What kind a role's file declares, and how it is opened; no `open`: such a role cannot be written
/// in Lua.
template <class Role>
struct Scripting {
  static constexpr const char* kind = nullptr;
};
template <>
struct Scripting<Stage> {
  static constexpr const char* kind = "stage";
  static constexpr auto open = scripted::open_stage;
};
template <>
struct Scripting<RotationStage> {
  static constexpr const char* kind = "rotation_stage";
  static constexpr auto open = scripted::open_rotation_stage;
};
template <>
struct Scripting<LensMover> {
  static constexpr const char* kind = "lens_mover";
  static constexpr auto open = scripted::open_lens_mover;
};
template <>
struct Scripting<FieldProbe> {
  static constexpr const char* kind = "field_probe";
  static constexpr auto open = scripted::open_field_probe;
};
template <>
struct Scripting<CurrentSensor> {
  static constexpr const char* kind = "current_sensor";
  static constexpr auto open = scripted::open_current_sensor;
};
template <>
struct Scripting<CoilAmplifier> {
  static constexpr const char* kind = "coils";
  static constexpr auto open = scripted::open_coils;
};
template <>
struct Scripting<Lamp> {
  static constexpr const char* kind = "lamp";
  static constexpr auto open = scripted::open_lamp;
};
template <>
struct Scripting<Instrument> {
  static constexpr const char* kind = "instrument";
  static constexpr auto open = scripted::open_instrument;
};

InstrumentFile file_of(const ConfigReader& reader) {
  return *find_instrument_file(reader.rig(), reader.file_of("driver"), reader.peek("driver"));
}

QuantityValue read_setting(ConfigReader& reader, const scripted::SettingDeclaration& setting) {
  if (setting.type == QuantityType::flag)
    return reader.flag(setting.name, std::get<bool>(setting.fallback));
  if (setting.type == QuantityType::text) {
    const auto& usual = std::get<std::string>(setting.fallback);
    return setting.choices.empty() ? reader.text(setting.name, usual)
                                   : reader.choice(setting.name, usual, setting.choices);
  }
  const scripted::DeclaredUnit& unit = setting.unit;
  const Bounds bounds{unit.to_si(setting.min), unit.to_si(setting.max), unit.si};
  // Rig files are in SI, as scripts are; the file computes in its own units.
  return unit.from_si(
      reader.number(setting.name, unit.to_si(std::get<double>(setting.fallback)), bounds));
}

/// The settings in the units that the file declares.
scripted::SettingValues read_settings(ConfigReader& reader, const scripted::Declaration& declared) {
  scripted::SettingValues values;
  for (const scripted::SettingDeclaration& one : declared.settings)
    values[one.name] = read_setting(reader, one);
  return values;
}

void check_bus(const InstrumentReader& instrument, const scripted::Declaration& declared) {
  if (instrument.emulated()) {
    if (!declared.emulator)
      instrument.reader.fail("address", "must be given: its file has no emulator");
    return;
  }
  const std::string bus = parse_address(instrument.address).bus;
  const auto& buses = declared.link.buses;
  if (std::find(buses.begin(), buses.end(), bus) == buses.end())
    instrument.reader.fail("address",
                           fmt::format("must begin with {}:", fmt::join(buses, ": or ")));
}

/// A bus of whole messages has no line whose settings could be read.
SerialPlace read_place(const InstrumentReader& instrument, const SerialSettings& usual) {
  if (instrument.emulated() || !carries_messages(instrument.address))
    return read_serial_place(instrument, usual);
  return {instrument.address, usual, true};
}

/// What is wrong in its file is an error of the rig's.
std::shared_ptr<scripted::Emulator> emulator_of(scripted::Loaded loaded,
                                                scripted::Surroundings surroundings = {}) {
  try {
    return scripted::make_emulator(std::move(loaded), std::move(surroundings));
  } catch (const scripted::ScriptFault& fault) {
    throw ConfigError(fault.what());
  }
}

// An emulated probe stands in the simulated world, an emulated stage carries what the rig says, and
// emulated amplifiers drive the simulated coils.
template <class Role>
std::shared_ptr<scripted::Emulator> emulate(const RigContext& where, const std::string& role,
                                            scripted::Loaded loaded, const std::string& load) {
  scripted::Surroundings surroundings;
  sim::Laboratory* const laboratory = where.laboratory;
  if constexpr (std::is_same_v<Role, FieldProbe>) {
    const int axes = static_cast<int>(loaded.declaration.numbers.at("axis_count"));
    surroundings.field = [laboratory, axes, places = where.places](Time now) {
      const Eigen::Vector3d at =
          places->stage ? places->stage(now) : Eigen::Vector3d(Eigen::Vector3d::Zero());
      const Eigen::Vector3d field = laboratory == nullptr ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                                                          : laboratory->field(at, now);
      if (axes == 1) return std::vector<double>{field.z()};
      return std::vector<double>{field.x(), field.y(), field.z()};
    };
  }
  if constexpr (std::is_same_v<Role, CoilAmplifier>)
    if (laboratory != nullptr)
      surroundings.drive = [laboratory](Time now, const std::vector<double>& currents) {
        laboratory->drive_coils(now, currents);
      };
  const auto axes = loaded.declaration.axes;
  const std::shared_ptr<scripted::Emulator> emulator =
      emulator_of(std::move(loaded), std::move(surroundings));
  if constexpr (std::is_same_v<Role, Stage>) {
    // The stage's own zero is anywhere: what it carries moves by the way from where it stands now.
    const auto origin = emulator->position(where.clock.now());
    carry(where, load, [axes, emulator, origin](Time now) {
      Eigen::Vector3d moved = Eigen::Vector3d::Zero();
      const auto at = emulator->position(now);
      for (std::size_t i = 0; at && origin && i < axes.size(); ++i) {
        const int axis = axes[i].name.front() - 'x';
        if (axes[i].name.size() == 1 && axis >= 0 && axis < 3)
          moved[axis] = (*at)[i] - (*origin)[i];
      }
      return moved;
    });
  }
  static_cast<void>(role);
  static_cast<void>(load);
  return emulator;
}

/// A role's file, and its settings in the rig file, as they were read.
struct Reading {
  InstrumentFile file;
  scripted::SettingValues values;
  SerialPlace place;
  std::string load;  // of a stage
  std::string role;
  std::string rescue;  // what the guardian was given
  bool has_safe_state = false;
};

template <class Role>
Reading read_file(const InstrumentReader& instrument) {
  const InstrumentFile file = file_of(instrument.reader);
  const scripted::Loaded first = load_instrument(file);
  const std::string& kind = first.declaration.kind;
  const bool fits =
      std::is_same_v<Role, Instrument> ? scripted::is_free(kind) : kind == Scripting<Role>::kind;
  if (!fits) instrument.reader.fail("driver", "is a " + kind + " by its file " + file.path);
  check_bus(instrument, first.declaration);
  Reading read{.file = file,
               .values = read_settings(instrument.reader, first.declaration),
               .place = read_place(instrument, first.declaration.link.serial),
               .load = {},
               .role = instrument.role,
               .rescue = rescue_text(instrument.reader),
               .has_safe_state = scripted::has_safe_state(first.declaration)};
  if constexpr (std::is_same_v<Role, Stage>) read.load = read_load(instrument, "nothing");
  // What these settings make wrong is told now, in the emulator too.
  // Loaded a second time, with the settings that hold: the first one had the file's defaults.
  scripted::Loaded tried = load_instrument(file, read.values);
  if (tried.declaration.emulator) emulator_of(std::move(tried));
  return read;
}

template <class Role>
Opened<Role> open_file(const Reading& read, const RigContext& where) {
  const SerialPlace& place = read.place;
  const bool far = place.emulated() || where.offer;
  std::shared_ptr<scripted::Emulator> peer;
  scripted::Loaded loaded = load_instrument(read.file, read.values);
  if (far && loaded.declaration.emulator)
    // A state of its own: driver and emulator of one file share nothing but the line.
    peer = emulate<Role>(where, read.role, load_instrument(read.file, read.values), read.load);
  if (where.offer && !peer) return {};
  const std::string end = loaded.declaration.link.framing.receive_end;
  const auto open = [&](std::unique_ptr<ByteLink> link) {
    auto told = scripted::link_to(peer, std::move(link));
    return Scripting<Role>::open({std::move(loaded), std::move(told), read.role, where.clock});
  };
  if (!place.emulated() && !where.offer && carries_messages(place.address))
    return {nullptr, open(traced(where, read.role, place.address,
                                 message_bytes(open_message_link(place.address, where.clock), end,
                                               where.clock)))};
  return open_on<Role>(place, peer, where, read.role, open);
}

template <class Role>
DriverReading<Role> opener_of(const Reading& read) {
  return {[read](const RigContext& where) { return open_file<Role>(read, where); },
          {read.file.path, read.file.text},
          read.has_safe_state};
}

/// What the whole rig's reader takes of a free role's table beside its driver.
void read_rest(ConfigReader& table, const std::string& role) {
  const std::vector<std::string>& fixed = role_names();
  if (std::find(fixed.begin(), fixed.end(), role) != fixed.end()) return;
  if (table.has("guardian")) table.flag("guardian", true);
  if (table.has("kind")) table.text("kind", "");
  table.finish();
}

/// Reads the file anew, by the role's table as the rig file had it.
template <class Role>
DriverReading<Role> read_again(const RigDescription& rig, const Reading& before) {
  ConfigReader whole(rig);
  ConfigReader table = whole.table(before.role);
  if (!names_instrument_file(table)) table.fail("driver", "is gone: " + before.file.path);
  table.text("driver", "");
  sim::LaboratorySettings laboratory;
  LinkLoads links;
  const InstrumentReader instrument{table, before.role, read_address(table), laboratory, links};
  const Reading now = read_file<Role>(instrument);
  read_rest(table, before.role);
  // The guardian is another process and was told at the start.
  if (now.rescue != before.rescue)
    table.fail("driver",
               "has another rescue, or line, and the guardian has the one before: that "
               "takes a rig that is opened anew");
  DriverReading<Role> reading = opener_of<Role>(now);
  reading.opener = explained(instrument, std::move(reading.opener));
  return reading;
}

}  // namespace

bool names_instrument_file(const ConfigReader& reader) {
  return find_instrument_file(reader.rig(), reader.file_of("driver"), reader.peek("driver"))
      .has_value();
}

template <class Role>
Opener<Role> read_scripted(const InstrumentReader& instrument) {
  if constexpr (Scripting<Role>::kind == nullptr) {
    instrument.reader.fail("driver", "cannot be a Lua file: not for this role");
  } else {
    const Reading read = read_file<Role>(instrument);
    // A reload reads the rig file's table again, whose reader is gone by then.
    // The table is kept, not the rig file: what is edited there meanwhile does not count.
    const auto rig = std::make_shared<const RigDescription>(instrument.reader.rig());
    return [read, rig](const RigContext& where) {
      if (where.offer) return open_file<Role>(read, where);
      return open_reloadable<Role>(
          {read.role, opener_of<Role>(read), [read, rig] { return read_again<Role>(*rig, read); }},
          where);
    };
  }
}

template Opener<Stage> read_scripted<Stage>(const InstrumentReader&);
template Opener<RotationStage> read_scripted<RotationStage>(const InstrumentReader&);
template Opener<LensMover> read_scripted<LensMover>(const InstrumentReader&);
template Opener<FieldProbe> read_scripted<FieldProbe>(const InstrumentReader&);
template Opener<CurrentSensor> read_scripted<CurrentSensor>(const InstrumentReader&);
template Opener<CoilAmplifier> read_scripted<CoilAmplifier>(const InstrumentReader&);
template Opener<Lamp> read_scripted<Lamp>(const InstrumentReader&);
template Opener<Instrument> read_scripted<Instrument>(const InstrumentReader&);
template Opener<OperatorInput> read_scripted<OperatorInput>(const InstrumentReader&);
template Opener<EnableLine> read_scripted<EnableLine>(const InstrumentReader&);

}  // namespace vitreo
