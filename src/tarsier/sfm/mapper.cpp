// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/bundle.h"
#include "tarsier/sfm/triangulation.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <set>

namespace tarsier::sfm {
namespace {

constexpr double kRadians = CV_PI / 180;
constexpr int kMostPairsOfATrack = 30;
constexpr int kNeighbours = 6;    // that move with a new photograph
constexpr double kGrowth = 1.25;  // of the model, after which all of it is adjusted
constexpr int kFirstPairsTried = 20;
constexpr std::size_t kLeastPoints = 30;  // of a first pair

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// One growing model. Its points lie at their track's index; those without a track are none yet.
class Growing {
 public:
  Growing(Model model, std::vector<std::vector<Observation>> tracks,
          const std::vector<cv::Mat>& descriptors, FeatureKind kind, const MapperOptions& options)
      : model_(std::move(model)),
        tracks_(std::move(tracks)),
        descriptors_(descriptors),
        kind_(kind),
        options_(options) {
    model_.points.assign(tracks_.size(), {});
    track_of_.resize(model_.images.size());
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      model_.images[i].registered = false;
      track_of_[i].assign(model_.images[i].features.size(), -1);
    }
    for (std::size_t t = 0; t < tracks_.size(); ++t)
      for (const Observation& seen : tracks_[t])
        track_of_[at(seen.image)][at(seen.feature)] = static_cast<int>(t);
    measure_rays();
  }

  [[nodiscard]] const Model& model() const { return model_; }
  [[nodiscard]] int registered() const {
    return static_cast<int>(
        std::count_if(model_.images.begin(), model_.images.end(),
                      [](const Photograph& image) { return image.registered; }));
  }

  // Starts from two photographs; false (and nothing is registered) where too little comes of it.
  bool start(const Pair& pair, const std::stop_token& stop, std::string& why) {
    Photograph& first = model_.images[at(pair.first)];
    Photograph& second = model_.images[at(pair.second)];
    first.pose = {};
    second.pose = pair.view.second_from_first;
    first.registered = second.registered = true;
    (void)triangulate_all(least_angle());
    BundleOptions bundle;
    (void)adjust(model_, bundle, stop);
    (void)filter_points(model_, options_);
    std::vector<double> angles;
    for (const Point& point : model_.points) {
      if (!point.track.empty())
        angles.push_back(ray_angle(point.position, first.pose.center(), second.pose.center()));
    }
    std::nth_element(angles.begin(),
                     angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2), angles.end());
    const double angle = angles.empty() ? 0 : angles[angles.size() / 2] / kRadians;
    if (angles.size() >= kLeastPoints && angle >= 0.5 * options_.first_angle_deg) return true;
    why = fmt::format("only {} points, {:.1f} degrees between their rays", angles.size(), angle);
    first.registered = second.registered = false;
    for (Point& point : model_.points) point = {};
    return false;
  }

  // Points of the model that the photograph should see, as (feature, track).
  [[nodiscard]] std::vector<std::pair<int, int>> visible(int image) const {
    std::vector<std::pair<int, int>> result;
    const std::vector<int>& tracks = track_of_[at(image)];
    for (std::size_t f = 0; f < tracks.size(); ++f) {
      if (tracks[f] >= 0 && !model_.points[at(tracks[f])].track.empty())
        result.emplace_back(static_cast<int>(f), tracks[f]);
    }
    return result;
  }

  // How much a photograph sees, and how well it is spread: occupied cells of finer and finer grids,
  // the finer ones counting more (Schonberger and Frahm, section 4.2).
  [[nodiscard]] double prospect(int image) const {
    const Photograph& photograph = model_.images[at(image)];
    const geometry::Camera& camera = model_.cameras[at(photograph.camera)];
    const auto seen = visible(image);
    double score = 0;
    for (int level = 1; level <= 5; ++level) {
      const int cells = 1 << level;
      std::set<int> occupied;
      for (const auto& [feature, track] : seen) {
        const cv::Point2d p(photograph.features[at(feature)]);
        const int x = std::clamp(static_cast<int>(p.x * cells / camera.width), 0, cells - 1);
        const int y = std::clamp(static_cast<int>(p.y * cells / camera.height), 0, cells - 1);
        occupied.insert(y * cells + x);
      }
      score += static_cast<double>(occupied.size()) * cells;
    }
    return score;
  }

