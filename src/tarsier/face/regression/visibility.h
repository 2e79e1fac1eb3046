// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/face_input.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/linalg/network.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Visibility and uncertainty of each fitted point, as in LUVLi (Kumar and others, "LUVLi face
// alignment", CVPR 2020), but estimated by a separate network after the fit. It is trained on faces
// with synthetic occlusions (occlusion.h).
namespace tarsier::face::regression {

// Chosen so that nine of ten points flagged as hidden are hidden (docs/results.md).
inline constexpr double kMinVisibleProbability = 0.15;

struct Visibility {
  Eigen::VectorXd visible;  // n, probability that the point is visible, 0..1
  // n, px: distance from the true position that 68 % of such points stay within.
  Eigen::VectorXd sigma_px;
  // visible < kMinVisibleProbability; empty if unknown.
  [[nodiscard]] std::vector<bool> hidden() const;
};

// A small convolutional network sees the face in the frame of the fitted points: kVisibilitySide px
// wide, kVisibilityScale px per unit of the mean shape's size, grey levels with mean 0 and
// deviation 1. Its output is 2 n numbers h, l:
//   visible_i = 1 / (1 + exp(a h_i + b))        sigma_i = s exp(l_i + c)
// where s is the shape's size in px (shape_size()), and a, b, c are fitted on held-out faces.
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
  int steps = 12000;      // with 32 fits each
  double occluded = 0.7;  // share of the fits with a synthetic occlusion
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"steps", steps, range(1, 1'000'000), "--steps", "training steps, batches of 32 fits"},
            {"occluded", occluded, inside(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// Accuracy of visibility and sigma on held-out faces. Counts of points.
struct VisibilityScore {
  int hidden = 0;
  int hidden_flagged = 0;  // hidden and flagged (Visibility::hidden())
  int visible = 0;
  int visible_flagged = 0;  // visible but flagged
  int within = 0;           // of all points: at most sigma from the true position
  // `hidden`: ground truth, one flag per point; points 2 x n, px. Throws std::invalid_argument for
  // other sizes.
  void add(const Visibility& visibility, const Eigen::Matrix2Xd& fitted,
           const Eigen::Matrix2Xd& truth, const std::vector<bool>& hidden);
  [[nodiscard]] double recall() const;     // share of the hidden points that are flagged
  [[nodiscard]] double precision() const;  // share of the flagged points that are hidden
  [[nodiscard]] double coverage()
      // Share of points within sigma. Each of the three is 1 if there are no such points.
      const;
};

// Needs at least ten faces; mirrored and turned faces follow the face they come from. Every fifth
// face is held out to fit a, b and c. Fits come from a descent that was trained on the other half
// of the faces, so that its errors are those of unseen faces. The result does not depend on the
// number of threads. Throws Interrupted, std::invalid_argument.
[[nodiscard]] VisibilityModel train_visibility_model(const std::vector<TrainingFace>& faces,
                                                     const VisibilityOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop);

// Buffers. One per thread.
struct VisibilityWorkspace {
  linalg::Workspace network;
  FaceInput face;
};

// The same for a set of annotated images (paths relative to the current folder), with `mirror` also
// mirrored. Images that cannot be used are listed in `skipped`. Also throws InputError.
[[nodiscard]] VisibilityModel train_visibility_model(const shape::LandmarkSet& set, bool mirror,
                                                     const VisibilityOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop,
                                                     std::vector<std::string>& skipped);

// For fitted points (2 x n, px of `gray`, CV_8UC1). If the points are not finite, or all within 1
// px of each other, they are hidden.
[[nodiscard]] Visibility visibility_of(const VisibilityModel& model, const cv::Mat& gray,
                                       const Eigen::Matrix2Xd& points,
                                       VisibilityWorkspace& workspace);

[[nodiscard]] nlohmann::json to_json(const VisibilityModel& model);
[[nodiscard]] VisibilityModel visibility_from_json(const nlohmann::json& value,
                                                   const std::string& path);

}  // namespace tarsier::face::regression
