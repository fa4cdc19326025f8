// SPDX-License-Identifier: Apache-2.0
#include "host/view/foxglove_view.h"

#include "host/text/error_words.h"
#include "host/view/board.h"
#include "host/view/foxglove_channels.h"
#include "host/view/foxglove_protocol.h"
#include "host/view/web_server.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo::view {
namespace {

using nlohmann::json;

constexpr auto kPicturePeriod = std::chrono::milliseconds(30);
constexpr auto kTimePeriod = std::chrono::milliseconds(100);
constexpr std::size_t kMostSubscriptions = 1000;  // of one client

/// Passes the record's news to the one who listened before, such as the page, and to the board.
class Relay final : public RecordListener {
 public:
  Relay(RecordListener* before, RecordListener& ours) : before_(before), ours_(ours) {}
  RecordListener* before() const { return before_; }
  void seen(const std::string& camera, const Frame& frame) override {
    if (before_ != nullptr) before_->seen(camera, frame);
    ours_.seen(camera, frame);
  }
  void sample(const StreamInfo& stream, Time time, std::span<const double> values) override {
    if (before_ != nullptr) before_->sample(stream, time, values);
    ours_.sample(stream, time, values);
  }
  void event(Time time, const std::string& kind, const std::string& text) override {
    if (before_ != nullptr) before_->event(time, kind, text);
    ours_.event(time, kind, text);
  }

 private:
  RecordListener* const before_;
  RecordListener& ours_;
};

/// One subscription: the channel, and the last picture that was sent of it.
struct Subscription {
  std::size_t channel;
  // ns: of what was sent at once. A scene is stamped with the present then, and rows of exposures
  // before it are still to come: a player's time would go backwards.
  std::uint64_t begin = 0;
  std::optional<std::uint64_t> picture{};
};

/// What is known of a connection.
struct Client {
  std::map<std::uint32_t, Subscription> subscriptions;  // by the client's number
  // Messages that gave way, as it was told last.
  std::uint64_t told_dropped = 0;
};

/// Where the zero of the run's clock lies: as the record has it, else now.
std::int64_t t0_of(const Session& session) {
  if (const auto& recorded = session.recorder.start().t0_utc_ns) return *recorded;
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
             .count() -
         session.clock.now().count();
}

}  // namespace

struct FoxgloveView::State {
  State(const ViewRequest& request, ProgressListener& terminal)
      : board(terminal),
        token_file(request.token_file),
        token(token_file.empty() ? random_token() : shared_token(token_file)),
        server(
            settings(request, token),
            {[this](int viewer) { greet(viewer); }, [this](int viewer) { clients.erase(viewer); },
             [this](int viewer, const std::string& message) { receive(viewer, message); },
             [this] { tick(); }}) {}

  /// Checked before anything listens.
  static ServerSettings settings(const ViewRequest& request, const std::string& token) {
    check(request);
    ServerSettings settings;
    settings.address = request.address;
    settings.port = request.port;
    settings.shared_token = token;
    settings.subprotocols = foxglove_subprotocols();
    return settings;
  }

  Board board;
  const std::filesystem::path token_file;
  const std::string token;
  // begin() and end() run on the script's thread, all else on the server's.
  std::mutex mutex;
  Session* session = nullptr;
  std::optional<Relay> relay;
  json metadata = json::object();
  std::string run, outcome;
  bool end_sent = true;
  std::int64_t t0 = 0;  // ns since 1970
  std::optional<FoxgloveChannels> channels;
  bool announced = false;  // the channels that are there from the begin
  // By the server's number. The server's thread alone uses them.
  std::map<int, Client> clients;
  std::chrono::steady_clock::time_point pictured{}, timed{};
  WebServer server;  // last: its thread uses all the others

  void greet(int viewer);
  void tick();
  void send_channels(int viewer);
  void send_news();
  void send_pictures();
  void tell_dropped(int viewer, Client& client);
  void receive(int viewer, const std::string& message);
  void subscribe(int viewer, const json& wanted);
  void unsubscribe(int viewer, const json& number);
};

// A client that came before the run has no channels yet: they are advertised as they appear.
void FoxgloveView::State::greet(int viewer) {
  const std::lock_guard lock(mutex);
  clients[viewer] = {};
  send_channels(viewer);
}

