// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/pairs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

bool has(const std::vector<ImagePair>& pairs, int first, int second) {
  return std::find(pairs.begin(), pairs.end(), ImagePair(std::minmax(first, second))) !=
         pairs.end();
}

bool in_order(const std::vector<ImagePair>& pairs) {
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (pairs[i].first >= pairs[i].second) return false;
    if (i > 0 && pairs[i] <= pairs[i - 1]) return false;
  }
  return true;
}

TEST(ExhaustivePairs, ContainAllPairs) {
  EXPECT_TRUE(exhaustive_pairs(0).empty());
  EXPECT_TRUE(exhaustive_pairs(1).empty());
  EXPECT_EQ(exhaustive_pairs(3), (std::vector<ImagePair>{{0, 1}, {0, 2}, {1, 2}}));
  EXPECT_EQ(exhaustive_pairs(20).size(), 190U);
  EXPECT_THROW((void)exhaustive_pairs(-1), std::invalid_argument);
}

TEST(SequentialPairs, ContainNextImagesAndPowersOfTwo) {
  EXPECT_TRUE(sequential_pairs(1, 3).empty());
  const auto pairs = sequential_pairs(40, 3);
  EXPECT_TRUE(in_order(pairs));
  std::vector<int> of_zero;
  for (const auto& [first, second] : pairs)
    if (first == 0) of_zero.push_back(second);
  EXPECT_EQ(of_zero, (std::vector<int>{1, 2, 3, 4, 8, 16, 32}));
  EXPECT_TRUE(has(pairs, 38, 39));
  EXPECT_EQ(sequential_pairs(5, 100), exhaustive_pairs(5));
  EXPECT_THROW((void)sequential_pairs(5, 0), std::invalid_argument);
}

class PairsList : public FolderTest {
 protected:
  std::vector<ImagePair> read(const std::string& text) {
    std::ofstream(path("pairs.txt"), std::ios::binary) << text;
    return read_pairs_list(path("pairs.txt"), names_);
  }
  // The error for this text.
  std::string reprojection_error(const std::string& text) {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      return std::string(error.what()).substr(path("pairs.txt").size());
    }
    return "none";
  }

  std::vector<std::string> names_ = {"a.jpg", "b.jpg", "sub/c.jpg", "my d.jpg",
                                     "x",     "x y",   "y z",       "z"};
};

TEST_F(PairsList, IsRead) {
  EXPECT_EQ(read("# all\r\n\r\nb.jpg a.jpg # again\r\n a.jpg\t b.jpg\nsub/c.jpg   a.jpg"),
            (std::vector<ImagePair>{{0, 1}, {0, 2}}));
  EXPECT_EQ(read("my d.jpg sub/c.jpg\n"), (std::vector<ImagePair>{{2, 3}}));
  EXPECT_TRUE(read("").empty());
}

