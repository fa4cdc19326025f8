// SPDX-License-Identifier: Apache-2.0
#include "host/serve/messages.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/files/child_process.h"
#include "host/files/log.h"
#include "host/files/posix_file.h"
#include "host/text/error_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

// s between tries; the last one again and again, until kGiveUp.
constexpr std::array<std::int64_t, 5> kPauses{5, 15, 60, 300, 1800};
constexpr std::int64_t kGiveUp = 2 * 86400;  // s after the message was made
constexpr auto kLook = std::chrono::milliseconds(500);
// Of the program that takes a message; then it is killed.
const std::vector<std::string> kPatience{"timeout", "--kill-after=5", "30"};

// Each error names the file: it is edited by hand, and seldom.
[[noreturn]] void refuse(const fs::path& file, const std::string& why) {
  throw ConfigError(file.string() + ": " + why);
}

// A line end in an address would begin another field of the mail.
std::string text_at(const fs::path& file, const nlohmann::json& table, const char* key) {
  const auto found = table.find(key);
  if (found == table.end() || !found->is_string() || found->get<std::string>().empty())
    refuse(file, std::string("messages: '") + key + "' is missing, or no text");
  const auto text = found->get<std::string>();
  if (text.find_first_of("\r\n") != std::string::npos)
    refuse(file, std::string("messages: '") + key + "' wants one line");
  return text;
}

/// Throws for anything that would be read and ignored.
void check_keys(const fs::path& file, const nlohmann::json& table,
                const std::vector<std::string>& known) {
  for (const auto& [key, value] : table.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string near = nearest(key, known);
    refuse(file,
           "'" + key + "' is not known" + (near.empty() ? "" : "; did you mean " + near + "?"));
  }
}

// At the start of the server, and again each time before something is told: the file may have
// changed.
void check_channel(const fs::path& file, const nlohmann::json& channel) {
  if (!channel.is_object()) refuse(file, "messages: wants a list of objects");
  const std::string kind = text_at(file, channel, "to");
  if (channel.contains("when")) {
    const std::string when = text_at(file, channel, "when");
    if (when != "failed" && when != "ended")
      refuse(file, "messages: 'when' is failed or ended; got " + when);
  }
  if (kind == "mail") {
    check_keys(file, channel, {"to", "when", "address", "sendmail"});
    if (text_at(file, channel, "address").find('@') == std::string::npos)
      refuse(file, "messages: 'address' wants NAME@HOST");
    if (channel.contains("sendmail")) text_at(file, channel, "sendmail");
  } else if (kind == "webhook") {
    check_keys(file, channel, {"to", "when", "url"});
    const std::string url = text_at(file, channel, "url");
    if (!url.starts_with("http://") && !url.starts_with("https://"))
      refuse(file, "messages: 'url' wants http:// or https://");
  } else if (kind == "command") {
    check_keys(file, channel, {"to", "when", "words"});
    const auto words = channel.value("words", nlohmann::json());
    const bool texts = words.is_array() && !words.empty() &&
                       std::all_of(words.begin(), words.end(),
                                   [](const nlohmann::json& one) { return one.is_string(); });
    if (!texts) refuse(file, "messages: 'words' wants a list of texts, the program first");
  } else {
    refuse(file, "messages: 'to' is mail, webhook or command; got " + kind);
  }
}

/// Runs the words with `input`; throws where they do not end well.
void feed(std::vector<std::string> words, const std::string& input) {
  // timeout(1) ends a program that hangs: messages behind it would wait for ever.
  const std::string name = words.front();
  words.insert(words.begin(), kPatience.begin(), kPatience.end());
  ChildProcess child(words, ChildProcess::Pipe::to_input);
  // A program need not read its input; how it ends says whether it took the message.
  child.write(input);
  const int status = child.finish();
  constexpr int kTimedOut = 124, kNotFound = 127;  // timeout(1)
  if (status == kTimedOut) throw std::runtime_error(name + " did not end within 30 s");
  if (status == kNotFound) throw std::runtime_error(name + ": there is no such program");
  if (status != 0) throw std::runtime_error(fmt::format("{} left with {}", name, status));
}

/// RFC 2047: what is not ASCII, in base64 (RFC 4648).
std::string header_text(const std::string& text) {
  const bool ascii =
      std::all_of(text.begin(), text.end(), [](unsigned char c) { return c >= ' ' && c < 127; });
  if (ascii) return text;
  constexpr const char* kBase64 =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string coded;
  for (std::size_t i = 0; i < text.size(); i += 3) {
    const auto byte = [&text, i](std::size_t k) {
      return i + k < text.size() ? static_cast<unsigned>(static_cast<unsigned char>(text[i + k]))
                                 : 0U;
    };
    // Three bytes are four digits of six bits, the first one in the highest bits.
    const unsigned bits = byte(0) << 16 | byte(1) << 8 | byte(2);
    for (std::size_t k = 0; k < 4; ++k)
      coded += i + k <= text.size() ? kBase64[bits >> (18 - 6 * k) & 63U] : '=';
  }
  return "=?utf-8?B?" + coded + "?=";
}

// Header fields are lines: a subject with a line end would begin another one.
void send_mail(const nlohmann::json& channel, const Message& message) {
  // /usr/sbin is not on the path of users on Debian.
  std::string program = channel.value("sendmail", "");
  if (program.empty())
    program = ::access("/usr/sbin/sendmail", X_OK) == 0 ? "/usr/sbin/sendmail" : "sendmail";
  feed({program, "-t", "-oi"}, "To: " + channel.value("address", "") +
                                   "\nSubject: " + header_text(message.subject) +
                                   "\nMIME-Version: 1.0\nContent-Type: text/plain; charset=utf-8\n"
                                   "Content-Transfer-Encoding: 8bit\n\n" +
                                   message.subject + "\n\n" + message.text + "\n");
}

