// Calibration files: the layout ETH's software writes, read to the number; what is wrong named with
// its line.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/field_calibration_yaml.h"

#include "control/multipole_fit.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

// The layout of the real files (keys in any order, block lists, ~ for none, a nested dash), with
// numbers of our own.
const std::string kFile = R"(#
# a comment
#
Coil_List:
  - Coil_0
  - Coil_1
  - Offset
Coil_1:
  Src_0:
    A_Coeff: ~
    B_Coeff:
      - 9.5e-07
      - -2.5e-09
    Source_Direction:
      - 0.6
      - 0
      - -0.8
    Source_Position:
      - -0.016
      - 0.063
      - -0.068
  Source_List:
    - Src_0
Coil_0:
  Source_List: [Src_1, Src_0]   # as some write it
  Src_1:
    B_Coeff: [-2e-06]
    A_Coeff: [1e-3, 2]
    Source_Direction: [0.0,
      1.0, 0.0]
    Source_Position: [0.1, 0.2, 0.3]
  Src_0:
    Source_Direction:
    - 0
    - 0
    - 1
    Source_Position:
    - 112262.25
    - 2
    - 3
    A_Coeff: ~
    B_Coeff:
    - 3.6e12
Offset:
  Source_List:
    - Src_0
  Src_0:
    A_Coeff:
      - 5e-5
    B_Coeff: ~
    Source_Position: [0, 0, 0]
    Source_Direction: [1, 0, 0]
System_Name: Two_Coils
Workspace_Dimensions:
  -
    - -0.01
    - 0.01
  -
    - -0.02
    - 0.02
  - - -0.03
    - 0.03
)";

