// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/model_conflicts.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/feature_grid.h"
#include "tarsier/sfm/global/view_graph.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <queue>
#include <tuple>

namespace tarsier::sfm {
namespace {

constexpr int kMinShared = 12;                        // min common points of two compared images
constexpr std::size_t kMaxComparedImages = 40;        // images that each is compared with
constexpr double kMaxAngle = 12 * kRadiansPerDegree;  // between the rays of two images to a point
constexpr double kMaxScale = 1.3;                     // ratio of their distances to it
constexpr double kMaxDistance = 6;  // distance() of two images; larger ones are clamped
// px, of an image of 1000 px: search radius around a projection
constexpr double kSearchRadiusPx = 2.5;
constexpr double kChanceShift = 6;  // radii, distance to the positions that measure chance
constexpr double kMaxChanceRate = 0.9;
constexpr int kMinExpectedViews = 5;  // min images that should show a point, for its rate to count
// quantile of the rates that defines the rate of most points
constexpr double kTypicalQuantile = 0.75;
constexpr double kMaxRareRatio = 0.7;  // of that rate: points with less are rare
// min other points, which give the typical rate of two images
constexpr double kMinCommonPoints = 5;
// min expected points that are rare in the other images
constexpr double kMinExpectedElsewhere = 4;
constexpr double kMinSharedElsewhere = 0.4;  // share of these above which there is no contradiction
constexpr double kMinExpected = 8;           // min expected points for a contradiction
constexpr std::size_t kMinPairs = 3;         // min contradicting pairs
constexpr double kMinConflictShare = 0.005;  // .. as a share of the evaluated ones
constexpr double kMinHighShare = 0.1;        // .. or this, where no images are of different places
// min contradictions of one image, in at least one image
constexpr double kMinImageContradictions = 3;
constexpr double kMinImageContradictionShare = 0.2;  // .. as a share of its evaluated pairs
constexpr int kMaxFewImages = 200;           // with fewer images, one misplaced image suffices
constexpr double kMaxNeighbourDistance = 1;  // max distance() of one of these
// max share of the expected points for a contradiction
constexpr double kMaxContradictionShare = 0.15;
constexpr double kMaxContradictionRatio = 0.25;  // .. relative to the typical share
constexpr double kMinReferenceShare = 0.35;  // with a smaller typical share, nothing is evaluated
// min expected points of pairs that define the typical share
constexpr double kMinExpectedForTypical = 4;
constexpr double kMinTypicalShare = 0.3;    // min typical share of the expected points
constexpr double kMinSamePlaceRatio = 0.5;  // of the typical share; above it, images show one place
// min expected points of two images and those around them
constexpr double kMinExpectedBetween = 20;
// of the typical share; below it, places are different
constexpr double kMaxDifferentPlaceRatio = 0.35;
constexpr double kMinModelMatchShare = 0.2;  // min share of a pair's matches that are points

// Search radius around a point's projection, px.
double radius_of(const geometry::Camera& camera) {
  return kSearchRadiusPx * std::max(1.0, std::max(camera.width, camera.height) / 1000.0);
}

// Compares the points that the images of a model are expected to observe with those they observe.
class Comparison {
 public:
  explicit Comparison(const Model& model)
      : model_(model), points_of_(model.images.size()), centers_(model.images.size()) {
    for (std::size_t p = 0; p < model.points.size(); ++p)
      for (const Observation& seen : model.points[p].track)
        points_of_[at(seen.image)].push_back(static_cast<int>(p));
    for (std::size_t i = 0; i < model.images.size(); ++i)
      centers_[i] =
          model.images[i].registered ? model.images[i].pose.center() : Eigen::Vector3d::Zero();
    expected_views_.assign(model.points.size(), 0);
    views_.assign(model.points.size(), 0);
    find_neighbours();
    checks_.resize(model.images.size());
    for (std::size_t i = 0; i < model.images.size(); ++i) check_points(i);
    find_rare();
  }

  // The images that share points with it, nearest first.
  [[nodiscard]] const std::vector<int>& neighbours(int image) const {
    return neighbours_[at(image)];
  }

  // Distance between the views of two images of the mean of the first one's points: the angle in
  // units of kMaxAngle, plus the logarithm of the ratio of the distances in units of that of
  // kMaxScale. 0 for the same position.
  [[nodiscard]] double distance(int first, int second) const {
    const std::vector<int>& points = points_of_[at(first)];
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    for (const int p : points) center += model_.points[at(p)].position;
    center /= std::max(1.0, static_cast<double>(points.size()));
    const Eigen::Vector3d one = center - centers_[at(first)];
    const Eigen::Vector3d other = center - centers_[at(second)];
    if (!(one.norm() > 0 && other.norm() > 0)) return kMaxDistance;
    const double cosine = one.dot(other) / (one.norm() * other.norm());
    return std::acos(std::clamp(cosine, -1.0, 1.0)) / kMaxAngle +
           std::abs(std::log(one.norm() / other.norm())) / std::log(kMaxScale);
  }

