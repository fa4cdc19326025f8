// SPDX-License-Identifier: Apache-2.0
#include "host/view/web_server.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <csignal>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <stdexcept>
#include <thread>

namespace vitreo::view {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;
using Request = http::request<http::string_body>;
using Response = http::response<http::string_body>;

constexpr std::size_t kLongestHeader = 8 << 10;
constexpr std::size_t kLongestBody = 64 << 10;
constexpr std::size_t kLongestMessage = 64 << 10;
constexpr std::size_t kMostQueued = 1 << 20;  // bytes of text that wait for one viewer
constexpr std::size_t kMostData = 4 << 20;    // bytes of send_data() that wait for one viewer
// Period of Callbacks::tick, in which frames and states are sent.
constexpr auto kTick = std::chrono::milliseconds(10);
// A viewer that sends more is dropped: a person clicks less.
constexpr int kMessagesPerSecond = 200;
constexpr std::size_t kMostCookies = 10000;  // of browsers that came with the shared token

/// Comparison of secrets in a time that does not depend on where they differ.
/// The length may show: it is no secret.
bool equal(std::string_view a, std::string_view b) {
  unsigned char difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    difference = static_cast<unsigned char>(difference | (a[i] ^ b[i]));
  return difference == 0;
}

/// "192.168.1.5:8080", "[fd00::5]:8080": host and port of a URL (RFC 3986, 3.2).
std::string host_and_port(const std::string& address, unsigned short port) {
  const bool six = address.find(':') != std::string::npos;
  return (six ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

std::string_view view_of(beast::string_view text) { return {text.data(), text.size()}; }

/// A text with the headers that every answer has.
/// "nosniff" and "no-store": a page served with a secret cookie must be neither reinterpreted nor
/// kept.
Response plain_reply(const Request& request, http::status status, const std::string& text) {
  Response response(status, request.version());
  response.set(http::field::content_type, "text/plain; charset=utf-8");
  response.set(http::field::cache_control, "no-store");
  response.set("X-Content-Type-Options", "nosniff");
  response.set("Referrer-Policy", "no-referrer");
  // No script but ours, no frame around it; pictures also from memory (the frames).
  response.set(
      "Content-Security-Policy",
      "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; "
      "form-action 'none'");
  response.body() = text;
  return response;
}

/// HTML with styles and a script of its own, which loads nothing.
Response as_document(Response response) {
  response.set(http::field::content_type, "text/html; charset=utf-8");
  response.set("Content-Security-Policy",
               "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src "
               "'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'");
  return response;
}

/// The value of our cookie ("name=") among those that a browser sent; "" when it is not there.
/// Cookies of other programs on the same host come along in one header, separated by "; " (RFC
/// 6265, 4.2.1).
std::string_view cookie_in(std::string_view header, const std::string& name) {
  while (!header.empty()) {
    const std::size_t end = std::min(header.find(';'), header.size());
    std::string_view one = header.substr(0, end);
    while (one.starts_with(' ')) one.remove_prefix(1);
    if (one.starts_with(name)) return one.substr(name.size());
    header.remove_prefix(std::min(end + 1, header.size()));
  }
  return {};
}

}  // namespace

// Four words of 32 bits: 128 bits are beyond guessing.
std::string random_token() {
  // Not a seeded generator: a token must not be predictable.
  std::random_device random;
  std::string token;
  for (int word = 0; word < 4; ++word) {
    char digits[9];
    std::snprintf(digits, sizeof digits, "%08x", random());
    token += digits;
  }
  return token;
}

struct WebServer::State {
  class Viewer;
  class Visitor;

  State(ServerSettings given, Callbacks the_callbacks)
      : settings(std::move(given)), call(std::move(the_callbacks)), listener(io), timer(io) {}

  ServerSettings settings;
  Callbacks call;
  std::size_t visitors = 0;  // before what may hold one
  // One thread runs it, so that only the two sets below, which invitation() also uses, need a lock.
  asio::io_context io{1};
  tcp::acceptor listener;
  asio::steady_timer timer;
  std::thread thread;
  std::mutex mutex;  // of the two sets
  std::set<std::string, std::less<>> tokens, cookies;
  std::map<int, std::shared_ptr<Viewer>> viewers;
  int last_viewer = 0;
  // Those that wait for the handler's reply; on the server's thread, as all that follows.
  std::map<std::uint64_t, std::shared_ptr<Visitor>> asking;
  std::uint64_t last_asked = 0;

  void listen();
  void reply(std::uint64_t asked, WebReply given);
  void accept();
  void tick();
  std::string host() const {
    return host_and_port(settings.address, listener.local_endpoint().port());
  }
  /// Against DNS rebinding: a foreign name that resolves to this machine is not accepted as Host.
  bool is_ours(std::string_view host_word) const {
    const std::string port = ":" + std::to_string(listener.local_endpoint().port());
    return host_word == host() ||
           (settings.address == "127.0.0.1" && host_word == "localhost" + port);
  }
  /// Whether the request has the cookie of an admitted browser; a program may send it as a bearer
  /// token (RFC 6750).
  bool known(const Request& request) {
    std::string_view secret =
        cookie_in(view_of(request[http::field::cookie]), settings.cookie + "=");
    const std::string_view bearer = view_of(request[http::field::authorization]);
    if (bearer.starts_with("Bearer ")) {
      secret = bearer.substr(7);
      // A program has no use for a cookie of its own.
      if (settings.handler && !settings.shared_token.empty() &&
          equal(settings.shared_token, secret))
        return true;
    }
    const std::lock_guard lock(mutex);
    return std::any_of(cookies.begin(), cookies.end(),
                       [&](const std::string& one) { return equal(one, secret); });
  }
  /// The cookie's value for a token, which is used up by that, unless it is the shared one.
  std::optional<std::string> exchange(std::string_view token) {
    const std::lock_guard lock(mutex);
    if (!settings.shared_token.empty() && equal(settings.shared_token, token)) {
      // A shared token is not used up, so its cookies are counted.
      if (cookies.size() >= kMostCookies) return {};
      return *cookies.insert(random_token()).first;
    }
    const auto found = std::find_if(tokens.begin(), tokens.end(),
                                    [&](const std::string& one) { return equal(one, token); });
    if (found == tokens.end()) return {};
    // Once only: an invitation in a browser's history or in a log is worth nothing.
    tokens.erase(found);
    return *cookies.insert(random_token()).first;
  }
  /// A WebSocket is not bound by the same-origin policy, so the origin is checked here (RFC 6455,
  /// 10.2); only a program with a bearer token sends none.
  bool may_upgrade(const Request& request) {
    const std::string_view origin = view_of(request[http::field::origin]);
    if (origin.empty()) return view_of(request[http::field::authorization]).starts_with("Bearer ");
    return origin.starts_with("http://") && is_ours(origin.substr(7));
  }
  /// A program has no cookie, and the origin of one says nothing: the token in the address admits
  /// it, which no page of another site knows.
  bool admits(const Request& request) const {
    constexpr std::string_view kToken = "?token=";
    const std::string_view target = view_of(request.target());
    const std::size_t at = target.find(kToken);
    return at != std::string_view::npos && !settings.shared_token.empty() &&
           equal(settings.shared_token, target.substr(at + kToken.size())) &&
           !subprotocol_of(request).empty();
  }
  /// The first of ours that the request offers; "" where it offers none.
  std::string subprotocol_of(const Request& request) const {
    http::token_list offered(request[http::field::sec_websocket_protocol]);
    for (const std::string& ours : settings.subprotocols)
      if (offered.exists(ours)) return ours;
    return "";
  }
  bool may_watch(const Request& request) {
    if (!settings.subprotocols.empty()) return admits(request);
    return view_of(request.target()) == "/live" && known(request) && may_upgrade(request);
  }
  std::optional<Response> answer(const Request& request);
  Response admit(const Request& request, std::string_view token);
};

/// One open WebSocket.
/// All functions run on the server's thread. Handlers hold a shared pointer, so a viewer that was
/// dropped lives until its last handler has returned.
class WebServer::State::Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  Viewer(State& state, beast::tcp_stream stream, int number)
      : state_(state), socket_(std::move(stream)), number_(number) {}

  void start(const Request& request) {
    websocket::stream_base::timeout patience{};
    patience.handshake_timeout = state_.settings.patience;
    patience.idle_timeout = state_.settings.patience;
    // A viewer that says nothing is asked; one that does not answer is dropped.
    patience.keep_alive_pings = true;
    // From here on the WebSocket's own timeouts hold.
    beast::get_lowest_layer(socket_).expires_never();
    socket_.set_option(patience);
    socket_.read_message_max(kLongestMessage);
    socket_.auto_fragment(false);
    socket_.control_callback(
        // A ping costs an answer, too.
        [this](websocket::frame_type kind, beast::string_view) {
          if (kind == websocket::frame_type::ping && floods()) drop();
        });
    if (const std::string chosen = state_.subprotocol_of(request); !chosen.empty())
      socket_.set_option(
          websocket::stream_base::decorator([chosen](websocket::response_type& response) {
            response.set(http::field::sec_websocket_protocol, chosen);
          }));
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return;
      self->state_.viewers[self->number_] = self;
      self->open_ = true;
      self->state_.call.joined(self->number_);
      self->read();
    });
  }
  void send(const std::string& text) {
    if (!open_) return;
    queued_ += text.size();
    // Nothing waits for a viewer: it may reload the page.
    if (queued_ > kMostQueued) return drop();
    texts_.push_back(text);
    write();
  }
  void send_frame(int slot, std::shared_ptr<const std::string> bytes) {
    if (!open_) return;
    // An older frame that still waits is replaced.
    frames_[slot] = std::move(bytes);
    write();
  }
  void send_data(std::shared_ptr<const std::string> bytes) {
    if (!open_) return;
    data_bytes_ += bytes->size();
    data_.push_back(std::move(bytes));
    // The newest stays, however large.
    for (; data_bytes_ > kMostData && data_.size() > 1; ++dropped_) {
      data_bytes_ -= data_.front()->size();
      data_.pop_front();
    }
    write();
  }
  std::uint64_t dropped() const { return dropped_; }
  bool busy(int slot) const {
    const auto found = frames_.find(slot);
    return (found != frames_.end() && found->second != nullptr) || slot_being_sent_ == slot;
  }
  void drop() {
    // Both the reader and the writer come here when a connection breaks.
    if (!std::exchange(open_, false)) return;
    beast::error_code ignored;
    beast::get_lowest_layer(socket_).socket().shutdown(tcp::socket::shutdown_both, ignored);
    beast::get_lowest_layer(socket_).close();
    state_.viewers.erase(number_);
    state_.call.left(number_);
  }

 private:
  // Only texts are accepted; a binary message, or too many, ends the connection.
  void read() {
    socket_.async_read(
        received_, [self = shared_from_this()](beast::error_code error, std::size_t) {
          if (error || !self->socket_.got_text() || self->floods()) return self->drop();
          const std::string message = beast::buffers_to_string(self->received_.data());
          self->received_.consume(self->received_.size());
          self->state_.call.received(self->number_, message);
          if (self->open_) self->read();
        });
  }
  bool floods() {
    const auto now = std::chrono::steady_clock::now();
    if (now - second_began_ > std::chrono::seconds(1)) {
      second_began_ = now;
      in_second_ = 0;
    }
    return ++in_second_ > kMessagesPerSecond;
  }
  void write() {
    // One write at a time, as Beast demands; texts go before data, and data before frames.
    if (writing_ || !open_) return;
    if (!texts_.empty()) {
      // Kept until the write is done: asio does not copy.
      sending_ = std::make_shared<const std::string>(std::move(texts_.front()));
      texts_.pop_front();
      socket_.text(true);
    } else if (!data_.empty()) {
      sending_ = std::move(data_.front());
      data_.pop_front();
      data_bytes_ -= sending_->size();
      slot_being_sent_ = kDataSlot;
      socket_.binary(true);
    } else {
      const auto next = std::find_if(frames_.begin(), frames_.end(),
                                     [](const auto& one) { return one.second != nullptr; });
      if (next == frames_.end()) return;
      sending_ = std::exchange(next->second, nullptr);
      slot_being_sent_ = next->first;
      socket_.binary(true);
    }
    writing_ = true;
    socket_.async_write(asio::buffer(*sending_),
                        [self = shared_from_this()](beast::error_code error, std::size_t) {
                          self->writing_ = false;
                          if (self->slot_being_sent_ == kTextSlot)
                            self->queued_ -= std::min(self->queued_, self->sending_->size());
                          self->slot_being_sent_ = kTextSlot;
                          if (error) return self->drop();
                          self->write();
                        });
  }

  State& state_;
  websocket::stream<beast::tcp_stream> socket_;
  const int number_;
  bool open_ = false;
  bool writing_ = false;
  beast::flat_buffer received_{kLongestMessage + 16};
  std::deque<std::string> texts_;
  std::size_t queued_ = 0;
  std::map<int, std::shared_ptr<const std::string>> frames_;
  std::shared_ptr<const std::string> sending_;
  std::deque<std::shared_ptr<const std::string>> data_;
  std::size_t data_bytes_ = 0;
  std::uint64_t dropped_ = 0;
  static constexpr int kTextSlot = -1;
  static constexpr int kDataSlot = -2;
  int slot_being_sent_ = kTextSlot;
  std::chrono::steady_clock::time_point second_began_{};
  int in_second_ = 0;
};