// The server's information once more, because only a run that has begun has a name.
void FoxgloveView::State::send_channels(int viewer) {
  // The protocol's first message. The capability "time" announces the binary messages of time; by
  // the session's id a client that comes again knows whether it is the same run.
  server.send(viewer, json_text({{"op", "serverInfo"},
                                 {"name", "vitreo"},
                                 {"capabilities", {"time"}},
                                 {"supportedEncodings", {"json"}},
                                 {"metadata", metadata},
                                 {"sessionId", run}}));
  server.send(viewer, json_text({{"op", "advertise"},
                                 {"channels", announced ? channels->all() : json::array()}}));
}

// Each 10 ms. The lock is held throughout, so end() waits until no message of the session is made.
void FoxgloveView::State::tick() {
  const auto now = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex);
  if (channels) {
    const json added = channels->discover();
    // Clients that came before the run learn of all of them.
    if (!std::exchange(announced, true)) {
      for (const auto& [viewer, client] : clients) send_channels(viewer);
    } else if (!added.empty()) {
      for (const auto& [viewer, client] : clients)
        server.send(viewer, json_text({{"op", "advertise"}, {"channels", added}}));
    }
    send_news();
    if (now - pictured >= kPicturePeriod) pictured = now, send_pictures();
  }
  if (session != nullptr && now - timed >= kTimePeriod) {
    timed = now;
    // Also while no topic has news, so that a player's clock goes on.
    const auto bytes = time_data(UtcClock(t0).ns(board.now()));
    for (const auto& [viewer, client] : clients) server.send_data(viewer, bytes);
  }
  // By a list of their own: a client that is told may be dropped, and leaves `clients` at that.
  std::vector<int> viewers;
  for (const auto& [viewer, client] : clients) viewers.push_back(viewer);
  for (const int viewer : viewers)
    if (const auto found = clients.find(viewer); found != clients.end())
      tell_dropped(viewer, found->second);
  // After the run, once the last rows are sent: its outcome.
  if (session == nullptr && !std::exchange(end_sent, true))
    for (const int viewer : server.viewers())
      server.send(viewer, status_text(kFoxgloveInfo, "the run has ended: " + outcome));
}

void FoxgloveView::State::send_news() {
  const auto wanted = [this](std::size_t channel) {
    for (const auto& [viewer, client] : clients)
      for (const auto& [number, one] : client.subscriptions)
        if (one.channel == channel) return true;
    return false;
  };
  // A row is encoded once. What goes to each client differs by the number of its subscription,
  // which stands before it.
  channels->news(wanted, [this](std::size_t channel, const ChannelMessage& message) {
    for (const auto& [viewer, client] : clients)
      for (const auto& [number, one] : client.subscriptions)
        if (one.channel == channel && message.time >= one.begin)
          server.send_data(viewer, message_data(number, message));
  });
}

/// A client whose last picture is still on its way is skipped: it gets the newest one later.
void FoxgloveView::State::send_pictures() {
  for (auto& [viewer, client] : clients)
    for (auto& [number, one] : client.subscriptions) {
      const int slot = static_cast<int>(one.channel);
      if (!channels->is_picture(one.channel) || server.busy(viewer, slot)) continue;
      if (const auto message = channels->picture(one.channel, one.picture))
        server.send_frame(viewer, slot, message_data(number, *message));
    }
}

void FoxgloveView::State::tell_dropped(int viewer, Client& client) {
  const std::uint64_t dropped = server.dropped(viewer);
  if (dropped == std::exchange(client.told_dropped, dropped)) return;
  server.send(viewer, status_text(kFoxgloveWarning,
                                  "this client is slower than the run: " + std::to_string(dropped) +
                                      " messages were dropped"));
}

/// Everything but a subscription is refused: a run is not steered from here.
void FoxgloveView::State::receive(int viewer, const std::string& message) {
  const std::lock_guard lock(mutex);
  try {
    const json request = json::parse(message);
    const std::string op = request.is_object() ? request.value("op", json()).dump() : "";
    const auto list = [&](const char* name) {
      const json found = request.value(name, json());
      if (!found.is_array()) throw std::invalid_argument(std::string(name) + " wants a list");
      return found;
    };
    if (op == "\"subscribe\"") {
      for (const json& wanted : list("subscriptions")) subscribe(viewer, wanted);
    } else if (op == "\"unsubscribe\"") {
      for (const json& number : list("subscriptionIds")) unsubscribe(viewer, number);
      // clientInfo asks for nothing.
    } else if (op != "\"clientInfo\"") {
      throw std::invalid_argument(op + " is not understood: this server can be read only");
    }
  } catch (const std::exception& error) {
    server.send(viewer, status_text(kFoxgloveError, error_words(error)));
  }
}

