// SPDX-License-Identifier: Apache-2.0
#include "host/engine/link_trace.h"

#include "devices/links/printable.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace vitreo {

void LinkTrace::passed(const LinkName& link, Time time, LinkEvent event,
                       std::span<const std::uint8_t> bytes) {
  if (over_) return;
  LinkRow row{time, link.role, link.address, to_string(event), {bytes.begin(), bytes.end()}};
  if (recorder_ != nullptr)
    recorder_->link(row);
  else
    waiting_.push_back(std::move(row));
}

LinkTrace::Recording::Recording(LinkTrace& trace, Recorder& recorder) : trace_(&trace) {
  for (const LinkRow& row : std::exchange(trace.waiting_, {})) recorder.link(row);
  trace.recorder_ = &recorder;
}

LinkTrace::Recording& LinkTrace::Recording::operator=(Recording&& other) noexcept {
  if (this != &other) {
    end();
    trace_ = std::exchange(other.trace_, nullptr);
  }
  return *this;
}

// Links are used to the end, when outputs are switched off by the rig's destruction: there is no
// record for that any more.
void LinkTrace::Recording::end() {
  if (trace_ == nullptr) return;
  trace_->recorder_ = nullptr;
  trace_->over_ = true;
  trace_ = nullptr;
}

std::string to_text(std::span<const LinkRow> rows) {
  std::size_t role = 0, address = 0;
  for (const LinkRow& row : rows) {
    role = std::max(role, row.role.size());
    address = std::max(address, row.address.size());
  }
  std::string lines;
  for (const LinkRow& row : rows) {
    lines += fmt::format("{:>13.6f} s  {:<{}}  {:<{}}  {}", to_seconds(row.time), row.role, role,
                         row.address, address, row.event);
    if (!row.bytes.empty())
      lines += fmt::format("{:{}}{}", "", 8 - std::min<std::size_t>(row.event.size(), 6),
                           printable(row.bytes, row.bytes.size()));
    // The error's text is no byte of the line.
    if (!row.bytes.empty() && row.event != "failed")
      lines += fmt::format("  {:02X}", fmt::join(row.bytes, " "));
    lines += '\n';
  }
  return lines;
}

}  // namespace vitreo
