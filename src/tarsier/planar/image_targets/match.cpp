// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/match.h"

#include "tarsier/geometry/planar_pose.h"
#include "tarsier/planar/image_targets/homography_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::planar::image_targets {
namespace {

// Reduces the candidates to about the `max_count` nearest.
void keep_nearest(const std::vector<std::uint16_t>& distances, int n, int max_count,
                  std::vector<std::int32_t>& index) {
  index.resize(static_cast<std::size_t>(n));
  if (n <= max_count) return;
  std::array<int, 257> count{};
  for (int i = 0; i < n; ++i) ++count[distances[static_cast<std::size_t>(i)]];
  int limit = 0;
  for (int sum = 0; limit < 256; ++limit) {
    sum += count[static_cast<std::size_t>(limit)];
    if (sum >= max_count) break;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i)
    if (distances[i] <= limit && kept < 2 * static_cast<std::size_t>(max_count))
      index[kept++] = index[i];
  index.resize(kept);
}

struct AffineMatch {
  cv::Point2f at;    // image
  cv::Point2f seen;  // frame
  cv::Matx22f map;   // frame from image, linear part
  cv::Matx22f back;  // its inverse
  float scale = 1;   // px of the frame per px of the feature's grid
  float weight = 1;
  int image_cell = 0;
  int feature = 0;
};

cv::Matx22f inverse_of(const cv::Matx22f& m) {
  const float d = 1 / (m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0));
  return {m(1, 1) * d, -m(0, 1) * d, -m(1, 0) * d, m(0, 0) * d};
}

std::vector<AffineMatch> affine_matches(const FeatureSet& frame, const Target& target,
                                        const std::vector<Match>& matches) {
  const float cell = static_cast<float>(std::max(target.gray.cols, target.gray.rows)) / 48 + 1e-3F;
  std::vector<AffineMatch> located;
  located.reserve(matches.size());
  for (const Match& m : matches) {
    const Feature& f = frame.features[static_cast<std::size_t>(m.feature)];
    const TrainedFeature& t = target.features[static_cast<std::size_t>(m.trained)];
    AffineMatch p;
    p.at = t.at;
    p.seen = f.at;
    const float c = f.scale * std::cos(f.angle);
    const float s = f.scale * std::sin(f.angle);
    p.map = cv::Matx22f(c, -s, s, c) * inverse_of(t.frame);
    p.back = inverse_of(p.map);
    p.scale = f.scale;
    p.weight = 1.05F - m.ratio;
    p.image_cell = static_cast<int>(t.at.y / cell) * 50 + static_cast<int>(t.at.x / cell);
    p.feature = m.feature;
    located.push_back(p);
  }
  return located;
}

bool agrees(const AffineMatch& h, const AffineMatch& m) {
  const cv::Point2f d = m.at - h.at;
  const float x = h.map(0, 0) * d.x + h.map(0, 1) * d.y;
  const float y = h.map(1, 0) * d.x + h.map(1, 1) * d.y;
  const float ex = h.seen.x + x - m.seen.x;
  const float ey = h.seen.y + y - m.seen.y;
  const float error2 = ex * ex + ey * ey;
  const float own_tolerance = 2 * (h.scale + m.scale);
  // (a + b)^2 <= 2 (a^2 + b^2): rejects most without a square root.
  if (error2 > 2 * (0.22F * 0.22F * (x * x + y * y) + own_tolerance * own_tolerance)) return false;
  const float tolerance = 0.22F * std::sqrt(x * x + y * y) + own_tolerance;
  if (error2 > tolerance * tolerance) return false;
  // Scale and rotation: the inverse of h's map times m's map must be near the identity.
  const cv::Matx22f a = h.back * m.map;
  const float det = a(0, 0) * a(1, 1) - a(0, 1) * a(1, 0);
  if (det < 0.3F || det > 3.3F) return false;
  const float cosine = (a(0, 0) + a(1, 1)) / 2;
  const float sine = (a(1, 0) - a(0, 1)) / 2;
  return cosine > 0 && std::fabs(sine) < 0.7F * cosine;
}

