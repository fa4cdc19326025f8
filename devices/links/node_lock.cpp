// SPDX-License-Identifier: Apache-2.0
#include "devices/links/node_lock.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <unistd.h>
#include <utility>

namespace vitreo {

OwnedError::OwnedError(const std::string& whose)
    : DeviceError(DeviceErrorKind::refused, whose, "another program has it open") {}

NodeLock::NodeLock(const std::string& path, const std::string& device)
    : descriptor_(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC)) {
  if (descriptor_ < 0 || ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0) return;
  ::close(std::exchange(descriptor_, -1));
  throw OwnedError(device);
}

NodeLock::~NodeLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

// Nothing is asked for: of a device that is gone poll() says so by itself (hidraw: POLLERR and
// POLLHUP).
bool NodeLock::hung_up() const {
  pollfd node{descriptor_, 0, 0};
  return descriptor_ >= 0 && ::poll(&node, 1, 0) > 0;
}

NodeLock::NodeLock(NodeLock&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}

NodeLock& NodeLock::operator=(NodeLock&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

}  // namespace vitreo
