// Whom the live view may be served to: this machine alone, or one named address of a network, for
// people who hold a token file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace vitreo::view {

struct ViewRequest {
  bool on = false;
  std::string address = "127.0.0.1";   // of the machine, at which the page is served
  unsigned short port = 0;             // 0: any that is free
  std::filesystem::path token_file{};  // empty: each browser wants an invitation of its own
};

/// Throws ConfigError naming the option: an address that is none, every address at once (nobody
/// could tell then whether a request was meant for us), one that other machines reach without a
/// token file.
void check(const ViewRequest& request);

/// The token in the file, 32 or more hexadecimal digits; a file that is not there is made, for its
/// owner alone (mode 0600). Throws ConfigError naming the file: others may read or write it, it
/// belongs to somebody else, it is no plain file or holds no such token.
std::string shared_token(const std::filesystem::path& file);

/// "192.168.1.5:8080", "[fd00::5]:8080": as it stands in an address.
std::string host_and_port(const std::string& address, unsigned short port);

}  // namespace vitreo::view
