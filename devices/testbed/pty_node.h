// Pseudo-terminal in place of an emulated device node, for poll(): umockdev's node is a plain file,
// which is always ready, so a client would spin. Output that is held back (as by Ctrl-S) makes it
// unwritable, a byte in its queue readable, and a closed far end is a hang-up.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo {

class PtyNode {
 public:
  PtyNode();  // throws DeviceError when the system has no pty left
  ~PtyNode();
  PtyNode(const PtyNode&) = delete;
  PtyNode& operator=(const PtyNode&) = delete;
  const std::string& path() const { return path_; }
  void block_output();
  void allow_output();
  void put_byte();
  void take_byte();
  void close_far_end();

 private:
  int near_ = -1;
  int far_ = -1;
  std::string path_;
};

}  // namespace vitreo
