// Modbus against libmodbus: its server behind a pseudo-terminal and on TCP, its client on ours.
// SPDX-License-Identifier: Apache-2.0
#ifdef VITREO_HAVE_LIBMODBUS
#include "devices/links/address.h"
#include "devices/links/modbus.h"
#include "devices/links/modbus_emulator.h"
#include "devices/time/error.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <atomic>
#include <modbus.h>
#include <pty.h>
#include <sys/socket.h>
#include <termios.h>
#include <thread>
#include <unistd.h>

namespace vitreo::modbus {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Words = std::vector<std::uint16_t>;
using Bits = std::vector<bool>;

constexpr int kSize = 200;
constexpr int kUnit = 17;

/// libmodbus' server in a thread of its own, on a descriptor that talks already or on a listening
/// socket.
class LibmodbusServer {
 public:
  /// Behind a pseudo-terminal.
  LibmodbusServer() : context_(modbus_new_rtu("/dev/null", 115200, 'N', 8, 1)) {
    char name[64] = {};
    termios raw{};
    cfmakeraw(&raw);
    EXPECT_EQ(openpty(&far_, &near_, name, &raw, nullptr), 0);
    address_ = std::string("serial:") + name;
    modbus_set_socket(context_, far_);
    modbus_set_slave(context_, kUnit);
    thread_ = std::thread([this] { serve(); });
  }
  /// On TCP.
  explicit LibmodbusServer(std::true_type) : context_(modbus_new_tcp("127.0.0.1", 0)) {
    listener_ = modbus_tcp_listen(context_, 1);
    sockaddr_in here{};
    socklen_t size = sizeof here;
    EXPECT_EQ(::getsockname(listener_, reinterpret_cast<sockaddr*>(&here), &size), 0);
    address_ = "tcp:127.0.0.1:" + std::to_string(ntohs(here.sin_port));
    thread_ = std::thread([this] {
      if (modbus_tcp_accept(context_, &listener_) >= 0) serve();
    });
  }
  ~LibmodbusServer() {
    ended_ = true;
    if (listener_ >= 0) ::shutdown(listener_, SHUT_RDWR);
    thread_.join();
    if (listener_ >= 0) modbus_close(context_);
    for (const int one : {far_, near_, listener_})
      if (one >= 0) ::close(one);
    modbus_mapping_free(mapping_);
    modbus_free(context_);
  }
  LibmodbusServer(const LibmodbusServer&) = delete;
  LibmodbusServer& operator=(const LibmodbusServer&) = delete;
  const std::string& address() const { return address_; }
  /// Of the next answers only.
  std::atomic<int> delay_ms{0};

 private:
  void serve() {
    modbus_set_indication_timeout(context_, 0, 50000);
    while (!ended_) {
      std::uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
      const int size = modbus_receive(context_, query);
      if (size < 0 && errno != ETIMEDOUT && errno != EMBBADCRC) return;
      if (size <= 0) continue;
      std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms.exchange(0)));
      modbus_reply(context_, query, size, mapping_);
    }
  }

  modbus_t* const context_;
  modbus_mapping_t* const mapping_ = modbus_mapping_new(kSize, kSize, kSize, kSize);
  int far_ = -1;
  int near_ = -1;
  int listener_ = -1;
  std::string address_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

struct Libmodbus : ::testing::TestWithParam<Framing> {
  std::unique_ptr<LibmodbusServer> server() {
    return GetParam() == Framing::rtu ? std::make_unique<LibmodbusServer>()
                                      : std::make_unique<LibmodbusServer>(std::true_type());
  }
  Settings settings() const {
    return {.framing = GetParam(),
            .reply_timeout = 300ms,
            .late = 1s,
            .character = character_time(SerialSettings{.baud_rate = 115200})};
  }
  std::unique_ptr<Client> client(const std::string& address) {
    return make_client(open_byte_link(address, {.baud_rate = 115200}, *clock), settings(), *clock);
  }
  std::unique_ptr<Clock> clock = virtual_clock(Pace::real_time);
};
INSTANTIATE_TEST_SUITE_P(OverBothFramings, Libmodbus,
                         ::testing::Values(Framing::rtu, Framing::tcp));

