// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::face::appearance {

using Eigen::Matrix2Xd;

namespace {

double size_of(const Matrix2Xd& points) {
  const Matrix2Xd centered = points.colwise() - points.rowwise().mean();
  return std::sqrt(centered.squaredNorm() / static_cast<double>(points.cols()));
}

// The same object: the centres are nearer than one RMS radius.
bool is_same_object(const Matrix2Xd& a, const Matrix2Xd& b) {
  return (a.rowwise().mean() - b.rowwise().mean()).norm() < std::max(size_of(a), size_of(b));
}

bool is_still_tracked(const Fitter& fitter, const TrackOptions& options, const FitResult& fit) {
  if (!fit.lost) return true;
  // Of all tests, only that of the error is less strict than for a new object.
  const double limit = fitter.model().lost_error;
  return limit > 0 && fit.error > limit && fit.error <= options.hold_error * limit &&
         fit.inside > 0.5 && fit.gain > 0 && fit.status != FitStatus::kDiverged;
}

FitResult fit_next(const Fitter& fitter, const TrackOptions& options, Track::Object& object,
                   const cv::Mat& image) {
  const FitResult& last = object.tracked.fit;
  FitResult fit = fitter.follow(image, last.points, object.workspace);
  if (fit.error <= options.worse * last.error && is_still_tracked(fitter, options, fit)) return fit;
  const FitResult refit = fitter.fit(image, last.points, object.workspace);
  return refit.error < fit.error ? refit : fit;
}

Track::Object& object_for(Track& track, const FitResult& fit, double time,
                          const TrackOptions& options) {
  for (Track::Object& object : track.objects) {
    if (!object.is_lost || time - object.last_fit_s > options.remember_s) continue;
    const double size = size_of(object.tracked.fit.points);
    const double distance =
        (object.tracked.fit.points.rowwise().mean() - fit.points.rowwise().mean()).norm();
    if (distance < 3 * size) return object;
  }
  track.objects.emplace_back();
  track.objects.back().tracked.id = track.next_id++;
  return track.objects.back();
}

}  // namespace

std::vector<TrackedObject> find_objects(const Fitter& fitter, const FindStarts& find,
                                        const cv::Mat& image, int max_objects,
                                        FitWorkspace& workspace) {
  std::vector<TrackedObject> found;
  for (const std::vector<Matrix2Xd>& starts : find(image)) {
    if (static_cast<int>(found.size()) >= max_objects) break;
    FitResult fit = fitter.fit_best(image, starts, workspace);
    if (fit.lost) continue;
    const bool is_known = std::any_of(found.begin(), found.end(), [&](const TrackedObject& other) {
      return is_same_object(other.fit.points, fit.points);
    });
    if (!is_known) found.push_back({static_cast<int>(found.size()) + 1, std::move(fit)});
  }
  return found;
}

std::vector<TrackedObject> track_objects(const Fitter& fitter, const TrackOptions& options,
                                         const FindStarts& find, Track& track, const cv::Mat& image,
                                         double time) {
  options.check();
  int followed = 0;
  for (Track::Object& object : track.objects) {
    if (object.is_lost) continue;
    FitResult fit = fit_next(fitter, options, object, image);
    if (!is_still_tracked(fitter, options, fit)) {
      object.is_lost = true;
      track.until_search = 0;
      continue;
    }
    object.tracked.fit = std::move(fit);
    object.last_fit_s = time;
    ++followed;
  }
  // If two objects overlap, the older one is kept.
  for (std::size_t i = 0; i < track.objects.size(); ++i) {
    for (std::size_t j = i + 1; j < track.objects.size(); ++j) {
      Track::Object& a = track.objects[i];
      Track::Object& b = track.objects[j];
      if (a.is_lost || b.is_lost || !is_same_object(a.tracked.fit.points, b.tracked.fit.points))
        continue;
      (a.tracked.id < b.tracked.id ? b : a).is_lost = true;
      --followed;
    }
  }
  if (--track.until_search < 0 && followed < options.max_objects) {
    track.until_search = options.search_every - 1;
    for (const std::vector<Matrix2Xd>& starts : find(image)) {
      if (followed >= options.max_objects || starts.empty()) break;
      const bool is_known =
          std::any_of(track.objects.begin(), track.objects.end(), [&](const Track::Object& object) {
            return !object.is_lost && is_same_object(object.tracked.fit.points, starts.front());
          });
      if (is_known) continue;
      FitWorkspace workspace;
      FitResult fit = fitter.fit_best(image, starts, workspace);
      if (fit.lost) continue;
      Track::Object& object = object_for(track, fit, time, options);
      object.tracked.fit = std::move(fit);
      object.workspace = std::move(workspace);
      object.is_lost = false;
      object.last_fit_s = time;
      ++followed;
    }
  }
  std::erase_if(track.objects, [&](const Track::Object& object) {
    return object.is_lost && time - object.last_fit_s > options.remember_s;
  });
  std::vector<TrackedObject> result;
  for (const Track::Object& object : track.objects)
    if (!object.is_lost) result.push_back(object.tracked);
  return result;
}

}  // namespace tarsier::face::appearance