/// One connection that speaks HTTP until it becomes a viewer's.
/// A visitor lives as long as one of its handlers is pending; the count in State limits how many
/// there are.
class WebServer::State::Visitor : public std::enable_shared_from_this<Visitor> {
 public:
  Visitor(State& state, tcp::socket socket) : state_(state), stream_(std::move(socket)) {
    ++state_.visitors;
  }
  ~Visitor() { --state_.visitors; }

  void read() {
    parser_.emplace();
    parser_->header_limit(kLongestHeader);
    parser_->body_limit(kLongestBody);
    stream_.expires_after(state_.settings.patience);
    http::async_read(stream_, received_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       if (!error) self->take(self->parser_->release());
                     });
  }
  /// On the server's thread.
  void give(WebReply given) {
    response_ = plain_reply(request_, static_cast<http::status>(given.status), "");
    response_->set(http::field::content_type, given.type);
    for (const auto& [name, value] : given.headers) response_->set(name, value);
    response_->body() = std::move(given.body);
    response_->keep_alive(request_.keep_alive());
    write();
  }

 private:
  void take(Request request) {
    // What is refused gets a plain HTTP answer.
    if (websocket::is_upgrade(request) && state_.is_ours(view_of(request[http::field::host])) &&
        state_.may_watch(request) && state_.viewers.size() < state_.settings.most_viewers) {
      // The viewer takes the connection over; this visitor ends with its handler.
      std::make_shared<Viewer>(state_, std::move(stream_), ++state_.last_viewer)->start(request);
      return;
    }
    response_ = state_.answer(request);
    request_ = std::move(request);
    if (!response_) return ask();
    response_->keep_alive(request_.keep_alive() && response_->result() == http::status::ok);
    write();
  }
  void ask() {
    const std::uint64_t asked = ++state_.last_asked;
    state_.asking[asked] = shared_from_this();
    WebRequest wanted{std::string(view_of(request_.method_string())),
                      std::string(view_of(request_.target())), std::move(request_.body())};
    if (request_.method() == http::verb::head) wanted.method = "GET";
    // By its number and not by a pointer to this visitor, which only the server's thread may let
    // go of.
    state_.settings.handler(std::move(wanted), [&state = state_, asked](WebReply given) {
      asio::post(state.io, [&state, asked, given = std::move(given)]() mutable {
        state.reply(asked, std::move(given));
      });
    });
  }
  void write() {
    response_->prepare_payload();
    // After prepare_payload(): the length is that of the whole.
    if (request_.method() == http::verb::head) response_->body().clear();
    stream_.expires_after(state_.settings.patience);
    http::async_write(stream_, *response_,
                      [self = shared_from_this()](beast::error_code error, std::size_t) {
                        if (error) return;
                        // The next request of the connection; after a refusal it is closed.
                        if (self->response_->keep_alive()) return self->read();
                        beast::error_code ignored;
                        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
                      });
  }

  State& state_;
  beast::tcp_stream stream_;
  beast::flat_buffer received_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Request request_;
  std::optional<Response> response_;
};

