// Emulator of a scripted instrument: what its file says of the far end, as the peer of a link.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/scripted/declaration.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::scripted {

/// What an emulated instrument can feel of the simulated world; empty where it cannot.
struct Surroundings {
  std::function<std::vector<double>(Time)> field{};  ///< T, along the probe's axes
  /// Told the currents, A, that the file keeps in e.currents, after each message.
  std::function<void(Time, const std::vector<double>&)> drive{};
};

class Emulator : public BytePeer {
 public:
  /// The file's `emulator.position`, SI, one an axis; nothing where it has none. Time as for say().
  virtual std::optional<std::vector<double>> position(Time now) = 0;
  /// What went wrong in it, "pump.lua:12: ..."; empty: nothing.
  virtual const std::string& fault() const = 0;
};

/// The link to an emulator, which may be null: what went wrong in it is DeviceError{protocol} where
/// something is read, for a driver could take the words on the line for an answer.
std::unique_ptr<ByteLink> link_to(std::shared_ptr<Emulator> emulator,
                                  std::unique_ptr<ByteLink> link);

/// `loaded` is its own: driver and emulator share no state. Throws ScriptFault where the file has
/// none, or one that is wrong, its `start` too. What goes wrong in it later is said on the line,
/// and then nothing.
std::unique_ptr<Emulator> make_emulator(Loaded loaded, Surroundings surroundings = {});

}  // namespace vitreo::scripted
