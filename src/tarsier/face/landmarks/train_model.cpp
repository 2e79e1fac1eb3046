// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/train_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/mirror_shift.h"
#include "tarsier/face/regression/quality.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tarsier::face::landmarks {

namespace {

// The detected box of each face; empty if not detected.
std::vector<cv::Rect2d> detected_boxes(const std::vector<regression::TrainingFace>& faces,
                                       Progress& progress, const std::stop_token& stop) {
  FaceFinderOptions options;
  options.thorough = false;
  // Training images are crops around their faces.
  options.detector.max_width = 320;
  FaceFinder finder(options);
  std::vector<cv::Rect2d> boxes(faces.size());
  progress.begin("finding faces", static_cast<std::int64_t>(faces.size()), "faces");
  for (std::size_t f = 0; f < faces.size(); ++f) {
    throw_if_stopped(stop);
    progress.advance();
    if (faces[f].mirrored) continue;
    const Eigen::Vector2d center = faces[f].points.rowwise().mean();
    for (const Candidate& candidate : finder.find_confident(faces[f].gray)) {
      if (candidate.box.contains(cv::Point2d(center.x(), center.y()))) {
        boxes[f] = candidate.box;
        break;
      }
    }
  }
  progress.end();
  return boxes;
}

// The mean shape in each box; 2 x 0 for an empty box.
std::vector<Eigen::Matrix2Xd> shapes_in_boxes(const LandmarkModel& model,
                                              const std::vector<cv::Rect2d>& boxes) {
  std::vector<Eigen::Matrix2Xd> shapes(boxes.size());
  for (std::size_t f = 0; f < boxes.size(); ++f) {
    if (boxes[f].width > 0) shapes[f] = start_in_box(model.box, model.shape.mean, boxes[f]);
  }
  return shapes;
}

// Fits that are good, nearly good and wrong.
std::vector<regression::RatedFit> rated_fits(const std::vector<regression::TrainingFace>& faces,
                                             const LandmarkModel& model, std::uint64_t seed,
                                             Progress& progress, const std::stop_token& stop) {
  constexpr int kNearStarts = 4;
  constexpr int kFarStarts = 6;
  constexpr int kPerturbedTruths = 3;
  constexpr int kFitsPerFace = kNearStarts + kFarStarts + kPerturbedTruths;
  std::vector<regression::RatedFit> fits(faces.size() * kFitsPerFace);
  const Rng root(seed);
  progress.begin("rating fits", static_cast<std::int64_t>(faces.size()), "faces");
  cv::parallel_for_(cv::Range(0, static_cast<int>(faces.size())), [&](const cv::Range& range) {
    FitWorkspace workspace;
    FitOptions options;
    options.starts = 1;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto f = static_cast<std::size_t>(i);
      const regression::TrainingFace& face = faces[f];
      Rng rng = root.fork(f);
      const Eigen::Vector2d center = face.points.rowwise().mean();
      const double size = regression::shape_size(face.points);
      for (int k = 0; k < kFitsPerFace; ++k) {
        regression::RatedFit& fit = fits[f * kFitsPerFace + static_cast<std::size_t>(k)];
        fit.face = i;
        if (k < kPerturbedTruths) {
          // The true shape with a small similarity transform.
          const double angle = rng.normal(0, 0.05);
          const double scale = std::exp(rng.normal(0, 0.05));
          const double down = rng.normal(0, 0.05);
          const double across = rng.normal(0, 0.05);
          const Eigen::Vector2d to = center + size * Eigen::Vector2d(across, down);
          const shape::Similarity2d similarity{scale * std::cos(angle), scale * std::sin(angle), 0,
                                               0};
          fit.points = similarity(Eigen::Matrix2Xd(face.points.colwise() - center)).colwise() + to;
          continue;
        }
        const bool is_far = k >= kPerturbedTruths + kNearStarts;
        const double reach = is_far ? rng.uniform(0.4, 2.0) : rng.uniform(0, 0.2);
        const double toward = rng.uniform(0, 2 * CV_PI);
        const Eigen::Vector2d to =
            center + reach * size * Eigen::Vector2d(std::cos(toward), std::sin(toward));
        const double scale = std::exp(is_far ? rng.uniform(-0.9, 0.7) : rng.normal(0, 0.12));
        const double angle = is_far ? rng.uniform(-0.8, 0.8) : rng.normal(0, 0.2);
        const Eigen::Matrix2Xd start =
            regression::place_mean_shape(model.shape.mean, to, size * scale, angle);
        fit.points = fit_points(model, options, face.gray, start, workspace).points;
        if (!fit.points.allFinite() || regression::shape_size(fit.points) < 1) fit.points = start;
      }
      progress.advance();
    }
  });
  throw_if_stopped(stop);
  progress.end();
  return fits;
}

}  // namespace

void TrainModelOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(std::isnan(to_the_right) || std::abs(to_the_right) <= 100, "to the right {}",
                  to_the_right);
  shape.check();
  tree_options.check();
  descent_options.check();
  patch_options.check();
}

