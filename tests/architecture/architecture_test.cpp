// Include table of docs/architecture.md against the sources: every include is read, each one that
// is forbidden is named.
// SPDX-License-Identifier: Apache-2.0
#include "tests/architecture/source_rules.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace vitreo::architecture {
namespace VITREO_TEST_FILE {

TEST(Architecture, IsKeptByEverySource) {
  const std::filesystem::path root = VITREO_SOURCE_DIR;
  for (const std::string_view folder : kEverything) {
    int sources = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const auto extension = entry.path().extension();
      if (!entry.is_regular_file() ||
          (extension != ".h" && extension != ".cpp" && extension != ".inc"))
        continue;
      ++sources;
      std::ostringstream text;
      text << std::ifstream(entry.path()).rdbuf();
      for (const auto& finding :
           findings_in(entry.path().lexically_relative(root).generic_string(), text.str()))
        ADD_FAILURE() << finding;
    }
    EXPECT_GT(sources, 0) << folder << " has no sources: was it moved?";
  }
}

// The test above can fail: what follows feeds the checker lines that are wrong, and their neighbors
// that are right.

int findings_for(const std::string& path, const std::string& line) {
  const std::string head =
      "// What this file is for, in one line.\n// SPDX-License-Identifier: Apache-2.0\n";
  return static_cast<int>(findings_in(path, head + line + "\n").size());
}
void expect_good(const std::string& path, const std::string& line) {
  EXPECT_EQ(findings_for(path, line), 0) << line;
}
void expect_bad(const std::string& path, const std::string& line) {
  EXPECT_EQ(findings_for(path, line), 1) << path << " may say " << line;
}

TEST(ArchitectureChecker, KnowsWhichFolderMayIncludeWhich) {
  for (const std::string pure : {"optics/rays", "vision", "control"}) {
    expect_good(pure + "/a.cpp", "#include \"" + pure + "/a.h\"");
    expect_bad(pure + "/a.cpp", "#include \"devices/time/clock.h\"");
    expect_bad(pure + "/a.cpp", "#include \"host/session/session.h\"");
  }
  expect_bad("optics/rays/a.h", "#include \"vision/ellipse.h\"");
  expect_bad("control/a.h", "  #  include \"optics/pose/pose.h\"");
  expect_bad("devices/time/clock.cpp", "#include \"optics/pose/pose.h\"");
  expect_good("devices/sim/world.cpp", "#include \"devices/sim/world.h\"");
  expect_good("devices/sim/world.cpp", "#include \"optics/rays/trace.h\"");
  expect_bad("devices/sim/world.cpp", "#include \"vision/ellipse.h\"");
}

TEST(ArchitectureChecker, KnowsWhichRoomMayIncludeWhich) {
  expect_good("optics/pose/pose.cpp", "#include \"optics/projection/single_viewpoint.h\"");
  expect_bad("optics/projection/single_viewpoint.h", "#include \"optics/pose/pose.h\"");
  expect_bad("optics/a.h", "#include \"optics/pose/pose.h\"");  // of no room
  expect_good("devices/instruments/usb3103/driver.cpp",
              "#include \"devices/instruments/usb3103/wire.h\"");
  expect_bad("devices/instruments/usb3103/driver.cpp", "#include \"devices/sim/world.h\"");
  expect_bad("devices/links/tcp_link.cpp", "#include \"devices/roles/camera.h\"");
  expect_bad("devices/roles/stage.cpp", "#include \"devices/links/tcp_link.h\"");
  expect_good("host/session/session.cpp", "#include \"vision/ellipse.h\"");
  expect_bad("host/record/recorder.cpp", "#include \"host/servo/servo.h\"");
  expect_bad("host/record/recorder.cpp", "#include \"host/runs/report.h\"");
  expect_bad("host/engine/run_engine.cpp", "#include \"host/view/live_view.h\"");
  expect_bad("host/files/ndtiff.cpp", "#include \"host/config/config.h\"");
  expect_bad("host/session/session.cpp", "#include \"host/lua/engine/engine.h\"");
  expect_bad("host/lua/interpreter/state.cpp", "#include \"host/lua/optics/classes.h\"");
  expect_bad("host/lua/vision/a.cpp", "#include \"host/lua/optics/classes.h\"");
  expect_good("host/lua/engine/library.cpp", "#include \"host/lua/optics/classes.h\"");
  expect_good("host/lua/rig/bind_simulation.cpp", "#include \"devices/sim/world.h\"");
  expect_good("host/cli/program.cpp", "#include \"host/lua/engine/engine.h\"");
  expect_bad("host/a.cpp", "#include <vector>");  // of no room
}

