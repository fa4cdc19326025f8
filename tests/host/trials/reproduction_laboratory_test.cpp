// The column of the emulated laboratory, kept in a file between reproductions.
// SPDX-License-Identifier: Apache-2.0
#include "host/trials/reproduction_laboratory.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;

struct ReproductionLaboratory : ::testing::Test {
  ReproductionLaboratory() {
    std::string folder = (fs::temp_directory_path() / "vitreo_laboratory_XXXXXX").string();
    if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no folder");
    file = fs::path(folder) / "laboratory.json";
  }
  ~ReproductionLaboratory() override { fs::remove_all(file.parent_path()); }
  static ReproducedRun run(const std::string& key, const std::string& row, double ours) {
    ReproducedRun run;
    run.plan.key = key;
    run.plan.laboratory = "octomag_lab";
    run.outcome = "completed";
    ReproducedRow one;
    one.id = row;
    one.unit = "m";
    one.ours = ours;
    run.rows.push_back(one);
    return run;
  }
  fs::path file;
};

TEST_F(ReproductionLaboratory, IsOfThoseRunsThatHaveARigOfRealDrivers) {
  PlannedRun without;
  without.key = "pure";
  const auto runs = laboratory_runs({without, run("square", "6.5", 1).plan});
  ASSERT_EQ(runs.size(), 1U);
  EXPECT_EQ(runs[0].key, "square");
}

TEST_F(ReproductionLaboratory, StandsBesideTheSimulatedNumbersOfTheSameRows) {
  keep_laboratory({run("square", "6.5", 140e-6)}, file);
  std::vector<ReproducedRun> runs{run("square", "6.5", 137e-6), run("upright", "6.5", 60e-6)};
  join_laboratory(runs, file);
  ASSERT_TRUE(runs[0].rows[0].laboratory);
  EXPECT_DOUBLE_EQ(*runs[0].rows[0].laboratory, 140e-6);
  EXPECT_FALSE(runs[1].rows[0].laboratory) << "another run has rows of the same name";
  const std::string page = reproduction_markdown(runs);
  EXPECT_NE(page.find("| 137 µm | 140 µm |"), std::string::npos) << page;
}

TEST_F(ReproductionLaboratory, ForgetsARunThatDidNotComplete) {
  keep_laboratory({run("square", "6.5", 140e-6), run("hold", "6.6", 1e-6)}, file);
  ReproducedRun failed = run("square", "6.5", 0);
  failed.outcome = "aborted";
  failed.rows.clear();
  keep_laboratory({failed}, file);
  std::vector<ReproducedRun> runs{run("square", "6.5", 137e-6), run("hold", "6.6", 1e-6)};
  join_laboratory(runs, file);
  EXPECT_FALSE(runs[0].rows[0].laboratory);
  EXPECT_TRUE(runs[1].rows[0].laboratory);
}

TEST_F(ReproductionLaboratory, IsEmptyWithoutAFileAndSaysWhenTheFileIsAnother) {
  std::vector<ReproducedRun> runs{run("square", "6.5", 137e-6)};
  join_laboratory(runs, file);
  EXPECT_FALSE(runs[0].rows[0].laboratory);
  std::ofstream(file) << "[1]";
  EXPECT_THROW(join_laboratory(runs, file), std::runtime_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
