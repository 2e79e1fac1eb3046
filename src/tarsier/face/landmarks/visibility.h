// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/face_input.h"
#include "tarsier/face/landmarks/training_face.h"
#include "tarsier/linalg/network.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Visibility and uncertainty of each fitted point, as LUVLi has them (Kumar and others, "LUVLi face alignment", CVPR
// 2020), but from a network of its own beside the fit, learnt from faces before which things are drawn
// (occlusion.h).
namespace tarsier::face::landmarks {

// So that of ten points that are called hidden nine are (docs/results.md).
inline constexpr double kHiddenBelow = 0.15;

struct Visibility {
  Eigen::VectorXd visible;   // n, probability that the point is seen, 0..1
  Eigen::VectorXd sigma_px;  // n, distance from the truth that 68 % of such points stay within, px
  // visible < kHiddenBelow; empty where nothing is known.
  [[nodiscard]] std::vector<bool> hidden() const;
};

// A small convolutional network sees the face in the frame of the fitted points: kVisibilitySide px a side,
// kVisibilityScale px to the mean shape's size, grey levels of mean 0 and deviation 1. It gives 2 n
// numbers h, l:
//   visible_i = 1 / (1 + exp(a h_i + b))        sigma_i = s exp(l_i + c)
// with s the shape's size in px (shape_size()), and a, b, c fitted on faces that the network did not learn from.
struct VisibilityModel {
  Eigen::Matrix2Xd mean;  // 2 x n: centred, size 1
  linalg::Network network;
  double hidden_slope = 1;   // a
  double hidden_offset = 0;  // b
  double sigma_offset = 0;   // c
  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  void check() const;  // throws std::invalid_argument
};
inline constexpr int kVisibilitySide = 64;
inline constexpr double kVisibilityScale = 13;

struct VisibilityOptions {
  int steps = 12000;      // of 32 fits
  double occluded = 0.7;  // share of the fits with something drawn before the face
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {
        {"steps", steps, range(1, 1'000'000), "--steps", "steps of the training, of 32 fits each"},
        {"occluded", occluded, inside(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// Accuracy of visibility and sigma on faces that the model did not learn from. Counts of points.
struct VisibilityScore {
  int hidden = 0;
  int hidden_found = 0;  // hidden and flagged (Visibility::hidden())
  int seen = 0;
  int seen_flagged = 0;  // seen but flagged
  int within = 0;        // of all: no farther from the truth than sigma
  // `hidden`: the truth, a flag for each point; points 2 x n, px. Throws std::invalid_argument for other sizes.
  void add(const Visibility& visibility, const Eigen::Matrix2Xd& fitted,
           const Eigen::Matrix2Xd& truth, const std::vector<bool>& hidden);
  [[nodiscard]] double recall() const;     // share of the hidden points that are flagged
  [[nodiscard]] double precision() const;  // share of the flagged points that are hidden
  [[nodiscard]] double coverage()
      const;  // share within sigma; each is 1 where there is no such point
};

// Needs ten faces at least; mirrored and turned ones lie behind theirs. Every fifth face is kept back for a, b and c.
// Fits come from a descent that the other half of the faces taught, so that errors are as on faces
// never seen. The same for any number of threads. Throws Interrupted, std::invalid_argument.
[[nodiscard]] VisibilityModel train_visibility_model(const std::vector<TrainingFace>& faces,
                                                     const VisibilityOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop);

// Buffers. One for each thread.
struct VisibilityWorkspace {
  linalg::Workspace network;
  FaceInput face;
};

// The same of a set of annotated images (paths from the current folder), with `mirror` also mirrored. Images that
// cannot be used are named in `skipped`. Throws InputError too.
[[nodiscard]] VisibilityModel train_visibility_model(const shape::LandmarkSet& set, bool mirror,
                                                     const VisibilityOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop,
                                                     std::vector<std::string>& skipped);

// Of points (2 x n, px of `gray`, CV_8UC1) that a fit gave. Points that are not finite, or within 1 px of each other,
// are hidden.
[[nodiscard]] Visibility visibility_of(const VisibilityModel& model, const cv::Mat& gray,
                                       const Eigen::Matrix2Xd& points,
                                       VisibilityWorkspace& workspace);

[[nodiscard]] nlohmann::json to_json(const VisibilityModel& model);
[[nodiscard]] VisibilityModel visibility_from_json(const nlohmann::json& value,
                                                   const std::string& path);

}  // namespace tarsier::face::landmarks
