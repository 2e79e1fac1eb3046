// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/features/features.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// Selection of the image pairs to compare. The smaller index of a pair comes first. Lists of pairs
// are sorted and contain each pair once.
namespace tarsier::sfm {

using ImagePair = std::pair<int, int>;

// All pairs: count * (count - 1) / 2.
[[nodiscard]] std::vector<ImagePair> exhaustive_pairs(int count);

// For images in the order of capture: each with the `overlap` (>= 1) next ones, and with those 2,
// 4, 8, .. images later. The latter stabilise a long sequence against drift between neighbours.
[[nodiscard]] std::vector<ImagePair> sequential_pairs(int count, int overlap);

// Reads a text file with two of `names` on each line, separated by white space. A '#' at the start
// of a line or after white space begins a comment. Names may contain spaces if a line can be read
// in only one way. Throws InputError with the line number for unknown names, an image paired with
// itself, and other kinds of files.
[[nodiscard]] std::vector<ImagePair> read_pairs_list(const std::string& path,
                                                     const std::vector<std::string>& names);

// Camera positions where known; in one frame, any unit.
using KnownPositions = std::vector<std::optional<Eigen::Vector3d>>;

struct RetrievalOptions {
  int words = 64;     // size of the vocabulary
  int nearest = 12;   // images to compare each one with
  int sampled = 200;  // max descriptors per image for training the vocabulary
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"words", words, range(1, 1024)},
            {"nearest", nearest, range(1, 10'000)},
            {"sampled", sampled, range(1, 100'000)}};
  }
  void check() const { check_fields(*this); }
};

// Returns the descriptors of an image, as in Features.
using DescriptorSource = std::function<cv::Mat(int)>;

// Finds similar images without comparing all of them point by point. Each image becomes a vector of
// residuals against a vocabulary, VLAD (Jegou et al., CVPR 2010), with intra-normalisation of each
// word's part (Arandjelovic and Zisserman, CVPR 2013), signed square roots and length 1. The
// vocabulary comes from k-means (seeded as k-means++, Arthur and Vassilvitskii, SODA 2007) over at
// most 50 000 descriptors. Stores one byte per image, word and dimension. Does not depend on the
// number of threads.
class Retrieval {
 public:
  // Calls `source` only from the calling thread, at most twice for each of `count` images. Holds
  // the descriptors of few images at a time. Images may have none. Throws std::invalid_argument for
  // invalid options and for descriptors that are not of `kind` or differ in width. Exceptions of
  // `source` are passed on.
  Retrieval(int count, const DescriptorSource& source, FeatureKind kind,
            const RetrievalOptions& options);

  [[nodiscard]] int count() const { return static_cast<int>(scales_.size()); }

  // Approximate cosine of the two images' vectors, -1..1; 0 where one has no descriptors.
  [[nodiscard]] double similarity(int first, int second) const;

  // Pairs each image with its `options.nearest` most similar others. An image without descriptors
  // is in no pair. All similarities are computed, as one matrix product.
  //
  // Where the images at twice the rank still have 0.85 of the similarity, the nearest images have
  // almost the same view. There, images at 2, 4, 8, .. times the rank `options.nearest` are added
  // while this holds, for every second, fourth, eighth, .. image: views that far apart change
  // slowly from image to image.
  //
  // `positions`, one per image or empty, are camera positions. For an image with a position, two
  // thirds of the `nearest` others are chosen by similarity among the nearest positions (four times
  // `nearest`, and equally near ones). The rest are the most similar of all images, since a
  // landmark is visible from afar and a receiver may be wrong. For an image without a position, all
  // are chosen this way. Throws std::invalid_argument for a wrong number of positions and for
  // numbers that are not finite.
  [[nodiscard]] std::vector<ImagePair> pairs(const KnownPositions& positions = {}) const;

 private:
  RetrievalOptions options_;
  int length_ = 0;                    // of a vector: words times dimensions of a descriptor
  std::vector<std::int8_t> vectors_;  // length_ numbers per image, in units of scales_
  std::vector<float> scales_;         // per image; 0: it has no descriptors
};

}  // namespace tarsier::sfm
