// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/incremental_mapper.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/sfm/bundle/bundle_residual.h"
#include "tarsier/sfm/bundle/point_selection.h"
#include "tarsier/sfm/mapper/absolute_pose.h"
#include "tarsier/sfm/mapper/model_filter.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMaxRayPairs = 30;
constexpr int kMaxAdjustedNeighbours = 6;      // images adjusted together with a new image
constexpr std::size_t kMinInitialPoints = 30;  // of an initial pair
constexpr int kLocalPoints = 600;              // per image that is adjusted with a new one
// Max observations of a point used while an image is added. Tracks may be in hundreds of images of
// a video, and the cost would grow with them.
constexpr int kLocalObservations = 40;
constexpr int kMaxPointIterations = 3;  // iterations for points that an adjustment left out
// observations of points that are adjusted alone
constexpr std::size_t kMaxBatchObservations = 2'000'000;
constexpr int kGrids = 5;  // grids of 2 x 2 to 32 x 32 cells

// Begin of the grid of 2^level x 2^level cells among the cells of all grids: after 4 + 16 + ..
std::size_t grid_start(int level) { return ((std::size_t{1} << (2 * level)) - 4) / 3; }

}  // namespace

IncrementalMapper::IncrementalMapper(Model model, std::vector<std::vector<Observation>> tracks,
                                     const std::vector<cv::Mat>& descriptors, FeatureKind kind,
                                     const MapperOptions& options)
    : model_(std::move(model)),
      tracks_(std::move(tracks)),
      descriptors_(descriptors),
      kind_(kind),
      options_(options) {
  model_.points.assign(tracks_.size(), {});
  is_point_.assign(tracks_.size(), 0);
  views_.resize(model_.images.size());
  track_of_.resize(model_.images.size());
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    model_.images[i].registered = false;
    track_of_[i].assign(model_.images[i].features.size(), -1);
  }
  for (std::size_t t = 0; t < tracks_.size(); ++t)
    for (const Observation& seen : tracks_[t])
      track_of_[at(seen.image)][at(seen.feature)] = static_cast<int>(t);
  compute_rays();
}

void IncrementalMapper::count(const Observation& seen, int change) {
  View& view = views_[at(seen.image)];
  const Image& entry = model_.images[at(seen.image)];
  const geometry::Camera& camera = model_.cameras[at(entry.camera)];
  const cv::Point2d p(entry.features[at(seen.feature)]);
  if (view.cells.empty()) view.cells.assign(grid_start(kGrids + 1), 0);
  view.visible += change;
  for (int level = 1; level <= kGrids; ++level) {
    const int cells = 1 << level;
    const int x = std::clamp(static_cast<int>(p.x * cells / camera.width), 0, cells - 1);
    const int y = std::clamp(static_cast<int>(p.y * cells / camera.height), 0, cells - 1);
    int& cell = view.cells[grid_start(level) + at(y * cells + x)];
    const bool was = cell > 0;
    cell += change;
    if (was != (cell > 0)) view.next_best_view_score += was ? -cells : cells;
  }
}

void IncrementalMapper::count_points(const std::vector<int>& tracks) {
  for (const int track : tracks) {
    const bool now = !model_.points[at(track)].track.empty();
    if (now == (is_point_[at(track)] != 0)) continue;
    is_point_[at(track)] = now ? 1 : 0;
    for (const Observation& seen : tracks_[at(track)]) count(seen, now ? 1 : -1);
  }
}

std::int64_t IncrementalMapper::observations() const {
  std::int64_t count = 0;
  for (const Point& point : model_.points) count += static_cast<std::int64_t>(point.track.size());
  return count;
}

std::vector<int> IncrementalMapper::all_tracks() const {
  std::vector<int> tracks(tracks_.size());
  std::iota(tracks.begin(), tracks.end(), 0);
  return tracks;
}

