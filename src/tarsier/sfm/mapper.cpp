// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/growing.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <string_view>

namespace tarsier::sfm {
namespace {

constexpr double kRadians = CV_PI / 180;
constexpr double kGrowth = 1.25;  // of the model, after which all of it is adjusted
constexpr int kFirstPairsTried = 20;
constexpr int kSmall = 10;       // photographs of a model that is cheap to adjust as a whole
constexpr double kRough = 1e-4;  // of an adjustment while the model still changes
constexpr double kFine = 1e-6;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

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

std::vector<std::vector<Observation>> tracks_of(const std::vector<Pair>& pairs,
                                                const std::vector<Photograph>& images) {
  std::vector<int> features;
  for (const Photograph& image : images)
    features.push_back(static_cast<int>(image.features.size()));
  return make_tracks(pairs, features);
}

// Adds what sees most, until nothing more can be added. `thorough`: when nothing more can, all of
// it is adjusted and what failed is tried once more. `tell`: image, added, why not.
template <typename Tell>
void add_all(Growing& growing, const std::vector<bool>& used, bool thorough, int& adjusted_at,
             const std::stop_token& stop, const Tell& tell) {
  std::map<int, std::size_t> failed;  // photograph: points it saw when it failed
  for (;;) {
    throw_if_stopped(stop);
    std::vector<std::pair<double, int>> next;
    for (std::size_t i = 0; i < used.size(); ++i) {
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
      tell(image, added, added ? std::string() : why);
      if (added) break;
      failed[image] = growing.visible(image).size();
    }
    if (!added) {
      if (!thorough || adjusted_at == growing.registered()) break;
      adjusted_at = growing.registered();
      growing.refine_all(1, kRough, stop);
      continue;
    }
    if (growing.registered() >= kGrowth * adjusted_at) {
      growing.refine_all(1, kRough, stop);
      adjusted_at = growing.registered();
    }
  }
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

int filter_points(Model& model, const MapperOptions& options, const std::vector<int>& images) {
  std::vector<bool> looked(model.images.size(), images.empty());
  for (const int image : images) looked[at(image)] = true;
  std::vector<int> dropped(model.points.size(), 0);
  const auto filter = [&](Point& point) {
    const std::size_t before = point.track.size();
    std::erase_if(point.track, [&](const Observation& seen) {
      const auto error = Growing::error_of(model, seen, point.position);
      return !error || *error > options.reprojection_px;
    });
    if (point.track.size() < 2 || !Growing::has_angle(model, point.track, point.position,
                                                      options.least_angle_deg * kRadians)) {
      point = {};
    }
    return static_cast<int>(before - point.track.size());
  };
  cv::parallel_for_(cv::Range(0, static_cast<int>(dropped.size())), [&](const cv::Range& range) {
    for (int p = range.start; p < range.end; ++p) {
      Point& point = model.points[at(p)];
      if (std::any_of(point.track.begin(), point.track.end(),
                      [&](const Observation& seen) { return looked[at(seen.image)]; })) {
        dropped[at(p)] = filter(point);
      }
    }
  });
  return std::accumulate(dropped.begin(), dropped.end(), 0);
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
                           const WatchModel& watch) {
  options.check();
  Reconstruction result;
  result.outcomes.resize(images.size());
  std::vector<bool> used(images.size(), false);
  std::vector<bool> bad_start(pairs.size(), false);
  int adjustments = 0;
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
    Model empty;
    empty.cameras = cameras;
    empty.images = images;
    Growing growing(std::move(empty), tracks_of(left, images), descriptors, kind, options);

    if (watch) {
      growing.watch([&](const char* moment, const Growing& now) {
        if (moment == std::string_view("before")) ++adjustments;
        watch(fmt::format("grown-{:03}-{}", adjustments, moment), now.finished(colors, 2));
      });
    }

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

    int adjusted_at = growing.registered();
    const auto tell = [&](int image, bool added, const std::string& why) {
      if (added) {
        result.story.push_back(fmt::format("add {}", images[at(image)].name));
        progress.advance();
      }
      result.outcomes[at(image)].reason = why;
    };
    add_all(growing, used, true, adjusted_at, stop, tell);
    growing.refine_all(3, kRough, stop);
    for (int round = 0; round < 2; ++round) {
      if (growing.extend() == 0) break;
      growing.refine_all(1, kRough, stop);
    }
    growing.refine_all(2, kFine, stop);
    Model model = growing.finished(colors);
    for (std::size_t i = 0; i < images.size(); ++i) used[i] = used[i] || model.images[i].registered;
    if (watch) watch(fmt::format("model-{}", result.models.size()), model);
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

Model go_on(const Model& before, const std::vector<geometry::Camera>& cameras,
            const std::vector<Photograph>& images,
            const std::vector<std::vector<cv::Vec3b>>& colors,
            const std::vector<cv::Mat>& descriptors, FeatureKind kind,
            const std::vector<Pair>& pairs, const MapperOptions& options, bool again,
            int& adjusted_at, const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(before.images.size() <= images.size() && before.cameras.size() <= cameras.size(),
                  "{} photographs after {}", images.size(), before.images.size());
  Model all;
  all.images = images;
  all.cameras = cameras;
  Growing growing(std::move(all), tracks_of(pairs, images), descriptors, kind, options);
  growing.resume(before);
  const std::vector<bool> used(images.size(), false);
  int adjusted = adjusted_at;
  const bool thorough = growing.registered() < kSmall;
  add_all(growing, used, thorough, adjusted, stop, [](int, bool, const std::string&) {});
  if (again) {
    growing.refine_all(2, kRough, stop);
    if (growing.extend() > 0) growing.refine_all(1, kRough, stop);
    adjusted = growing.registered();
  }
  adjusted_at = adjusted;
  return growing.finished(colors);
}

}  // namespace tarsier::sfm
