// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/tracks.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"

#include <algorithm>
#include <numeric>

namespace tarsier::sfm {
namespace {

class TrackBuilder {
 public:
  explicit TrackBuilder(const std::vector<int>& features) {
    starts_.resize(features.size() + 1, 0);
    for (std::size_t i = 0; i < features.size(); ++i)
      starts_[i + 1] = starts_[i] + static_cast<std::size_t>(features[i]);
    parents_.resize(starts_.back());
    std::iota(parents_.begin(), parents_.end(), std::size_t{0});
    members_.resize(starts_.back());
  }

  void join(const Observation& a, const Observation& b) {
    std::size_t x = root(index(a));
    std::size_t y = root(index(b));
    if (x == y) return;
    if (members_[x].empty()) members_[x] = {a};
    if (members_[y].empty()) members_[y] = {b};
    if (share_image(members_[x], members_[y])) return;
    if (members_[x].size() < members_[y].size()) std::swap(x, y);
    std::vector<Observation> all;
    std::merge(members_[x].begin(), members_[x].end(), members_[y].begin(), members_[y].end(),
               std::back_inserter(all),
               [](const Observation& p, const Observation& q) { return p.image < q.image; });
    members_[x] = std::move(all);
    members_[y] = {};
    parents_[y] = x;
  }

  [[nodiscard]] std::vector<std::vector<Observation>> tracks() {
    std::vector<std::vector<Observation>> tracks;
    for (auto& members : members_)
      if (members.size() >= 2) tracks.push_back(std::move(members));
    return tracks;
  }

 private:
  [[nodiscard]] std::size_t index(const Observation& seen) const {
    const auto image = static_cast<std::size_t>(seen.image);
    TARSIER_REQUIRE(
        image + 1 < starts_.size() && seen.feature >= 0 &&
            starts_[image] + static_cast<std::size_t>(seen.feature) < starts_[image + 1],
        "feature {} of image {}", seen.feature, seen.image);
    return starts_[image] + static_cast<std::size_t>(seen.feature);
  }

  std::size_t root(std::size_t x) {
    while (parents_[x] != x) x = parents_[x] = parents_[parents_[x]];
    return x;
  }

  static bool share_image(const std::vector<Observation>& a, const std::vector<Observation>& b) {
    for (auto p = a.begin(), q = b.begin(); p != a.end() && q != b.end();) {
      if (p->image == q->image) return true;
      p->image < q->image ? static_cast<void>(++p) : static_cast<void>(++q);
    }
    return false;
  }

  std::vector<std::size_t> starts_;
  std::vector<std::size_t> parents_;
  std::vector<std::vector<Observation>> members_;  // for roots, sorted by image
};

}  // namespace

std::vector<std::size_t> max_inliers_of_images(const std::vector<Pair>& pairs, std::size_t images) {
  std::vector<std::size_t> strongest(images, 0);
  for (const Pair& pair : pairs)
    for (const int image : {pair.first, pair.second}) {
      std::size_t& most = strongest[static_cast<std::size_t>(image)];
      most = std::max(most, pair.view.inliers.size());
    }
  return strongest;
}

double strength_of(const Pair& pair, const std::vector<std::size_t>& max_inliers) {
  return static_cast<double>(pair.view.inliers.size()) /
         static_cast<double>(std::max(max_inliers[at(pair.first)], max_inliers[at(pair.second)]));
}

std::vector<std::vector<Observation>> make_tracks(const std::vector<Pair>& pairs,
                                                  const std::vector<int>& features) {
  std::vector<const Pair*> all;
  all.reserve(pairs.size());
  for (const Pair& pair : pairs) all.push_back(&pair);
  return make_tracks(all, features);
}

std::vector<std::vector<Observation>> make_tracks(const std::vector<const Pair*>& pairs,
                                                  const std::vector<int>& features) {
  std::vector<std::size_t> order(pairs.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return pairs[a]->view.inliers.size() > pairs[b]->view.inliers.size();
  });
  TrackBuilder builder(features);
  for (const std::size_t k : order) {
    for (const Match& match : pairs[k]->view.inliers)
      builder.join({pairs[k]->first, match.first}, {pairs[k]->second, match.second});
  }
  std::vector<std::vector<Observation>> tracks = builder.tracks();
  std::sort(tracks.begin(), tracks.end(), [](const auto& a, const auto& b) {
    if (a.size() != b.size()) return a.size() > b.size();
    if (a[0].image != b[0].image) return a[0].image < b[0].image;
    return a[0].feature < b[0].feature;
  });
  return tracks;
}

}  // namespace tarsier::sfm
