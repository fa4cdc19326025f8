// Web server of the live view against hostile visitors: each rule of docs/live_view.md by the bytes
// that would break it.
// SPDX-License-Identifier: Apache-2.0
#include "host/view/web_server.h"

#include "tests/host/view/web_client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace vitreo::view {
namespace VITREO_TEST_FILE {

constexpr const char* kShared = "00112233445566778899aabbccddeeff";

struct Live : testing::Test {
  Live()
      : server({"127.0.0.1", 0, {{"/index.html", "text/html", "<p>page</p>", false}}, 4, kShared},
               {[this](int viewer) { last = viewer, ++joined; }, [this](int) { ++left; },
                [this](int viewer, const std::string& message) {
                  const std::lock_guard lock(mutex);
                  received = message;
                  server_pointer()->send(viewer, "heard " + std::to_string(message.size()));
                },
                [this] {
                  if (flood > 0 && last > 0) server_pointer()->send(last, std::string(200000, 'x'));
                },
                [](std::string_view path) {
                  return std::string(path == "/report" ? "<h1>report</h1>" : "");
                }}) {}
  WebServer* server_pointer() { return &server; }
  std::string host() const { return "127.0.0.1:" + std::to_string(server.port()); }
  std::string token() {
    const std::string address = server.invitation();
    return address.substr(address.find("token=") + 6);
  }
  std::string ask(const std::string& text) {
    Wire wire(server.port());
    wire.say(text);
    return wire.hear();
  }
  std::string get(const std::string& path, const std::string& more = "",
                  const std::string& to = "") {
    return ask("GET " + path + " HTTP/1.1\r\nHost: " + (to.empty() ? host() : to) +
               "\r\nConnection: close\r\n" + more + "\r\n");
  }
  std::string cookie() {
    const std::string reply = get("/?token=" + token());
    const std::size_t begin = reply.find("vitreo=");
    EXPECT_NE(begin, std::string::npos) << reply;
    return reply.substr(begin, reply.find(';', begin) - begin);
  }
  static int status(const std::string& reply) {
    return reply.size() > 12 ? std::stoi(reply.substr(9, 3)) : 0;
  }
  std::string upgrade(const std::string& origin, const std::string& more) const {
    return upgrade_request(host(), origin, more);
  }
  template <class Ready>
  static bool soon(Ready ready) {
    for (int i = 0; i < 300 && !ready(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return ready();
  }

  std::atomic<int> joined{0}, left{0}, last{0}, flood{0};
  std::mutex mutex;
  std::string received;
  WebServer server;
};

TEST_F(Live, ADocumentThatIsMadeMeanwhileIsForThoseWhoWereAdmittedAndLoadsNothing) {
  EXPECT_EQ(status(get("/report")), 403);
  const std::string reply = get("/report", "Cookie: " + cookie() + "\r\n");
  EXPECT_EQ(status(reply), 200);
  EXPECT_NE(reply.find("<h1>report</h1>"), std::string::npos);
  EXPECT_NE(reply.find("default-src 'none'"), std::string::npos) << reply;
  EXPECT_EQ(status(get("/reports", "Cookie: " + cookie() + "\r\n")), 404);
}

TEST_F(Live, ListensAtTheLoopbackAddressAlone) {
  const auto reached = [this](const char* at) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_port = htons(server.port());
    inet_pton(AF_INET, at, &address.sin_addr);
    const int one = ::socket(AF_INET, SOCK_STREAM, 0);
    const int done = connect(one, reinterpret_cast<const sockaddr*>(&address), sizeof address);
    close(one);
    return done == 0;
  };
  EXPECT_TRUE(reached("127.0.0.1"));
  EXPECT_FALSE(reached("127.0.0.2")) << "as every other address of this machine";
}

TEST_F(Live, WhoIsSlowWithARequestIsNotWaitedFor) {
  WebServer hasty({"127.0.0.1", 0, {}, 4, kShared, std::chrono::milliseconds(300)},
                  {[](int) {}, [](int) {}, [](int, const std::string&) {}, [] {}});
  std::vector<std::unique_ptr<Wire>> slow;
  for (int i = 0; i < 16; ++i) {  // as many as there is room for
    slow.push_back(std::make_unique<Wire>(hasty.port()));
    slow.back()->say("GET / HTTP/1.1\r\nHost: 127");
  }
  for (const auto& wire : slow) {
    wire->hear();
    EXPECT_TRUE(wire->closed());
  }
  Wire other(hasty.port());
  other.say("GET / HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(hasty.port()) +
            "\r\nConnection: close\r\n\r\n");
  EXPECT_EQ(status(other.hear()), 403) << "there is room again, for who has a token";
}

TEST_F(Live, LetsInWhoKnowsTheSharedTokenAndAsOftenAsTheyLike) {
  std::string before;
  for (int visit = 0; visit < 3; ++visit) {
    const std::string reply = get(std::string("/?token=") + kShared);
    EXPECT_EQ(status(reply), 303) << reply;
    const std::size_t begin = reply.find("vitreo=");
    const std::string cookie = reply.substr(begin, reply.find(';', begin) - begin);
    EXPECT_NE(cookie, before) << "a cookie for each";
    EXPECT_EQ(cookie.find(kShared), std::string::npos);
    EXPECT_EQ(status(get("/", "Cookie: " + cookie + "\r\n")), 200);
    before = cookie;
  }
  EXPECT_EQ(status(get("/?token=00112233445566778899aabbccddeefe")), 403);
  EXPECT_EQ(status(get("/", std::string("Authorization: Bearer ") + kShared + "\r\n")), 403)
      << "it is no cookie";
}

TEST_F(Live, LetsInWhoHasAnInvitationAndOnlyOnce) {
  EXPECT_EQ(status(get("/")), 403);
  const std::string invitation = token();
  const std::string reply = get("/?token=" + invitation);
  EXPECT_EQ(status(reply), 303);
  EXPECT_NE(reply.find("HttpOnly; SameSite=Strict"), std::string::npos) << reply;
  EXPECT_EQ(status(get("/?token=" + invitation)), 403);
  EXPECT_EQ(status(get("/?token=")), 403);
  EXPECT_EQ(status(get("/?token=" + invitation.substr(0, 31))), 403);
  const std::string page = get("/", "Cookie: " + cookie() + "\r\n");
  EXPECT_EQ(status(page), 200);
  EXPECT_NE(page.find("<p>page</p>"), std::string::npos);
  for (const char* header :
       {"Content-Security-Policy: default-src 'self'", "frame-ancestors 'none'",
        "X-Content-Type-Options: nosniff", "Referrer-Policy: no-referrer"})
    EXPECT_NE(page.find(header), std::string::npos) << header;
  EXPECT_EQ(status(get("/", "Cookie: vitreo=00000000000000000000000000000000\r\n")), 403);
}

TEST_F(Live, AnswersOnlyToItsOwnName) {
  const std::string known = "Cookie: " + cookie() + "\r\n",
                    port = ":" + std::to_string(server.port());
  EXPECT_EQ(status(get("/", known, "localhost" + port)), 200);
  for (const std::string& other :
       {"127.0.0.1.evil.example" + port, "evil.example" + port, std::string("127.0.0.1"),
        std::string("127.0.0.1:1"), std::string("localhost"), "127.0.0.2" + port, "0.0.0.0" + port,
        "[::1]" + port, "localhost.evil.example" + port, "127.0.0.1" + port + "0",
        "user@127.0.0.1" + port, "2130706433" + port})
    EXPECT_EQ(status(get("/", known, other)), 403) << other;
}

TEST_F(Live, ServesItsTableAndNothingElse) {
  const std::string known = "Cookie: " + cookie() + "\r\n";
  for (const char* path : {"/../etc/passwd", "/%2e%2e/etc/passwd", "/etc/passwd", "//etc/passwd",
                           "/index.html%00", "/live"})
    EXPECT_EQ(status(get(path, known)), 404) << path;
  for (const char* method : {"POST", "PUT", "DELETE"})
    EXPECT_EQ(status(ask(std::string(method) + " / HTTP/1.1\r\nHost: " + host() + "\r\n" + known +
                         "Connection: close\r\nContent-Length: 0\r\n\r\n")),
              405)
        << method;
  EXPECT_EQ(ask(std::string(100, '\xff') + "\r\n\r\n").find("200 OK"), std::string::npos);
  EXPECT_EQ(get("/", known + "X: " + std::string(9000, 'x') + "\r\n").find("200 OK"),
            std::string::npos);
  EXPECT_EQ(status(get("/", known)), 200);  // it is still there
}

TEST_F(Live, OpensTheSocketOnlyToItsOwnPage) {
  const std::string known = "Cookie: " + cookie() + "\r\n", ours = "http://" + host();
  for (const std::string& foreign :
       {std::string("http://evil.example"), "http://" + host() + ".evil.example",
        "https://" + host(), std::string("null"), std::string()})
    EXPECT_NE(status(ask(upgrade(foreign, known + "X: y\r\n"))), 101) << foreign;
  EXPECT_NE(status(ask(upgrade(ours, ""))), 101) << "without a cookie";
  EXPECT_EQ(joined, 0);
  Wire good(server.port());
  good.say(upgrade(ours, known));
  EXPECT_EQ(status(good.hear("\r\n\r\n")), 101);
  EXPECT_TRUE(soon([this] { return joined == 1; }));
  Wire native(server.port());  // a program of the user's, which says so
  native.say(upgrade("", "Authorization: Bearer " + known.substr(15, 32) + "\r\n"));
  EXPECT_EQ(status(native.hear("\r\n\r\n")), 101);
}

TEST_F(Live, DropsWhoSpeaksNonsenseAndKeepsTheOthers) {
  const std::string known = "Cookie: " + cookie() + "\r\n", ours = "http://" + host();
  const auto open = [&](Wire& wire) {
    wire.say(upgrade(ours, known));
    EXPECT_EQ(status(wire.hear("\r\n\r\n")), 101);
  };
  Wire good(server.port());
  open(good);
  for (const std::string& nonsense :
       {frame(2, "binary"), std::string("\x81\x05plain", 7), std::string("\xff\xff\xff\xff\xff", 5),
        std::string("\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff\0\0\0\0", 14)}) {
    Wire bad(server.port());
    open(bad);
    bad.say(nonsense);
    bad.finish();  // or the server would wait some seconds for the end of who speaks nonsense
    bad.hear();
    EXPECT_TRUE(bad.closed());
  }
  Wire large(server.port());
  open(large);
  large.say(std::string("\x81\xff\0\0\0\0\0\x01\x11\x70\0\0\0\0", 14) + std::string(70000, 'x'));
  large.finish();
  large.hear();
  EXPECT_TRUE(large.closed()) << "a message of 70 kB";
  for (const int kind : {1, 9}) {  // messages, pings
    Wire many(server.port());
    open(many);
    for (int i = 0; i < 10000; ++i) many.say(frame(static_cast<unsigned char>(kind), "{}"));
    many.hear();
    EXPECT_TRUE(many.closed()) << kind;
  }
  good.say(frame(1, "{\"do\": \"hello\"}"));
  EXPECT_NE(good.hear("heard").find("heard 15"), std::string::npos);
}

TEST_F(Live, DropsAViewerWhoDoesNotListen) {
  const std::string known = "Cookie: " + cookie() + "\r\n";
  Wire deaf(server.port());
  deaf.say(upgrade("http://" + host(), known));
  EXPECT_EQ(status(deaf.hear("\r\n\r\n")), 101);
  EXPECT_TRUE(soon([this] { return joined == 1; }));
  flood = 1;  // 10 MB/s that is not read
  EXPECT_TRUE(soon([this] { return left == 1; }));
}

TEST_F(Live, AViewerWhoDoesNotListenHoldsNobodyElseUp) {
  const std::string known = "Cookie: " + cookie() + "\r\n", ours = "http://" + host();
  const auto open = [&](Wire& wire) {
    wire.say(upgrade(ours, known));
    EXPECT_EQ(status(wire.hear("\r\n\r\n")), 101);
  };
  Wire good(server.port());
  open(good);
  Wire deaf(server.port());
  open(deaf);
  EXPECT_TRUE(soon([this] { return joined == 2; }));
  flood = 1;  // 10 MB/s for the last who joined
  for (int i = 1; i <= 20; ++i) {
    good.say(frame(1, std::string(static_cast<std::size_t>(100 + i), ' ')));
    EXPECT_NE(good.hear("heard " + std::to_string(100 + i)).find("heard"), std::string::npos) << i;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(soon([this] { return left == 1; })) << "it is dropped";
  good.say(frame(1, "{}"));
  EXPECT_NE(good.hear("heard 2").find("heard 2"), std::string::npos);
}

TEST_F(Live, HasRoomForSoManyViewersAndNoMore) {
  const std::string known = "Cookie: " + cookie() + "\r\n", ours = "http://" + host();
  std::vector<std::unique_ptr<Wire>> wires;
  for (int i = 0; i < 4; ++i) {
    wires.push_back(std::make_unique<Wire>(server.port()));
    wires.back()->say(upgrade(ours, known));
    EXPECT_EQ(status(wires.back()->hear("\r\n\r\n")), 101);
  }
  EXPECT_TRUE(soon([this] { return joined == 4; }));
  EXPECT_NE(status(ask(upgrade(ours, known))), 101);
}

/// A server for programs of one subprotocol.
struct Subprotocol : testing::Test {
  Subprotocol()
      : server(settings(), {[this](int viewer) { last = viewer; }, [](int) {},
                            [](int, const std::string&) {}, [this] { tick(); }}) {}
  static ServerSettings settings() {
    ServerSettings settings;
    settings.shared_token = kShared;
    settings.subprotocols = {"later.v2", "first.v1"};
    return settings;
  }
  /// What there is to be sent is sent on the server's own thread.
  void tick() {
    for (; messages > 0 && last > 0; --messages)
      server.send_data(last, std::make_shared<const std::string>(100000, 'x'));
    if (last > 0) dropped = server.dropped(last);
  }
  std::string upgrade(const std::string& target, const std::string& offered) const {
    std::string request = upgrade_request("127.0.0.1:" + std::to_string(server.port()), "",
                                          "Sec-WebSocket-Protocol: " + offered + "\r\n");
    request.replace(request.find("/live"), 5, target);
    return request;
  }
  std::string answer(const std::string& target, const std::string& offered) {
    Wire wire(server.port());
    wire.say(upgrade(target, offered));
    return wire.hear("\r\n\r\n");
  }
  std::atomic<int> last{0}, messages{0};
  std::atomic<std::uint64_t> dropped{0};
  WebServer server;
};

TEST_F(Subprotocol, IsChosenFromWhatIsOfferedAndAdmittedByTheTokenAlone) {
  const std::string good = std::string("/?token=") + kShared;
  EXPECT_NE(answer(good, "first.v1").find("Sec-WebSocket-Protocol: first.v1\r\n"),
            std::string::npos);
  EXPECT_NE(answer(good, "first.v1, later.v2").find("Sec-WebSocket-Protocol: later.v2\r\n"),
            std::string::npos);
  for (const auto& [target, offered] : {std::pair<std::string, std::string>{good, "other"},
                                        {"/?token=", "first.v1"},
                                        {"/", "first.v1"},
                                        {"/?token=" + std::string(32, '0'), "first.v1"},
                                        {good + "0", "first.v1"}})
    EXPECT_EQ(answer(target, offered).substr(9, 3), "403") << target << " " << offered;
}

TEST_F(Subprotocol, DropsTheOldestOfWhatASlowProgramDoesNotRead) {
  Wire slow(server.port());
  slow.say(upgrade(std::string("/?token=") + kShared, "first.v1"));
  slow.hear("\r\n\r\n");
  messages = 1000;  // 100 MB, of which the system's buffers take a few
  for (int i = 0; i < 300 && dropped == 0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_GT(dropped, 800U);
  EXPECT_LT(dropped, 1000U);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::view