std::string with(std::string from, const std::string& to) {
  std::string text = kFile;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string complaint(const std::string& text) {
  try {
    parse_field_calibration(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(FieldCalibrationFile, is_read_in_the_layout_that_eth_writes) {
  const control::FieldCalibration file = parse_field_calibration(kFile);
  EXPECT_EQ(file.system_name, "Two_Coils");
  ASSERT_EQ(file.field.coils(), 2);
  const auto& first = file.field.sources()[0];
  ASSERT_EQ(first.size(), 2U);
  EXPECT_EQ(first[0].position, Eigen::Vector3d(0.1, 0.2, 0.3));  // the order of Source_List
  EXPECT_EQ(first[0].axis, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(first[0].regular, (std::vector<double>{1e-3, 2}));
  EXPECT_EQ(first[0].irregular, (std::vector<double>{-2e-6}));
  EXPECT_EQ(first[1].position.x(), 112262.25);
  EXPECT_EQ(first[1].irregular, (std::vector<double>{3.6e12}));
  EXPECT_EQ(file.field.sources()[1][0].irregular, (std::vector<double>{9.5e-7, -2.5e-9}));
  EXPECT_EQ(file.field.region().low, Eigen::Vector3d(-0.01, -0.02, -0.03));
  EXPECT_EQ(file.field.region().high, Eigen::Vector3d(0.01, 0.02, 0.03));
  // Offset is the field without current: here uniform, 50 uT along x.
  EXPECT_LT(
      (file.field.background({1e-3, 2e-3, 3e-3}).head<3>() - Eigen::Vector3d(5e-5, 0, 0)).norm(),
      1e-19);
}

TEST(FieldCalibrationFile, written_and_read_again_is_the_same_to_the_bit) {
  const control::FieldCalibration file = parse_field_calibration(kFile);
  const std::string text = field_calibration_text(file);
  const control::FieldCalibration again = parse_field_calibration(text);
  EXPECT_EQ(again.system_name, file.system_name);
  EXPECT_EQ(again.field.matrix({1e-3, 2e-3, 3e-3}), file.field.matrix({1e-3, 2e-3, 3e-3}));
  EXPECT_EQ(again.field.background({0, 0, 0}), file.field.background({0, 0, 0}));
  EXPECT_EQ(field_calibration_text(again), text);
}

TEST(FieldCalibrationFile, reads_the_line_ends_of_windows_and_a_byte_order_mark) {
  std::string text = "\xef\xbb\xbf";
  for (const char c : kFile) text += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(field_calibration_text(parse_field_calibration(text)),
            field_calibration_text(parse_field_calibration(kFile)));
}

TEST(FieldCalibrationFile, reads_quoted_names_and_mappings_in_braces) {
  constexpr const char* kInBraces = R"(# as Python writes it
"Coil_List": ["North pole", 'B', Offset]
Workspace_Dimensions: [[-.01, 1e-2], [-0.02, .02], [-3E-2, 0.03]]
"North pole":
  Source_List: [Src_0]
  Src_0: {A_Coeff: ~, B_Coeff: [9.5e-07, -2.5e-09], Source_Position: [-0.016, 0.1, 0.2],
    "Source_Direction": [0.6, 0, -0.8]}
'B': {Source_List: [s], s: {A_Coeff: , B_Coeff: [+1e-6], Source_Position: [0, 0, .1], Source_Direction: [0, 0, 1]}}
Offset: {Source_List: [s], s: {A_Coeff: [5e-5], Source_Position: [0, 0, 0], Source_Direction: [1, 0, 0]}}
Notes: {}
)";
  const control::MultipoleField field = parse_field_calibration(kInBraces).field;
  EXPECT_EQ(field.coils(), 2);
  EXPECT_EQ(field.region().low, Eigen::Vector3d(-0.01, -0.02, -0.03));
  EXPECT_EQ(field.sources()[0][0].irregular, (std::vector<double>{9.5e-07, -2.5e-09}));
  EXPECT_EQ(field.sources()[0][0].axis, Eigen::Vector3d(0.6, 0, -0.8));
  EXPECT_TRUE(field.sources()[1][0].regular.empty());
  const auto expect = [](const std::string& text, const std::string& what) {
    EXPECT_NE(complaint(text).find(what), std::string::npos) << complaint(text);
  };
  expect("a: {b: 1", "line 1: ");
  expect("a: {b: 1, b: 2}", "line 1: 'b' is given twice");
  expect("a: {b: 1]", "line 1: ");
  expect("a: {b: 1} c", "line 1: ");
  expect("a: {: 1}", "line 1: a key without a name");
  expect("a: {[1]: 1}", "line 1: a key without a name");
  expect("a: {b:", "line 1: ");
  std::string deep = "a: ";
  for (int k = 0; k < 5000; ++k) deep += "{a: ";
  expect(deep, "nested too deeply");
  expect(deep + std::string(5000, '}'), "nested too deeply");
}

TEST(FieldCalibrationFile, says_what_is_wrong_and_in_which_line) {
  const auto expect = [](const std::string& text, const std::string& line,
                         const std::string& what) {
    const std::string said = complaint(text);
    EXPECT_EQ(said.rfind("line " + line + ": ", 0), 0U) << said;
    EXPECT_NE(said.find(what), std::string::npos) << said;
  };
  expect("", "1", "no keys");
  expect("just text", "1", "no keys");
  expect(with("Coil_List:", "Coils:"), "4", "Coil_List is missing");
  expect(with("  - Coil_1\n", "  - Coil_7\n"), "4", "Coil_7 is missing");
  expect(with("  - Coil_1\n", "  - Coil_0\n"), "6", "'Coil_0' is listed twice");
  expect(with("- 9.5e-07", "- 9.5e-07x"), "12", "Coil_1/Src_0/B_Coeff: '9.5e-07x' is not a number");
  expect(with("- 9.5e-07", "- .nan"), "12", "not a number");
  expect(with("- 9.5e-07", "- inf"), "12", "not finite");
  expect(with("- 9.5e-07", "- 1e999"), "12", "not a number");
  expect(with("      - 0.6\n", ""), "15", "Source_Direction: three numbers");
  expect(with("      - 0.6\n", "      - 0.9\n"), "15",
         "Coil_1/Src_0/Source_Direction: not a unit vector, its norm is 1.204");
  expect(with("Source_Position: [0.1, 0.2, 0.3]", "Src_Position: [0.1, 0.2, 0.3]"), "27",
         "Source_Position is missing");
  expect(with("Source_List: [Src_1, Src_0]", "Source_List: []"), "25", "Source_List: empty");
  expect(with("Workspace_Dimensions:", "Workspace:"), "4", "Workspace_Dimensions is missing");
  expect(with("    - -0.02\n", "    - 0.05\n"), "59", "low must be below high");
  expect(with("System_Name: Two_Coils", "Coil_List: [a]"), "53", "'Coil_List' is given twice");
  expect(with("System_Name: Two_Coils", "System_Name: *nothing"), "53", "anchor");
  EXPECT_NE(complaint(with("System_Name: Two_Coils", "System_Name: \"Two")), "");
  EXPECT_NE(complaint(with("System_Name: Two_Coils", "   System_Name: Two_Coils")), "");
  expect(with("[0.1, 0.2, 0.3]", "[0.1, 0.2, 0.3"), "32", "flow");
  expect(with("System_Name: Two_Coils", "System_Name: \x04"), "53", "control character");
  expect(std::string(kFile) + "---\nb: 1\n", "64", "a second document");
  expect(with("  - Offset\n", "  - Offset\n  - Offset_2\n"), "5", "more than one Offset");
  expect(std::string(100, '[') + "\n", "1", "nested too deeply");
  std::string deep;
  for (int k = 0; k < 5000; ++k) deep += "- ";
  expect(deep + "1", "1", "nested too deeply");
}

// What yaml-cpp, and so ETH's own reader, takes beside the layout that its writer makes.
TEST(FieldCalibrationFile, reads_anchors_block_scalars_text_over_lines_and_columns) {
  const std::string text = with("System_Name: Two_Coils", "System_Name: |\n  Two\n  Coils");
  EXPECT_EQ(parse_field_calibration(text).system_name, "Two Coils");
  EXPECT_EQ(
      parse_field_calibration(with("System_Name: Two_Coils", "System_Name: >-\n  Two\n  Coils"))
          .system_name,
      "Two Coils");
  EXPECT_EQ(parse_field_calibration(with("Two_Coils", "\"Two\n  Coils\"")).system_name,
            "Two Coils");
  const std::string anchored =
      with("    - Src_0\nCoil_0:", "    - Src_0\n    - Src_1\n  Src_1: *other\nCoil_0:");
  const std::size_t at = anchored.find("Coil_1:\n  Src_0:");
  ASSERT_NE(at, std::string::npos);
  const std::string with_anchor = std::string(anchored).replace(at, 16, "Coil_1:\n  Src_0: &other");
  const control::FieldCalibration file = parse_field_calibration(with_anchor);
  const auto& sources = file.field.sources()[1];
  ASSERT_EQ(sources.size(), 2U);
  EXPECT_EQ(sources[1].irregular, sources[0].irregular);
  EXPECT_EQ(sources[1].position, sources[0].position);
  const control::FieldCalibration column = parse_field_calibration(
      with("Source_Position: [0.1, 0.2, 0.3]", "Source_Position: [[0.1], [0.2], [0.3]]"));
  EXPECT_EQ(column.field.sources()[0][0].position, Eigen::Vector3d(0.1, 0.2, 0.3));
}

// optimized_quadrupole_5.yaml of ETH's public calibrations has a norm of 1.0014.
TEST(FieldCalibrationFile, normalizes_a_direction_up_to_5_percent_off_with_a_warning) {
  EXPECT_TRUE(parse_field_calibration(kFile).warnings.empty());
  EXPECT_TRUE(parse_field_calibration(with("      - 0.6\n", "      - 0.6005\n")).warnings.empty());
  const control::FieldCalibration off =
      parse_field_calibration(with("      - 0.6\n", "      - 0.602333\n"));
  ASSERT_EQ(off.warnings.size(), 1U);
  EXPECT_EQ(off.warnings[0],
            "line 15: Coil_1/Src_0/Source_Direction: not a unit vector, its norm is 1.001; "
            "normalized");
  EXPECT_NEAR(off.field.sources()[1][0].axis.norm(), 1, 1e-15);
  EXPECT_EQ(parse_field_calibration(with("      - 0.6\n", "      - 0.67\n")).warnings.size(), 1U);
  EXPECT_NE(complaint(with("      - 0.6\n", "      - 0.69\n")).find("not a unit vector"),
            std::string::npos);
  EXPECT_NE(complaint(with("Source_Direction: [1, 0, 0]", "Source_Direction: [0, 0, 0]"))
                .find("not a unit vector"),
            std::string::npos);
}

TEST(FieldCalibrationFile, refuses_what_is_too_large_before_it_costs_much) {
  EXPECT_NE(complaint(std::string((std::size_t{1} << 20) + 1, ' ')).find("larger than 1 MiB"),
            std::string::npos);
  std::string bomb = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (int k = 1; k < 12; ++k) {
    const std::string before = "*a" + std::to_string(k - 1);
    bomb += "a" + std::to_string(k) + ": &a" + std::to_string(k) + " [";
    for (int n = 0; n < 10; ++n) bomb += (n > 0 ? ", " : "") + before;
    bomb += "]\n";
  }
  EXPECT_NE(complaint(bomb).find("line 5: more than 50000 values"), std::string::npos)
      << complaint(bomb);
  std::string many = "a: [";
  for (int k = 0; k < 60000; ++k) many += "1, ";
  EXPECT_NE(complaint(many + "1]").find("more than 50000 values"), std::string::npos);
  EXPECT_NE(complaint("a: &a [*a]").find("line 1: "), std::string::npos) << complaint("a: &a [*a]");
}

TEST(FieldCalibrationFile, written_from_dipoles_it_is_read_back_to_the_bit_with_any_name) {
  std::mt19937_64 random(3);
  const control::Region box{Eigen::Vector3d::Constant(-12e-3), Eigen::Vector3d::Constant(12e-3)};
  const control::MultipoleField field =
      control::multipoles_like(control::CoilField::octomag().perturbed({}, random), 2, box);
  const std::string name = "Octo\"Mag' \\ n: #1";
  const control::FieldCalibration back =
      parse_field_calibration(field_calibration_text({name, field}));
  EXPECT_EQ(back.system_name, name);
  std::uniform_real_distribution<double> uniform(-9e-3, 9e-3);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d p(uniform(random), uniform(random), uniform(random));
    EXPECT_EQ(back.field.matrix(p), field.matrix(p));
  }
}

TEST(FieldCalibrationFile, survives_any_damage_with_a_clear_error_or_a_field) {
  std::mt19937_64 random(5);
  std::uniform_int_distribution<std::size_t> where(0, kFile.size() - 1);
  std::uniform_int_distribution<int> what(0, 255);
  int refused = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    std::string text = kFile;
    for (int k = 0; k < 3; ++k) text[where(random)] = static_cast<char>(what(random));
    if (trial % 3 == 0) text.resize(where(random));
    const std::string said = complaint(text);  // anything else thrown fails the test
    refused += !said.empty();
  }
  EXPECT_GT(refused, 2500);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
