// The live view as its user meets it: the real program, and headless Chromium with real clicks
// (tests/page/live_view.mjs).
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace {

bool there(const std::string& what) { return std::system(("command -v " + what + " >/dev/null 2>&1").c_str()) == 0; }

TEST(LiveView, ShowsSteersAndStopsARun) {
  if (!there("node") || !there("chromium") || !std::filesystem::exists(VITREO_PAGE_TEST "/node_modules"))
    GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  const Workplace place;
  place.write("work.sh", "'" VITREO_PROGRAM
                         "' view --operator 'Eve <b>Bold</b>' >out 2>err &\n"
                         "program=$!\n"
                         "for i in $(seq 150); do\n"
                         "  address=$(cat out err | grep -o 'http://127.0.0.1:[0-9]*/?token=[0-9a-f]*' | head -n 1)\n"
                         "  [ -n \"$address\" ] && break\n"
                         "  sleep 0.1\n"
                         "done\n"
                         "timeout 150 node " VITREO_PAGE_TEST
                         "/live_view.mjs \"$address\" . \"$(command -v chromium)\" >seen 2>seen.err\n"
                         "kill -INT $program 2>/dev/null\n"
                         "wait $program\n"
                         "echo $? >code\n");
  ASSERT_EQ(std::system(("cd '" + place.folder().string() + "' && sh work.sh").c_str()), 0);
  const auto seen = nlohmann::json::parse(place.read("seen"), nullptr, false);
  ASSERT_TRUE(seen.is_object()) << place.read("seen") << place.read("seen.err") << place.read("err");
  if (const char* keep = std::getenv("VITREO_KEEP_PICTURES"))
    std::system(("cp '" + place.folder().string() + "'/*.png '" + keep + "'").c_str());
  EXPECT_FALSE(seen.contains("failed")) << seen << place.read("err");
  EXPECT_TRUE(seen["errors"].empty()) << seen["errors"];
  EXPECT_EQ(seen["addressAfter"].get<std::string>().find("token"), std::string::npos);
  EXPECT_EQ(seen["withoutControl"], 0);
  EXPECT_EQ(seen["note"].get<std::string>().rfind("target ", 0), 0U) << seen["note"];
  EXPECT_NE(seen["distance"].get<std::string>().find("mm"), std::string::npos);
  EXPECT_EQ(seen["secondVisit"], 403);
  EXPECT_EQ(seen["state"].get<std::string>().rfind("ended: stopped", 0), 0U) << seen["state"];
  EXPECT_EQ(place.read("code"), "3\n") << place.read("out") << place.read("err");
  EXPECT_NE((place.read("out") + place.read("err")).find("target 1:"), std::string::npos);
}

}  // namespace
}  // namespace vitreo
