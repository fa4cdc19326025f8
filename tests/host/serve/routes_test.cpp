// Interface of the workbench: its description against its routes, forms, files and messages.
// SPDX-License-Identifier: Apache-2.0
#include "host/serve/routes.h"

#include "host/config/config.h"
#include "host/files/run_folder.h"
#include "host/serve/job_process.h"
#include "host/serve/messages.h"
#include "host/text/units.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <sys/stat.h>

namespace vitreo::serve {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;

struct Folder {
  Folder() : path(fs::temp_directory_path() / ("vitreo_serve_" + random_hex(8))) {
    fs::create_directory(path);
  }
  ~Folder() { fs::remove_all(path); }
  fs::path write(const std::string& name, const std::string& text, fs::perms mode) const {
    const fs::path file = path / name;
    fs::create_directories(file.parent_path());
    std::ofstream(file) << text;
    fs::permissions(file, mode);
    return file;
  }
  std::string read(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(path / name).rdbuf();
    return text.str();
  }
  const fs::path path;
};

constexpr auto kMine = fs::perms(0600);
constexpr auto kProgram = fs::perms(0700);

Parameter speed() {
  Parameter parameter;
  parameter.name = "speed";
  parameter.unit = "mm/s";
  parameter.fallback = 0.0005;
  return parameter;
}

TEST(Routes, AreThoseOfTheDescription) {
  std::ifstream file(VITREO_SOURCE_DIR "/docs/reference/openapi.json");
  const nlohmann::json described = nlohmann::json::parse(file);
  std::vector<std::string> names;
  for (const auto& [path, methods] : described.at("paths").items())
    for (const auto& [method, about] : methods.items()) {
      std::string upper = method;
      std::transform(upper.begin(), upper.end(), upper.begin(), ::toupper);
      names.push_back(upper + " " + path);
      EXPECT_TRUE(about.contains("operationId")) << path;
    }
  std::vector<std::string> routes = route_names();
  std::sort(names.begin(), names.end());
  std::sort(routes.begin(), routes.end());
  EXPECT_EQ(names, routes);
}

TEST(Routes, OnlyWhatSteersARunIsUrgent) {
  EXPECT_TRUE(is_urgent({"POST", "/api/run", "{}"}));
  EXPECT_FALSE(is_urgent({"GET", "/api/run", ""}));
  EXPECT_FALSE(is_urgent({"POST", "/api/runs", ""}));
  EXPECT_FALSE(is_urgent({"POST", "/api/queue", ""}));
}

TEST(Forms, ABareNumberHasTheUnitOfItsField) {
  EXPECT_EQ(with_unit_of(speed(), "1"), "1mm/s");
  EXPECT_EQ(with_unit_of(speed(), "1e-1"), "1e-1mm/s");
  EXPECT_EQ(with_unit_of(speed(), "0.1,0.5"), "0.1,0.5mm/s");
  EXPECT_EQ(with_unit_of(speed(), "0.1..2:5"), "0.1..2mm/s:5");
  EXPECT_EQ(with_unit_of(speed(), "0.1..2:5:log"), "0.1..2mm/s:5:log");
  EXPECT_EQ(with_unit_of(speed(), "500 um/s"), "500 um/s") << "a unit that is typed stays";
  EXPECT_EQ(with_unit_of(speed(), ""), "");
  Parameter text;
  text.kind = ParameterKind::text;
  EXPECT_EQ(with_unit_of(text, "12"), "12");
}

TEST(Shelf, GivesOnlyPlainFilesOfRunsAndSweeps) {
  const Folder folder;
  folder.write("secret", "secret", kMine);
  folder.write("runs/a/report.html", "<p>report</p>", kMine);
  folder.write("sweeps/b/runs/c/report.html", "<p>point</p>", kMine);
  fs::create_symlink("../../secret", folder.path / "runs/a/link.txt");
  fs::create_directory_symlink("..", folder.path / "runs/up");
  const Shelf shelf(folder.path / "runs", folder.path / "sweeps");
  const view::WebReply report = shelf.file("/runs/a/report.html");
  EXPECT_EQ(report.status, 200);
  EXPECT_EQ(report.body, "<p>report</p>");
  ASSERT_FALSE(report.headers.empty());
  EXPECT_EQ(report.headers[0].first, "Content-Security-Policy");
  EXPECT_EQ(report.headers[0].second.rfind("sandbox", 0), 0U) << report.headers[0].second;
  EXPECT_EQ(shelf.file("/sweeps/b/runs/c/report.html").body, "<p>point</p>");
  for (const char* path :
       {"/runs/../secret", "/runs/a/../../secret", "/runs/a/link.txt", "/runs/up/secret", "/runs",
        "/runs/a", "/runs//a/report.html", "/secret", "/other/secret", "/runs/a/none",
        "/runs/a/report.html/", "/runs/.hidden", "/runs/a/report.html\n"})
    EXPECT_EQ(shelf.file(path).status, 404) << path;
}

TEST(Shelf, RefusesNamesThatLeadElsewhere) {
  const Folder folder;
  folder.write("runs/a/x", "", kMine);
  Shelf shelf(folder.path / "runs", folder.path / "sweeps");
  for (const char* name : {"", "..", ".", "a/../..", "/etc", "none", "a\\b"})
    EXPECT_THROW(shelf.run(name), ConfigError) << name;
  EXPECT_THROW(shelf.compare({"a"}), ConfigError) << "one is no comparison";
  EXPECT_EQ(shelf.run("a").at("outcome"), "unreadable") << "its row stays";
}

TEST(Messages, SettingsThatWouldBeReadAndIgnoredAreRefused) {
  const Folder folder;
  const auto refused = [&folder](const std::string& text, const std::string& why) {
    const fs::path file = folder.write("messages.json", text, kMine);
    try {
      read_message_settings(file);
      ADD_FAILURE() << text << " was taken";
    } catch (const ConfigError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("messages.json"), std::string::npos);
    }
  };
  EXPECT_TRUE(read_message_settings(folder.path / "none").channels.empty());
  refused("junk", "no JSON object");
  refused(R"({"mesages": []})", "did you mean messages?");
  refused(R"({"messages": [{"to": "pigeon"}]})", "mail, webhook or command");
  refused(R"({"messages": [{"to": "mail", "address": "anna"}]})", "NAME@HOST");
  refused(R"({"messages": [{"to": "mail", "address": "a@b\nBcc: c@d"}]})", "one line");
  refused(R"({"messages": [{"to": "webhook", "url": "file:///etc/passwd"}]})", "https://");
  refused(R"({"messages": [{"to": "command", "words": []}]})", "the program first");
  refused(R"({"messages": [{"to": "command", "words": ["a"], "when": "never"}]})",
          "failed or ended");
  const fs::path open = folder.write("messages.json", "{}", fs::perms(0666));
  EXPECT_THROW(read_message_settings(open), ConfigError) << "others may write what is run";
}

Message message_to(const nlohmann::json& channel) {
  Message message;
  message.channel = channel.dump();
  message.subject = "Eye length overnight failed at 03:12";
  message.text = "Coils: 0 A, read back\n\"quoted\" \\ \u00b5m";
  return message;
}

// RFC 5322 and 2047: fields, an empty line, the body.
TEST(Messages, AMailIsWhatSendmailTakes) {
  const Folder folder;
  const fs::path program = folder.write("sendmail",
                                        "#!/bin/sh\necho \"$@\" > '" + folder.path.string() +
                                            "/words'\ncat > '" + folder.path.string() + "/mail'\n",
                                        kProgram);
  Message message =
      message_to({{"to", "mail"}, {"address", "anna@lab.example"}, {"sendmail", program.string()}});
  tell(message);
  EXPECT_EQ(folder.read("words"), "-t -oi\n");
  const std::string mail = folder.read("mail");
  EXPECT_EQ(mail.rfind("To: anna@lab.example\nSubject: Eye length overnight failed at 03:12\n", 0),
            0U)
      << mail;
  EXPECT_NE(mail.find("\n\nEye length overnight failed"), std::string::npos);
  message.subject = "5 \u00b5m";
  tell(message);
  // printf '5 \302\265m' | base64
  EXPECT_NE(folder.read("mail").find("Subject: =?utf-8?B?NSDCtW0=?=\n"), std::string::npos)
      << folder.read("mail");
}

TEST(Messages, ACommandGetsTheFirstLineAsAWordAndAllAsInput) {
  const Folder folder;
  const fs::path program = folder.write("notify",
                                        "#!/bin/sh\necho \"$2\" > '" + folder.path.string() +
                                            "/word'\ncat > '" + folder.path.string() + "/input'\n",
                                        kProgram);
  tell(message_to({{"to", "command"}, {"words", {program.string(), "-u"}}}));
  EXPECT_EQ(folder.read("word"), "Eye length overnight failed at 03:12\n");
  EXPECT_NE(folder.read("input").find("read back"), std::string::npos);
}

TEST(Messages, WhatWasNotTakenIsAnErrorThatNamesTheProgram) {
  const auto why = [](const nlohmann::json& channel) {
    try {
      tell(message_to(channel));
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  EXPECT_EQ(why({{"to", "command"}, {"words", {"false"}}}), "false left with 1");
  EXPECT_NE(why({{"to", "command"}, {"words", {"/none/such"}}}).find("no such program"),
            std::string::npos);
  // Port 9 of this machine: discard, which nothing serves.
  EXPECT_NE(why({{"to", "webhook"}, {"url", "http://127.0.0.1:9/hook"}}).find("curl left with 7"),
            std::string::npos);
}

TEST(Messages, AChannelIsShownWithoutItsSecrets) {
  EXPECT_EQ(channel_text({{"to", "webhook"},
                          {"url", "https://anna:secret@hooks.example:8443/services/secret?k=s"}}),
            "webhook at hooks.example:8443");
  EXPECT_EQ(channel_text({{"to", "mail"}, {"address", "anna@lab.example"}}),
            "mail to anna@lab.example");
  EXPECT_EQ(channel_text({{"to", "command"}, {"words", {"notify-send", "secret"}}}),
            "command notify-send");
}

TEST(Messages, AnEndIsToldToThoseWhoWantEveryEndAndAFailureToAll) {
  MessageSettings settings;
  settings.link = "http://127.0.0.1:7600";
  settings.channels = {{{"to", "mail"}, {"address", "a@b"}},
                       {{"to", "mail"}, {"address", "c@d"}, {"when", "ended"}}};
  const auto ended = messages_for(settings, Occasion::end, 4, "Hold completed\nmore", "text", 7);
  ASSERT_EQ(ended.size(), 1U);
  EXPECT_NE(ended[0].channel.find("c@d"), std::string::npos);
  EXPECT_EQ(ended[0].subject, "Vitreo: Hold completed") << "one line";
  EXPECT_NE(ended[0].text.find("http://127.0.0.1:7600/#/job/4"), std::string::npos);
  EXPECT_EQ(messages_for(settings, Occasion::failure, 4, "s", "t", 7).size(), 2U);
}

TEST(JobProcess, IsAliveUntilNothingOfItIsLeft) {
  const Folder folder;
  const JobProcess process(folder.path / "1");
  EXPECT_FALSE(process.alive());
  // Its child outlives it by some tenths of a second, as a guardian may.
  const int number = process.start(
      {"/bin/sh", "-c", "sleep 0.4 & echo 'live view: http://127.0.0.1:5/?token=x' >&2"});
  EXPECT_TRUE(process.alive());
  EXPECT_THROW(process.start({"/bin/true"}), std::runtime_error) << "it goes on";
  for (int i = 0; i < 200 && process.alive(); ++i) usleep(10000);
  EXPECT_FALSE(process.alive());
  JobProcess::reap(number);
  EXPECT_EQ(process.live_view(), "http://127.0.0.1:5/");
  EXPECT_EQ(process.end(false).outcome, "lost");
  EXPECT_TRUE(process.end(false).hold) << "what became of the rig is not known";
}

TEST(JobProcess, ReadsHowARunEndedFromItsLastLine) {
  const Folder folder;
  const JobProcess process(folder.path);
  const auto end_of = [&](const std::string& out, bool sweep = false) {
    folder.write("out", out, kMine);
    return process.end(sweep);
  };
  const JobEnd completed =
      end_of("noise\n{\"outcome\":\"completed\",\"exit_code\":0,\"run\":\"/x/runs/a\"}\n");
  EXPECT_EQ(completed.outcome, "completed");
  EXPECT_EQ(completed.run, "a");
  EXPECT_FALSE(completed.hold);
  EXPECT_TRUE(end_of(R"({"outcome":"aborted","exit_code":6,"run":"a","reason":"r"})").hold)
      << "a script that did not respond";
  EXPECT_TRUE(end_of(R"({"error":"coils: not there","exit_code":7})").hold);
  const JobEnd refused = end_of(R"({"error":"speed: is too large","exit_code":2})");
  EXPECT_EQ(refused.outcome, "refused");
  EXPECT_EQ(refused.reason, "speed: is too large");
  EXPECT_FALSE(refused.hold);
  const JobEnd sweep = end_of(
      R"({"exit_code":1,"sweep":"/x/sweeps/s","outcomes":{"completed":18,"failed":2}})", true);
  EXPECT_EQ(sweep.outcome, "failed");
  EXPECT_EQ(sweep.reason, "18 completed, 2 failed");
  EXPECT_EQ(sweep.run, "s");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::serve
