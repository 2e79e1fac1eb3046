// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/open_loops.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/pair_agreement.h"

#include <algorithm>
#include <cstddef>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinLoopInliers = 30;
constexpr int kMinLoopSteps = 8;
constexpr double kMinAgreement = 0.5;  // share of all inliers

// Number of steps from an image to all others, by breadth-first search.
class StepDistances {
 public:
  explicit StepDistances(std::size_t images) : neighbours_(images), steps_(images) {}

  void join(int a, int b) {
    neighbours_[at(a)].push_back(b);
    neighbours_[at(b)].push_back(a);
  }

  void search(int from) {
    steps_.assign(steps_.size(), -1);
    steps_[at(from)] = 0;
    order_.assign(1, from);
    for (std::size_t k = 0; k < order_.size(); ++k) {
      for (const int other : neighbours_[at(order_[k])]) {
        if (steps_[at(other)] >= 0) continue;
        steps_[at(other)] = steps_[at(order_[k])] + 1;
        order_.push_back(other);
      }
    }
  }

  // -1: unreachable.
  [[nodiscard]] int to(int image) const { return steps_[at(image)]; }

 private:
  std::vector<std::vector<int>> neighbours_;
  std::vector<int> steps_;
  std::vector<int> order_;  // order of the search
};

}  // namespace

std::vector<const Pair*> open_loops(const Model& model, const std::vector<const Pair*>& pairs) {
  StepDistances distances(model.images.size());
  std::vector<const Pair*> contradicted;
  std::size_t all = 0;
  std::size_t agreeing = 0;
  for (const Pair* pair : pairs) {
    if (!is_registered(model, *pair)) continue;
    const std::size_t inliers = pair->view.inliers.size();
    all += inliers;
    if (agrees(model, *pair)) {
      agreeing += inliers;
      distances.join(pair->first, pair->second);
    } else if (inliers >= kMinLoopInliers) {
      contradicted.push_back(pair);
    }
  }
  if (static_cast<double>(agreeing) < kMinAgreement * static_cast<double>(all)) return {};
  std::stable_sort(contradicted.begin(), contradicted.end(),
                   [](const Pair* a, const Pair* b) { return a->first < b->first; });
  std::vector<const Pair*> open;
  int from = -1;
  for (const Pair* pair : contradicted) {
    if (pair->first != from) distances.search(from = pair->first);
    const int distance = distances.to(pair->second);
    if (distance < 0 || distance >= kMinLoopSteps) open.push_back(pair);
  }
  return open;
}

double agreeing_inliers(const Model& model, const std::vector<const Pair*>& pairs) {
  double sum = 0;
  for (const Pair* pair : pairs)
    if (is_registered(model, *pair) && agrees(model, *pair))
      sum += static_cast<double>(pair->view.inliers.size());
  return sum;
}

}  // namespace tarsier::sfm
