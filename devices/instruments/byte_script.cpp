// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/byte_script.h"

#include "devices/links/printable.h"
#include "devices/time/error.h"

#include <exception>
#include <functional>
#include <sstream>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr Time kPatience = std::chrono::milliseconds(500);  // to write, or for an answer's begin
constexpr Time kSilence = std::chrono::milliseconds(60);    // ends an answer
constexpr int kAttempts = 3;
constexpr std::size_t kLongest = 4096;  // bytes of an answer

std::string hex(const std::string& bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const char c : bytes) {
    text += kDigits[static_cast<unsigned char>(c) >> 4];
    text += kDigits[static_cast<unsigned char>(c) & 15];
  }
  return text;
}

std::string bytes_of(const std::string& text) {
  const auto digit = [](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    throw std::invalid_argument("a rescue's bytes are hexadecimal digits");
  };
  if (text.size() % 2 != 0) throw std::invalid_argument("a rescue's bytes have two digits each");
  std::string bytes;
  for (std::size_t i = 0; i < text.size(); i += 2)
    bytes.push_back(static_cast<char>(digit(text[i]) * 16 + digit(text[i + 1])));
  return bytes;
}

void send(ByteLink& link, const std::string& message) {
  link.write({reinterpret_cast<const std::uint8_t*>(message.data()), message.size()}, kPatience);
}

/// All that is said until it is silent.
std::string heard(ByteLink& link, Time patience) {
  std::string said;
  for (Time wait = patience; said.size() < kLongest; wait = kSilence) {
    const ByteString bytes = link.read(kLongest - said.size(), wait);
    if (bytes.empty()) break;
    said.append(bytes.begin(), bytes.end());
  }
  return said;
}

std::string ask(ByteLink& link, const std::string& question) {
  send(link, question);
  return heard(link, kPatience);
}

void zero(ByteLink& link, const ByteScript& script) {
  for (const std::string& message : script.zero) send(link, message);
}

/// What the host had begun may have spoiled the first copy: it is sent again.
void read_back(ByteLink& link, const ByteScript& script) {
  heard(link, kSilence);
  for (const auto& [question, wanted] : script.check) {
    std::string said;
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      said = ask(link, question);
      if (said.find(wanted) != std::string::npos) break;
      zero(link, script);
      heard(link, kSilence);
    }
    if (said.find(wanted) != std::string::npos) continue;
    if (said.empty())
      throw DeviceError(DeviceErrorKind::timeout, link.address(),
                        "was told to go to zero, and is silent");
    throw DeviceError(DeviceErrorKind::protocol, link.address(),
                      "was told to go to zero, and says " + printable(said));
  }
}

}  // namespace

bool ByteScript::operator==(const ByteScript& other) const {
  return to_text(*this) == to_text(other);
}

// The line, how many messages and checks, question, identity, messages, checks.
std::string to_text(const ByteScript& script) {
  std::ostringstream text;
  const SerialSettings& line = script.line;
  text << line.baud_rate << ' ' << line.data_bits << ' ' << static_cast<int>(line.parity) << ' '
       << line.stop_bits << ' ' << line.rts_cts << ' ' << line.xon_xoff << ' '
       << static_cast<int>(line.opening_lines) << ' ' << script.zero.size() << ' '
       << script.check.size() << ' ' << hex(script.question) << ". " << hex(script.identity) << '.';
  for (const std::string& message : script.zero) text << ' ' << hex(message) << '.';
  for (const auto& [question, wanted] : script.check)
    text << ' ' << hex(question) << ". " << hex(wanted) << '.';
  return text.str();
}

ByteScript parse_byte_script(const std::string& text) {
  std::istringstream in(text);
  ByteScript script;
  int parity = 0;
  std::size_t zeros = 0, checks = 0;
  int opening = 0;
  in >> script.line.baud_rate >> script.line.data_bits >> parity >> script.line.stop_bits >>
      script.line.rts_cts >> script.line.xon_xoff >> opening >> zeros >> checks;
  if (!in || zeros > 1000 || checks > 1000 || parity < 0 || parity > 4 || opening < 0 ||
      opening > 3)
    throw std::invalid_argument("a rescue is not understood");
  script.line.parity = static_cast<Parity>(parity);
  script.line.opening_lines = static_cast<OpeningLines>(opening);
  // A full stop behind each, so that an empty one is a word too.
  const auto next = [&in] {
    std::string word;
    if (!(in >> word) || word.back() != '.') throw std::invalid_argument("a rescue is cut short");
    return bytes_of(word.substr(0, word.size() - 1));
  };
  script.question = next();
  script.identity = next();
  for (std::size_t i = 0; i < zeros; ++i) script.zero.push_back(next());
  for (std::size_t i = 0; i < checks; ++i) {
    std::string question = next();
    script.check.emplace_back(std::move(question), next());
  }
  return script;
}

Rescue rescue_by(const ByteScript& script) {
  ByteRescue way;
  way.line = script.line;
  way.answers = [script](ByteLink& link) {
    return ask(link, script.question).find(script.identity) != std::string::npos;
  };
  way.zero = [script](const std::vector<std::unique_ptr<ByteLink>>& links) {
    std::exception_ptr failure;
    const auto each = [&](const auto& work) {
      for (const auto& link : links) {
        try {
          work(*link, script);
        } catch (const DeviceError&) {
          if (!failure) failure = std::current_exception();
        }
      }
    };
    each(zero);
    each(read_back);
    if (failure) std::rethrow_exception(failure);
  };
  return {.driver = "script", .settings = kLineKeys, .way = way};
}

}  // namespace vitreo
