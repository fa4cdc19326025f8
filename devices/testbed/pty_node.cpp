// SPDX-License-Identifier: Apache-2.0
#include "devices/testbed/pty_node.h"

#include "devices/time/error.h"

#include <fcntl.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

namespace vitreo {

// far_ is the master and plays the device; near_ is the slave, which clients open by its name, and
// is kept open here so that flow control and queue do not go with a client.
PtyNode::PtyNode() {
  // Raw: no echo and no translation, or bytes in the queue would multiply.
  char name[64] = {};
  termios raw{};
  cfmakeraw(&raw);
  raw.c_cflag |= CREAD | CLOCAL;
  if (openpty(&far_, &near_, name, &raw, nullptr) != 0)
    throw DeviceError(DeviceErrorKind::refused, "testbed",
                      "the system has no pseudo-terminal left");
  path_ = name;
  // Else a program that is started inside the testbed would hold both ends, and none would see a
  // hang-up.
  for (const int end : {near_, far_}) fcntl(end, F_SETFD, FD_CLOEXEC);
  fcntl(near_, F_SETFL, O_NONBLOCK);
}

PtyNode::~PtyNode() {
  close_far_end();
  ::close(near_);
}

/// TCOOFF suspends output: poll() no longer reports POLLOUT.
void PtyNode::block_output() { tcflow(near_, TCOOFF); }
void PtyNode::allow_output() { tcflow(near_, TCOON); }

/// A byte in the queue is POLLIN for each program that has the node open.
void PtyNode::put_byte() {
  const char byte = 1;
  if (far_ >= 0 && ::write(far_, &byte, 1) != 1)
    throw DeviceError(DeviceErrorKind::refused, "testbed", "a report queue is full");
}

// Clients do not read the byte themselves: umockdev answers their reads.
void PtyNode::take_byte() {
  char byte = 0;
  if (::read(near_, &byte, 1) != 1) return;  // hung up meanwhile: the byte is gone with it
}

// Idempotent: unplugging and destruction both come here.
void PtyNode::close_far_end() {
  if (const int end = std::exchange(far_, -1); end >= 0) ::close(end);
}

}  // namespace vitreo