std::vector<int> IncrementalMapper::points_of(const std::vector<int>& images) const {
  std::vector<char> is_selected(model_.images.size(), 0);
  for (const int image : images) is_selected[at(image)] = 1;
  std::vector<char> is_visited(tracks_.size(), 0);
  std::vector<int> result;
  for (const int image : images) {
    for (const int track : track_of_[at(image)]) {
      if (track < 0 || std::exchange(is_visited[at(track)], 1) != 0) continue;
      const std::vector<Observation>& observations = model_.points[at(track)].track;
      if (std::any_of(observations.begin(), observations.end(),
                      [&](const Observation& seen) { return is_selected[at(seen.image)] != 0; }))
        result.push_back(track);
    }
  }
  std::sort(result.begin(), result.end());
  return result;
}

int IncrementalMapper::filter(const std::vector<int>& points, const std::vector<int>& images) {
  const int dropped = filter_selected_points(model_, options_, points, images);
  count_points(points);
  return dropped;
}

void IncrementalMapper::resume(const Model& before) {
  std::copy(before.cameras.begin(), before.cameras.end(), model_.cameras.begin());
  for (std::size_t i = 0; i < before.images.size(); ++i) {
    model_.images[i].registered = before.images[i].registered;
    model_.images[i].pose = before.images[i].pose;
    registered_ += before.images[i].registered ? 1 : 0;
  }
  compute_rays();
  (void)triangulate_all(min_angle());
}

IncrementalMapperState IncrementalMapper::state() const {
  IncrementalMapperState state;
  state.model = packed(model_);
  state.ray_cameras = ray_cameras_;
  if (extended_) state.tracks = tracks_;
  return state;
}

void IncrementalMapper::restore(const IncrementalMapperState& state) {
  if (!state.tracks.empty()) {
    tracks_ = state.tracks;
    extended_ = true;
    for (auto& tracks : track_of_) std::fill(tracks.begin(), tracks.end(), -1);
    for (std::size_t t = 0; t < tracks_.size(); ++t)
      for (const Observation& seen : tracks_[t])
        track_of_[at(seen.image)][at(seen.feature)] = static_cast<int>(t);
  }
  model_.cameras = state.ray_cameras;
  compute_rays();
  unpack(state.model, model_);
  registered_ = static_cast<int>(state.model.registered.size());
  count_points(all_tracks());
}

void IncrementalMapper::adjust_model(BundleOptions options, const std::stop_token& stop) {
  if (watch_) watch_("before", *this);
  options.fixed_images = fixed_images_;
  options.fixed_cameras = fixed_cameras_;
  const BundleReport report = adjust(model_, options, stop);
  if (!report.warning.empty()) {
    warnings_.push_back(
        fmt::format("bundle adjustment of {} images and {} observations: {}",
                    options.images.empty() ? at(registered_) : options.images.size(),
                    report.residuals, report.warning));
  }
  if (watch_) watch_("after", *this);
}

void IncrementalMapper::adjust_by_some_points(BundleOptions options,
                                              const RefineOptions& refinement,
                                              const std::stop_token& stop) {
  std::vector<int> images;
  for (std::size_t i = 0; i < model_.images.size(); ++i)
    if (model_.images[i].registered) images.push_back(static_cast<int>(i));
  std::vector<int> points = all_tracks();
  std::erase_if(points, [&](int p) { return model_.points[at(p)].track.empty(); });
  options.max_observations = refinement.max_observations;
  options.points = select_points(model_, points, images, refinement.points_per_image,
                                 refinement.max_observations);
  adjust_model(options, stop);
  std::vector<int> others;
  auto adjusted = options.points.begin();
  for (const int p : points) {
    const bool was_adjusted = adjusted != options.points.end() && *adjusted == p;
    if (was_adjusted) ++adjusted;
    if (!was_adjusted || (refinement.max_observations > 0 &&
                          model_.points[at(p)].track.size() > at(refinement.max_observations)))
      others.push_back(p);
  }
  // The filter drops points that are now behind a camera.
  std::erase_if(others, [&](int p) {
    const Point& point = model_.points[at(p)];
    return !std::all_of(point.track.begin(), point.track.end(), [&](const Observation& seen) {
      return (model_.images[at(seen.image)].pose * point.position).z() >= kMinDepth;
    });
  });
  adjust_points(others);
}