void WebServer::State::reply(std::uint64_t asked, WebReply given) {
  const auto found = asking.find(asked);
  if (found == asking.end()) return;
  const std::shared_ptr<Visitor> visitor = std::move(found->second);
  asking.erase(found);
  visitor->give(std::move(given));
}

/// The cookie of a browser that came with an invitation.
Response WebServer::State::admit(const Request& request, std::string_view token) {
  const auto cookie = exchange(token);
  if (!cookie)
    return plain_reply(request, http::status::forbidden,
                       "this invitation was used already, or is none of ours\n");
  Response response = plain_reply(request, http::status::see_other, "");
  response.set(http::field::set_cookie,
               // HttpOnly: no script reads it. SameSite: other sites do not send it. The redirect
               // takes the token out of the address bar.
               settings.cookie + "=" + *cookie + "; HttpOnly; SameSite=" +
                   (settings.opened_by_links ? "Lax" : "Strict") + "; Path=/");
  response.set(http::field::location, "/");
  return response;
}

/// The answer to a request that is no WebSocket: host, method, invitation, cookie, then the file.
/// Nothing: it is the handler's.
std::optional<Response> WebServer::State::answer(const Request& request) {
  const auto reply = [&request](http::status status, const std::string& text) {
    return plain_reply(request, status, text);
  };
  if (!is_ours(view_of(request[http::field::host])))
    return reply(http::status::forbidden, "this host is not ours\n");
  const bool reads = request.method() == http::verb::get || request.method() == http::verb::head;
  if (!reads && !settings.handler)
    return reply(http::status::method_not_allowed,
                 "only GET: what changes something goes through the WebSocket\n");
  if (!settings.subprotocols.empty())
    return reply(http::status::forbidden,
                 "this is a WebSocket for " + settings.subprotocols.front() +
                     ", at the address that the program printed: it has a token in it\n");
  const std::string_view target = view_of(request.target());
  constexpr std::string_view kInvited = "/?token=";
  if (target.starts_with(kInvited)) return admit(request, target.substr(kInvited.size()));
  if (!known(request))
    return reply(http::status::forbidden,
                 "open the address that the program printed: it has an invitation in it\n");
  // A cookie comes along with the form of any page; the origin says whose it was.
  if (!reads && !may_upgrade(request))
    return reply(http::status::forbidden,
                 "what changes something comes from our own page, or with a bearer token\n");
  const std::string_view path = target == "/" ? "/index.html" : target;
  for (const Asset& asset : settings.assets) {
    if (asset.path != path) continue;
    Response response = reply(http::status::ok, std::string(asset.bytes));
    response.set(http::field::content_type, asset.type);
    if (asset.gzip) response.set(http::field::content_encoding, "gzip");
    return response;
  }
  if (const std::string made = call.document ? call.document(path) : ""; !made.empty())
    return as_document(reply(http::status::ok, made));
  if (settings.handler) return std::nullopt;
  return reply(http::status::not_found, "there is no such page\n");
}

