// Trace of the links of a run: every byte, kept until there is a record, then written into it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/link_tap.h"
#include "host/record/recorder.h"

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// Called with the clock's baton, as the links are. What passes before record_into() waits in
/// memory (instruments are opened before there is a record), what passes after the record's end is
/// dropped.
class LinkTrace final : public LinkTap {
 public:
  void passed(const LinkName& link, Time time, LinkEvent event,
              std::span<const std::uint8_t> bytes) override;

  /// While it lives, `recorder` is given what passes; it outlives this.
  class Recording {
   public:
    Recording() = default;
    Recording(LinkTrace& trace, Recorder& recorder);
    ~Recording() { end(); }
    Recording(Recording&& other) noexcept : trace_(std::exchange(other.trace_, nullptr)) {}
    Recording& operator=(Recording&& other) noexcept;
    /// Before the record is closed.
    void end();

   private:
    LinkTrace* trace_ = nullptr;
  };

  /// What has passed while there was no record, for an opening that fails.
  const std::vector<LinkRow>& waiting() const { return waiting_; }

 private:
  Recorder* recorder_ = nullptr;
  bool over_ = false;
  std::vector<LinkRow> waiting_;
};

/// A line a row: "    0.012345 s  stage  serial:/dev/ttyUSB0  to    c\x0D  63 0D".
std::string to_text(std::span<const LinkRow> rows);

}  // namespace vitreo
