// Connection of a scripted instrument: its file, its link and what passes between them; opened
// again after it was lost, as the same instrument only.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/link_state.h"
#include "devices/scripted/exchange.h"

#include <memory>
#include <string>

namespace vitreo::scripted {

class Connection {
 public:
  /// Identifies the instrument and sets it up. Throws DeviceError.
  Connection(Loaded loaded, std::unique_ptr<ByteLink> link, const std::string& name, Clock& clock);

  /// During a Turn: after a lost link, opens it again; half configured counts as lost, and another
  /// instrument is refused. Throws DeviceError.
  void be_open();

  /// At any time, and by any task: what shows without a question.
  LinkState link_state() const;

  const Declaration& declaration() const { return loaded_.declaration; }
  const Identity& identity() const { return identity_; }
  Dialogue& dialogue() { return dialogue_; }
  Exchange& exchange() { return exchange_; }

 private:
  Loaded loaded_;
  Dialogue dialogue_;
  Exchange exchange_;
  Identity identity_;
};

}  // namespace vitreo::scripted
