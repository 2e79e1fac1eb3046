// SPDX-License-Identifier: MIT
#include "tarsier/face/people/group_merging.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::people {
namespace {

using recognition::Rows;

constexpr Eigen::Index kScoredSightings = 5;  // sightings per group for the scores of strangers
// Max number of scores for the median, from evenly chosen pairs of groups.
constexpr std::size_t kMaxScores = 2'000'000;

struct Group {
  std::int64_t id = 0;
  Eigen::MatrixXd rows;  // templates, later directions
  double size = 0;
};

std::vector<Group> largest_groups(const GroupTemplates& groups, int max_groups) {
  std::vector<Group> out;
  for (const auto& [id, rows] : groups) {
    if (rows.rows() == 0) continue;
    TARSIER_REQUIRE(rows.rows() <= kMaxSightingsPerGroup, "{} sightings of a group", rows.rows());
    TARSIER_REQUIRE(out.empty() || rows.cols() == out.front().rows.cols(),
                    "templates of {} and {} numbers", rows.cols(), out.front().rows.cols());
    out.push_back({id, rows.cast<double>(), static_cast<double>(rows.rows())});
  }
  if (out.size() <= static_cast<std::size_t>(max_groups)) return out;
  std::stable_sort(out.begin(), out.end(),
                   [](const Group& a, const Group& b) { return a.size > b.size; });
  out.resize(static_cast<std::size_t>(max_groups));
  std::sort(out.begin(), out.end(), [](const Group& a, const Group& b) { return a.id < b.id; });
  return out;
}

Eigen::MatrixXd scatter_within(const std::vector<Group>& groups) {
  const Eigen::Index length = groups.front().rows.cols();
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(length, length);
  double count = 0;
  for (const Group& group : groups) {
    if (group.rows.rows() < 2) continue;
    const Eigen::MatrixXd centered = group.rows.rowwise() - group.rows.colwise().mean();
    sum.noalias() += centered.transpose() * centered;
    count += static_cast<double>(group.rows.rows() - 1);
  }
  return sum / std::max(1.0, count);
}

void whiten_groups(std::vector<Group>& groups, double floor) {
  const Eigen::MatrixXd within = scatter_within(groups);
  const linalg::SymmetricEigen axes = linalg::symmetric_eigen(within);
  const Eigen::VectorXd variances = axes.values.cwiseMax(0);
  const double added = std::max(1e-12, floor * variances.mean());
  const Eigen::MatrixXd whitening = axes.vectors *
                                    (variances.array() + added).rsqrt().matrix().asDiagonal() *
                                    axes.vectors.transpose();
  Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(within.cols());
  for (const Group& group : groups) mean += group.rows.colwise().mean();
  mean /= static_cast<double>(groups.size());
  for (Group& group : groups) {
    group.rows = (group.rows.rowwise() - mean) * whitening;
    for (Eigen::Index i = 0; i < group.rows.rows(); ++i) {
      const double norm = group.rows.row(i).norm();
      if (norm > 1e-12) group.rows.row(i) /= norm;
    }
  }
}

// Median of the strangers' scores plus `deviations` robust deviations.
double threshold_of(const std::vector<Group>& groups, double deviations) {
  const std::size_t pairs = groups.size() * (groups.size() - 1) / 2;
  const std::size_t step = std::max<std::size_t>(
      1, pairs * static_cast<std::size_t>(kScoredSightings * kScoredSightings) / kMaxScores);
  std::vector<double> scores;
  std::size_t number = 0;
  for (std::size_t a = 0; a < groups.size(); ++a) {
    for (std::size_t b = a + 1; b < groups.size(); ++b) {
      if (number++ % step != 0) continue;
      const Eigen::MatrixXd& first = groups[a].rows;
      const Eigen::MatrixXd& second = groups[b].rows;
      const Eigen::MatrixXd some =
          first.topRows(std::min(kScoredSightings, first.rows())) *
          second.topRows(std::min(kScoredSightings, second.rows())).transpose();
      scores.insert(scores.end(), some.data(), some.data() + some.size());
    }
  }
  const double median = upper_median(scores);
  for (double& score : scores) score = std::abs(score - median);
  return median + deviations * 1.4826 * upper_median(scores);
}

// Mean scores between groups, with the nearest group of each cached. Merging rescans only the
// groups whose cached value is no longer valid.
class Linkage {
 public:
  Linkage(const std::vector<Group>& groups,
          const std::set<std::pair<std::int64_t, std::int64_t>>& cannot_link)
      : groups_(groups), nearest_(groups.size(), 0), merged_(groups.size(), false) {
    const auto count = static_cast<Eigen::Index>(groups.size());
    Eigen::MatrixXd means(count, groups.front().rows.cols());
    for (Eigen::Index i = 0; i < count; ++i) {
      means.row(i) = groups_[static_cast<std::size_t>(i)].rows.colwise().mean();
      sizes_.push_back(groups_[static_cast<std::size_t>(i)].size);
    }
    scores_ = (means * means.transpose()).cast<float>();
    for (Eigen::Index i = 0; i < count; ++i) {
      scores_(i, i) = kForbidden;
      for (Eigen::Index j = 0; j < i; ++j) {
        const std::int64_t a = groups_[static_cast<std::size_t>(i)].id;
        const std::int64_t b = groups_[static_cast<std::size_t>(j)].id;
        if (cannot_link.contains({std::min(a, b), std::max(a, b)})) scores_(i, j) = kForbidden;
        scores_(j, i) = scores_(i, j);
      }
    }
    for (Eigen::Index i = 0; i < count; ++i) update_nearest(i);
  }

