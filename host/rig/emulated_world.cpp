// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulated_world.h"

#include <mutex>

namespace vitreo {

UsbTestbed& EmulatedWorld::testbed() {
  if (!testbed_) testbed_ = make_usb_testbed();
  return *testbed_;
}

// The turn is taken before the testbed's lock, and the testbed's own thread holds that one alone:
// no two wait for each other.
void EmulatedWorld::with(const std::function<void()>& work) {
  const std::lock_guard lock(turns_);
  if (testbed_)
    testbed_->with_emulators(work);
  else
    work();
}

void EmulatedWorld::in_turn(const std::function<void()>& work) {
  const std::lock_guard lock(turns_);
  work();
}

}  // namespace vitreo