TEST(ArchitectureChecker, KnowsWhereLibrariesBelong) {
  expect_good("host/lua/engine/engine.cpp", "#include <lua.hpp>");
  for (const char* path : {"host/session/session.cpp", "host/cli/main.cpp",
                           "devices/time/clock.cpp", "optics/rays/a.cpp"})
    expect_bad(path, "#include <lua.hpp>");
  for (const char* library : {"fmt/core.h", "sqlite3.h", "nlohmann/json.hpp"}) {
    const std::string line = "#include <" + std::string(library) + ">";
    expect_good("host/session/session.cpp", line);
    for (const char* path :
         {"optics/rays/a.h", "vision/a.h", "control/a.h", "devices/time/a.h", "devices/sim/a.h"})
      expect_bad(path, line);
  }
  expect_good("host/cli/command_line.cpp", "#include <CLI/CLI.hpp>");
  for (const char* path : {"host/cli/run.cpp", "host/session/session.cpp", "host/cli/main.cpp"})
    expect_bad(path, "#include <CLI/CLI.hpp>");
  expect_good("devices/links/serial_port.cpp", "#include <libserialport.h>");
  for (const char* path : {"devices/links/serial_link.cpp", "devices/instruments/zaber/driver.cpp",
                           "host/rig/open_rig.cpp"})
    expect_bad(path, "#include <libserialport.h>");
  expect_good("optics/pose/a.cpp", "#include <ceres/ceres.h>");
  expect_bad("devices/sim/a.cpp", "#include <ceres/ceres.h>");
  expect_good("vision/a.cpp", "#include <opencv2/imgproc.hpp>");
  expect_good("vision/a.cpp", "#include <opencv2/video/tracking.hpp>");
  expect_bad("vision/a.cpp", "#include <opencv2/videoio.hpp>");
  expect_bad("vision/a.cpp", "#include <opencv2/opencv.hpp>");
  expect_good("devices/roles/camera.h", "#include <opencv2/core/mat.hpp>");
  expect_bad("devices/roles/camera.h", "#include <opencv2/imgproc.hpp>");
  expect_bad("optics/rays/a.cpp", "#include <opencv2/core.hpp>");
  expect_bad("control/a.cpp", "#include <opencv2/core.hpp>");
  expect_bad("host/rig/a.cpp", "#include <gsl/span>");
}

TEST(ArchitectureChecker, KnowsTheStandardLibraryFromTheSystem) {
  expect_good("optics/rays/a.cpp", "#include <vector>");
  expect_bad("optics/rays/a.cpp", "#include <vectors>");
  expect_bad("optics/rays/a.cpp", "#include <math.h>");
  expect_bad("optics/rays/a.cpp", "#include <fstream>");
  expect_bad("control/a.cpp", "#include <chrono>");
  expect_good("devices/time/clock.cpp", "#include <thread>");
  for (const char* header : {"unistd.h", "sys/socket.h", "signal.h", "fcntl.h"}) {
    const std::string line = "#include <" + std::string(header) + ">";
    expect_good("devices/links/hid_link.cpp", line);
    expect_good("host/safety/guardian.cpp", line);
    for (const char* path : {"optics/rays/a.h", "vision/a.h", "control/a.h", "devices/sim/a.h"})
      expect_bad(path, line);
  }
}

TEST(ArchitectureChecker, WantsOursInQuotesAndOthersInBrackets) {
  expect_bad("devices/time/clock.cpp", "#include <devices/time/clock.h>");
  expect_bad("devices/time/clock.cpp", "#include \"clock.h\"");
  expect_bad("devices/time/clock.cpp", "#include \"../devices/time/clock.h\"");
  expect_bad("devices/time/clock.cpp", "#include \"Eigen/Core\"");
  expect_bad("util/a.h", "#include <vector>");
}

TEST(ArchitectureChecker, NamesFileAndLine) {
  const auto findings = findings_in("optics/rays/a.cpp",
                                    "// What it is for, briefly.\n// SPDX-License-Identifier: "
                                    "Apache-2.0\n\n#include <lua.hpp>\n");
  EXPECT_EQ(findings, std::vector<std::string>{
                          "optics/rays/a.cpp:4: <lua.hpp> is forbidden in optics/rays/"});
}

TEST(ArchitectureChecker, WantsAPurposeALicenseAndNothingLeftToDo) {
  const std::string license = "// SPDX-License-Identifier: Apache-2.0\n";
  EXPECT_EQ(findings_in("optics/rays/a.h", "// What it is for, briefly.\n").size(), 1U);
  EXPECT_EQ(findings_in("optics/rays/a.h", license).size(), 1U);
  EXPECT_EQ(findings_in("optics/rays/a.h", "#pragma once\n" + license).size(), 1U);
  EXPECT_EQ(findings_in("optics/rays/a.h", "").size(), 1U);
  EXPECT_EQ(
      findings_in("optics/rays/a.h",
                  "// What it is for, briefly, and so on. SPDX-License-Identifier: Apache-2.0\n")
          .size(),
      1U);
  EXPECT_EQ(findings_in("optics/rays/a.cpp", license + "#include \"optics/rays/a.h\"\n").size(),
            0U);  // the header says it
  EXPECT_EQ(findings_in("optics/rays/a.cpp", license + "#include \"optics/rays/b.h\"\n").size(),
            1U);
  expect_bad("optics/rays/a.h", "int a;  // TODO: more");
  expect_bad("optics/rays/a.h", "// FIXME");
  expect_good("optics/rays/a.h", "int kTODOs = 0;");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::architecture
