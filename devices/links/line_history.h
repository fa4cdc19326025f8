// History of a line: what was sent and heard lately, and when, for the texts of errors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace vitreo {

/// Of each direction the first 256 bytes of the last exchange, and of all since begin(). Times are
/// of the clock of the caller.
class LineHistory {
 public:
  /// An instrument is being opened: what was before is forgotten.
  void begin();
  /// `called`: how errors name it; empty: by its bytes. It is a question, until the next one.
  void sent(std::span<const std::uint8_t> bytes, std::string_view called, Time now);
  void heard(std::span<const std::uint8_t> bytes, Time now);
  /// The answer to the last question is waited for no more.
  void gave_up(Time now);

  /// Whether an answer that was given up has not come since.
  bool owed() const { return given_up_.has_value(); }
  /// Whether nothing came since the last question.
  bool silent() const { return exchange_.heard.empty(); }
  /// Whether anything was sent since begin().
  bool asked() const { return !opening_.sent.empty(); }
  /// Whether nothing came since begin().
  bool silent_from_the_beginning() const { return opening_.heard.empty(); }

  /// `says nothing to "*IDN?" within 0.5 s`; where something came, what.
  std::string silence(Time now) const;
  /// `"KEPCO" came within 1.3 s of "*IDN?", and not within 0.5 s`; empty where the last answer came
  /// in time, or never.
  const std::string& lateness() const { return lateness_; }
  /// What the bytes since begin() look like: an echo, another instrument. Empty: like nothing.
  std::string appearance() const;
  /// The bytes heard since the last question, as printable() has them, without the line's end.
  std::string last_heard() const;
  /// The bytes heard since begin(), as printable() has them.
  std::string all_heard() const;

 private:
  struct Traffic {
    ByteString sent, heard;
  };
  std::string question() const;

  Traffic opening_;
  Traffic exchange_;
  std::string called_;
  Time asked_{};
  std::optional<Time> given_up_;
  std::string lateness_;
  bool late_now_ = false;  // since the last question
};

}  // namespace vitreo
