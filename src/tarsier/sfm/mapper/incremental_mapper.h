// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/bundle.h"
#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/mapper/triangulation.h"

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

// The inside of the mapper: one growing model. Its points lie at their track's index; those without
// observations are none yet.
class IncrementalMapper {
 public:
  IncrementalMapper(Model model, std::vector<std::vector<Observation>> tracks,
                    const std::vector<cv::Mat>& descriptors, FeatureKind kind,
                    const MapperOptions& options);
  [[nodiscard]] const Model& model() const { return model_; }
  [[nodiscard]] int registered() const { return registered_; }
  [[nodiscard]] std::int64_t observations() const;  // of all points
  // Is called with "before" and "after" around each adjustment, of all of it or of a part.
  using Watch = std::function<void(const char* moment, const IncrementalMapper&)>;
  void watch(Watch watch) { watch_ = std::move(watch); }
  // Images whose poses and cameras whose numbers no adjustment changes.
  void hold(std::vector<int> images, std::vector<int> cameras) {
    fixed_images_ = std::move(images);
    fixed_cameras_ = std::move(cameras);
  }
  // How far off an observation may be, px, from now on: while poses are rough.
  void set_reprojection_px(double threshold) { options_.reprojection_px = threshold; }
  // Takes the poses and cameras of a model of the first images, with points of all tracks.
  void resume(const Model& before);
  // Starts from two images; false (and nothing is registered) where too little comes of it.
  bool start(const Pair& pair, const std::stop_token& stop, std::string& why);
  // Points of the model that the image should see, as (feature, track), and their number,
  // which is kept up to date as points come and go.
  [[nodiscard]] std::vector<std::pair<int, int>> visible(int image) const;
  [[nodiscard]] int seen(int image) const { return views_[static_cast<std::size_t>(image)].seen; }
  // How much an image sees, and how well it is spread: occupied cells of finer and finer grids,
  // the finer ones counting more (Schonberger and Frahm, section 4.2). Kept up to date as well.
  [[nodiscard]] double next_best_view_score(int image) const {
    return static_cast<double>(views_[static_cast<std::size_t>(image)].next_best_view_score);
  }
  // Adds an image; `why` tells what was missing where it fails. Throws Interrupted: it is then
  // not in, and the model is as it was.
  bool add(int image, const std::stop_token& stop, std::string& why);
  // How all of it is adjusted: to what share of the sum, by how many points of each image, and by how many observations of
  // a point. Points that took no part, or not with all observations, are adjusted alone afterwards. 0: by all.
  struct Effort {
    double tolerance = 1e-3;
    int points_per_image = 0;
    int max_observations = 0;
    double loss_px = 0.5;  // BundleOptions::loss_px
  };
  // Adjusts all of it, drops what is off, and looks for what fits now; whether much changed, so
  // that another round is worth it. Throws Interrupted: the model is then as it was.
  bool refine_once(const Effort& effort, const std::stop_token& stop);
  // The same again while much changes.
  void refine_all(int rounds, const Effort& effort, const std::stop_token& stop);
  // Looks for known points where they should appear in images that do not show them yet: a
  // match too weak on its own is good at the right place. A feature that belongs to another track
  // joins the two if they are one point. In each image it looks for the points of those that
  // have a point in common with it. Returns how many observations came in. Throws Interrupted: the
  // model is then a good one, but between two states.
  int extend_tracks(const std::stop_token& stop);
  // The model with points in a row, their colours and errors, and what each feature shows. Points
  // that at least so many images show; 0: as the options say.
  [[nodiscard]] Model finished(const std::vector<std::vector<cv::Vec3b>>& colors,
                               int min_views = 0) const;
  // All that it takes to go on from here in another process, to the last bit; and that.
  [[nodiscard]] IncrementalMapperState state() const;
  void restore(const IncrementalMapperState& state);
  // What went wrong in adjustments since the last call, a line each.
  [[nodiscard]] std::vector<std::string> take_troubles() { return std::exchange(troubles_, {}); }
  static std::optional<double> error_of(const Model& model, const Observation& seen,
                                        const Eigen::Vector3d& position);
  // Whether two rays to the point differ by `least` radians or more.
  static bool has_angle(const Model& model, const std::vector<Observation>& track,
                        const Eigen::Vector3d& position, double least);