void IncrementalMapper::adjust_points(const std::vector<int>& points) {
  BundleOptions options;
  options.only_points = true;
  options.max_iterations = kMaxPointIterations;
  std::size_t observations = 0;
  for (const int p : points) {
    options.points.push_back(p);
    observations += model_.points[at(p)].track.size();
    if (observations < kMaxBatchObservations && p != points.back()) continue;
    adjust_model(options, {});
    options.points.clear();
    observations = 0;
  }
}

bool IncrementalMapper::start(const Pair& pair, const std::stop_token& stop, std::string& why) {
  Image& first = model_.images[at(pair.first)];
  Image& second = model_.images[at(pair.second)];
  first.pose = {};
  second.pose = pair.view.second_from_first;
  first.registered = second.registered = true;
  registered_ = 2;
  (void)triangulate_all(min_angle());
  adjust_model(BundleOptions{}, stop);
  (void)filter(all_tracks());
  std::vector<double> angles;
  for (const Point& point : model_.points) {
    if (!point.track.empty())
      angles.push_back(ray_angle(point.position, first.pose.center(), second.pose.center()));
  }
  std::nth_element(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2),
                   angles.end());
  const double angle = angles.empty() ? 0 : angles[angles.size() / 2] / kRadiansPerDegree;
  if (angles.size() >= kMinInitialPoints && angle >= 0.5 * options_.first_angle_deg) return true;
  why = fmt::format("rejected, only {} points with a triangulation angle of {:.1f} degrees",
                    angles.size(), angle);
  first.registered = second.registered = false;
  registered_ = 0;
  for (Point& point : model_.points) point = {};
  count_points(all_tracks());
  return false;
}

std::vector<std::pair<int, int>> IncrementalMapper::visible(int image) const {
  std::vector<std::pair<int, int>> result;
  const std::vector<int>& tracks = track_of_[at(image)];
  for (std::size_t f = 0; f < tracks.size(); ++f) {
    if (tracks[f] >= 0 && !model_.points[at(tracks[f])].track.empty())
      result.emplace_back(static_cast<int>(f), tracks[f]);
  }
  return result;
}

bool IncrementalMapper::add(int image, const std::stop_token& stop, std::string& why) {
  Image& entry = model_.images[at(image)];
  const geometry::Camera& camera = model_.cameras[at(entry.camera)];
  const auto seen = visible(image);
  if (static_cast<int>(seen.size()) < options_.pose_inliers) {
    why = fmt::format("only {} 2D-3D correspondences with the model, {} are needed", seen.size(),
                      options_.pose_inliers);
    return false;
  }
  std::vector<cv::Point3d> positions;
  std::vector<cv::Point2d> pixels;
  for (const auto& [feature, track] : seen) {
    const cv::Point2d& ray = rays_[at(image)][at(feature)];
    positions.emplace_back(geometry::to_cv(model_.points[at(track)].position));
    pixels.emplace_back(camera.fx * ray.x + camera.cx, camera.fy * ray.y + camera.cy);
  }
  const auto pose = absolute_pose(positions, pixels, camera, options_.pose_px, options_.seed);
  if (!pose) {
    why =
        fmt::format("no camera pose fits the {} 2D-3D correspondences with the model", seen.size());
    return false;
  }
  entry.pose = *pose;
  std::vector<Correspondence2D3D> inliers = inliers_of(image, seen, options_.pose_px);
  adjust_pose(entry.pose, camera, inliers, options_.pose_px / 2);
  inliers = inliers_of(image, seen, options_.pose_px);
  const auto needed = std::max<std::size_t>(
      at(options_.pose_inliers),
      static_cast<std::size_t>(options_.pose_inlier_share * static_cast<double>(seen.size())));
  if (inliers.size() < needed) {
    why =
        fmt::format("{} of {} 2D-3D correspondences are inliers of the camera pose, {} are needed",
                    inliers.size(), seen.size(), needed);
    return false;
  }
  adjust_pose(entry.pose, camera, inliers, options_.reprojection_px / 2);
  // Number of observations of the points that may change.
  std::vector<std::pair<int, std::size_t>> before;
  for (const int track : track_of_[at(image)])
    if (track >= 0) before.emplace_back(track, model_.points[at(track)].track.size());
  entry.registered = true;
  ++registered_;
  (void)triangulate_all(min_angle(), image);
  try {
    refine_around(image, stop);
  } catch (const Interrupted&) {
    std::vector<int> tracks;
    for (const auto& [track, size] : before) {
      Point& point = model_.points[at(track)];
      if (size == 0) {
        point = {};
      } else {
        point.track.resize(size);  // triangulate_track only appends
      }
      tracks.push_back(track);
    }
    count_points(tracks);
    entry.registered = false;
    entry.pose = {};
    --registered_;
    throw;
  }
  return true;
}