  // The number of rare points of `from` that `to` is expected to observe, and how many it observes.
  // A point that few images are expected to observe may be rare only because `to` does not observe
  // it. Such points would always count against `to`. Therefore `to` does not contradict `from`
  // where it observes enough of the points that are rare in the other images.
  [[nodiscard]] ModelConflicts::Evidence observed(int from, int to) const {
    Sum rare;
    Sum common;
    Sum rare_elsewhere;
    Sum common_elsewhere;
    const std::vector<PointCheck>& checks = checks_[at(to)];
    for (const int p : points_of_[at(from)]) {
      if (expected_views_[at(p)] < kMinExpectedViews) continue;
      const auto found =
          std::lower_bound(checks.begin(), checks.end(), p,
                           [](const PointCheck& check, int point) { return check.point < point; });
      if (found == checks.end() || found->point != p) continue;
      (is_rare(views_[at(p)], expected_views_[at(p)]) ? rare : common).add(*found);
      const int observed = views_[at(p)] - (found->is_observed ? 1 : 0);
      (is_rare(observed, expected_views_[at(p)] - 1) ? rare_elsewhere : common_elsewhere)
          .add(*found);
    }
    ModelConflicts::Evidence evidence = evidence_of(rare, common);
    const ModelConflicts::Evidence elsewhere = evidence_of(rare_elsewhere, common_elsewhere);
    if (elsewhere.expected >= kMinExpectedElsewhere &&
        elsewhere.found >= kMinSharedElsewhere * elsewhere.expected)
      evidence.found = std::max(evidence.found, kMinTypicalShare * evidence.expected);
    return evidence;
  }

 private:
  struct PointCheck {
    int point;
    bool is_observed;
    int chance_matches;  // number of the four positions beside it that have a feature
  };
  // Weak points lie in areas with few features, so chance is measured at the points that are
  // summed.
  struct Sum {
    double points = 0;
    double observed = 0;
    double chance_matches = 0;

    void add(const PointCheck& check) {
      points += 1;
      observed += check.is_observed ? 1 : 0;
      chance_matches += check.chance_matches / 4.0;
    }
    [[nodiscard]] double observed_without_chance() const {
      const double chance_rate = std::min(kMaxChanceRate, chance_matches / std::max(1.0, points));
      return (observed - chance_rate * points) / (1 - chance_rate);
    }
  };

  [[nodiscard]] bool is_rare(int observed, int expected) const {
    return observed < max_rare_rate_ * expected;
  }

  static ModelConflicts::Evidence evidence_of(const Sum& rare, const Sum& common) {
    if (common.points < kMinCommonPoints) return {};
    return {rare.points * std::max(0.0, common.observed_without_chance() / common.points),
            rare.observed_without_chance()};
  }

  void find_neighbours() {
    neighbours_.resize(model_.images.size());
    std::vector<int> shared(model_.images.size(), 0);
    for (std::size_t i = 0; i < neighbours_.size(); ++i) {
      std::vector<int> others;
      for (const int p : points_of_[i])
        for (const Observation& seen : model_.points[at(p)].track)
          if (shared[at(seen.image)]++ == 0) others.push_back(seen.image);
      std::vector<std::pair<double, int>> order;
      for (const int other : others)
        if (other != static_cast<int>(i) && shared[at(other)] >= kMinShared)
          order.emplace_back((centers_[at(other)] - centers_[i]).squaredNorm(), other);
      std::sort(order.begin(), order.end());
      if (order.size() > kMaxComparedImages) order.resize(kMaxComparedImages);
      for (const auto& [distance, other] : order) neighbours_[i].push_back(other);
      for (const int other : others) shared[at(other)] = 0;
    }
  }

  [[nodiscard]] bool has_similar_view(const Eigen::Vector3d& one,
                                      const Eigen::Vector3d& other) const {
    const double a = one.norm();
    const double b = other.norm();
    return one.dot(other) >= std::cos(kMaxAngle) * a * b && a <= kMaxScale * b &&
           b <= kMaxScale * a;
  }

