// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/flow.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

const cv::Size kFrameSize(320, 240);

// A smooth, unbounded surface with a known value at every position, not only at pixels.
class Texture {
 public:
  explicit Texture(std::uint64_t seed) {
    Rng rng(seed);
    for (int i = 0; i < 40; ++i) {
      const double length = rng.uniform(9, 50);  // px
      const double angle = rng.uniform(0, 2 * std::numbers::pi);
      waves_.push_back({2 * std::numbers::pi / length * std::cos(angle),
                        2 * std::numbers::pi / length * std::sin(angle),
                        rng.uniform(0, 2 * std::numbers::pi)});
    }
  }
  // The values at `begin`, `begin + step` .. of a line. Rotating a vector is many times faster than
  // a sine for each value.
  [[nodiscard]] std::vector<double> along(const cv::Point2d& begin, const cv::Point2d& step,
                                          int count) const {
    std::vector<double> sums(static_cast<std::size_t>(count), 128);
    for (const cv::Vec3d& wave : waves_) {
      const double turn = wave[0] * step.x + wave[1] * step.y;
      const double across = std::cos(turn);
      const double up = std::sin(turn);
      double x = 14 * std::cos(wave[0] * begin.x + wave[1] * begin.y + wave[2]);
      double y = 14 * std::sin(wave[0] * begin.x + wave[1] * begin.y + wave[2]);
      for (double& sum : sums) {
        sum += y;
        const double next = across * x - up * y;
        y = up * x + across * y;
        x = next;
      }
    }
    return sums;
  }

 private:
  std::vector<cv::Vec3d> waves_;
};

// A camera that moves over the surface.
struct Motion {
  cv::Point2d shift;  // px a frame
  double zoom = 1;    // a frame
  double turn = 0;    // radians a frame

  // The position of frame 0's point in `frame`, and back.
  [[nodiscard]] cv::Point2d seen(const cv::Point2d& at, int frame) const {
    const double s = std::pow(zoom, frame);
    const double c = std::cos(turn * frame);
    const double d = std::sin(turn * frame);
    const cv::Point2d p = at - center();
    return center() + s * cv::Point2d(c * p.x - d * p.y, d * p.x + c * p.y) + frame * shift;
  }
  [[nodiscard]] cv::Point2d world(const cv::Point2d& at, int frame) const {
    const double s = std::pow(zoom, frame);
    const double c = std::cos(turn * frame);
    const double d = std::sin(turn * frame);
    const cv::Point2d p = at - center() - frame * shift;
    return center() + cv::Point2d(c * p.x + d * p.y, -d * p.x + c * p.y) / s;
  }
  static cv::Point2d center() { return {160, 120}; }
};

cv::Mat drawn(const Texture& texture, const Motion& motion, int frame) {
  cv::Mat image(kFrameSize, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    const cv::Point2d begin = motion.world(cv::Point2d(0, y), frame);
    const cv::Point2d step = motion.world(cv::Point2d(1, y), frame) - begin;
    const std::vector<double> line = texture.along(begin, step, image.cols);
    for (int x = 0; x < image.cols; ++x)
      image.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(line[static_cast<std::size_t>(x)]);
  }
  return image;
}

const FlowMatches* pair_of(const FlowResult& result, int first, int second) {
  for (const FlowMatches& pair : result.pairs)
    if (pair.first == first && pair.second == second) return &pair;
  return nullptr;
}

cv::Point2f point_of(const FlowResult& result, int image, int feature) {
  return result.features[static_cast<std::size_t>(image)].points[static_cast<std::size_t>(feature)];
}

// Sorted errors of a pair's matches, px.
std::vector<double> errors_of(const FlowResult& result, const FlowMatches& pair,
                              const Motion& motion) {
  std::vector<double> errors;
  for (const Match& match : pair.matches) {
    const cv::Point2d a = point_of(result, pair.first, match.first);
    const cv::Point2d b = point_of(result, pair.second, match.second);
    errors.push_back(cv::norm(motion.seen(motion.world(a, pair.first), pair.second) - b));
  }
  std::sort(errors.begin(), errors.end());
  return errors;
}

