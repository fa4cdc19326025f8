// Messages: how a person who is not at the screen is told of an end, by mail, a webhook or a
// command.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/serve/job_queue.h"

#include <nlohmann/json.hpp>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace vitreo::serve {

/// What is told. failure: an end that is not "completed", an alarm of high priority, a question
/// that stands long; end: every end.
enum class Occasion { failure, end };

/// The settings file, JSON: {"name": "OctoMag, room 3", "link": "http://...", "messages":
/// [{"to": "mail", "address": "anna@lab.example", "when": "failed"},
///  {"to": "webhook", "url": "https://..."}, {"to": "command", "words": ["notify-send"]}]}.
struct MessageSettings {
  std::string name = "Vitreo";  // of the rig, at the head of each message
  std::string link{};           // the workbench's address, for the links; empty: none
  std::vector<nlohmann::json> channels{};
};

/// A file that is not there has no channels. Throws ConfigError naming the file: it belongs to
/// another user or others may write it (it names commands), is no JSON, or has a wrong key.
MessageSettings read_message_settings(const std::filesystem::path& file);

/// "mail to anna@lab.example", "webhook at lab.example", "command notify-send": without what is
/// secret in it.
std::string channel_text(const nlohmann::json& channel);

/// One message a channel that wants to hear of it.
std::vector<Message> messages_for(const MessageSettings& settings, Occasion occasion,
                                  std::int64_t job, const std::string& subject,
                                  const std::string& text, std::int64_t now);

/// Gives it to the channel's program (sendmail, curl, the command) and waits for that, at most
/// 30 s. Throws std::runtime_error where it was not taken.
void tell(const Message& message);

/// Tells what is due in the queue, and tries again what was not taken: after 5 s, 15 s, 1 min, 5
/// min, then each 30 min for two days.
class Messenger {
 public:
  explicit Messenger(JobQueue& queue);
  ~Messenger();
  Messenger(const Messenger&) = delete;
  Messenger& operator=(const Messenger&) = delete;

 private:
  void work();
  void tell_due();

  JobQueue& queue_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace vitreo::serve