bool IncrementalMapper::refine_once(const RefineOptions& refinement, const std::stop_token& stop) {
  BundleOptions bundle;
  bundle.tolerance = refinement.tolerance;
  bundle.loss_px = refinement.loss_px;
  // Two views do not determine the focal length.
  const bool can_refine_lens = registered() >= 3;
  bundle.focal = options_.refine_focal && can_refine_lens;
  bundle.center = options_.refine_center && registered() >= 5;
  bundle.distortion = options_.refine_distortion && can_refine_lens;
  if (refinement.points_per_image > 0) {
    adjust_by_some_points(bundle, refinement, stop);
  } else {
    adjust_model(bundle, stop);
  }
  if (bundle.focal || bundle.center || bundle.distortion) compute_rays();
  const int dropped = filter(all_tracks());
  const int found = triangulate_all(min_angle());
  return dropped + found >= 0.002 * static_cast<double>(observations());
}

void IncrementalMapper::refine_all(int rounds, const RefineOptions& refinement,
                                   const std::stop_token& stop) {
  for (int round = 0; round < rounds; ++round)
    if (!refine_once(refinement, stop)) break;
}

Model IncrementalMapper::finished(const std::vector<std::vector<cv::Vec3b>>& colors,
                                  int min_views) const {
  Model result;
  result.cameras = model_.cameras;
  result.images.resize(model_.images.size());
  for (std::size_t i = 0; i < result.images.size(); ++i) {
    const Image& image = model_.images[i];
    if (image.registered) {
      result.images[i] = image;
      result.images[i].points.assign(image.features.size(), -1);
    } else {
      result.images[i].name = image.name;
      result.images[i].camera = image.camera;
    }
  }
  if (min_views <= 0) min_views = registered() < 4 ? 2 : options_.min_views;
  const std::size_t min_track_length = at(std::max(2, min_views));
  for (const Point& point : model_.points) {
    if (point.track.size() < min_track_length) continue;
    Point copy = point;
    cv::Vec3d color;
    double squares = 0;
    for (const Observation& seen : point.track) {
      color += cv::Vec3d(colors[at(seen.image)][at(seen.feature)]);
      const auto error = reprojection_error(model_, seen, point.position);
      squares += error ? *error * *error : 0;
      result.images[at(seen.image)].points[at(seen.feature)] =
          static_cast<int>(result.points.size());
    }
    const auto count = static_cast<double>(point.track.size());
    for (int k = 0; k < 3; ++k) copy.color[k] = cv::saturate_cast<std::uint8_t>(color[k] / count);
    copy.error = std::sqrt(squares / count);
    result.points.push_back(std::move(copy));
  }
  return result;
}