  // Looks for the points of near images in this image.
  void check_points(std::size_t to) {
    if (neighbours_[to].empty()) return;
    const Image& image = model_.images[to];
    const geometry::Camera& camera = model_.cameras[at(image.camera)];
    const FeatureGrid grid(image.features, camera, radius_of(camera));
    const double shift = kChanceShift * grid.radius();
    const double margin = shift + grid.radius();
    std::vector<int> points;
    for (const int from : neighbours_[to])
      for (const int p : points_of_[at(from)])
        if (has_similar_view(model_.points[at(p)].position - centers_[at(from)],
                             model_.points[at(p)].position - centers_[to]))
          points.push_back(p);
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    for (const int p : points) {
      const auto pixel = camera.project(image.pose * model_.points[at(p)].position);
      if (!pixel || !(pixel->x > margin && pixel->y > margin && pixel->x < camera.width - margin &&
                      pixel->y < camera.height - margin))
        continue;
      PointCheck check{p, grid.has(pixel->x, pixel->y), 0};
      for (const cv::Point2d& by : {cv::Point2d(shift, 0), cv::Point2d(-shift, 0),
                                    cv::Point2d(0, shift), cv::Point2d(0, -shift)})
        check.chance_matches += grid.has(pixel->x + by.x, pixel->y + by.y) ? 1 : 0;
      checks_[to].push_back(check);
      ++expected_views_[at(p)];
      views_[at(p)] += check.is_observed ? 1 : 0;
    }
  }

  void find_rare() {
    std::vector<double> rates;
    for (std::size_t p = 0; p < expected_views_.size(); ++p)
      if (expected_views_[p] >= kMinExpectedViews)
        rates.push_back(static_cast<double>(views_[p]) / expected_views_[p]);
    if (rates.empty()) return;
    const auto typical_rate =
        rates.begin() +
        static_cast<std::ptrdiff_t>(kTypicalQuantile * static_cast<double>(rates.size() - 1));
    std::nth_element(rates.begin(), typical_rate, rates.end());
    max_rare_rate_ = kMaxRareRatio * *typical_rate;
  }

  const Model& model_;
  std::vector<std::vector<int>> points_of_;  // for each image, ascending
  std::vector<Eigen::Vector3d> centers_;
  std::vector<std::vector<int>> neighbours_;
  std::vector<std::vector<PointCheck>> checks_;  // for each image, sorted by point
  std::vector<int> expected_views_;              // for each point: images that should show it
  std::vector<int> views_;                       // for each point: images that show it
  double max_rare_rate_ = 0;                     // max rate of rare points
};

// The share of rare points that two images of one place usually have in common. It falls with their
// distance, in some scenes fast, since a detector finds weak features only from nearby. It is
// estimated by the best pairs at this distance or farther.
class ReferenceShares {
 public:
  explicit ReferenceShares(std::vector<std::pair<double, double>> by_distance) {
    std::sort(by_distance.begin(), by_distance.end());
    for (std::size_t k = 0; k < kSteps; ++k) {
      const auto from = std::lower_bound(by_distance.begin(), by_distance.end(),
                                         std::pair(static_cast<double>(k) * kStep, -1e9));
      std::vector<double> shares;
      for (auto pair = from; pair != by_distance.end(); ++pair) shares.push_back(pair->second);
      if (shares.size() < kMinFarther) break;
      const auto best =
          shares.begin() +
          static_cast<std::ptrdiff_t>(kBestQuantile * static_cast<double>(shares.size() - 1));
      std::nth_element(shares.begin(), best, shares.end());
      shares_[k] = *best;
    }
  }
  [[nodiscard]] double at(double distance) const {
    return shares_[static_cast<std::size_t>(std::min(distance, kMaxDistance) / kStep)];
  }

