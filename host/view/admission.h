// Admission to the live view: the address it is served at (this machine alone, or one named address
// of a network) and the token file that a network wants.
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
  /// s after the run, at most, for which its report is served while a page is still open.
  double linger = 0;
};

constexpr int kFoxglovePort = 8765;  // to which Foxglove and its kin connect by default

/// Throws ConfigError naming the option: an address that is none, every address at once (the Host
/// header of a request could not be checked then), one that other machines reach without a
/// token file.
void check(const ViewRequest& request);

/// The token in the file, 32 or more hexadecimal digits; a file that is not there is made, for its
/// owner alone (mode 0600). Throws ConfigError naming the file: others may read or write it, it
/// belongs to another user, it is no plain file or holds no such token.
std::string shared_token(const std::filesystem::path& file);

}  // namespace vitreo::view
