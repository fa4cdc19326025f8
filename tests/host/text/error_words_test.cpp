// SPDX-License-Identifier: Apache-2.0
#include "host/text/error_words.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <functional>
#include <stdexcept>
#include <string>
#include <tuple>

namespace vitreo {
namespace VITREO_TEST_FILE {

using nlohmann::json;

std::string said(const std::function<void()>& what) {
  try {
    what();
  } catch (const std::exception& error) {
    return error_words(error);
  }
  return "nothing was thrown";
}

TEST(ErrorWords, OfTheJsonLibraryAreOurs) {
  const json table = {{"by", 5}, {"list", {1, 2}}};
  EXPECT_EQ(said([&] { static_cast<void>(table.at("by").get<std::string>()); }),
            "a value is of the wrong kind: wants a text, got a number");
  EXPECT_EQ(said([&] { static_cast<void>(table.at("list").get<double>()); }),
            "a value is of the wrong kind: wants a number, got a list");
  EXPECT_EQ(said([&] { static_cast<void>(table.at("text")); }), "text: is missing");
  EXPECT_EQ(said([&] { static_cast<void>(table.at("list").at(7)); }), "a list is too short");
  EXPECT_EQ(said([&] { static_cast<void>(json("\xff").dump()); }), "a text is not UTF-8");
  EXPECT_EQ(said([&] { std::ignore = json::parse("{\"a\": nul}"); }), "is no JSON from byte 10 on");
  EXPECT_EQ(said([&] { static_cast<void>(table.at("by").at("x")); }),
            "a value is of the wrong kind");
  EXPECT_EQ(said([&] { std::ignore = json::parse("1e999"); }), "a number is too large");
}

TEST(ErrorWords, OfOthersStay) {
  EXPECT_EQ(said([] { throw std::runtime_error("the stage is stuck"); }), "the stage is stuck");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