// Throws the system's error; the constructor adds the address.
void WebServer::State::listen() {
  const tcp::endpoint where(asio::ip::make_address(settings.address), settings.port);
  listener.open(where.protocol());
  // A port that was just left may be used at once.
  listener.set_option(asio::socket_base::reuse_address(true));
  listener.bind(where);
  listener.listen();
}

void WebServer::State::accept() {
  listener.async_accept([this](beast::error_code error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    // A browser opens several connections; beyond that they are closed.
    if (!error && visitors < 4 * settings.most_viewers)
      std::make_shared<Visitor>(*this, std::move(socket))->read();
    accept();
  });
}

void WebServer::State::tick() {
  timer.expires_after(kTick);
  timer.async_wait([this](beast::error_code error) {
    if (error) return;
    call.tick();
    tick();
  });
}

WebServer::WebServer(ServerSettings settings, Callbacks callbacks)
    : state_(std::make_unique<State>(std::move(settings), std::move(callbacks))) {
  try {
    state_->listen();
  } catch (const std::exception& error) {
    throw ConfigError("view: cannot listen at " + state_->settings.address + ":" +
                      std::to_string(state_->settings.port) + ": " + error.what());
  }
  state_->accept();
  state_->tick();
  state_->thread = quiet_thread([this] { state_->io.run(); });
}