  // Adds a photograph; `why` tells what was missing where it fails.
  bool add(int image, const std::stop_token& stop, std::string& why) {
    Photograph& photograph = model_.images[at(image)];
    const geometry::Camera& camera = model_.cameras[at(photograph.camera)];
    const auto seen = visible(image);
    if (static_cast<int>(seen.size()) < options_.pose_inliers) {
      why = fmt::format("sees {} points of the model, {} are needed", seen.size(),
                        options_.pose_inliers);
      return false;
    }
    std::vector<cv::Point3d> positions;
    std::vector<cv::Point2d> pixels;
    for (const auto& [feature, track] : seen) {
      const cv::Point2d& ray = rays_[at(image)][at(feature)];
      positions.emplace_back(model_.points[at(track)].position);
      pixels.emplace_back(camera.fx * ray.x + camera.cx, camera.fy * ray.y + camera.cy);
    }
    const auto pose = pose_of(positions, pixels, camera);
    if (!pose) {
      why = fmt::format("no pose fits the {} points that it should see", seen.size());
      return false;
    }
    photograph.pose = *pose;
    std::vector<Sighting> inliers = inliers_of(image, seen, options_.pose_px);
    adjust_pose(photograph.pose, camera, inliers, options_.pose_px / 2);
    inliers = inliers_of(image, seen, options_.pose_px);
    const auto needed = std::max<std::size_t>(
        at(options_.pose_inliers),
        static_cast<std::size_t>(options_.pose_inlier_share * static_cast<double>(seen.size())));
    if (inliers.size() < needed) {
      why = fmt::format("{} of {} points agree on a pose, {} are needed", inliers.size(),
                        seen.size(), needed);
      return false;
    }
    adjust_pose(photograph.pose, camera, inliers, options_.reprojection_px / 2);
    photograph.registered = true;
    (void)triangulate_all(least_angle(), image);
    refine_around(image, stop);
    return true;
  }

  // Adjusts all of it, drops what is off, and looks for what fits now; again while much changes.
  void refine_all(int rounds, const std::stop_token& stop) {
    for (int round = 0; round < rounds; ++round) {
      BundleOptions bundle;
      // Two views do not tell the focal length.
      const bool enough = registered() >= 3;
      bundle.focal = options_.refine_focal && enough;
      bundle.center = options_.refine_center && registered() >= 5;
      bundle.distortion = options_.refine_distortion && enough;
      (void)adjust(model_, bundle, stop);
      if (bundle.focal || bundle.center || bundle.distortion) measure_rays();
      const int dropped = filter_points(model_, options_);
      const int found = triangulate_all(least_angle());
      const ModelStatistics now = statistics_of(model_);
      if (dropped + found < 0.002 * static_cast<double>(now.observations)) break;
    }
  }