TrainedModel train_landmark_model(const shape::LandmarkSet& set, const std::string& set_path,
                                  const TrainModelOptions& options, Progress& progress,
                                  const std::stop_token& stop) {
  options.check();
  TrainedModel result;
  regression::LoadOptions load;
  load.mirror = options.mirror;
  std::vector<regression::TrainingFace> faces =
      regression::load_training_faces(set, set_path, load, progress, stop, result.skipped);
  const auto shape_of_faces = [&] {
    std::vector<Eigen::Matrix2Xd> shapes;
    shapes.reserve(faces.size());
    for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
    try {
      return shape::train_shape_model(shapes, options.shape);
    } catch (const std::invalid_argument& error) {
      throw InputError(set_path.empty() ? "the set" : set_path, error.what());
    }
  };
  LandmarkModel& model = result.model;
  model.shape = shape_of_faces();
  if (options.mirror) {
    result.to_the_right = options.to_the_right;
    if (std::isnan(options.to_the_right)) {
      result.to_the_right =
          regression::measured_shift(faces, model.shape.mean, options.seed, progress, stop);
    }
    if (std::abs(result.to_the_right) > regression::kMinCorrectedShift) {
      log_info(
          "the points lie {:.2f} px to the right of a symmetric annotation (pixels counted "
          "from 1?); mirrored faces are shifted to match",
          result.to_the_right);
      load.to_the_right = result.to_the_right;
      result.skipped.clear();
      faces = regression::load_training_faces(set, set_path, load, progress, stop, result.skipped);
      model.shape = shape_of_faces();
    }
  }
  model.shape.mirror = set.mirror;
  model.shape.connections = set.connections;
  if (const auto markup = shape::known_markup(set.points())) model.eyes = markup->outer_eyes;
  result.faces = static_cast<int>(std::count_if(
      faces.begin(), faces.end(), [](const regression::TrainingFace& f) { return !f.mirrored; }));

  const std::vector<regression::TrainingFace> real = faces;
  if (options.extra) {
    faces = regression::with_extra_faces(real, options.extra,
                                         options.mirror ? set.mirror : std::vector<int>{},
                                         load.to_the_right, options.seed, progress, stop);
    result.extra = static_cast<int>(
        std::count_if(faces.begin(), faces.end(),
                      [](const regression::TrainingFace& f) { return f.turned && !f.mirrored; }));
  }

  std::vector<cv::Rect2d> boxes = detected_boxes(faces, progress, stop);
  std::vector<Eigen::Matrix2Xd> shapes;
  std::vector<cv::Rect2d> boxes_of_real;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (faces[f].turned) continue;
    shapes.push_back(faces[f].points);
    boxes_of_real.push_back(boxes[f]);
  }
  try {
    model.box = train_box_model(shapes, boxes_of_real);
    result.detected = model.box.trained_on;
  } catch (const std::invalid_argument&) {
    log_warning(
        "{}: the face detector detects none of the objects; the model fits points only from a "
        "given initial position",
        set_path);
  }

  // A box that does not contain the face's points is a false detection. A mirrored face gets the
  // mirrored box, shifted like its points.
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (faces[f].mirrored && f > 0 && boxes[f - 1].width > 0) {
      const cv::Rect2d& box = boxes[f - 1];
      boxes[f] = {faces[f].gray.cols - box.x - box.width + 2 * load.to_the_right / faces[f].scale,
                  box.y, box.width, box.height};
    }
  }
  std::vector<regression::Start> starts = regression::scattered_starts(
      faces, model.shape.mean, options.starts, options.seed, shapes_in_boxes(model, boxes));
  if (options.start_shapes) {
    const std::vector<regression::Start> shaped = regression::shaped_starts(
        faces, options.start_shapes, options.shaped_starts, options.seed, stop);
    starts.insert(starts.end(), shaped.begin(), shaped.end());
  }
  if (options.trees) {
    regression::TreesOptions trees = options.tree_options;
    trees.seed = options.seed;
    model.trees = regression::train_trees(faces, starts, trees, progress, stop);
  }
  if (options.descent) {
    // Half of the starts is enough for a linear model. Pairs are taken, so that both kinds of
    // starts are included.
    std::vector<regression::Start> half;
    for (std::size_t i = 0; i < starts.size(); ++i) {
      if (i / 2 % 2 == 0) half.push_back(starts[i]);
    }
    regression::DescentOptions descent = options.descent_options;
    descent.seed = options.seed;
    model.descent = regression::train_descent(faces, half, descent, progress, stop);
  }
  if (options.patches) {
    regression::PatchOptions patches = options.patch_options;
    patches.seed = options.seed;
    model.patches = regression::train_patches(real, model.shape, patches, progress, stop);
  }
  if (options.quality && (model.trees || model.descent || model.patches)) {
    model.quality =
        regression::train_quality(faces, rated_fits(faces, model, options.seed, progress, stop),
                                  regression::QualityOptions{}, progress, stop);
  }
  return result;
}

}  // namespace tarsier::face::landmarks