  GroupPairs merge(double threshold) {
    GroupPairs merged;
    for (;;) {
      Eigen::Index best = -1;
      for (Eigen::Index i = 0; i < scores_.rows(); ++i)
        if (!merged_[at(i)] && (best < 0 || score(i) > score(best))) best = i;
      if (best < 0 || !(score(best) >= threshold)) return merged;
      // Ids rise, so this is the older one.
      const Eigen::Index into = std::min(best, nearest_[at(best)]);
      const Eigen::Index from = std::max(best, nearest_[at(best)]);
      merge_pair(from, into);
      merged.emplace_back(groups_[at(from)].id, groups_[at(into)].id);
    }
  }

 private:
  static constexpr float kForbidden = -2;  // scores are -1 .. 1
  static std::size_t at(Eigen::Index i) { return static_cast<std::size_t>(i); }
  [[nodiscard]] float score(Eigen::Index i) const { return scores_(i, nearest_[at(i)]); }
  void update_nearest(Eigen::Index i) { scores_.row(i).maxCoeff(&nearest_[at(i)]); }

  void merge_pair(Eigen::Index from, Eigen::Index into) {
    const auto a = static_cast<float>(sizes_[at(into)]);
    const auto b = static_cast<float>(sizes_[at(from)]);
    for (Eigen::Index k = 0; k < scores_.rows(); ++k) {
      const bool forbidden = scores_(into, k) == kForbidden || scores_(from, k) == kForbidden;
      scores_(into, k) =
          forbidden ? kForbidden : (a * scores_(into, k) + b * scores_(from, k)) / (a + b);
    }
    scores_(into, into) = kForbidden;
    scores_.row(from).setConstant(kForbidden);
    scores_.col(from).setConstant(kForbidden);
    scores_.col(into) = scores_.row(into).transpose();
    sizes_[at(into)] += sizes_[at(from)];
    merged_[at(from)] = true;
    for (Eigen::Index i = 0; i < scores_.rows(); ++i) {
      if (merged_[at(i)]) continue;
      if (i == into || nearest_[at(i)] == from || nearest_[at(i)] == into) update_nearest(i);
    }
  }

  const std::vector<Group>& groups_;
  Eigen::MatrixXf scores_;  // mean of all pairs
  std::vector<double> sizes_;
  std::vector<Eigen::Index> nearest_;
  std::vector<bool> merged_;
};

}  // namespace

std::optional<GroupPairs> find_group_merges(
    const GroupTemplates& groups,
    const std::set<std::pair<std::int64_t, std::int64_t>>& cannot_link,
    const GroupMergingOptions& options) {
  options.check();
  std::vector<Group> used = largest_groups(groups, options.max_groups);
  Eigen::Index pairs = 0;
  for (const Group& group : used) pairs += group.rows.rows() - 1;
  if (used.size() < static_cast<std::size_t>(options.min_groups) || pairs < options.min_pairs)
    return std::nullopt;
  whiten_groups(used, options.floor);
  return Linkage(used, cannot_link).merge(threshold_of(used, options.deviations));
}

}  // namespace tarsier::face::people