double part(const std::vector<double>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

FlowResult tracked(const std::vector<cv::Mat>& frames, const FlowOptions& options) {
  FlowTracker tracker(options);
  for (const cv::Mat& frame : frames) tracker.add(frame);
  return tracker.finish();
}

TEST(Flow, IsAccurateAfterFiveFrames) {
  const Texture texture(1);
  for (const Motion& motion : {Motion{{3.3, -1.7}, 1, 0}, Motion{{0.37, 0.21}, 1.03, 0},
                               Motion{{-5.6, 2.3}, 0.98, 0.02}, Motion{{14.2, 6.1}, 1, 0}}) {
    std::vector<cv::Mat> frames;
    for (int k = 0; k < 8; ++k) frames.push_back(drawn(texture, motion, k));
    const FlowResult result = tracked(frames, {});
    ASSERT_EQ(result.features.size(), 8U);
    for (int first = 0; first < 8; ++first) {
      for (int second = first + 1; second < 8; ++second) {
        const FlowMatches* pair = pair_of(result, first, second);
        if (second - first >= FlowOptions{}.reach) {
          EXPECT_EQ(pair, nullptr);
          continue;
        }
        ASSERT_NE(pair, nullptr) << first << " " << second;
        const auto errors = errors_of(result, *pair, motion);
        EXPECT_GE(errors.size(), 15U) << first << " " << second;
        EXPECT_LT(part(errors, 0.5), 0.05) << first << " " << second;
        EXPECT_LT(part(errors, 0.95), 0.3) << first << " " << second;
        if (first == 0 && second == 5)
          RecordProperty("median_px", std::to_string(part(errors, 0.5)));
      }
    }
  }
}

TEST(Flow, MatchesConnectAllFrames) {
  const Texture texture(2);
  const Motion motion{{1.3, 0.6}, 1, 0};
  std::vector<cv::Mat> frames;
  for (int k = 0; k < 16; ++k) frames.push_back(drawn(texture, motion, k));
  const FlowResult result = tracked(frames, {});
  const FlowMatches* start = pair_of(result, 0, 1);
  ASSERT_NE(start, nullptr);
  for (int k = 0; k + 2 < 16; ++k) {
    const FlowMatches* pair = pair_of(result, k, k + 2);
    ASSERT_NE(pair, nullptr) << k;
    EXPECT_GT(pair->matches.size(), start->matches.size() / 2) << k;
  }
}

TEST(Flow, DropsOccludedAndLeavingPoints) {
  const Texture texture(3);
  const Texture other(4);
  const Motion motion{{6.4, 0.3}, 1, 0};
  const cv::Rect cover(120, 60, 110, 110);
  std::vector<cv::Mat> frames;
  for (int k = 0; k < 7; ++k) {
    frames.push_back(drawn(texture, motion, k));
    if (k >= 3) drawn(other, {}, 0)(cover).copyTo(frames.back()(cover));
  }
  FlowOptions options;
  options.reach = 7;
  const FlowResult result = tracked(frames, options);
  int before = 0;
  int across = 0;
  int wrong = 0;
  int covered = 0;
  const cv::Rect inside(cover.x + 5, cover.y + 5, cover.width - 10, cover.height - 10);
  for (const FlowMatches& pair : result.pairs) {
    for (const Match& match : pair.matches) {
      const cv::Point2f a = point_of(result, pair.first, match.first);
      const cv::Point2f b = point_of(result, pair.second, match.second);
      EXPECT_TRUE(cv::Rect2f(0, 0, 319, 239).contains(b));
      if (pair.first == 1 && pair.second == 2 && cover.contains(cv::Point(b))) ++before;
      if (pair.first >= 3 || pair.second < 3) continue;
      ++across;
      if (cv::norm(cv::Point2d(b - a) - (pair.second - pair.first) * motion.shift) > 1) ++wrong;
      if (inside.contains(cv::Point(b))) ++covered;
    }
  }
  // A few patches at the cover's rim are wrong, since most of their pixels stay as before.
  EXPECT_GT(across, 500);
  EXPECT_LT(wrong, across / 50);
  EXPECT_EQ(covered, 0);
  RecordProperty("wrong", std::to_string(wrong) + " of " + std::to_string(across));
  EXPECT_GT(before, 10);
  // Features found on the cover stay on it.
  const FlowMatches* late = pair_of(result, 4, 6);
  ASSERT_NE(late, nullptr);
  int still = 0;
  for (const Match& match : late->matches) {
    if (cv::norm(point_of(result, 4, match.first) - point_of(result, 6, match.second)) < 0.2)
      ++still;
  }
  EXPECT_GT(still, 10);
}

TEST(Flow, TracksNothingAcrossSceneCut) {
  const FlowResult result = tracked({drawn(Texture(5), {}, 0), drawn(Texture(6), {}, 0)}, {});
  for (const FlowMatches& pair : result.pairs) EXPECT_LE(pair.matches.size(), 3U);  // by chance
}

TEST(Flow, ToleratesGainAndOffset) {
  const Texture texture(7);
  const Motion motion{{2.2, 1.4}, 1.01, 0};
  std::vector<cv::Mat> frames;
  for (int k = 0; k < 4; ++k) {
    cv::Mat frame;
    drawn(texture, motion, k).convertTo(frame, CV_8U, 1 - 0.04 * k, 4.0 * k);
    frames.push_back(frame);
  }
  const FlowResult result = tracked(frames, {});
  const FlowMatches* pair = pair_of(result, 0, 3);
  ASSERT_NE(pair, nullptr);
  EXPECT_LT(part(errors_of(result, *pair, motion), 0.5), 0.1);
}

TEST(Flow, FeaturesAndMatchesAreConsistent) {
  const Texture texture(8);
  const Motion motion{{2, 3}, 1, 0};
  std::vector<cv::Mat> frames;
  for (int k = 0; k < 5; ++k) {
    cv::Mat gray = drawn(texture, motion, k);
    cv::Mat color;
    cv::merge(std::vector<cv::Mat>{gray, gray / 2, cv::Mat(kFrameSize, CV_8UC1, cv::Scalar(9))},
              color);
    frames.push_back(color);
  }
  const FlowResult result = tracked(frames, {});
  for (const Features& features : result.features) {
    EXPECT_FALSE(features.points.empty());
    EXPECT_EQ(features.points.size(), features.colors.size());
    EXPECT_EQ(features.points.size(), features.sizes.size());
    EXPECT_TRUE(features.descriptors.empty());
    for (const cv::Vec3b& color : features.colors) EXPECT_EQ(color[2], 9);
  }
  for (const FlowMatches& pair : result.pairs) {
    EXPECT_LT(pair.first, pair.second);
    for (std::size_t i = 0; i < pair.matches.size(); ++i) {
      const auto first = static_cast<std::size_t>(pair.matches[i].first);
      const auto second = static_cast<std::size_t>(pair.matches[i].second);
      EXPECT_LT(first, result.features[static_cast<std::size_t>(pair.first)].points.size());
      EXPECT_LT(second, result.features[static_cast<std::size_t>(pair.second)].points.size());
      if (i > 0) {
        EXPECT_LT(pair.matches[i - 1].first, pair.matches[i].first);
        EXPECT_LT(pair.matches[i - 1].second, pair.matches[i].second);
      }
    }
  }
}

TEST(Flow, IsTheSameForAnyNumberOfThreads) {
  const Texture texture(9);
  const Motion motion{{2.7, -3.1}, 1.02, 0.01};
  std::vector<cv::Mat> frames;
  for (int k = 0; k < 7; ++k) frames.push_back(drawn(texture, motion, k));
  FlowOptions options;
  options.reach = 4;
  std::vector<FlowResult> results;
  const int before = cv::getNumThreads();
  for (const int threads : {1, 3}) {
    cv::setNumThreads(threads);
    results.push_back(tracked(frames, options));
  }
  cv::setNumThreads(before);
  ASSERT_EQ(results[0].pairs.size(), results[1].pairs.size());
  for (std::size_t i = 0; i < results[0].pairs.size(); ++i)
    EXPECT_EQ(results[0].pairs[i].matches, results[1].pairs[i].matches);
  for (std::size_t i = 0; i < frames.size(); ++i)
    EXPECT_EQ(results[0].features[i].points, results[1].features[i].points);
}

TEST(Flow, AcceptsUniformFramesAndRefusesInvalidOnes) {
  FlowTracker tracker({});
  const cv::Mat flat(kFrameSize, CV_8UC1, cv::Scalar(80));
  tracker.add(flat);
  tracker.add(flat);
  EXPECT_EQ(tracker.count(), 2);
  EXPECT_THROW(tracker.add(cv::Mat(100, 100, CV_8UC1, cv::Scalar(0))), std::invalid_argument);
  EXPECT_THROW(tracker.add(cv::Mat(kFrameSize, CV_32FC1, cv::Scalar(0))), std::invalid_argument);
  EXPECT_THROW(tracker.add(cv::Mat()), std::invalid_argument);
  const FlowResult result = tracker.finish();
  EXPECT_EQ(result.features.size(), 2U);
  EXPECT_TRUE(result.pairs.empty());
  tracker.add(cv::Mat(100, 100, CV_8UC1, cv::Scalar(0)));  // a new sequence
  EXPECT_EQ(tracker.finish().features.size(), 1U);
  EXPECT_TRUE(tracker.finish().features.empty());
  FlowOptions options;
  options.reach = 1;
  EXPECT_THROW(FlowTracker{options}, std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
