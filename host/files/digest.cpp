// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"

#include <fmt/format.h>

#include <array>
#include <openssl/evp.h>
#include <stdexcept>
#include <zlib.h>

namespace vitreo {
namespace {

// EVP returns 1 for success, and 0 or a negative number for failure.
void require_success(int result) {
  if (result != 1) throw std::runtime_error("SHA-256: libcrypto refuses it");
}

}  // namespace

void Sha256::Free::operator()(evp_md_ctx_st* context) const { EVP_MD_CTX_free(context); }

// EVP_DigestInit_ex() fails where no provider of libcrypto offers the algorithm: an error, never
// another digest.
Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  require_success(context_ ? EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) : 0);
}

Sha256& Sha256::update(std::string_view bytes) {
  require_success(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size()));
  return *this;
}

// EVP_DigestFinal_ex() adds the padding and the length, so that a later update() would be an error.
std::string Sha256::hex() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  require_success(EVP_DigestFinal_ex(context_.get(), digest.data(), &size));
  std::string text;
  for (unsigned int i = 0; i < size; ++i) text += fmt::format("{:02x}", digest[i]);
  return text;
}

std::string sha256(std::string_view bytes) { return Sha256().update(bytes).hex(); }

// crc32_z() takes a size of 64 bits; crc32() would cut it to 32, and a frame's bytes may be more.
std::uint32_t crc32(const void* bytes, std::size_t size, std::uint32_t before) {
  // zlib takes a null pointer for the request to begin anew, and answers 0 whatever came before.
  if (size == 0) return before;
  return static_cast<std::uint32_t>(::crc32_z(before, static_cast<const Bytef*>(bytes), size));
}

}  // namespace vitreo