  // Looks for known points where they should appear in photographs that do not show them yet: a
  // match too weak on its own is good at the right place. A feature that belongs to another track
  // joins the two if they are one point. Returns how many observations came in.
  int extend() {
    if (descriptors_.empty() || options_.extend_px <= 0) return 0;
    int gained = 0;
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      if (!model_.images[i].registered) continue;
      const Nearby nearby(model_.images[i], options_.extend_px);
      for (std::size_t t = 0; t < tracks_.size(); ++t) {
        if (model_.points[t].track.empty() || shows(model_.points[t].track, static_cast<int>(i)))
          continue;
        const int feature = look_for(static_cast<int>(t), static_cast<int>(i), nearby);
        if (feature >= 0) gained += take(static_cast<int>(t), {static_cast<int>(i), feature});
      }
    }
    return gained;
  }

  // The model with points in a row, their colours and errors, and what each feature shows.
  [[nodiscard]] Model finished(const std::vector<std::vector<cv::Vec3b>>& colors) const {
    Model result;
    result.cameras = model_.cameras;
    result.images = model_.images;
    for (Photograph& image : result.images) image.points.assign(image.features.size(), -1);
    const auto least =
        static_cast<std::size_t>(registered() < 4 ? 2 : std::max(2, options_.least_views));
    for (const Point& point : model_.points) {
      if (point.track.size() < least) continue;
      Point copy = point;
      cv::Vec3d color;
      double squares = 0;
      for (const Observation& seen : point.track) {
        color += cv::Vec3d(colors[at(seen.image)][at(seen.feature)]);
        const auto error = error_of(model_, seen, point.position);
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

  static std::optional<double> error_of(const Model& model, const Observation& seen,
                                        const cv::Vec3d& position) {
    const Photograph& image = model.images[at(seen.image)];
    const auto pixel = model.cameras[at(image.camera)].project(image.pose * position);
    if (!pixel) return std::nullopt;
    return cv::norm(*pixel - cv::Point2d(image.features[at(seen.feature)]));
  }

 private:
  [[nodiscard]] double least_angle() const { return options_.least_angle_deg * kRadians; }

  // The features of a photograph by place.
  class Nearby {
   public:
    Nearby(const Photograph& image, double radius) : radius_(radius), features_(image.features) {
      for (std::size_t f = 0; f < features_.size(); ++f)
        cells_[cell(features_[f].x, features_[f].y)].push_back(static_cast<int>(f));
    }
    template <typename Function>
    void for_each(const cv::Point2d& p, const Function& function) const {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const auto found = cells_.find(cell(p.x + dx * radius_, p.y + dy * radius_));
          if (found == cells_.end()) continue;
          for (const int f : found->second)
            if (cv::norm(cv::Point2d(features_[at(f)]) - p) <= radius_) function(f);
        }
      }
    }

   private:
    [[nodiscard]] std::pair<int, int> cell(double x, double y) const {
      return {static_cast<int>(std::floor(x / radius_)), static_cast<int>(std::floor(y / radius_))};
    }
    double radius_;
    const std::vector<cv::Point2f>& features_;
    std::map<std::pair<int, int>, std::vector<int>> cells_;
  };

  static bool shows(const std::vector<Observation>& track, int image) {
    return std::any_of(track.begin(), track.end(),
                       [&](const Observation& seen) { return seen.image == image; });
  }

  // The feature of a photograph that looks most like the point, near its place; or -1.
  [[nodiscard]] int look_for(int track, int image, const Nearby& nearby) const {
    const Photograph& photograph = model_.images[at(image)];
    const geometry::Camera& camera = model_.cameras[at(photograph.camera)];
    const Point& point = model_.points[at(track)];
    const auto pixel = camera.project(photograph.pose * point.position);
    if (!pixel || pixel->x < 0 || pixel->y < 0 || pixel->x >= camera.width ||
        pixel->y >= camera.height) {
      return -1;
    }
    int best = -1;
    double most = options_.extend_similarity;
    nearby.for_each(*pixel, [&](int feature) {
      double likeness = 0;
      for (const Observation& seen : point.track)
        likeness =
            std::max(likeness, similarity(descriptors_[at(image)], feature,
                                          descriptors_[at(seen.image)], seen.feature, kind_));
      if (likeness > most) {
        most = likeness;
        best = feature;
      }
    });
    return best;
  }

  int take(int track, const Observation& seen) {
    std::vector<Observation>& own = tracks_[at(track)];
    Point& point = model_.points[at(track)];
    const int other = track_of_[at(seen.image)][at(seen.feature)];
    if (other == track) return 0;  // it was dropped for being off
    if (other < 0) {
      const auto error = error_of(model_, seen, point.position);
      if (!error || *error > options_.reprojection_px || shows(own, seen.image)) return 0;
      own.push_back(seen);
      point.track.push_back(seen);
      track_of_[at(seen.image)][at(seen.feature)] = track;
      return 1;
    }
    // Two tracks: one point if all their sights agree.
    std::vector<Observation>& theirs = tracks_[at(other)];
    for (const Observation& observation : theirs)
      if (shows(own, observation.image)) return 0;
    std::vector<Observation> all = point.track;
    const std::vector<Observation>& more =
        model_.points[at(other)].track.empty() ? theirs : model_.points[at(other)].track;
    for (const Observation& observation : more)
      if (model_.images[at(observation.image)].registered) all.push_back(observation);
    std::vector<Sight> sights;
    for (const Observation& observation : all) sights.push_back(sight(observation));
    const auto position = triangulate(sights);
    if (!position || within(all, *position).size() != all.size()) return 0;
    const int gained =
        static_cast<int>(all.size() - point.track.size() - model_.points[at(other)].track.size());
    for (const Observation& observation : theirs) {
      own.push_back(observation);
      track_of_[at(observation.image)][at(observation.feature)] = track;
    }
    theirs.clear();
    model_.points[at(other)] = {};
    point.position = *position;
    point.track = std::move(all);
    return std::max(gained, 1);
  }

  // Normalised coordinates of all features.
  void measure_rays() {
    rays_.resize(model_.images.size());
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      const Photograph& image = model_.images[i];
      const geometry::Camera& camera = model_.cameras[at(image.camera)];
      rays_[i].clear();
      for (const cv::Point2d& p : undistorted(image.features, camera))
        rays_[i].emplace_back((p.x - camera.cx) / camera.fx, (p.y - camera.cy) / camera.fy);
    }
  }

  [[nodiscard]] std::optional<geometry::Rigid> pose_of(const std::vector<cv::Point3d>& positions,
                                                       const std::vector<cv::Point2d>& pixels,
                                                       const geometry::Camera& camera) const {
    cv::UsacParams params;
    params.confidence = 0.9999;
    params.isParallel = false;
    params.loIterations = 10;
    params.loMethod = cv::LOCAL_OPTIM_INNER_LO;
    params.loSampleSize = 14;
    params.maxIterations = 10000;
    params.neighborsSearch = cv::NEIGH_GRID;
    params.randomGeneratorState = static_cast<int>(options_.seed & 0x7fffffffU);
    params.sampler = cv::SAMPLING_UNIFORM;
    params.score = cv::SCORE_METHOD_MSAC;
    params.threshold = options_.pose_px;
    cv::Mat matrix(camera.matrix());
    cv::Mat rotation_vector;
    cv::Mat translation;
    cv::Mat inliers;
    try {
      if (!cv::solvePnPRansac(positions, pixels, matrix, cv::noArray(), rotation_vector,
                              translation, inliers, params)) {
        return std::nullopt;
      }
    } catch (const cv::Exception&) {
      return std::nullopt;
    }
    cv::Mat rotation;
    cv::Rodrigues(rotation_vector, rotation);
    geometry::Rigid pose;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) pose.rotation(r, c) = rotation.at<double>(r, c);
      pose.translation[r] = translation.at<double>(r);
    }
    if (!std::isfinite(pose.translation.dot(pose.translation)) ||
        std::abs(cv::determinant(pose.rotation) - 1) > 1e-3) {
      return std::nullopt;
    }
    return pose;
  }

  [[nodiscard]] std::vector<Sighting> inliers_of(int image,
                                                 const std::vector<std::pair<int, int>>& seen,
                                                 double threshold) const {
    std::vector<Sighting> result;
    for (const auto& [feature, track] : seen) {
      const cv::Vec3d& position = model_.points[at(track)].position;
      const auto error = error_of(model_, {image, feature}, position);
      if (error && *error <= threshold)
        result.push_back({cv::Point2d(model_.images[at(image)].features[at(feature)]), position});
    }
    return result;
  }

  // The photographs that share most points with a new one move with it, the others hold them.
  void refine_around(int image, const std::stop_token& stop) {
    std::map<int, int> shared;
    for (const auto& [feature, track] : visible(image))
      for (const Observation& seen : model_.points[at(track)].track) ++shared[seen.image];
    shared.erase(image);
    std::vector<std::pair<int, int>> order;
    for (const auto& [other, count] : shared) order.emplace_back(-count, other);
    std::sort(order.begin(), order.end());
    BundleOptions bundle;
    bundle.most_iterations = 20;
    bundle.images = {image};
    for (std::size_t k = 0; k < order.size() && k < kNeighbours; ++k)
      bundle.images.push_back(order[k].second);
    // A model this small is adjusted as a whole.
    if (registered() <= kNeighbours + 1) bundle.images.clear();
    (void)adjust(model_, bundle, stop);
    (void)filter_points(model_, options_);
  }

  // Points for tracks that have none, and further observations for those that have one. Of all
  // tracks, or of those of one photograph. Returns how many observations came in.
  int triangulate_all(double least_angle, int image = -1) {
    std::vector<int> chosen;
    if (image < 0) {
      chosen.resize(tracks_.size());
      std::iota(chosen.begin(), chosen.end(), 0);
    } else {
      for (const int track : track_of_[at(image)])
        if (track >= 0) chosen.push_back(track);
    }
    std::vector<int> gained(chosen.size(), 0);
    cv::parallel_for_(cv::Range(0, static_cast<int>(chosen.size())), [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k)
        gained[at(k)] = triangulate_track(chosen[at(k)], least_angle);
    });
    return std::accumulate(gained.begin(), gained.end(), 0);
  }

  int triangulate_track(int track, double least_angle) {
    Point& point = model_.points[at(track)];
    const std::size_t before = point.track.size();
    std::vector<Observation> there;
    for (const Observation& seen : tracks_[at(track)])
      if (model_.images[at(seen.image)].registered) there.push_back(seen);
    if (there.size() < 2 || before == there.size()) return 0;
    if (before > 0) {
      for (const Observation& seen : there) {
        if (std::find(point.track.begin(), point.track.end(), seen) != point.track.end()) continue;
        const auto error = error_of(model_, seen, point.position);
        if (error && *error <= options_.reprojection_px) point.track.push_back(seen);
      }
      return static_cast<int>(point.track.size() - before);
    }
    // The pair of sights that most others agree with.
    std::vector<Observation> best;
    cv::Vec3d position;
    int tried = 0;
    const auto count = static_cast<int>(there.size());
    for (int apart = count - 1; apart >= 1 && tried < kMostPairsOfATrack; --apart) {
      for (int i = 0; i + apart < count && tried < kMostPairsOfATrack; ++i) {
        ++tried;
        const auto candidate = triangulate({sight(there[at(i)]), sight(there[at(i + apart)])});
        if (!candidate) continue;
        std::vector<Observation> agreeing = within(there, *candidate);
        if (agreeing.size() > best.size()) {
          best = std::move(agreeing);
          position = *candidate;
        }
      }
      if (best.size() == there.size()) break;
    }
    if (best.size() < 2) return 0;
    std::vector<Sight> sights;
    for (const Observation& seen : best) sights.push_back(sight(seen));
    const auto refined = triangulate(sights);
    if (refined) position = *refined;
    best = within(there, position);
    if (best.size() < 2 || widest_angle(model_, best, position) < least_angle) return 0;
    point.position = position;
    point.track = std::move(best);
    return static_cast<int>(point.track.size());
  }

  [[nodiscard]] Sight sight(const Observation& seen) const {
    return {model_.images[at(seen.image)].pose, rays_[at(seen.image)][at(seen.feature)]};
  }

  [[nodiscard]] std::vector<Observation> within(const std::vector<Observation>& all,
                                                const cv::Vec3d& position) const {
    std::vector<Observation> result;
    for (const Observation& seen : all) {
      const auto error = error_of(model_, seen, position);
      if (error && *error <= options_.reprojection_px) result.push_back(seen);
    }
    return result;
  }

 public:
  static double widest_angle(const Model& model, const std::vector<Observation>& track,
                             const cv::Vec3d& position) {
    double widest = 0;
    for (std::size_t i = 0; i < track.size(); ++i) {
      for (std::size_t k = i + 1; k < track.size(); ++k) {
        widest =
            std::max(widest, ray_angle(position, model.images[at(track[i].image)].pose.center(),
                                       model.images[at(track[k].image)].pose.center()));
      }
    }
    return widest;
  }

 private:
  Model model_;
  std::vector<std::vector<Observation>> tracks_;
  const std::vector<cv::Mat>& descriptors_;
  FeatureKind kind_;
  MapperOptions options_;
  std::vector<std::vector<int>> track_of_;      // of each feature of each photograph, or -1
  std::vector<std::vector<cv::Point2d>> rays_;  // of each feature
};