std::optional<double> IncrementalMapper::reprojection_error(const Model& model,
                                                            const Observation& seen,
                                                            const Eigen::Vector3d& position) {
  const Image& image = model.images[at(seen.image)];
  const auto pixel = model.cameras[at(image.camera)].project(image.pose * position);
  if (!pixel) return std::nullopt;
  return cv::norm(*pixel - cv::Point2d(image.features[at(seen.feature)]));
}

void IncrementalMapper::compute_rays() {
  ray_cameras_ = model_.cameras;
  rays_.resize(model_.images.size());
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    const Image& image = model_.images[i];
    const geometry::Camera& camera = model_.cameras[at(image.camera)];
    rays_[i].clear();
    for (const cv::Point2d& p : undistorted(image.features, camera))
      rays_[i].emplace_back((p.x - camera.cx) / camera.fx, (p.y - camera.cy) / camera.fy);
  }
}

std::vector<Correspondence2D3D> IncrementalMapper::inliers_of(
    int image, const std::vector<std::pair<int, int>>& seen, double threshold) const {
  std::vector<Correspondence2D3D> result;
  for (const auto& [feature, track] : seen) {
    const Eigen::Vector3d& position = model_.points[at(track)].position;
    const auto error = reprojection_error(model_, {image, feature}, position);
    if (error && *error <= threshold)
      result.push_back({cv::Point2d(model_.images[at(image)].features[at(feature)]), position});
  }
  return result;
}

void IncrementalMapper::refine_around(int image, const std::stop_token& stop) {
  std::vector<int> shared(model_.images.size(), 0);
  for (const auto& [feature, track] : visible(image))
    for (const Observation& seen : model_.points[at(track)].track) ++shared[at(seen.image)];
  shared[at(image)] = 0;
  std::vector<std::pair<int, int>> order;
  for (std::size_t i = 0; i < shared.size(); ++i)
    if (shared[i] > 0) order.emplace_back(-shared[i], static_cast<int>(i));
  std::sort(order.begin(), order.end());
  BundleOptions bundle;
  bundle.max_iterations = 20;
  bundle.tolerance = 1e-4;
  bundle.images = {image};
  for (std::size_t k = 0; k < order.size() && k < kMaxAdjustedNeighbours; ++k)
    bundle.images.push_back(order[k].second);
  std::vector<int> points;
  if (registered() <= kMaxAdjustedNeighbours + 1) {
    bundle.images.clear();  // a small model is adjusted as a whole
    points = all_tracks();
  } else {
    points = points_of(bundle.images);
    bundle.points = select_points(model_, points, bundle.images, kLocalPoints);
    bundle.max_observations = kLocalObservations;
  }
  adjust_model(bundle, stop);
  if (bundle.points.empty()) {
    (void)filter(points);
    return;
  }
  // Only observations whose point or image moved can have become inaccurate; a point may be in
  // hundreds of images.
  std::vector<int> unmoved;
  std::set_difference(points.begin(), points.end(), bundle.points.begin(), bundle.points.end(),
                      std::back_inserter(unmoved));
  (void)filter(bundle.points);
  (void)filter(unmoved, bundle.images);
}

int IncrementalMapper::triangulate_all(double min_angle, int image) {
  std::vector<int> chosen;
  if (image < 0) {
    chosen = all_tracks();
  } else {
    for (const int track : track_of_[at(image)])
      if (track >= 0) chosen.push_back(track);
  }
  std::vector<int> gained(chosen.size(), 0);
  cv::parallel_for_(cv::Range(0, static_cast<int>(chosen.size())), [&](const cv::Range& range) {
    std::vector<int> shown_in(model_.images.size(), -1);
    for (int k = range.start; k < range.end; ++k)
      gained[at(k)] = triangulate_track(chosen[at(k)], min_angle, shown_in);
  });
  count_points(chosen);
  return std::accumulate(gained.begin(), gained.end(), 0);
}

