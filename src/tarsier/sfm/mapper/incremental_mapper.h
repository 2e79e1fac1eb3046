// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/two_view/tracks.h"
#include "tarsier/sfm/two_view/triangulation.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// Internal to the mappers: one growing model. A point has the index of its track; without
// observations it does not exist yet.
class IncrementalMapper {
 public:
  IncrementalMapper(Model model, std::vector<std::vector<Observation>> tracks,
                    const std::vector<cv::Mat>& descriptors, FeatureKind kind,
                    const MapperOptions& options);
  [[nodiscard]] const Model& model() const { return model_; }
  [[nodiscard]] int registered() const { return registered_; }
  [[nodiscard]] std::int64_t observations() const;  // of all points
  // Called with "before" and "after" around each adjustment of the whole model or a part.
  using Watch = std::function<void(const char* stage, const IncrementalMapper&)>;
  void watch(Watch watch) { watch_ = std::move(watch); }
  // Images whose poses and cameras whose parameters no adjustment changes.
  void fix(std::vector<int> images, std::vector<int> cameras) {
    fixed_images_ = std::move(images);
    fixed_cameras_ = std::move(cameras);
  }
  // Sets the max reprojection error of an observation, px; larger while poses are rough.
  void set_reprojection_px(double threshold) { options_.reprojection_px = threshold; }
  // Takes poses and cameras from a model of the first images, and triangulates points of all
  // tracks.
  void resume(const Model& before);
  // Starts from two images. Returns false, with nothing registered, where there are too few points.
  bool start(const Pair& pair, const std::stop_token& stop, std::string& why);
  // Model points that the image should see, as (feature, track), and their number. The number is
  // updated as points are added and removed.
  [[nodiscard]] std::vector<std::pair<int, int>> visible(int image) const;
  [[nodiscard]] int visible_count(int image) const {
    return views_[static_cast<std::size_t>(image)].visible;
  }
  // Score for choosing the next image: how much it sees, and how evenly. Counts occupied cells of
  // increasingly fine grids; finer ones weigh more (Schonberger and Frahm, section 4.2). Also
  // updated.
  [[nodiscard]] double next_best_view_score(int image) const {
    return static_cast<double>(views_[static_cast<std::size_t>(image)].next_best_view_score);
  }
  // Registers an image; on failure `why` is the reason. Throws Interrupted: the image is then not
  // registered and the model is unchanged.
  bool add(int image, const std::stop_token& stop, std::string& why);
  // Options of an adjustment of the whole model: the tolerance, the points used per image, and the
  // observations used per point (0: all). Points that are not used, or not with all observations,
  // are adjusted alone afterwards.
  struct RefineOptions {
    double tolerance = 1e-3;
    int points_per_image = 0;
    int max_observations = 0;
    double loss_px = 0.5;  // BundleOptions::loss_px
  };
  // Adjusts the whole model, drops outliers and triangulates. Returns whether much changed, so that
  // another round is worthwhile. Throws Interrupted: the model is then unchanged.
  bool refine_once(const RefineOptions& refinement, const std::stop_token& stop);
  // Repeats refine_once() while much changes.
  void refine_all(int rounds, const RefineOptions& refinement, const std::stop_token& stop);
  // Searches known points in images that do not show them yet. A match that is too weak alone is
  // accepted at the projected position. Where the feature belongs to another track, both tracks are
  // merged if they are one point. An image is searched for the points of all images that share a
  // point with it. Returns the number of new observations. Throws Interrupted: the model is then
  // valid, but between two states.
  int extend_tracks(const std::stop_token& stop);
  // The model with consecutive points, their colours and errors, and the point of each feature.
  // Contains points that at least `min_views` images show; 0: as in the options.
  [[nodiscard]] Model finished(const std::vector<std::vector<cv::Vec3b>>& colors,
                               int min_views = 0) const;
  // The complete state, for a bit-identical continuation in another process; and its restoration.
  [[nodiscard]] IncrementalMapperState state() const;
  void restore(const IncrementalMapperState& state);
  // Warnings of adjustments since the last call, one line each.
  [[nodiscard]] std::vector<std::string> take_warnings() { return std::exchange(warnings_, {}); }
  static std::optional<double> reprojection_error(const Model& model, const Observation& seen,
                                                  const Eigen::Vector3d& position);
  // Whether two rays to the point differ by at least `min_angle_rad`.
  static bool has_angle(const Model& model, const std::vector<Observation>& track,
                        const Eigen::Vector3d& position, double min_angle_rad);