// How good a pair is to begin with: many points in front of both, seen under a wide angle, and not
// all explained by one plane, which tells little of the cameras.
double promise_of(const Pair& pair, const MapperOptions& options) {
  const auto inliers = static_cast<double>(pair.view.inliers.size());
  if (inliers < options.first_inliers || pair.view.in_front < 0.5 * inliers) return 0;
  const double angle = pair.view.median_angle / kRadians;
  if (angle < options.first_angle_deg) return 0;
  const double plane = std::min(1.0, pair.view.homography_inliers / inliers);
  return pair.view.in_front * std::min(angle, 15.0) / 15 * (1.05 - plane);
}

std::string lonely(const std::vector<Pair>& pairs, const std::vector<Photograph>& images,
                   int image) {
  const Pair* best = nullptr;
  for (const Pair& pair : pairs) {
    if (pair.first != image && pair.second != image) continue;
    if (best == nullptr || pair.view.inliers.size() > best->view.inliers.size() ||
        (pair.view.inliers.size() == best->view.inliers.size() && pair.matches > best->matches)) {
      best = &pair;
    }
  }
  if (best == nullptr) return "was compared with no other photograph";
  const std::string& name = images[at(best->first == image ? best->second : best->first)].name;
  if (best->view.inliers.empty())
    return fmt::format("too few matches: at most {}, with {}, and no geometry fits them",
                       best->matches, name);
  return fmt::format("its best pair, {} inliers with {}, is no good start and joins no model",
                     best->view.inliers.size(), name);
}

