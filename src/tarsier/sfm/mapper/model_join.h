// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <map>
#include <stop_token>
#include <string>
#include <vector>

// Models that have images in common become one, where that is safe.
//
// Here the models of a list have the same images and cameras, each with its own ones registered (with_same_images()), and the
// features of an image are the same in all that have it.
namespace tarsier::sfm {

struct MapperOptions;

struct JoinOptions {
  int min_images = 3;                // registered in both, whose poses agree
  int min_points = 30;               // that both have: at least one feature shows them in both
  double min_inlier_share = 0.5;     // of these points
  double min_image_share = 2.0 / 3;  // of the common images, whose poses agree
  double inlier_px = 4;            // an inlier's reprojection error in the other model, at most ..
  double inlier_share = 0.005;     // .. or this of the image's larger side, where that is more
  double max_rotation_deg = 3;     // between poses that agree
  double max_center_share = 0.05;  // .. between their centres, of the depth of the image's points
  double max_scale_error = 0.02;   // standard error of the scale
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"min_images", min_images, at_least(1)},
            {"min_points", min_points, at_least(3)},
            {"min_inlier_share", min_inlier_share, range(0, 1)},
            {"min_image_share", min_image_share, range(0, 1)},
            {"inlier_px", inlier_px, at_least(0)},
            {"inlier_share", inlier_share, range(0, 1)},
            {"max_rotation_deg", max_rotation_deg, range(0, 180)},
            {"max_center_share", max_center_share, at_least(0)},
            {"max_scale_error", max_scale_error, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

// Whether two images have the same features at the same places, within 0.01 px.
[[nodiscard]] bool has_same_features(const Image& a, const Image& b);

// What two models say about each other.
struct ModelJoin {
  int first = 0;  // models
  int second = 0;
  int images = 0;    // common ones
  int agreeing = 0;  // of these: with the same pose in both
  int points = 0;    // common ones
  int inliers = 0;
  double rotation_deg = 0;  // between the poses of a common image: the median
  double scale_error = 0;   // standard error of the scale, as a share of it
  geometry::Sim3 first_from_second;
  std::string refusal;  // why they are not joined; "": they are
};

// The similarity S, first_from_second, that two models agree on.
//
// Common points p, q are those that are each other's most frequent partner among the features (image, feature) that show a
// point in both. Two candidates for S compete: the robust least squares of common points and centres (robust_similarity(),
// seeded); and the one whose rotation is the mean of R_i' Q_i over the common images (R_i, Q_i: camera from world in the
// first and second model), whose scale is the median quotient of the depths of common points in common images, and whose
// translation is the median of p - s R q: it holds also for points and centres on a line. The one with which more images,
// then more points agree is kept. A pair of points is an inlier if S q projects within inlier_px of the common features in the
// first model and S^-1 p in the second. The standard error of the scale is 1.4826 MAD(log(depth / depth)) / sqrt(n), of n
// inliers.
//
// Refused, with the reason and the numbers, where one of the limits of the options is not kept, where features of an image
// differ, or a number is not finite.
[[nodiscard]] ModelJoin find_join(const Model& first, const Model& second,
                                  const JoinOptions& options = {});

struct JoinedModels {
  std::vector<Model> models;     // most images first
  std::vector<int> joined_in;    // of each given model: which of `models`
  std::vector<ModelJoin> joins;  // of all two that have images in common, by first, then second
  std::map<int, std::string> left_out;  // images of joined models that are not in these, and why
  std::vector<std::string> log;
};

// Joins models along a maximum spanning tree of their joins by the number of inliers. A join that closes a cycle must agree
// with the others (10 degrees, a quarter of the scale, a tenth of the extent) or is refused; where there are such, rotations
// (average_rotations()), scales and translations of all are averaged, so that what drift leaves is spread over the cycle:
//
//   min sum w_ab (log s_b - log s_a - log s_ab)^2,   min sum w_ab |t_b - t_a - s_a R_a t_ab|^2
//
// with world_from_a = (s_a, R_a, t_a) and a_from_b = (s_ab, R_ab, t_ab). Of points with a feature in common the tracks are
// united, unless that would put two features of an image into one. An image has the pose of the model in which it shows most
// points; one that lies elsewhere in another of them, by more than such a join may, is left out. A camera has the mean
// numbers of the models, weighted by their images. Then all of it is adjusted, with ever smaller
// losses, observations that are off are dropped (filter_points()), and images that do not hang together with the rest are
// left out (keep_largest_part()). The lens is refined as the mapper's options say, and where the models have different ones
// of a camera. Models that nothing was joined to stay as they are.
//
// `names` are those of the models, for the log. Deterministic for any number of threads. Throws std::invalid_argument for
// models that do not have the same images and cameras, Interrupted.
[[nodiscard]] JoinedModels join_models(const std::vector<Model>& models,
                                       const std::vector<std::string>& names,
                                       const JoinOptions& options, const MapperOptions& mapper,
                                       const std::stop_token& stop = {});

// Models whose images have the same names (read_colmap(), say) as models with the same images and cameras: in the order of
// their first appearance. Cameras are the same where an image says so. An image whose size or kind of lens is
// another one than in the model before is not registered: it is another image.
[[nodiscard]] std::vector<Model> with_same_images(const std::vector<Model>& models);

}  // namespace tarsier::sfm