TEST_P(Libmodbus, TakesAndGivesEveryTable) {
  const auto its = server();
  const auto our = client(its->address());
  Words words;
  Bits bits;
  for (int i = 0; i < 123; ++i) {
    words.push_back(static_cast<std::uint16_t>(i * 523));
    bits.push_back(i % 3 == 0);
  }
  our->write_registers(kUnit, 0, words);
  our->write_register(kUnit, 123, 0xABCD);
  words.push_back(0xABCD);
  EXPECT_EQ(our->read_holding_registers(kUnit, 0, 124), words);
  our->write_coils(kUnit, 5, bits);
  our->write_coil(kUnit, 4, true);
  bits.insert(bits.begin(), true);
  EXPECT_EQ(our->read_coils(kUnit, 4, 124), bits);
  EXPECT_EQ(our->read_discrete_inputs(kUnit, 0, 200), Bits(200));
  EXPECT_EQ(our->read_input_registers(kUnit, 75, 125), Words(125));
}

TEST_P(Libmodbus, RefusesAnAddressItDoesNotHave) {
  const auto its = server();
  const auto our = client(its->address());
  try {
    our->read_holding_registers(kUnit, kSize, 1);
    ADD_FAILURE();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(error.text.find("illegal data address (exception 2)"), std::string::npos);
  }
  our->write_register(kUnit, 0, 5);
  EXPECT_EQ(our->read_holding_registers(kUnit, 0, 1), Words{5});
}

TEST_P(Libmodbus, AnswersLateAndIsNotMisunderstood) {
  const auto its = server();
  const auto our = client(its->address());
  our->write_registers(kUnit, 0, Words{1, 2});
  its->delay_ms = 500;
  EXPECT_THROW(our->read_holding_registers(kUnit, 0, 1), DeviceError);
  EXPECT_EQ(our->read_holding_registers(kUnit, 1, 1), Words{2});
}

/// What libmodbus as a client does with our emulator.
struct Mirror final : Store {
  std::optional<std::uint16_t> read(Table, std::uint16_t address, Time) override {
    if (address >= kSize) return std::nullopt;
    return values[address];
  }
  std::uint8_t write(Table, std::uint16_t address, std::uint16_t value, Time) override {
    if (address >= kSize) return 2;
    values[address] = value;
    return 0;
  }
  std::uint16_t values[kSize] = {};
};

TEST_P(Libmodbus, IsServedByOurEmulator) {
  Mirror store;
  const auto emulator = make_emulator(store, {.framing = GetParam(), .unit = kUnit});
  const bool rtu = GetParam() == Framing::rtu;
  RealEnd end(*emulator, rtu ? open_pty_end() : open_tcp_end());
  const std::string place = end.address().substr(end.address().rfind(':') + 1);
  modbus_t* const its = rtu ? modbus_new_rtu(place.c_str(), 115200, 'N', 8, 1)
                            : modbus_new_tcp("127.0.0.1", std::stoi(place));
  modbus_set_slave(its, kUnit);
  modbus_set_response_timeout(its, 2, 0);
  ASSERT_EQ(modbus_connect(its), 0) << modbus_strerror(errno);
  const std::uint16_t words[] = {1, 0xFFFF, 3};
  EXPECT_EQ(modbus_write_registers(its, 10, 3, words), 3);
  EXPECT_EQ(modbus_write_register(its, 13, 4), 1);
  std::uint16_t back[4] = {};
  EXPECT_EQ(modbus_read_registers(its, 10, 4, back), 4);
  EXPECT_EQ(Words(back, back + 4), (Words{1, 0xFFFF, 3, 4}));
  EXPECT_EQ(modbus_read_input_registers(its, 10, 4, back), 4);
  const std::uint8_t bits[] = {1, 0, 1, 1, 0, 0, 0, 1, 1};
  EXPECT_EQ(modbus_write_bits(its, 50, 9, bits), 9);
  EXPECT_EQ(modbus_write_bit(its, 51, 1), 1);
  std::uint8_t got[9] = {};
  EXPECT_EQ(modbus_read_bits(its, 50, 9, got), 9);
  EXPECT_EQ(Bits(got, got + 9), (Bits{1, 1, 1, 1, 0, 0, 0, 1, 1}));
  EXPECT_EQ(modbus_read_registers(its, kSize, 1, back), -1);
  EXPECT_EQ(errno, EMBXILADD);
  modbus_close(its);
  modbus_free(its);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::modbus
#endif
