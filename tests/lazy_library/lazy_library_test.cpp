// Stand-ins for lazily opened libraries (cmake/lazy_library.cpp.in): one whose library is absent,
// and one whose library lacks a function.
// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

extern "C" {
int lazy_absent(int);
int lazy_missing(int);
double lazy_weighted_sum(int count, double a, double b, double c, double d, double e, double f,
                         double g, double h, double on_stack);
}

namespace vitreo {
namespace {

std::string error_of(int (*function)(int)) {
  try {
    function(1);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(LazyLibrary, ThatIsAbsentSaysSoAtEveryCall) {
  const std::string first = error_of(lazy_absent);
  EXPECT_NE(first.find("libvitreo_not_there.so.1 cannot be loaded: "), std::string::npos) << first;
  EXPECT_NE(first.find("No such file"), std::string::npos) << first;
  // dlerror() gives its text once, and null afterwards.
  EXPECT_EQ(error_of(lazy_absent), first);
  EXPECT_EQ(error_of(lazy_absent), first);
}

TEST(LazyLibrary, ThatLacksAFunctionNamesItAtEveryCall) {
  for (int call = 0; call < 2; ++call)
    EXPECT_EQ(error_of(lazy_missing), "liblazy_present.so has no lazy_missing");
}

TEST(LazyLibrary, ReceivesTheArgumentsOfTheFirstCallAndOfLaterOnes) {
  for (int call = 0; call < 3; ++call)
    EXPECT_EQ(lazy_weighted_sum(2, 1, 1, 1, 1, 1, 1, 1, 1, 1), 90);
}

}  // namespace
}  // namespace vitreo
