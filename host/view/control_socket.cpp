// SPDX-License-Identifier: Apache-2.0
#include "host/view/control_socket.h"

#include "devices/time/quiet_thread.h"
#include "host/session/session.h"
#include "host/text/error_words.h"
#include "host/view/control_client.h"
#include "host/view/instrument_panel.h"

#include <algorithm>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <iterator>
#include <list>
#include <optional>
#include <stdexcept>
#include <thread>

namespace vitreo {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using Local = asio::local::stream_protocol;

constexpr std::size_t kLongestLine = 64 << 10;
constexpr std::size_t kMostClients = 16;
/// Beyond them: heard, until so many later ones have come.
constexpr std::size_t kMostVisitors = 256;
constexpr auto kStatusPeriod = std::chrono::milliseconds(50);  // of the checks for a change

/// A request to end the run, whatever else the line holds: nothing about it is a reason to refuse
/// it. So {"do": "stop"} with any decoration, and the plain word.
std::optional<OperatorCommand> end_of_run(const std::string& line) {
  OperatorCommand command;
  command.source = "the control socket";
  const nlohmann::json request = nlohmann::json::parse(line, nullptr, false);
  const auto text = [&request](const char* key) {
    const auto found = request.find(key);
    return found != request.end() && found->is_string() ? found->get<std::string>() : "";
  };
  if (request.is_object()) {
    command.word = text("do");
    command.by = text("by");
  } else {
    const std::size_t begin = line.find_first_not_of(" \t\r"), end = line.find_last_not_of(" \t\r");
    if (begin != std::string::npos) command.word = line.substr(begin, end - begin + 1);
  }
  // Any other word is read with all that belongs to it.
  if (!OperatorDesk::ends_run(command.word)) return std::nullopt;
  return command;
}

/// "positions" of a target, m, world; empty for other requests. Throws std::invalid_argument.
/// The number of targets is limited by OperatorTargets, their reach by the script that takes them.
std::vector<Eigen::Vector3d> positions_of(const nlohmann::json& request) {
  std::vector<Eigen::Vector3d> positions;
  for (const nlohmann::json& one : request.value("positions", nlohmann::json::array())) {
    const bool numbers = one.is_array() && one.size() == 3 &&
                         std::all_of(one.begin(), one.end(),
                                     [](const nlohmann::json& each) { return each.is_number(); });
    if (!numbers) throw std::invalid_argument("positions: wants a list of [x, y, z] in m");
    positions.emplace_back(one[0].get<double>(), one[1].get<double>(), one[2].get<double>());
  }
  return positions;
}

/// "" where it is not given. Throws std::invalid_argument for what is no text.
std::string text_of(const nlohmann::json& request, const std::string& key) {
  const auto found = request.find(key);
  if (found == request.end()) return "";
  if (!found->is_string()) throw std::invalid_argument(key + ": wants a text");
  return *found;
}

/// false where it is not given. Throws std::invalid_argument.
bool flag_of(const nlohmann::json& request, const std::string& key) {
  const auto found = request.find(key);
  if (found == request.end()) return false;
  if (!found->is_boolean()) throw std::invalid_argument(key + ": wants true or false");
  return *found;
}

/// The request as a command of OperatorDesk; a field of the wrong type throws.
OperatorCommand command_of(const nlohmann::json& request) {
  OperatorCommand command;
  command.word = text_of(request, "do");
  command.by = text_of(request, "by");
  command.source = "the control socket";
  if (command.word == "pause") command.text = text_of(request, "at");
  if (command.word == "ack") command.text = text_of(request, "alarm");
  if (command.word == "answer" && !request.contains("text"))
    throw std::invalid_argument("text: is missing");
  if (command.word == "answer") command.text = text_of(request, "text");
  if (command.word == "adjust") view::read_adjustment(request, command);
  command.override_condition = flag_of(request, "override");
  command.targets = positions_of(request);
  return command;
}

/// Throws std::invalid_argument in words of our own.
nlohmann::json parsed(const std::string& line) {
  nlohmann::json request = nlohmann::json::parse(line, nullptr, false);
  if (request.is_discarded()) throw std::invalid_argument("is no JSON; wants {\"do\": WORD}");
  return request;
}

/// Of a line that was understood; a plain word to end the run is no JSON.
bool is_watch(const std::string& line) {
  const nlohmann::json request = nlohmann::json::parse(line, nullptr, false);
  return request.is_object() && request.value("do", "") == "watch";
}

nlohmann::json status_reply(const OperatorDesk& desk) {
  return {{"ok", true}, {"status", desk.status()}};
}

}  // namespace

// Never throws: whatever a client sends, the reply is JSON, and the connection goes on.
nlohmann::json answer_request(const std::string& line, OperatorDesk& desk) {
  try {
    if (const auto end = end_of_run(line)) {
      desk.perform(*end);
      return status_reply(desk);
    }
    const nlohmann::json request = parsed(line);
    if (!request.is_object() || !request.contains("do"))
      throw std::invalid_argument("wants {\"do\": WORD}");
    const OperatorCommand command = command_of(request);
    // These two only read; "watch" is noted by the server.
    if (command.word != "status" && command.word != "watch") desk.perform(command);
    return status_reply(desk);
  } catch (const std::exception& error) {
    return {{"ok", false}, {"error", error_words(error)}};
  }
}