 private:
  static constexpr double kStep = 0.25;
  static constexpr auto kSteps = static_cast<std::size_t>(kMaxDistance / kStep) + 1;
  static constexpr std::size_t kMinFarther = 5;
  static constexpr double kBestQuantile = 0.9;
  std::array<double, kSteps> shares_{};
};

// Whether the matches of a pair are points of the model.
bool is_in_model(const Model& model, const Pair& pair) {
  const std::vector<int>& first = model.images[at(pair.first)].points;
  const std::vector<int>& second = model.images[at(pair.second)].points;
  std::size_t all = 0;
  std::size_t in_both = 0;
  for (const Match& match : pair.view.inliers) {
    const int a = first[at(match.first)];
    const int b = second[at(match.second)];
    all += a >= 0 || b >= 0 ? 1 : 0;
    in_both += a >= 0 && a == b ? 1 : 0;
  }
  return in_both > 0 &&
         static_cast<double>(in_both) >= kMinModelMatchShare * static_cast<double>(all);
}

}  // namespace

ModelConflicts::ModelConflicts(const Model& model)
    : neighbours_(model.images.size()), shares_(model.images.size(), 0) {
  const Comparison comparison(model);
  std::vector<std::vector<int>> neighbours(model.images.size());
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    for (const int j : comparison.neighbours(static_cast<int>(i))) {
      neighbours[i].push_back(j);
      neighbours[at(j)].push_back(static_cast<int>(i));
    }
  }
  std::vector<double> shares;
  std::vector<std::pair<double, double>> evaluated;  // distance and share
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    std::sort(neighbours[i].begin(), neighbours[i].end());
    neighbours[i].erase(std::unique(neighbours[i].begin(), neighbours[i].end()),
                        neighbours[i].end());
    const int first = static_cast<int>(i);
    for (const int second : neighbours[i]) {
      if (second < first) continue;
      // Of both directions, the one with less contradiction is used: what one image cannot show,
      // from farther away or from the side, is missing in one direction only.
      const Evidence one = comparison.observed(first, second);
      const Evidence other = comparison.observed(second, first);
      const Evidence evidence = one.found - kMinTypicalShare * one.expected >
                                        other.found - kMinTypicalShare * other.expected
                                    ? one
                                    : other;
      if (!(evidence.expected > 0)) continue;
      const double distance = comparison.distance(first, second);
      neighbours_[i].push_back({second, evidence, distance});
      neighbours_[at(second)].push_back({first, evidence, distance});
      if (evidence.expected >= kMinExpectedForTypical)
        shares.push_back(evidence.found / evidence.expected);
      if (evidence.expected >= kMinExpected)
        evaluated.emplace_back(distance, evidence.found / evidence.expected);
    }
  }
  if (!shares.empty()) {
    const auto typical =
        shares.begin() +
        static_cast<std::ptrdiff_t>(kTypicalQuantile * static_cast<double>(shares.size() - 1));
    std::nth_element(shares.begin(), typical, shares.end());
    typical_share_ = std::clamp(*typical, kMinTypicalShare, 1.0);
  }
  const ReferenceShares reference_shares(evaluated);
  for (std::size_t i = 0; i < neighbours_.size(); ++i) {
    std::sort(neighbours_[i].begin(), neighbours_[i].end(),
              [](const Neighbour& a, const Neighbour& b) { return a.image < b.image; });
    double all = 0;
    double contradicted = 0;
    bool by_neighbour = false;
    for (const auto& [other, evidence, distance] : neighbours_[i]) {
      const double reference = reference_shares.at(distance);
      if (evidence.expected < kMinExpected || reference < kMinReferenceShare) continue;
      all += 1;
      evaluated_ += other > static_cast<int>(i) ? 1 : 0;
      if (evidence.found >=
          std::min(kMaxContradictionShare, kMaxContradictionRatio * reference) * evidence.expected)
        continue;
      contradicted += 1;
      by_neighbour = by_neighbour || distance < kMaxNeighbourDistance;
      if (other > static_cast<int>(i)) pairs_.emplace_back(static_cast<int>(i), other);
    }
    if (all > 0) shares_[i] = contradicted / all;
    is_clustered_ = is_clustered_ || (by_neighbour && contradicted >= kMinImageContradictions &&
                                      contradicted >= kMinImageContradictionShare * all);
  }
  find_places();
  std::vector<double> different(neighbours_.size(), 0);
  for (const auto& [first, second] : pairs_) {
    if (!are_different(first, second)) continue;
    different[at(first)] += 1;
    different[at(second)] += 1;
  }
  const auto images = std::count_if(different.begin(), different.end(),
                                    [](double pairs) { return pairs >= kMinImageContradictions; });
  const auto compared =
      std::count_if(neighbours_.begin(), neighbours_.end(),
                    [](const std::vector<Neighbour>& others) { return !others.empty(); });
  has_different_places_ = images >= (compared < kMaxFewImages ? 1 : 2);
}

bool ModelConflicts::any(bool is_repetitive) const {
  const auto pairs = static_cast<double>(pairs_.size());
  const auto evaluated = static_cast<double>(evaluated_);
  if (pairs_.size() < kMinPairs || pairs < kMinConflictShare * evaluated) return false;
  return is_repetitive ||
         (is_clustered_ && (has_different_places_ || pairs >= kMinHighShare * evaluated));
}

const ModelConflicts::Evidence* ModelConflicts::find(int first, int second) const {
  const std::vector<Neighbour>& neighbours = neighbours_[at(first)];
  const auto found =
      std::lower_bound(neighbours.begin(), neighbours.end(), second,
                       [](const Neighbour& a, int image) { return a.image < image; });
  return found != neighbours.end() && found->image == second ? &found->evidence : nullptr;
}