 private:
  // What an image sees of the model: cells of all five grids, each with how many features of
  // points lie in it.
  struct View {
    int seen = 0;
    std::int64_t next_best_view_score = 0;
    std::vector<int> cells;
  };
  void adjust_model(BundleOptions options, const std::stop_token& stop);
  // Adjusts all images by some of the points and observations, then points by all of their observations, the images fixed.
  void adjust_by_some_points(BundleOptions options, const Effort& effort,
                             const std::stop_token& stop);
  // Adjusts these points alone.
  void adjust_points(const std::vector<int>& points);
  void count(const Observation& seen, int change);
  // After points of these tracks have come or gone.
  void count_points(const std::vector<int>& tracks);
  [[nodiscard]] std::vector<int> all_tracks() const;
  // Tracks of the points that some of the images show, ascending.
  [[nodiscard]] std::vector<int> points_of(const std::vector<int>& images) const;
  // Drops observations of these points in `images` (empty: in all) that are off, and points that are left with too few.
  int filter(const std::vector<int>& points, const std::vector<int>& images = {});
  [[nodiscard]] double min_angle() const { return options_.min_angle_deg * CV_PI / 180; }
  // The one of some features of an image that looks most like the point, and enough so; or -1.
  [[nodiscard]] int best_match(int track, int image, const std::vector<int>& features) const;
  // Joins a feature, or the track that it is part of, to a track that no image shows twice then. How many observations that
  // gives; 0: they are not one point.
  int merge(int track, const Observation& seen);
  // Whether a point is far off where the first and the last image show another one; both are well known.
  [[nodiscard]] bool are_apart(const Point& point, const Point& other) const;
  // Normalised coordinates of all features.
  void measure_rays();
  [[nodiscard]] std::optional<geometry::Rigid3> pose_of(const std::vector<cv::Point3d>& positions,
                                                        const std::vector<cv::Point2d>& pixels,
                                                        const geometry::Camera& camera) const;
  [[nodiscard]] std::vector<Correspondence2D3D> inliers_of(
      int image, const std::vector<std::pair<int, int>>& seen, double threshold) const;
  // The images that share most points with a new one move with it, the others hold them.
  void refine_around(int image, const std::stop_token& stop);
  // Points for tracks that have none, and further observations for those that have one. Of all
  // tracks, or of those of one image. Returns how many observations came in.
  int triangulate_all(double min_angle, int image = -1);
  // `shown_in`: scratch memory, a number of each image; each is below zero or that of a track asked for before.
  int triangulate_track(int track, double min_angle, std::vector<int>& shown_in);
  [[nodiscard]] ObservationRay ray_of(const Observation& seen) const;
  [[nodiscard]] std::vector<Observation> within(const std::vector<Observation>& all,
                                                const Eigen::Vector3d& position) const;

  Model model_;
  std::vector<std::vector<Observation>> tracks_;
  const std::vector<cv::Mat>& descriptors_;
  FeatureKind kind_;
  MapperOptions options_;
  Watch watch_;
  int registered_ = 0;
  std::vector<View> views_;
  std::vector<char> is_point_;                  // of each track: whether views_ count it
  bool extended_ = false;                       // the tracks are not those of the pairs any more
  std::vector<std::vector<int>> track_of_;      // of each feature of each image, or -1
  std::vector<std::vector<cv::Point2d>> rays_;  // of each feature
  std::vector<geometry::Camera> ray_cameras_;   // that they were measured with
  std::vector<std::vector<double>> norms_;  // of each descriptor, since the first extend_tracks()
  std::vector<std::string> troubles_;
  std::vector<int> fixed_images_;
  std::vector<int> fixed_cameras_;
};

}  // namespace tarsier::sfm