void FoxgloveView::State::subscribe(int viewer, const json& wanted) {
  const std::uint32_t number = number_in(wanted, "id");
  const std::uint32_t channel = number_in(wanted, "channelId");
  // The client chooses the number of a subscription; those of the channels count from 1.
  auto& subscriptions = clients[viewer].subscriptions;
  if (!channels || channel < 1 || channel > channels->count())
    throw std::invalid_argument("channel " + std::to_string(channel) + ": is not there");
  if (subscriptions.size() >= kMostSubscriptions)
    throw std::invalid_argument("more subscriptions than this server takes");
  const auto [added, is_new] = subscriptions.try_emplace(number, Subscription{channel - 1});
  if (!is_new)
    throw std::invalid_argument("subscription " + std::to_string(number) + ": is there already");
  // What stands still comes once, and a slow stream seldom: not to wait for the next row.
  std::vector<ChannelMessage> first = channels->first(channel - 1);
  std::stable_sort(first.begin(), first.end(),
                   [](const auto& one, const auto& other) { return one.time < other.time; });
  for (const ChannelMessage& message : first) {
    added->second.begin = std::max(added->second.begin, message.time);
    server.send_data(viewer, message_data(number, message));
  }
}

void FoxgloveView::State::unsubscribe(int viewer, const json& number) {
  if (!number.is_number_unsigned() || number.get<std::uint64_t>() > 0xFFFFFFFF ||
      clients[viewer].subscriptions.erase(number.get<std::uint32_t>()) == 0)
    throw std::invalid_argument("subscription " + number.dump() + ": is not there");
}

FoxgloveView::FoxgloveView(const ViewRequest& request, ProgressListener& terminal)
    : state_(std::make_unique<State>(request, terminal)) {}

FoxgloveView::~FoxgloveView() {
  end("");
  // The server's thread sends the last rows and the outcome at its next tick: at most 0.2 s, for a
  // server that does not send any more must not hold up the end of the program.
  for (int wait = 0; wait < 10; ++wait) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const std::lock_guard lock(state_->mutex);
    if (state_->end_sent) break;
  }
}

ProgressListener& FoxgloveView::listener() { return state_->board; }

void FoxgloveView::begin(Session& session) {
  const RunStart& start = session.recorder.start();
  {
    const std::lock_guard lock(state_->mutex);
    state_->run = session.recorder.folder().filename().string();
    state_->metadata = {{"run", state_->run},
                        {"title", start.protocol_title},
                        {"operator", start.operator_name},
                        {"parameters", json_text(start.parameters)}};
    state_->t0 = t0_of(session);
    state_->channels.emplace(state_->board, RunTopics(start, state_->t0));
    state_->session = &session;
  }
  // From here on the run's threads write to the board, which has a lock of its own: they never wait
  // for this one.
  state_->relay.emplace(session.recorder.listener(), state_->board);
  session.recorder.watch(&*state_->relay);
  // Frames come also while the script grabs none.
  session.frames.watch();
  state_->board.message("foxglove: " + address());
}

// Also called by the destructor, and for a run that never began: then there is no session to
// forget. Faces end in the reverse order of their begins, so the one before still listens.
void FoxgloveView::end(const std::string& outcome) {
  const std::lock_guard lock(state_->mutex);
  if (state_->session == nullptr) return;
  state_->session->recorder.watch(state_->relay->before());
  state_->session = nullptr;
  state_->outcome = outcome;
  state_->end_sent = false;
}

std::string FoxgloveView::address() const {
  const std::string base = "ws" + state_->server.address().substr(4) + "?token=";
  if (state_->token_file.empty()) return base + state_->token;
  // Not the token itself: a screen is read by more people than the file is.
  return base + "TOKEN, with what stands in " + state_->token_file.string() + " for TOKEN";
}

}  // namespace vitreo::view