int IncrementalMapper::triangulate_track(int track, double min_angle, std::vector<int>& shown_in) {
  Point& point = model_.points[at(track)];
  const std::vector<Observation>& all = tracks_[at(track)];
  const std::size_t before = point.track.size();
  const auto is_registered = [&](const Observation& seen) {
    return model_.images[at(seen.image)].registered;
  };
  const auto number =
      static_cast<std::size_t>(std::count_if(all.begin(), all.end(), is_registered));
  if (number < 2 || before == number) return 0;
  if (before > 0) {
    for (const Observation& seen : point.track) shown_in[at(seen.image)] = track;
    for (const Observation& seen : all) {
      if (!is_registered(seen) || shown_in[at(seen.image)] == track) continue;
      const auto error = reprojection_error(model_, seen, point.position);
      if (error && *error <= options_.reprojection_px) point.track.push_back(seen);
    }
    return static_cast<int>(point.track.size() - before);
  }
  std::vector<Observation> usable;
  usable.reserve(number);
  std::copy_if(all.begin(), all.end(), std::back_inserter(usable), is_registered);
  // Searches the pair of rays with which most others agree.
  std::vector<Observation> best;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  int attempts = 0;
  const auto count = static_cast<int>(usable.size());
  for (int gap = count - 1; gap >= 1 && attempts < kMaxRayPairs; --gap) {
    for (int i = 0; i + gap < count && attempts < kMaxRayPairs; ++i) {
      ++attempts;
      const auto candidate = triangulate({ray_of(usable[at(i)]), ray_of(usable[at(i + gap)])});
      if (!candidate) continue;
      std::vector<Observation> agreeing = consistent_observations(usable, *candidate);
      if (agreeing.size() > best.size()) {
        best = std::move(agreeing);
        position = *candidate;
      }
    }
    if (best.size() == usable.size()) break;
  }
  if (best.size() < 2) return 0;
  std::vector<ObservationRay> rays;
  rays.reserve(best.size());
  for (const Observation& seen : best) rays.push_back(ray_of(seen));
  const auto refined = triangulate(rays);
  if (refined) position = *refined;
  best = consistent_observations(usable, position);
  if (best.size() < 2 || !has_angle(model_, best, position, min_angle)) return 0;
  point.position = position;
  point.track = std::move(best);
  return static_cast<int>(point.track.size());
}

ObservationRay IncrementalMapper::ray_of(const Observation& seen) const {
  return {model_.images[at(seen.image)].pose, rays_[at(seen.image)][at(seen.feature)]};
}

std::vector<Observation> IncrementalMapper::consistent_observations(
    const std::vector<Observation>& all, const Eigen::Vector3d& position) const {
  std::vector<Observation> result;
  for (const Observation& seen : all) {
    const auto error = reprojection_error(model_, seen, position);
    if (error && *error <= options_.reprojection_px) result.push_back(seen);
  }
  return result;
}

bool IncrementalMapper::has_angle(const Model& model, const std::vector<Observation>& track,
                                  const Eigen::Vector3d& position, double min_angle_rad) {
  const auto center = [&](const Observation& seen) {
    return model.images[at(seen.image)].pose.center();
  };
  // The first and the last are often the farthest apart.
  if (track.size() >= 2 &&
      ray_angle(position, center(track.front()), center(track.back())) >= min_angle_rad)
    return true;
  std::vector<Eigen::Vector3d> centers;
  centers.reserve(track.size());
  for (const Observation& seen : track) centers.push_back(center(seen));
  for (std::size_t i = 0; i < track.size(); ++i)
    for (std::size_t k = track.size() - 1; k > i; --k)
      if (ray_angle(position, centers[i], centers[k]) >= min_angle_rad) return true;
  return false;
}

}  // namespace tarsier::sfm
