// Digests of recorded data: SHA-256 of texts and files, CRC-32 of frames.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

struct evp_md_ctx_st;  // libcrypto's EVP_MD_CTX: its headers stay in digest.cpp

namespace vitreo {

/// SHA-256 (FIPS 180-4) of bytes that come in parts, by libcrypto.
class Sha256 {
 public:
  /// Throws std::runtime_error where libcrypto refuses the algorithm, as all members do.
  Sha256();
  Sha256& update(std::string_view bytes);
  /// 64 hexadecimal digits, lower case. Ends the digest: nothing may be added afterwards.
  std::string hex();

 private:
  struct Free {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, Free> context_;
};

/// 64 hexadecimal digits, lower case.
std::string sha256(std::string_view bytes);

/// CRC-32 (ISO 3309, as in PNG, zip and MCAP), by zlib. Continues from `before`, the CRC-32 of the
/// bytes in front of these. A null pointer is allowed where `size` is 0.
std::uint32_t crc32(const void* bytes, std::size_t size, std::uint32_t before = 0);

}  // namespace vitreo
