// Lock of a device's node: one owner among the programs that ask, host and guardian alike. The
// kernel itself lets any number of programs open a hidraw or a serial node.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/error.h"

#include <string>

namespace vitreo {

/// DeviceError{refused}: another program has the device. A guardian that meets it leaves the device
/// to that program.
class OwnedError : public DeviceError {
 public:
  explicit OwnedError(const std::string& whose);
};

/// Held from construction to destruction, and gone with its process. Advisory (flock), so it costs
/// a program that does not ask nothing.
class NodeLock {
 public:
  NodeLock() = default;
  /// Of the node at `path`, before anything is sent to it; `device` is for the error. A node that
  /// may not be opened is not locked: its own opening says why. Throws OwnedError.
  NodeLock(const std::string& path, const std::string& device);
  ~NodeLock();
  NodeLock(NodeLock&& other) noexcept;
  NodeLock& operator=(NodeLock&& other) noexcept;
  NodeLock(const NodeLock&) = delete;
  NodeLock& operator=(const NodeLock&) = delete;

  /// Whether the device behind the node has gone; false where nothing is locked.
  bool hung_up() const;

 private:
  int descriptor_ = -1;
};

}  // namespace vitreo
