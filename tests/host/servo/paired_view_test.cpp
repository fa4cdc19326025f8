// Which cameras a place is by: a change that stays begins anew, one that passes is passed over.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/paired_view.h"

#include <gtest/gtest.h>

#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Place = PairedView::Place;

std::vector<Place> heard(const std::vector<bool>& places) {
  PairedView view;
  std::vector<Place> all;
  for (const bool paired : places) all.push_back(view.hear(paired));
  return all;
}

TEST(PairedView, OfOneCameraAloneIsTakenFromTheFirst) {
  EXPECT_EQ(heard({false, false}), (std::vector<Place>{Place::taken, Place::taken}));
}

TEST(PairedView, ThatStaysAnotherBeginsAnewOnce) {
  EXPECT_EQ(
      heard({true, true, true, true, true, true, true}),
      (std::vector<Place>{Place::passed_over, Place::passed_over, Place::passed_over,
                          Place::passed_over, Place::begins_anew, Place::taken, Place::taken}));
}

TEST(PairedView, OfACameraThatComesAndGoesIsHeardByTheOtherAlone) {
  PairedView view;
  int taken = 0;
  for (int k = 0; k < 100; ++k) {
    const Place place = view.hear(k % 2 == 1);
    EXPECT_NE(place, Place::begins_anew) << k;
    taken += place == Place::taken ? 1 : 0;
  }
  EXPECT_EQ(taken, 50);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
