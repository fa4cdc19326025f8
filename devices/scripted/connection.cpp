// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/connection.h"

#include <utility>

namespace vitreo::scripted {

Connection::Connection(Loaded loaded, std::unique_ptr<ByteLink> link, const std::string& name,
                       Clock& clock)
    // The exchange borrows the two before it, in the order of the members.
    : loaded_(std::move(loaded)),
      dialogue_(std::move(link), name, clock),
      exchange_(loaded_, dialogue_) {
  const Dialogue::Turn turn(dialogue_);
  identity_ = dialogue_.opening([this] { return exchange_.begin(); });
}

void Connection::be_open() {
  if (!dialogue_.lost()) return;
  dialogue_.reopen();
  try {
    const Identity now = exchange_.begin();
    // The firmware may differ: an update is no exchange of the instrument.
    if (now.name != identity_.name || now.serial != identity_.serial)
      dialogue_.fail(DeviceErrorKind::not_found,
                     "it was a " + to_string(identity_) + ", and now there is a " + to_string(now));
  } catch (const DeviceError&) {
    dialogue_.abandon();
    throw;
  }
}

LinkState Connection::link_state() const {
  return {dialogue_.hung_up() ? dialogue_.description() : "", exchange_.owed()};
}

}  // namespace vitreo::scripted