TEST_F(PairsList, ErrorsNameTheLine) {
  EXPECT_EQ(reprojection_error("a.jpg b.jpg\n\na.jpg nowhere.jpg\n"),
            ": line 3: no image is named 'nowhere.jpg'");
  EXPECT_EQ(reprojection_error("c.jpg b.jpg"), ": line 1: no image is named 'c.jpg'");
  EXPECT_EQ(reprojection_error("#\na.jpg\n"), ": line 2: expected the names of two images");
  EXPECT_EQ(
      reprojection_error("a.jpg b.jpg 17\n"),
      ": line 1: 'a.jpg b.jpg 17' does not name two images: expected two image names per line");
  EXPECT_EQ(reprojection_error("a.jpg a.jpg\n"), ": line 1: 'a.jpg' is paired with itself");
  EXPECT_EQ(reprojection_error("x y z\n"),
            ": line 1: the line is ambiguous, because image names contain spaces");
  EXPECT_NE(
      reprojection_error("a.jpg b.jpg\n" + std::string(100'000, 'a')).find(": line 2: longer"),
      std::string::npos);
  EXPECT_THROW((void)read_pairs_list(path("nowhere.txt"), names_), InputError);
  EXPECT_THROW((void)read_pairs_list(path("."), names_), InputError);
}

// The descriptors of world points, slightly different in each image.
class World {
 public:
  World(int points, FeatureKind kind, std::uint64_t seed) : kind_(kind), rng_(seed) {
    Rng rng(seed);
    const bool sift = kind == FeatureKind::kSift;
    looks_.create(points, sift ? 128 : 32, CV_8UC1);
    for (int r = 0; r < looks_.rows; ++r)
      for (int k = 0; k < looks_.cols; ++k)
        looks_.at<std::uint8_t>(r, k) = static_cast<std::uint8_t>(
            sift ? std::min(255.0, std::abs(rng.normal(0, 45))) : rng.integer(0, 255));
  }

  // `count` points from `from` on, in a circle.
  [[nodiscard]] cv::Mat image(int from, int count) {
    cv::Mat seen;
    for (int i = 0; i < count; ++i) seen.push_back(looks_.row((from + i) % looks_.rows));
    for (int r = 0; r < seen.rows; ++r) {
      for (int k = 0; k < seen.cols; ++k) {
        auto& value = seen.at<std::uint8_t>(r, k);
        if (kind_ == FeatureKind::kSift)
          value = cv::saturate_cast<std::uint8_t>(value + rng_.normal(0, 12));
        else if (rng_.uniform() < 0.3)
          value ^= static_cast<std::uint8_t>(1 << rng_.integer(0, 7));
      }
    }
    return seen;
  }

 private:
  FeatureKind kind_;
  Rng rng_;
  cv::Mat looks_;
};

// Images around an object. Each image has 200 points and shares all but `step` of them with the
// next.
std::vector<cv::Mat> ring(int images, FeatureKind kind, std::uint64_t seed, int step = 50) {
  World world(images * step, kind, seed);
  std::vector<cv::Mat> result;
  for (int i = 0; i < images; ++i) result.push_back(world.image(i * step, 200));
  return result;
}

Retrieval retrieval_of(const std::vector<cv::Mat>& images, FeatureKind kind,
                       const RetrievalOptions& options) {
  return {static_cast<int>(images.size()),
          [&](int i) { return images[static_cast<std::size_t>(i)]; }, kind, options};
}

TEST(Retrieval, FindsNeighboursInRing) {
  for (const FeatureKind kind : {FeatureKind::kSift, FeatureKind::kOrb}) {
    const auto images = ring(30, kind, 1);
    RetrievalOptions options;
    options.nearest = 4;
    const Retrieval retrieval = retrieval_of(images, kind, options);
    const auto pairs = retrieval.pairs();
    EXPECT_TRUE(in_order(pairs));
    for (int i = 0; i < 30; ++i) {
      EXPECT_TRUE(has(pairs, i, (i + 1) % 30)) << i;
      EXPECT_TRUE(has(pairs, i, (i + 2) % 30)) << i;
      EXPECT_NEAR(retrieval.similarity(i, i), 1, 0.02);
      EXPECT_GT(retrieval.similarity(i, (i + 1) % 30), retrieval.similarity(i, (i + 10) % 30));
      EXPECT_DOUBLE_EQ(retrieval.similarity(i, 0), retrieval.similarity(0, i));
    }
    EXPECT_LE(pairs.size(), 30U * 4U);
  }
}

// The four nearest neighbours of each image are at most two steps away.
TEST(Retrieval, AddsDistantImagesInDenseRing) {
  constexpr int kImages = 150;
  constexpr int kStep = 2;
  RetrievalOptions options;
  options.words = 8;  // so that each has many points
  options.nearest = 4;
  const auto pairs =
      retrieval_of(ring(kImages, FeatureKind::kSift, 1, kStep), FeatureKind::kSift, options)
          .pairs();
  EXPECT_TRUE(in_order(pairs));
  std::vector<int> farthest(kImages, 0);
  for (const auto& [first, second] : pairs) {
    const int distance = std::min(second - first, kImages - second + first);
    EXPECT_LT(distance * kStep, 150) << "they share little: " << first << " and " << second;
    farthest[static_cast<std::size_t>(first)] =
        std::max(farthest[static_cast<std::size_t>(first)], distance);
    farthest[static_cast<std::size_t>(second)] =
        std::max(farthest[static_cast<std::size_t>(second)], distance);
  }
  EXPECT_GE(*std::min_element(farthest.begin(), farthest.end()), 2);
  EXPECT_GE(
      std::count_if(farthest.begin(), farthest.end(), [](int distance) { return distance >= 6; }),
      kImages / 3);
  EXPECT_LE(pairs.size(), kImages * 4U);
}

TEST(Retrieval, SeparatesScenes) {
  auto images = ring(12, FeatureKind::kSift, 2);
  for (const cv::Mat& other : ring(12, FeatureKind::kSift, 3)) images.push_back(other);
  RetrievalOptions options;
  options.nearest = 4;
  const auto pairs = retrieval_of(images, FeatureKind::kSift, options).pairs();
  EXPECT_GE(pairs.size(), 48U);
  for (const auto& [first, second] : pairs) EXPECT_EQ(first < 12, second < 12);
}

TEST(Retrieval, IsTheSameForAnyNumberOfThreads) {
  // More images than in a block of the product and in a panel, and more words than in a panel.
  const auto images = ring(150, FeatureKind::kSift, 4);
  RetrievalOptions options;
  options.words = 60;
  std::vector<std::vector<ImagePair>> pairs;
  std::vector<double> similarities;
  const int before = cv::getNumThreads();
  for (const int threads : {1, 3}) {
    cv::setNumThreads(threads);
    const Retrieval retrieval = retrieval_of(images, FeatureKind::kSift, options);
    pairs.push_back(retrieval.pairs());
    similarities.push_back(retrieval.similarity(3, 5));
  }
  cv::setNumThreads(before);
  EXPECT_EQ(pairs[0], pairs[1]);
  EXPECT_EQ(similarities[0], similarities[1]);
  for (int i = 0; i < 150; ++i) EXPECT_TRUE(has(pairs[0], i, (i + 1) % 150)) << i;
  options.seed = 2;
  EXPECT_NE(retrieval_of(images, FeatureKind::kSift, options).similarity(3, 5), similarities[0]);
}

TEST(Retrieval, PositionsDistinguishIdenticalScenes) {
  // The same ring twice, so far apart that only the positions separate them.
  auto images = ring(60, FeatureKind::kSift, 5);
  for (const cv::Mat& twin : ring(60, FeatureKind::kSift, 5)) images.push_back(twin);
  KnownPositions positions;
  for (int i = 0; i < 120; ++i) {
    const double angle = 2 * CV_PI * (i % 60) / 60;
    positions.emplace_back(Eigen::Vector3d(i < 60 ? 0 : 500, std::cos(angle), std::sin(angle)));
  }
  RetrievalOptions options;
  options.nearest = 6;
  const Retrieval retrieval = retrieval_of(images, FeatureKind::kSift, options);
  const auto between_rings = [](const std::vector<ImagePair>& pairs) {
    return std::count_if(pairs.begin(), pairs.end(), [](const ImagePair& pair) {
      return pair.first < 60 && pair.second >= 60;
    });
  };
  const auto by_similarity = retrieval.pairs();
  const auto guided = retrieval.pairs(positions);
  EXPECT_TRUE(in_order(guided));
  EXPECT_GT(between_rings(by_similarity), static_cast<int>(by_similarity.size()) / 3);
  // A third of each image's pairs is chosen by appearance alone.
  EXPECT_LE(between_rings(guided), 2 * 120);
  for (int i = 0; i < 60; ++i) {
    for (const int first : {0, 60}) {
      EXPECT_TRUE(has(guided, first + i, first + (i + 1) % 60)) << i;
      EXPECT_TRUE(has(guided, first + i, first + (i + 2) % 60)) << i;
    }
  }
}

TEST(Retrieval, UninformativePositionsChangeNothing) {
  const auto images = ring(40, FeatureKind::kSift, 6);
  RetrievalOptions options;
  options.nearest = 6;
  const Retrieval retrieval = retrieval_of(images, FeatureKind::kSift, options);
  const auto by_similarity = retrieval.pairs();
  // A receiver with a constant position, and images without positions.
  EXPECT_EQ(retrieval.pairs(KnownPositions(40, Eigen::Vector3d(1, 2, 3))), by_similarity);
  EXPECT_EQ(retrieval.pairs(KnownPositions(40)), by_similarity);
  EXPECT_THROW((void)retrieval.pairs(KnownPositions(39)), std::invalid_argument);
  EXPECT_THROW((void)retrieval.pairs(KnownPositions(40, Eigen::Vector3d(1, NAN, 3))),
               std::invalid_argument);
}

TEST(Retrieval, ToleratesEmptyAndEqualImages) {
  EXPECT_TRUE(retrieval_of({}, FeatureKind::kSift, {}).pairs().empty());
  EXPECT_TRUE(retrieval_of({cv::Mat(), cv::Mat()}, FeatureKind::kSift, {}).pairs().empty());
  // All descriptors are equal, so there is one word and no information.
  const cv::Mat flat(50, 128, CV_8UC1, cv::Scalar(40));
  EXPECT_TRUE(retrieval_of({flat, flat}, FeatureKind::kSift, {}).pairs().empty());

  auto images = ring(6, FeatureKind::kSift, 5);
  images.insert(images.begin() + 2, cv::Mat());
  const Retrieval retrieval = retrieval_of(images, FeatureKind::kSift, {});
  EXPECT_EQ(retrieval.similarity(0, 2), 0);
  const auto pairs = retrieval.pairs();
  EXPECT_EQ(pairs.size(), 15U);
  for (const auto& [first, second] : pairs) EXPECT_TRUE(first != 2 && second != 2);
}

TEST(Retrieval, RefusesInvalidDescriptorsAndOptions) {
  const cv::Mat wide(5, 128, CV_8UC1, cv::Scalar(1));
  const cv::Mat narrow(5, 64, CV_8UC1, cv::Scalar(1));
  const cv::Mat floats(5, 128, CV_32FC1, cv::Scalar(1));
  EXPECT_THROW(retrieval_of({wide, narrow}, FeatureKind::kSift, {}), std::invalid_argument);
  EXPECT_THROW(retrieval_of({floats}, FeatureKind::kSift, {}), std::invalid_argument);
  RetrievalOptions options;
  options.words = 0;
  EXPECT_THROW(retrieval_of({wide}, FeatureKind::kSift, options), std::invalid_argument);
  EXPECT_THROW((void)retrieval_of({wide}, FeatureKind::kSift, {}).similarity(0, 1),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