 private:
  // What an image sees of the model: the cells of all five grids, each with the number of features
  // of points in it.
  struct View {
    int visible = 0;
    std::int64_t next_best_view_score = 0;
    std::vector<int> cells;
  };
  void adjust_model(BundleOptions options, const std::stop_token& stop);
  // Adjusts all images by some of the points and observations, then all other points with fixed
  // images.
  void adjust_by_some_points(BundleOptions options, const RefineOptions& refinement,
                             const std::stop_token& stop);
  // Adjusts these points only.
  void adjust_points(const std::vector<int>& points);
  void count(const Observation& seen, int change);
  // Call after points of these tracks were added or removed.
  void count_points(const std::vector<int>& tracks);
  [[nodiscard]] std::vector<int> all_tracks() const;
  // Tracks of the points that some of the images show, ascending.
  [[nodiscard]] std::vector<int> points_of(const std::vector<int>& images) const;
  // Drops inaccurate observations of these points in `images` (empty: in all), and points that are
  // left with too few.
  int filter(const std::vector<int>& points, const std::vector<int>& images = {});
  [[nodiscard]] double min_angle() const { return options_.min_angle_deg * CV_PI / 180; }
  // Of these features of an image, the one most similar to the point; -1 where none is similar
  // enough.
  [[nodiscard]] int best_match(int track, int image, const std::vector<int>& features) const;
  // Merges a feature, or its track, into a track, unless an image would then be in it twice.
  // Returns the number of new observations; 0: they are not one point.
  int merge(int track, const Observation& seen);
  // Whether the two points are far apart as the first and the last image see them; both are
  // accurate.
  [[nodiscard]] bool are_distinct(const Point& point, const Point& other) const;
  // Computes the normalised coordinates of all features.
  void compute_rays();
  [[nodiscard]] std::vector<Correspondence2D3D> inliers_of(
      int image, const std::vector<std::pair<int, int>>& seen, double threshold) const;
  // Adjusts a new image and the images that share most points with it; all others stay fixed.
  void refine_around(int image, const std::stop_token& stop);
  // Triangulates tracks without a point and adds observations to the other points. Handles all
  // tracks, or those of one image. Returns the number of new observations.
  int triangulate_all(double min_angle, int image = -1);
  // `shown_in`: scratch memory, one number per image, negative or the index of an earlier track.
  int triangulate_track(int track, double min_angle, std::vector<int>& shown_in);
  [[nodiscard]] ObservationRay ray_of(const Observation& seen) const;
  [[nodiscard]] std::vector<Observation> consistent_observations(
      const std::vector<Observation>& all, const Eigen::Vector3d& position) const;

  Model model_;
  std::vector<std::vector<Observation>> tracks_;
  const std::vector<cv::Mat>& descriptors_;
  FeatureKind kind_;
  MapperOptions options_;
  Watch watch_;
  int registered_ = 0;
  std::vector<View> views_;
  std::vector<char> is_point_;                  // for each track: whether views_ count it
  bool extended_ = false;                       // the tracks are no longer those of the pairs
  std::vector<std::vector<int>> track_of_;      // for each feature of each image, or -1
  std::vector<std::vector<cv::Point2d>> rays_;  // for each feature
  std::vector<geometry::Camera> ray_cameras_;   // the cameras that rays_ were computed with
  // for each descriptor, from the first extend_tracks() on
  std::vector<std::vector<double>> norms_;
  std::vector<std::string> warnings_;
  std::vector<int> fixed_images_;
  std::vector<int> fixed_cameras_;
};

}  // namespace tarsier::sfm