/// All on one thread of its own, the constructor and the destructor excepted; so nothing is locked.
struct ControlSocket::Server {
  struct Client {
    explicit Client(Local::socket its_socket) : socket(std::move(its_socket)) {}
    Local::socket socket;
    std::string received;
    bool watches = false;
    bool visitor = false;  // came when there was no room
  };
  // A list: an entry stays valid when others are dropped.
  using Entry = std::list<Client>::iterator;

  // Listening throws in the constructor, before there is a thread; everything after it happens on
  // that thread.
  Server(fs::path the_path, OperatorDesk& the_desk) : path(std::move(the_path)), desk(the_desk) {
    std::error_code ignored;
    fs::remove(path, ignored);
    try {
      const Local::endpoint endpoint(path.string());
      // A file of that name was left by a host that was killed: removed above.
      acceptor.open(endpoint.protocol());
      acceptor.bind(endpoint);
      acceptor.listen(128);
    } catch (const std::exception& error) {
      throw std::runtime_error(path.string() + ": cannot listen: " + error.what());
    }
    accept();
    send_changes();
    thread = quiet_thread([this] { io.run(); });
  }
  // The io_context is stopped, so no handler runs any more when its thread has been joined.
  ~Server() {
    io.stop();
    thread.join();
    std::error_code ignored;
    fs::remove(path, ignored);
  }

  void accept() {
    acceptor.async_accept([this](boost::system::error_code failed, Local::socket socket) {
      // Who comes when there is no room is heard all the same, for it may be a stop.
      if (!failed) admit(std::move(socket));
      accept();
    });
  }

  void admit(Local::socket socket) {
    boost::system::error_code ignored;
    // send() must not wait for a client.
    socket.non_blocking(true, ignored);
    // Counted anew each time: there are a few hundred at most.
    const auto visitors =
        static_cast<std::size_t>(std::count_if(clients.begin(), clients.end(), is_visitor));
    clients.emplace_back(std::move(socket));
    clients.back().visitor = clients.size() - visitors > kMostClients;
    // The oldest goes: a stop is said in the first moments of its connection.
    if (visitors >= kMostVisitors) close(*std::find_if(clients.begin(), clients.end(), is_visitor));
    read(std::prev(clients.end()));
  }
  /// One that is closed already leaves at its next read.
  static bool is_visitor(const Client& client) { return client.visitor && client.socket.is_open(); }

  void read(Entry client) {
    // A line beyond kLongestLine is an error of the read, and drops the client.
    asio::async_read_until(client->socket, asio::dynamic_buffer(client->received, kLongestLine),
                           '\n', [this, client](boost::system::error_code failed, std::size_t end) {
                             if (failed || !answer(*client, end)) return drop(client);
                             read(client);
                           });
  }

  /// The first `end` bytes are a line. False: the client does not read.
  bool answer(Client& client, std::size_t end) {
    // Without the line end.
    const std::string line = client.received.substr(0, end - 1);
    client.received.erase(0, end);
    const nlohmann::json reply = answer_request(line, desk);
    const bool watch = reply["ok"] && is_watch(line);
    // A visitor can ask for the status as often as it likes.
    // What is sent without being asked for needs a place.
    if (watch && client.visitor)
      return send(client, {{"ok", false}, {"error", "there are too many clients to watch"}});
    if (watch) client.watches = true;
    return send(client, reply);
  }

  /// Never waits: a client whose buffer is full is one that does not read.
  static bool send(Client& client, const nlohmann::json& message) {
    // What a client sent us comes back in errors: it need not be UTF-8.
    const std::string line =
        message.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    boost::system::error_code failed;
    return client.socket.write_some(asio::buffer(line), failed) == line.size() && !failed;
  }

  /// A read that is under way ends with an error, and that drops the client for good.
  static void close(Client& client) {
    boost::system::error_code ignored;
    client.socket.close(ignored);
    client.watches = false;
  }
  void drop(Entry client) { clients.erase(client); }

  void send_changes() {
    timer.expires_after(kStatusPeriod);
    timer.async_wait([this](boost::system::error_code) {
      // The desk counts changes under the run's threads; the server polls, so that they never wait
      // for it.
      if (const unsigned long changes = desk.changes(); changes != notified) {
        notified = changes;
        const nlohmann::json reply = status_reply(desk);
        for (Client& client : clients)
          if (client.watches && !send(client, reply)) close(client);
      }
      send_changes();
    });
  }

  const fs::path path;
  OperatorDesk& desk;
  asio::io_context io;
  Local::acceptor acceptor{io};
  asio::steady_timer timer{io};
  std::list<Client> clients;
  unsigned long notified = 0;
  std::thread thread;
};

ControlSocket::ControlSocket(const fs::path& path, OperatorDesk& desk)
    : server_(std::make_unique<Server>(path, desk)) {}
ControlSocket::~ControlSocket() = default;

void ControlFace::begin(Session& session) {
  try {
    const std::string name = session.recorder.folder().filename().string();
    socket_ = std::make_unique<ControlSocket>(control_socket_path(name), session.desk);
  } catch (const std::exception& error) {
    // The run goes on: it can still be steered at the terminal.
    session.recorder.event(session.clock.now(), "error",
                           std::string("no control socket: ") + error.what());
  }
}

void ControlFace::end(const std::string&) { socket_.reset(); }

}  // namespace vitreo