// Why no pair of photographs is a start, by the one with most inliers.
std::string no_start(const std::vector<Pair>& pairs, const std::vector<Photograph>& images,
                     const MapperOptions& options) {
  const Pair* best = nullptr;
  const Pair* most = nullptr;
  for (const Pair& pair : pairs) {
    if (best == nullptr || pair.view.inliers.size() > best->view.inliers.size()) best = &pair;
    if (most == nullptr || pair.matches > most->matches) most = &pair;
  }
  if (best == nullptr) return "there are no two photographs to compare";
  if (best->view.inliers.empty())
    return fmt::format("no two photographs show the same thing: at most {} matches ({} and {})",
                       most->matches, images[at(most->first)].name, images[at(most->second)].name);
  const auto inliers = static_cast<double>(best->view.inliers.size());
  const std::string names =
      fmt::format("the best pair, {} and {}, has {} inliers", images[at(best->first)].name,
                  images[at(best->second)].name, best->view.inliers.size());
  if (inliers < options.first_inliers)
    return fmt::format("{}, a start needs {}", names, options.first_inliers);
  if (best->view.homography_inliers > 0.9 * inliers)
    return fmt::format(
        "{}, and one plane or a camera that only turned explains {:.0f} % of them: move the camera "
        "sideways between photographs",
        names, 100 * best->view.homography_inliers / inliers);
  return fmt::format("{}, but its rays differ by only {:.1f} degrees: move the camera sideways",
                     names, best->view.median_angle / kRadians);
}

}  // namespace

