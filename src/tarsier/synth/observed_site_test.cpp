// SPDX-License-Identifier: MIT
#include "tarsier/synth/observed_site.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace tarsier::synth {
namespace {

ObservedSite site_of(SiteKind kind, int images, double repeats = 0) {
  SiteOptions options;
  options.kind = kind;
  options.images = images;
  options.repeats = repeats;
  options.neighbours = 8;
  options.features = 200;
  return make_observed_site(options);
}

TEST(ObservedSite, PairsConnectAllImages) {
  for (const SiteKind kind :
       {SiteKind::kRing, SiteKind::kGrid, SiteKind::kWalk, SiteKind::kCity, SiteKind::kSymmetric}) {
    const ObservedSite site = site_of(kind, 60);
    ASSERT_EQ(site.poses.size(), 60U);
    std::set<int> reached{0};
    for (std::size_t before = 0; before != reached.size();) {
      before = reached.size();
      for (const auto& pair : site.pairs) {
        EXPECT_LT(pair.first, pair.second);
        if (reached.contains(pair.first)) reached.insert(pair.second);
        if (reached.contains(pair.second)) reached.insert(pair.first);
      }
    }
    EXPECT_EQ(reached.size(), 60U) << static_cast<int>(kind);
    for (const auto& features : site.features) EXPECT_GE(features.size(), 60U);
  }
}

TEST(ObservedSite, CityHasLoops) {
  const ObservedSite site = site_of(SiteKind::kCity, 120);
  // Images of a street that is driven a second time match those of the first time.
  EXPECT_GT(std::count_if(site.pairs.begin(), site.pairs.end(),
                          [](const auto& pair) { return pair.second - pair.first > 30; }),
            100);
}

TEST(ObservedSite, MatchesAcrossPlacesOnlyForRepeatedAppearance) {
  const auto wrong = [](const ObservedSite& site) {
    return std::count_if(site.pairs.begin(), site.pairs.end(),
                         [](const ObservedSite::Pair& pair) { return !pair.same_place; });
  };
  EXPECT_EQ(wrong(site_of(SiteKind::kRing, 80)), 0);
  EXPECT_GT(wrong(site_of(SiteKind::kRing, 80, 1)), 0);
  EXPECT_GT(wrong(site_of(SiteKind::kSymmetric, 40)), 0);
}

TEST(ObservedSite, IsDeterministic) {
  const ObservedSite a = site_of(SiteKind::kCity, 30);
  const ObservedSite b = site_of(SiteKind::kCity, 30);
  EXPECT_EQ(a.features, b.features);
  ASSERT_EQ(a.pairs.size(), b.pairs.size());
  for (std::size_t k = 0; k < a.pairs.size(); ++k)
    EXPECT_EQ(a.pairs[k].matches, b.pairs[k].matches);
}

TEST(ObservedSite, RejectsInvalidOptions) {
  SiteOptions options;
  options.images = 2;
  EXPECT_THROW((void)make_observed_site(options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::synth