struct Support {
  std::vector<int> members;
  double score = 0;
  int distinct = 0;
};

// Sums weights. Of matches to the same cell of the image and the same place of the frame, only the
// first (best) counts.
template <class Test>
Support support_of(const std::vector<AffineMatch>& located, Test&& test) {
  Support support;
  std::array<std::uint64_t, 40> cells{};
  int last[64];
  int n = 0;
  for (std::size_t j = 0; j < located.size(); ++j) {
    const AffineMatch& m = located[j];
    if (!test(m)) continue;
    support.members.push_back(static_cast<int>(j));
    const auto cell = static_cast<std::size_t>(m.image_cell);
    std::uint64_t& word = cells[(cell / 64) % 40];
    if ((word >> (cell % 64) & 1) != 0) continue;
    word |= std::uint64_t{1} << (cell % 64);
    bool seen = false;
    for (int k = 0; k < n; ++k)
      if (last[k] == m.feature) seen = true;
    if (seen) continue;
    if (n < 64) last[n++] = m.feature;
    support.score += m.weight;
    ++support.distinct;
  }
  return support;
}

cv::Matx33d affine_of(const AffineMatch& p) {
  const auto a = cv::Matx22d(p.map);
  return {a(0, 0), a(0, 1), p.seen.x - a(0, 0) * p.at.x - a(0, 1) * p.at.y,
          a(1, 0), a(1, 1), p.seen.y - a(1, 0) * p.at.x - a(1, 1) * p.at.y,
          0,       0,       1};
}

double side_of(const cv::Matx33d& h, cv::Size size) {
  const cv::Point2d middle(size.width / 2.0, size.height / 2.0);
  const cv::Point2d o = geometry::mapped(h, middle);
  const cv::Point2d x = geometry::mapped(h, middle + cv::Point2d(1, 0)) - o;
  const cv::Point2d y = geometry::mapped(h, middle + cv::Point2d(0, 1)) - o;
  return std::sqrt(std::abs(x.cross(y)) * size.width * size.height);
}

// Fits an affine map, then a homography, each from the matches within the tolerance.
void optimise(Hypothesis& hypothesis, Support support, const std::vector<AffineMatch>& located,
              cv::Size size) {
  for (int round = 0; round < 3; ++round) {
    std::vector<Correspondence> correspondences;
    for (const int j : support.members) {
      const AffineMatch& p = located[static_cast<std::size_t>(j)];
      // Coarse features are less accurate.
      const double w = 1 / (1.0 + p.scale * p.scale / 4);
      correspondences.push_back({p.at, p.seen, w, 0, w});
    }
    cv::Matx33d h = hypothesis.h;
    const double side = side_of(h, size);
    HomographyFitOptions options;
    options.affine = round == 0;
    options.tolerance_px = std::max(6.0, side * (round == 0 ? 0.25 : 0.08));
    options.sigma_px = 1.5;
    options.iterations = 6;
    if (!fit_homography(h, size, correspondences, options)) return;
    const double near = std::max(4.0, side * (round == 0 ? 0.08 : 0.03));
    Support next = support_of(located, [&](const AffineMatch& p) {
      const cv::Point2d d = cv::Point2d(p.seen) - geometry::mapped(h, p.at);
      const double limit = near + p.scale;
      return d.dot(d) < limit * limit;
    });
    if (next.distinct < 3) return;
    hypothesis.h = h;
    hypothesis.score = next.score;
    hypothesis.support = next.distinct;
    support = std::move(next);
  }
}

}  // namespace

