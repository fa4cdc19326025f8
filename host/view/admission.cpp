// SPDX-License-Identifier: Apache-2.0
#include "host/view/admission.h"

#include "host/config/config.h"
#include "host/view/web_server.h"

#include <algorithm>
#include <arpa/inet.h>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo::view {
namespace {

constexpr std::size_t kShortest = 32;   // characters of a token: 128 bits in hexadecimal
constexpr std::size_t kLongest = 1024;  // characters

/// Scope guard of a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int number() const { return number_; }

 private:
  const int number_;
};

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& why) {
  throw ConfigError("--token-file " + file.string() + ": " + why);
}

/// Makes the file with a new token and returns that. O_EXCL and O_NOFOLLOW: a file or a link that
/// was put there meanwhile is not written to.
std::string made(const std::filesystem::path& file) {
  const Descriptor out(
      ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (out.number() < 0) refuse(file, std::string("cannot be made: ") + std::strerror(errno));
  const std::string token = random_token(), line = token + "\n";
  // The mode given to open() is cut by the umask; this one is not.
  if (::fchmod(out.number(), 0600) != 0 ||
      ::write(out.number(), line.data(), line.size()) != static_cast<ssize_t>(line.size()) ||
      ::fsync(out.number()) != 0)
    refuse(file, std::string("cannot be written: ") + std::strerror(errno));
  return token;
}

}  // namespace

// Names are not accepted, only addresses: what a name resolves to may change, and the Host header
// of requests is compared with this text.
void check(const ViewRequest& request) {
  in_addr four = {};
  in6_addr six = {};
  const std::string option = "--listen " + request.address + ": ";
  bool loopback = false, any = false;
  if (inet_pton(AF_INET, request.address.c_str(), &four) == 1) {
    // 127.0.0.0/8 (RFC 1122, 3.2.1.3).
    loopback = (ntohl(four.s_addr) >> 24) == 127;
    any = four.s_addr == INADDR_ANY;
  } else if (inet_pton(AF_INET6, request.address.c_str(), &six) == 1) {
    loopback = IN6_IS_ADDR_LOOPBACK(&six);
    any = IN6_IS_ADDR_UNSPECIFIED(&six);
  } else {
    throw ConfigError(option + "wants an IP address of this machine, such as 192.168.1.5");
  }
  if (any)
    throw ConfigError(option +
                      "is every address at once; name the one on which the page is wanted");
  if (!loopback && request.token_file.empty())
    throw ConfigError(
        option +
        "can be reached from other machines, so it wants --token-file FILE (for its "
        "owner alone, mode 0600); or leave it away, and from there: ssh -L PORT:127.0.0.1:PORT");
}

/// Owner and mode are checked on the open descriptor, not on the path: the file cannot be exchanged
/// between check and reading. O_NONBLOCK: opening a pipe must not hang.
std::string shared_token(const std::filesystem::path& file) {
  const Descriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (in.number() < 0 && errno == ENOENT) return made(file);
  if (in.number() < 0)
    // O_NOFOLLOW gives ELOOP for a link.
    refuse(file, errno == ELOOP ? "is a link; name the file itself" : std::strerror(errno));
  struct stat about = {};
  if (::fstat(in.number(), &about) != 0 || !S_ISREG(about.st_mode))
    refuse(file, "is no plain file");
  if (about.st_uid != ::geteuid()) refuse(file, "belongs to another user");
  if ((about.st_mode & 077) != 0)
    refuse(file, "others may read or write it; chmod 600 " + file.string());
  // Room for a line end, and for one character too many to be noticed.
  char bytes[kLongest + 2];
  const ssize_t got = ::read(in.number(), bytes, sizeof bytes);
  std::string token(bytes, static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
  while (!token.empty() && std::isspace(static_cast<unsigned char>(token.back())) != 0)
    token.pop_back();
  const bool hexadecimal = std::all_of(token.begin(), token.end(),
                                       [](unsigned char c) { return std::isxdigit(c) != 0; });
  if (token.size() < kShortest || token.size() > kLongest || !hexadecimal)
    refuse(file,
           "wants one line of 32 or more hexadecimal digits (openssl rand -hex 32), or not to be "
           "there: it is made");
  return token;
}

}  // namespace vitreo::view