void MapperOptions::check() const {
  TARSIER_REQUIRE(reprojection_px >= 0.1 && reprojection_px <= 50, "reprojection {} px",
                  reprojection_px);
  TARSIER_REQUIRE(least_angle_deg >= 0.01 && least_angle_deg <= 30, "least angle {}",
                  least_angle_deg);
  TARSIER_REQUIRE(first_angle_deg >= 0.1 && first_angle_deg <= 60, "first angle {}",
                  first_angle_deg);
  TARSIER_REQUIRE(first_inliers >= 16 && first_inliers <= 100'000, "{} first inliers",
                  first_inliers);
  TARSIER_REQUIRE(pose_inliers >= 6 && pose_inliers <= 100'000, "{} pose inliers", pose_inliers);
  TARSIER_REQUIRE(pose_inlier_share >= 0 && pose_inlier_share <= 1, "pose inlier share {}",
                  pose_inlier_share);
  TARSIER_REQUIRE(pose_px >= 0.1 && pose_px <= 50, "pose threshold {}", pose_px);
  TARSIER_REQUIRE(least_views >= 2 && least_views <= 100, "{} views", least_views);
  TARSIER_REQUIRE(least_photographs >= 2 && least_photographs <= 1000, "{} photographs",
                  least_photographs);
}

int filter_points(Model& model, const MapperOptions& options) {
  int dropped = 0;
  for (Point& point : model.points) {
    if (point.track.empty()) continue;
    const std::size_t before = point.track.size();
    std::erase_if(point.track, [&](const Observation& seen) {
      const auto error = Growing::error_of(model, seen, point.position);
      return !error || *error > options.reprojection_px;
    });
    if (point.track.size() < 2 || Growing::widest_angle(model, point.track, point.position) <
                                      options.least_angle_deg * kRadians) {
      point = {};
    }
    dropped += static_cast<int>(before - point.track.size());
  }
  return dropped;
}

ModelStatistics statistics_of(const Model& model) {
  ModelStatistics result;
  for (const Photograph& image : model.images) result.registered += image.registered;
  std::int64_t points = 0;
  double squares = 0;
  for (const Point& point : model.points) {
    if (point.track.empty()) continue;
    ++points;
    for (const Observation& seen : point.track) {
      const auto error = Growing::error_of(model, seen, point.position);
      squares += error ? *error * *error : 0;
      ++result.observations;
    }
  }
  if (points > 0) {
    result.reprojection_px = std::sqrt(squares / static_cast<double>(result.observations));
    result.mean_track = static_cast<double>(result.observations) / static_cast<double>(points);
  }
  return result;
}

Reconstruction reconstruct(const std::vector<geometry::Camera>& cameras,
                           const std::vector<Photograph>& images,
                           const std::vector<std::vector<cv::Vec3b>>& colors,
                           const std::vector<cv::Mat>& descriptors, FeatureKind kind,
                           const std::vector<Pair>& pairs, const MapperOptions& options,
                           Progress& progress, const std::stop_token& stop,
                           const std::function<void(const Model&)>& watch) {
  options.check();
  Reconstruction result;
  result.outcomes.resize(images.size());
  std::vector<bool> used(images.size(), false);
  std::vector<bool> bad_start(pairs.size(), false);
  progress.begin("reconstruct", static_cast<std::int64_t>(images.size()), "photographs");

  for (;;) {
    // What is left, and its best pairs.
    std::vector<Pair> left;
    std::vector<std::pair<double, std::size_t>> starts;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Pair& pair = pairs[k];
      if (pair.view.inliers.empty() || used[at(pair.first)] || used[at(pair.second)]) continue;
      left.push_back(pair);
      const double promise = promise_of(pair, options);
      if (promise > 0 && !bad_start[k]) starts.emplace_back(-promise, k);
    }
    if (starts.empty()) break;
    std::sort(starts.begin(), starts.end());
    std::vector<int> features;
    for (const Photograph& image : images)
      features.push_back(static_cast<int>(image.features.size()));
    Model empty;
    empty.cameras = cameras;
    empty.images = images;
    Growing growing(std::move(empty), make_tracks(left, features), descriptors, kind, options);

    bool started = false;
    for (std::size_t k = 0; k < starts.size() && k < kFirstPairsTried && !started; ++k) {
      throw_if_stopped(stop);
      const Pair& pair = pairs[starts[k].second];
      std::string why;
      started = growing.start(pair, stop, why);
      result.story.push_back(fmt::format(
          "start from {} and {} ({} inliers, {:.1f} degrees, {:.0f} % of one plane): {}",
          images[at(pair.first)].name, images[at(pair.second)].name, pair.view.inliers.size(),
          pair.view.median_angle / kRadians,
          100.0 * pair.view.homography_inliers / static_cast<double>(pair.view.inliers.size()),
          started ? "good" : why));
      if (!started) bad_start[starts[k].second] = true;
    }
    if (!started) break;
    progress.advance(2);
    if (watch) watch(growing.model());

    // Add what sees most, until nothing more can be added.
    int refined_at = growing.registered();
    std::map<int, std::size_t> failed;  // photograph: points it saw when it failed
    for (;;) {
      throw_if_stopped(stop);
      std::vector<std::pair<double, int>> next;
      for (std::size_t i = 0; i < images.size(); ++i) {
        const int image = static_cast<int>(i);
        if (used[i] || growing.model().images[i].registered) continue;
        const std::size_t seen = growing.visible(image).size();
        if (seen < 6) continue;
        const auto before = failed.find(image);
        if (before != failed.end() &&
            static_cast<double>(seen) < 1.1 * static_cast<double>(before->second) + 5) {
          continue;
        }
        next.emplace_back(-growing.prospect(image), image);
      }
      std::sort(next.begin(), next.end());
      bool added = false;
      for (const auto& [prospect, image] : next) {
        std::string why;
        added = growing.add(image, stop, why);
        if (added) {
          result.story.push_back(fmt::format("add {}", images[at(image)].name));
          result.outcomes[at(image)].reason.clear();
          progress.advance();
          break;
        }
        failed[image] = growing.visible(image).size();
        result.outcomes[at(image)].reason = why;
      }
      if (!added) {
        if (refined_at == growing.registered()) break;
        refined_at = growing.registered();
        growing.refine_all(1, stop);
        continue;
      }
      if (growing.registered() >= kGrowth * refined_at || growing.registered() <= 4) {
        growing.refine_all(2, stop);
        refined_at = growing.registered();
        if (watch) watch(growing.model());
      }
    }
    growing.refine_all(3, stop);
    for (int round = 0; round < 2; ++round) {
      if (growing.extend() == 0) break;
      growing.refine_all(2, stop);
    }
    Model model = growing.finished(colors);
    for (std::size_t i = 0; i < images.size(); ++i) used[i] = used[i] || model.images[i].registered;
    if (watch) watch(model);
    result.models.push_back(std::move(model));
  }
  progress.end();

  std::erase_if(result.models, [&](const Model& model) {
    return statistics_of(model).registered < options.least_photographs;
  });
  if (result.models.empty()) result.no_model = no_start(pairs, images, options);
  std::stable_sort(result.models.begin(), result.models.end(), [](const Model& a, const Model& b) {
    const ModelStatistics x = statistics_of(a);
    const ModelStatistics y = statistics_of(b);
    return x.registered != y.registered ? x.registered > y.registered
                                        : x.observations > y.observations;
  });
  for (std::size_t i = 0; i < images.size(); ++i) {
    Outcome& outcome = result.outcomes[i];
    for (std::size_t m = 0; m < result.models.size() && !outcome.registered; ++m) {
      if (!result.models[m].images[i].registered) continue;
      outcome.registered = true;
      outcome.model = static_cast<int>(m);
      outcome.reason.clear();
    }
    if (!outcome.registered && outcome.reason.empty())
      outcome.reason = lonely(pairs, images, static_cast<int>(i));
  }
  return result;
}

}  // namespace tarsier::sfm
