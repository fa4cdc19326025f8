// Error messages in words of our own where a library's would reach people.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>
#include <string>

namespace vitreo {

/// What `error` says. An error of the JSON library, whose texts begin with
/// "[json.exception.type_error.302]", is told in our words: what is missing, of what kind it must
/// be, or where a text ceases to be JSON.
std::string error_words(const std::exception& error);

}  // namespace vitreo
