// Look memory: worth of looks by those that were like them; audit and warnings of trained models.
// SPDX-License-Identifier: Apache-2.0
#include "vision/look_memory.h"

#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

LookFeatures look_at(float where, std::mt19937& random, float spread = 0.1F) {
  std::normal_distribution<float> normal(0, spread);
  LookFeatures look;
  for (float& value : look) value = where + normal(random);
  return look;
}

TEST(LookMemory, an_empty_one_says_nothing) {
  const LookWorth worth = LookMemory().worth({});
  EXPECT_EQ(worth.center, 1);
  EXPECT_EQ(worth.shape, 1);
  EXPECT_EQ(worth.likeness, 0);
}

TEST(LookMemory, looks_that_erred_more_than_they_claimed_are_worth_less) {
  std::mt19937 random(3);
  LookMemory memory;
  std::exponential_distribution<double> half_chi2(0.5);  // chi^2 of two degrees of freedom
  for (int k = 0; k < 300; ++k) {
    memory.add_object(look_at(0, random), half_chi2(random), 3);       // as they claimed
    memory.add_object(look_at(2, random), 25 * half_chi2(random), 3);  // five times as far off
  }
  EXPECT_LT(memory.worth(look_at(0, random)).center, 2.5);
  const double far = memory.worth(look_at(2, random)).center;
  EXPECT_GT(far, 15);
  EXPECT_LT(far, 60);
}

TEST(LookMemory, a_look_like_anatomy_or_like_nothing_is_not_at_the_object) {
  std::mt19937 random(5);
  LookMemory memory;
  for (int k = 0; k < 200; ++k) {
    memory.add_object(look_at(0, random), 2, 3);
    memory.add_other(look_at(1.5F, random));
  }
  EXPECT_GT(memory.worth(look_at(0, random)).likeness, 2);
  EXPECT_LT(memory.worth(look_at(1.5F, random)).likeness, -2);
  EXPECT_LT(memory.worth(look_at(-3, random)).likeness, -2);
  EXPECT_GT(memory.worth(look_at(-3, random)).center, 10);
}

TEST(LookMemory, is_in_the_saved_model_with_its_audit) {
  generated::Sequence sequence({.seed = 31});
  const ObjectModel model = ObjectModel::train(sequence.training(4), {}, {});
  EXPECT_GT(model.looks.objects(), 100U);
  EXPECT_EQ(model.audit.asked, 4);
  const ObjectModel loaded = ObjectModel::load(model.save());
  EXPECT_EQ(loaded.looks.objects(), model.looks.objects());
  EXPECT_EQ(loaded.looks.others(), model.looks.others());
  EXPECT_EQ(loaded.save(), model.save());
}

// Masks that lie on the ground: what is learnt as the object's color is the ground's.
TEST(LookMemory, a_model_of_poor_quality_says_so) {
  generated::Sequence sequence({.seed = 32});
  std::vector<LabeledImage> images = sequence.training(4);
  EXPECT_TRUE(ObjectModel::train(images, {}, {}).warnings().empty());
  for (LabeledImage& one : images)
    one.mask = generated::Sequence::mask_of({{90, 400}, 30, 15, 0.2}, one.image.size());
  const std::vector<std::string> said = ObjectModel::train(images, {}, {}).warnings();
  ASSERT_FALSE(said.empty());
  EXPECT_NE(said.front().find("hardly tell"), std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
