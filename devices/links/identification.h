// Identification of an instrument that is plugged in and not known yet: its numbers on USB, words
// in its adapter's name, and questions to a port that move and energize nothing.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/identity.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// A setting of a role's table in a rig file.
struct ProposedSetting {
  std::string key;
  std::string value;  ///< as Lua writes it
};

/// A role that an instrument can play, and what its table says beside driver, address and
/// baud_rate.
struct ProposedRole {
  std::string role;
  std::vector<ProposedSetting> settings{};
  std::string note{};  ///< what else the table needs, for people; empty: nothing
};

/// What an answer tells.
struct Recognized {
  Identity identity;
  std::vector<ProposedRole> roles;  ///< the likeliest first
};

/// Devices on USB that a driver takes, by their numbers.
struct UsbKind {
  std::uint16_t vendor = 0;
  std::vector<std::uint16_t> products{};
  std::vector<ProposedRole> roles{};  ///< the likeliest first; empty: a serial adapter, to be asked
};

/// What is sent to a port to learn whether an instrument of this kind is there.
struct PortQuestion {
  std::vector<int> baud_rates{};  ///< the likeliest first; not used on TCP
  /// Each is sent when the answer to the one before is over.
  std::vector<ByteString> messages{};
  double opening_pause = 0;  ///< s: opening the port restarts some controllers
  double patience = 1;       ///< s, for the first byte of an answer
  bool may_begin_silent =
      false;  ///< silence after the first message is no silence of the instrument
  /// From the answers so far, one a message; nothing where it is no such instrument, or where the
  /// next message's answer is needed. Never throws.
  std::optional<Recognized> (*recognize)(const std::vector<ByteString>& answers) = nullptr;
};

/// A driver's own part, in its folder beside wire.h.
struct Identification {
  std::vector<UsbKind> usb{};
  std::vector<std::string> words{};  ///< one of them in an adapter's name decides
  std::optional<PortQuestion> question{};
  /// Bytes that could set the instrument moving, energize it or change what it keeps. A question to
  /// others that holds one of them is sent only when this one has been asked, and is not there.
  std::string_view commands{};
  std::string caution{};  ///< what a question does all the same, for people; empty: nothing
};

inline ByteString bytes_of_text(std::string_view text) { return {text.begin(), text.end()}; }
inline std::string text_of_bytes(const ByteString& bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace vitreo