std::vector<Match> match_features(const FeatureSet& frame, const Target& target,
                                  const MatchOptions& options) {
  options.check();
  std::vector<Match> matches;
  const std::size_t n = target.descriptors.size();
  if (n < 2) return matches;
  const Kernels& kernel = kernels();
  std::vector<std::uint16_t> bits(n);
  std::vector<std::int32_t> near;
  const float min_distance =
      options.min_separation *
      std::hypot(static_cast<float>(target.gray.cols), static_cast<float>(target.gray.rows));
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const Descriptor& d = frame.descriptors[i];
    near.resize(n);
    const int count =
        kernel.search(d.sketch, target.sketches.data(), static_cast<int>(n), options.max_bits,
                      static_cast<int>(n), near.data(), bits.data());
    keep_nearest(bits, count, options.candidates, near);
    if (near.empty()) continue;
    int best = -1;
    int nearest = std::numeric_limits<int>::max();
    std::array<int, 160> distances{};
    for (std::size_t k = 0; k < near.size(); ++k) {
      distances[k] = kernel.distance(
          d.values.data(), target.descriptors[static_cast<std::size_t>(near[k])].values.data());
      if (distances[k] < nearest) {
        nearest = distances[k];
        best = near[k];
      }
    }
    const cv::Point2f at = target.features[static_cast<std::size_t>(best)].at;
    int other = -1;
    int farthest = 0;
    for (std::size_t k = 0; k < near.size(); ++k) {
      farthest = std::max(farthest, distances[k]);
      const cv::Point2f e = target.features[static_cast<std::size_t>(near[k])].at - at;
      if (e.dot(e) < min_distance * min_distance) continue;
      if (other < 0 || distances[k] < other) other = distances[k];
    }
    // No candidate is at another place: the next one is at least as distant as the farthest
    // candidate, or as typical for a sketch at the limit.
    const double typical = 22000;
    const double second = other >= 0 ? other : std::max<double>(farthest, typical);
    const auto ratio = static_cast<float>(std::sqrt(nearest / std::max(1.0, second)));
    if (ratio >= options.ratio) continue;
    matches.push_back(
        {static_cast<std::int32_t>(i), best, ratio, std::sqrt(static_cast<float>(nearest))});
  }
  std::stable_sort(matches.begin(), matches.end(),
                   [](const Match& a, const Match& b) { return a.ratio < b.ratio; });
  if (matches.size() > options.max_matches) matches.resize(options.max_matches);
  return matches;
}

std::vector<Hypothesis> find_hypotheses(const FeatureSet& frame, const Target& target,
                                        const std::vector<Match>& matches, std::size_t max_count) {
  const std::vector<AffineMatch> located = affine_matches(frame, target, matches);
  struct Start {
    std::size_t match;
    double score;
  };
  std::vector<Start> starts;
  // The matches are sorted by ratio: if none of the first is right, later ones are not either.
  for (std::size_t i = 0; i < std::min<std::size_t>(located.size(), 200); ++i) {
    const Support s =
        support_of(located, [&](const AffineMatch& m) { return agrees(located[i], m); });
    if (s.distinct >= 3) starts.push_back({i, s.score});
  }
  std::stable_sort(starts.begin(), starts.end(),
                   [](const Start& a, const Start& b) { return a.score > b.score; });
  starts.resize(std::min(starts.size(), 4 * max_count));
  std::vector<Hypothesis> found;
  for (const Start& start : starts) {
    const AffineMatch& seed = located[start.match];
    Hypothesis h{affine_of(seed), start.score, 0};
    optimise(h, support_of(located, [&](const AffineMatch& m) { return agrees(seed, m); }), located,
             target.size());
    const auto same = [&](const Hypothesis& other) {
      double e = 0;
      for (const cv::Point2d& c : target.corners())
        e = std::max(e, cv::norm(geometry::mapped(h.h, c) - geometry::mapped(other.h, c)));
      return e < 3;
    };
    if (std::none_of(found.begin(), found.end(), same)) found.push_back(h);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.score > b.score; });
  if (found.size() > max_count) found.resize(max_count);
  return found;
}

}  // namespace tarsier::planar::image_targets
