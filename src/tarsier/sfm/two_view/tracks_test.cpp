// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/tracks.h"

#include <gtest/gtest.h>

#include <set>

namespace tarsier::sfm {
namespace {

Pair matched_pair(int first, int second, std::vector<Match> matches) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.matches = static_cast<int>(matches.size());
  pair.view.inliers = std::move(matches);
  return pair;
}

TEST(MakeTracks, MergesMatchesOfSeveralPairs) {
  const auto tracks = make_tracks({matched_pair(0, 1, {{0, 0}, {1, 2}}),
                                   matched_pair(1, 2, {{0, 5}}), matched_pair(0, 2, {{0, 5}})},
                                  {3, 3, 6});
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0], (std::vector<Observation>{{0, 0}, {1, 0}, {2, 5}}));
  EXPECT_EQ(tracks[1], (std::vector<Observation>{{0, 1}, {1, 2}}));
}

TEST(MakeTracks, WrongMatchDoesNotMergeTracks) {
  // The weak pair matches feature 0 of image 2 with another point of image 0.
  const auto tracks =
      make_tracks({matched_pair(0, 1, {{0, 0}, {1, 1}, {2, 2}}),
                   matched_pair(1, 2, {{0, 0}, {1, 1}}), matched_pair(0, 2, {{1, 0}})},
                  {3, 3, 3});
  ASSERT_EQ(tracks.size(), 3U);
  for (const auto& track : tracks) {
    std::set<int> images;
    for (const Observation& seen : track) EXPECT_TRUE(images.insert(seen.image).second);
  }
  EXPECT_EQ(tracks[0], (std::vector<Observation>{{0, 0}, {1, 0}, {2, 0}}));
  EXPECT_EQ(tracks[1], (std::vector<Observation>{{0, 1}, {1, 1}, {2, 1}}));
}

TEST(MakeTracks, RefusesUnknownFeatures) {
  EXPECT_THROW((void)make_tracks({matched_pair(0, 1, {{3, 0}})}, {3, 3}), std::invalid_argument);
  EXPECT_THROW((void)make_tracks({matched_pair(0, 2, {{0, 0}})}, {3, 3}), std::invalid_argument);
  EXPECT_TRUE(make_tracks(std::vector<Pair>{}, {3, 3}).empty());
}

}  // namespace
}  // namespace tarsier::sfm