/// A value of curl's configuration file.
// As curl(1) reads its configuration: backslash and quote are escaped, a line end is \n.
std::string curl_text(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    if (c == '\n')
      quoted += "\\n";
    else
      quoted += c;
  }
  return quoted + "\"";
}

// By the standard input and not by words, which every user of the machine can read: an address of a
// webhook is a secret.
void post(const nlohmann::json& channel, const Message& message) {
  // "text" is what Slack, Mattermost and their kin show; the others are for programs.
  const nlohmann::json body{{"text", message.subject + "\n" + message.text},
                            {"subject", message.subject},
                            {"job", message.job},
                            {"time", message.added}};
  feed({"curl", "--config", "-"},
       "url = " + curl_text(channel.value("url", "")) +
           "\nheader = \"Content-Type: application/json\"\n" + "data-binary = " +
           curl_text(body.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace)) +
           "\nfail\nsilent\nshow-error\nmax-time = 25\noutput = \"/dev/null\"\n");
}

}  // namespace

MessageSettings read_message_settings(const fs::path& file) {
  MessageSettings settings;
  struct stat about = {};
  if (::stat(file.c_str(), &about) != 0) {
    if (errno == ENOENT) return settings;
    refuse(file, std::strerror(errno));
  }
  // What the file names is run: who may write the file may run anything as this user.
  if (about.st_uid != ::geteuid() || (about.st_mode & 022) != 0)
    refuse(file, "names commands, so it must be yours and not writable by others; chmod go-w it");
  const nlohmann::json read = nlohmann::json::parse(read_whole_file(file), nullptr, false);
  if (!read.is_object()) refuse(file, "is no JSON object");
  check_keys(file, read, {"name", "link", "messages"});
  if (read.contains("name")) settings.name = text_at(file, read, "name");
  if (read.contains("link")) settings.link = text_at(file, read, "link");
  const nlohmann::json channels = read.value("messages", nlohmann::json::array());
  if (!channels.is_array()) refuse(file, "messages: wants a list of objects");
  for (const nlohmann::json& channel : channels) {
    check_channel(file, channel);
    settings.channels.push_back(channel);
  }
  return settings;
}

std::string channel_text(const nlohmann::json& channel) {
  const std::string kind = channel.value("to", "");
  if (kind == "mail") return "mail to " + channel.value("address", "");
  if (kind == "command") return "command " + channel.at("words").at(0).get<std::string>();
  // A webhook's path is its password.
  const std::string url = channel.value("url", "");
  const std::size_t host = url.find("//") + 2;
  // Without a name and password in front of the host, nor the path.
  std::string name = url.substr(host, url.find_first_of("/?#", host) - host);
  return "webhook at " + name.substr(name.rfind('@') + 1);
}

std::vector<Message> messages_for(const MessageSettings& settings, Occasion occasion,
                                  std::int64_t job, const std::string& subject,
                                  const std::string& text, std::int64_t now) {
  std::vector<Message> messages;
  for (const nlohmann::json& channel : settings.channels) {
    // An end that is as it should be is told only to those who want to hear of it.
    if (occasion == Occasion::end && channel.value("when", "failed") != "ended") continue;
    Message message;
    message.job = job;
    message.channel = channel.dump();
    message.subject = settings.name + ": " + subject.substr(0, subject.find('\n'));
    message.text = text;
    if (!settings.link.empty())
      message.text += fmt::format("\n{}{}#/job/{}", settings.link,
                                  settings.link.ends_with('/') ? "" : "/", job);
    message.added = now;
    messages.push_back(std::move(message));
  }
  return messages;
}

void tell(const Message& message) {
  const nlohmann::json channel = nlohmann::json::parse(message.channel);
  const std::string kind = channel.value("to", "");
  if (kind == "mail") return send_mail(channel, message);
  if (kind == "webhook") return post(channel, message);
  // No shell: a subject with a quote or a semicolon stays one word.
  auto words = channel.at("words").get<std::vector<std::string>>();
  // The first line as a word, which is what notify-send and the like show; all of it as input.
  words.push_back(message.subject);
  feed(words, message.subject + "\n" + message.text + "\n");
}

Messenger::Messenger(JobQueue& queue) : queue_(queue), thread_(quiet_thread([this] { work(); })) {}

Messenger::~Messenger() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void Messenger::work() {
  for (;;) {
    try {
      tell_due();
    } catch (const std::exception& error) {
      write_log("messages: " + error_words(error));
    }
    std::unique_lock lock(mutex_);
    if (wake_.wait_for(lock, kLook, [this] { return ended_; })) return;
  }
}

void Messenger::tell_due() {
  // One after the other: a channel that hangs for 30 s delays the next, but at most so long.
  for (const Message& message : queue_.due_messages(seconds_now())) {
    {
      const std::lock_guard lock(mutex_);
      if (ended_) return;
    }
    try {
      tell(message);
      queue_.told(message.id, seconds_now());
    } catch (const std::exception& error) {
      const std::int64_t now = seconds_now();
      const auto pause =
          kPauses[std::min(static_cast<std::size_t>(message.tries), kPauses.size() - 1)];
      // Far beyond every clock: not tried again, and it stays in the list as not told.
      const bool give_up = now - message.added > kGiveUp;
      queue_.failed(message.id, give_up ? INT64_MAX : now + pause, error_words(error));
      write_log("message of job " + std::to_string(message.job) +
                " was not taken: " + error_words(error));
    }
  }
}

}  // namespace vitreo::serve