WebServer::~WebServer() {
  // Handlers that are pending are destroyed with the io_context, after the viewers.
  state_->io.stop();
  state_->thread.join();
  state_->viewers.clear();
}

std::string WebServer::address() const { return "http://" + state_->host() + "/"; }

unsigned short WebServer::port() const { return state_->listener.local_endpoint().port(); }

std::string WebServer::invitation() {
  const std::lock_guard lock(state_->mutex);
  return address() + "?token=" + *state_->tokens.insert(random_token()).first;
}

void WebServer::send(int viewer, const std::string& text) {
  const auto found = state_->viewers.find(viewer);
  if (found == state_->viewers.end()) return;
  const auto kept = found->second;  // it may drop itself
  kept->send(text);
}

// The bytes are shared by all viewers: a frame is encoded once.
void WebServer::send_frame(int viewer, int slot, std::shared_ptr<const std::string> bytes) {
  const auto found = state_->viewers.find(viewer);
  if (found == state_->viewers.end()) return;
  const auto kept = found->second;
  kept->send_frame(slot, std::move(bytes));
}

void WebServer::send_data(int viewer, std::shared_ptr<const std::string> bytes) {
  const auto found = state_->viewers.find(viewer);
  if (found == state_->viewers.end()) return;
  const auto kept = found->second;
  kept->send_data(std::move(bytes));
}

std::uint64_t WebServer::dropped(int viewer) const {
  const auto found = state_->viewers.find(viewer);
  return found == state_->viewers.end() ? 0 : found->second->dropped();
}

bool WebServer::busy(int viewer, int slot) const {
  const auto found = state_->viewers.find(viewer);
  return found != state_->viewers.end() && found->second->busy(slot);
}

std::vector<int> WebServer::viewers() const {
  std::vector<int> numbers;
  for (const auto& [number, viewer] : state_->viewers) numbers.push_back(number);
  return numbers;
}

}  // namespace vitreo::view
