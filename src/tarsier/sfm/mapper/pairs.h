// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/mapper/features.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// Which images to compare with which. A pair names the smaller index first; lists of pairs are
// sorted and hold each pair once.
namespace tarsier::sfm {

using ImagePair = std::pair<int, int>;

// Each with each: count * (count - 1) / 2 of them.
[[nodiscard]] std::vector<ImagePair> exhaustive_pairs(int count);

// For images in the order in which they were taken: each with the `overlap` (>= 1) next ones,
// and beyond these with the ones 2, 4, 8, .. images later, which hold a long sequence together
// where its links of neighbours drift.
[[nodiscard]] std::vector<ImagePair> sequential_pairs(int count, int overlap);

// A text file with two of `names` on each line, with white space between; what follows a '#' at a
// line's start or after white space is a comment. Names may contain spaces as long as only one
// reading of a line fits. Throws InputError with the line's number for names that are not there, a
// image that is paired with itself, and files that are no text of this kind.
[[nodiscard]] std::vector<ImagePair> read_pairs_list(const std::string& path,
                                                     const std::vector<std::string>& names);

// Where images were taken, of those of which it is known; in one frame, any unit.
using KnownPlaces = std::vector<std::optional<Eigen::Vector3d>>;

struct RetrievalOptions {
  int words = 64;     // of the vocabulary
  int nearest = 12;   // images to compare each one with
  int sampled = 200;  // at most so many descriptors of an image make the vocabulary
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"words", words, range(1, 1024)},
            {"nearest", nearest, range(1, 10'000)},
            {"sampled", sampled, range(1, 100'000)}};
  }
  void check() const { check_fields(*this); }
};

// Gives the descriptors of an image, as Features has them.
using DescriptorSource = std::function<cv::Mat(int)>;

// Images that look alike, found without comparing all of them point by point: each becomes one
// vector of residuals against a vocabulary, VLAD (Jegou et al., CVPR 2010), with each word's share
// brought to the same length (intra-normalisation, Arandjelovic and Zisserman, CVPR 2013), signed
// square roots and length 1. The vocabulary comes from k-means (seeded as k-means++, Arthur and
// Vassilvitskii, SODA 2007) over at most 50 000 descriptors. Keeps one byte for each word and
// dimension of an image. The same for any number of threads.
class Retrieval {
 public:
  // Calls `source` from the calling thread only, at most twice for each of `count` images, and
  // holds the descriptors of few images at a time. Images may have none. Throws
  // std::invalid_argument for bad options and descriptors that are not of `kind` or of different
  // widths; what `source` throws goes through.
  Retrieval(int count, const DescriptorSource& source, FeatureKind kind,
            const RetrievalOptions& options);

  [[nodiscard]] int count() const { return static_cast<int>(scales_.size()); }

  // About the cosine of the two images' vectors, -1..1; 0 if one has no descriptors.
  [[nodiscard]] double similarity(int first, int second) const;

  // Each image with its `options.nearest` most similar others. One that has no descriptors is
  // in no pair. All similarities are computed, as one product of matrices.
  //
  // Where images lie so close that those at twice the rank have 0.85 of the similarity, the nearest ones are seen from
  // nearly the same place. The images at 2, 4, 8, .. times the rank `options.nearest` are added there, as long as that holds,
  // by every second, fourth, eighth, .. image: views that far apart change slowly from image to image.
  //
  // `places`, one for each image or empty: where images were taken. Two thirds of the `nearest`
  // others of an image with a place are then the most similar among those that were taken nearest
  // to it, four times `nearest` of them and what is as near; the others are the most similar of
  // all, since a landmark is seen from afar and a receiver may be wrong. Of an image without a
  // place all are. Throws std::invalid_argument for another number of places and numbers that are
  // not finite.
  [[nodiscard]] std::vector<ImagePair> pairs(const KnownPlaces& places = {}) const;

 private:
  RetrievalOptions options_;
  int length_ = 0;                    // of a vector: words times dimensions of a descriptor
  std::vector<std::int8_t> vectors_;  // length_ of an image, in units of ..
  std::vector<float> scales_;         // .. this; 0: it has no descriptors
};

}  // namespace tarsier::sfm