std::vector<int> ModelConflicts::same_place(int image) const {
  std::vector<int> same{image};
  for (const auto& [other, evidence, distance] : neighbours_[at(image)])
    if (evidence.expected >= kMinExpectedForTypical &&
        evidence.found >= kMinSamePlaceRatio * typical_share_ * evidence.expected)
      same.push_back(other);
  std::sort(same.begin(), same.end());
  return same;
}

ModelConflicts::Evidence ModelConflicts::between(int first, int second) const {
  const std::vector<int> ones = same_place(first);
  const std::vector<int> others = same_place(second);
  Evidence sum;
  for (const int one : ones) {
    for (const int other : others) {
      const Evidence* evidence = find(one, other);
      if (evidence == nullptr) continue;
      sum.expected += evidence->expected;
      sum.found += evidence->found;
    }
  }
  return sum;
}

// Greedy contraction of a graph with attractive and repulsive edges (Keuper and others, Efficient
// decomposition of image and mesh graphs by lifted multicuts, ICCV 2015). The two places that share
// most beyond half of the typical share are merged, until no two do.
void ModelConflicts::find_places() {
  const std::size_t images = neighbours_.size();
  std::vector<std::map<int, double>> edges(images);
  std::priority_queue<std::tuple<double, int, int>> next;
  for (std::size_t i = 0; i < images; ++i) {
    for (const auto& [other, evidence, distance] : neighbours_[i]) {
      const double weight =
          evidence.found - kMinSamePlaceRatio * typical_share_ * evidence.expected;
      edges[i][other] = weight;
      if (weight > 0 && other > static_cast<int>(i))
        next.emplace(weight, static_cast<int>(i), other);
    }
  }
  Components places(images);
  std::vector<char> is_merged(images, 0);
  while (!next.empty()) {
    const auto [weight, first, second] = next.top();
    next.pop();
    if (is_merged[at(first)] != 0 || is_merged[at(second)] != 0) continue;
    const auto edge = edges[at(first)].find(second);
    if (edge == edges[at(first)].end() || edge->second != weight) continue;
    const bool first_survives = edges[at(first)].size() >= edges[at(second)].size();
    const int survivor = first_survives ? first : second;
    const int merged = first_survives ? second : first;
    is_merged[at(merged)] = 1;
    places.join(survivor, merged);
    edges[at(survivor)].erase(merged);
    for (const auto& [other, more] : edges[at(merged)]) {
      if (other == survivor) continue;
      edges[at(other)].erase(merged);
      const double sum = edges[at(survivor)][other] += more;
      edges[at(other)][survivor] = sum;
      if (sum > 0) next.emplace(sum, std::min(survivor, other), std::max(survivor, other));
    }
    edges[at(merged)].clear();
  }
  place_.resize(images);
  for (std::size_t i = 0; i < images; ++i) place_[i] = places.root(static_cast<int>(i));
  for (std::size_t i = 0; i < images; ++i) {
    for (const auto& [other, evidence, distance] : neighbours_[i]) {
      if (other < static_cast<int>(i) || place_[i] == place_[at(other)]) continue;
      Evidence& sum = between_places_[std::minmax(place_[i], place_[at(other)])];
      sum.expected += evidence.expected;
      sum.found += evidence.found;
    }
  }
}

bool ModelConflicts::are_different(int first, int second) const {
  const auto places = between_places_.find(std::minmax(place_[at(first)], place_[at(second)]));
  if (places != between_places_.end() && shows_different_places(places->second)) return true;
  return shows_different_places(between(first, second));
}

bool ModelConflicts::shows_different_places(const Evidence& evidence) const {
  return evidence.expected >= kMinExpectedBetween &&
         evidence.found < kMaxDifferentPlaceRatio * typical_share_ * evidence.expected;
}

std::vector<const Pair*> conflicting_pairs(const Model& model, const ModelConflicts& conflicts,
                                           const std::vector<const Pair*>& pairs) {
  std::vector<const Pair*> all;
  std::vector<const Pair*> in_model;
  for (const Pair* pair : pairs) {
    if (!model.images[at(pair->first)].registered || !model.images[at(pair->second)].registered ||
        !conflicts.are_different(pair->first, pair->second)) {
      continue;
    }
    all.push_back(pair);
    if (is_in_model(model, *pair)) in_model.push_back(pair);
  }
  return in_model.empty() ? all : in_model;
}

}  // namespace tarsier::sfm
