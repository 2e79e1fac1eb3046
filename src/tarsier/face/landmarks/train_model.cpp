// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/train_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

namespace tarsier::face::landmarks {

namespace {

constexpr double kShift = 0.09;
constexpr double kScale = 0.10;
constexpr double kRotation = 10 * CV_PI / 180;

Eigen::Matrix2Xd placed(const Eigen::Matrix2Xd& mean, const Eigen::Vector2d& center, double size,
                        double angle) {
  const shape::Similarity2d place{size * std::cos(angle), size * std::sin(angle), center.x(),
                                  center.y()};
  return place(mean);
}

// The detected box of each face; empty if not detected.
std::vector<cv::Rect2d> detected_boxes(const std::vector<TrainingFace>& faces, Progress& progress,
                                       const std::stop_token& stop) {
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

// Adds the given shapes of each face as starts, slightly displaced.
void add_shaped_starts(const std::vector<TrainingFace>& faces, const TrainModelOptions& options,
                       std::vector<Start>& starts, const std::stop_token& stop) {
  std::vector<std::vector<Eigen::Matrix2Xd>> shapes(faces.size());
  const Rng root = Rng(options.seed).fork(77);
  cv::parallel_for_(cv::Range(0, static_cast<int>(faces.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto f = static_cast<std::size_t>(i);
      Rng rng = root.fork(f);
      for (const Eigen::Matrix2Xd& shape :
           options.start_shapes(faces[f], options.shaped_starts, rng())) {
        TARSIER_REQUIRE(shape.cols() == faces[f].points.cols() && shape.allFinite(),
                        "{}: a start that is none", faces[f].name);
        const Eigen::Vector2d center = shape.rowwise().mean();
        const double angle = rng.normal(0, kRotation / 4);
        const double scale = std::exp(rng.normal(0, kScale / 2));
        const double dx = rng.normal(0, kShift / 2);
        const double dy = rng.normal(0, kShift / 2);
        const Eigen::Vector2d to = center + shape_size(shape) * Eigen::Vector2d(dx, dy);
        const shape::Similarity2d similarity{scale * std::cos(angle), scale * std::sin(angle), 0,
                                             0};
        shapes[f].push_back(similarity(Eigen::Matrix2Xd(shape.colwise() - center)).colwise() + to);
      }
    }
  });
  throw_if_stopped(stop);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (Eigen::Matrix2Xd& shape : shapes[f])
      starts.push_back({static_cast<int>(f), std::move(shape)});
  }
}

// Fits that are good, nearly good and wrong.
std::vector<RatedFit> rated_fits(const std::vector<TrainingFace>& faces, const LandmarkModel& model,
                                 std::uint64_t seed, Progress& progress,
                                 const std::stop_token& stop) {
  constexpr int kNearStarts = 4;
  constexpr int kFarStarts = 6;
  constexpr int kPerturbedTruths = 3;
  constexpr int kFitsPerFace = kNearStarts + kFarStarts + kPerturbedTruths;
  std::vector<RatedFit> fits(faces.size() * kFitsPerFace);
  const Rng root(seed);
  progress.begin("rating fits", static_cast<std::int64_t>(faces.size()), "faces");
  cv::parallel_for_(cv::Range(0, static_cast<int>(faces.size())), [&](const cv::Range& range) {
    FitWorkspace workspace;
    FitOptions options;
    options.starts = 1;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto f = static_cast<std::size_t>(i);
      const TrainingFace& face = faces[f];
      Rng rng = root.fork(f);
      const Eigen::Vector2d center = face.points.rowwise().mean();
      const double size = shape_size(face.points);
      for (int k = 0; k < kFitsPerFace; ++k) {
        RatedFit& fit = fits[f * kFitsPerFace + static_cast<std::size_t>(k)];
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
        const Eigen::Matrix2Xd start = placed(model.shape.mean, to, size * scale, angle);
        fit.points = fit_points(model, options, face.gray, start, workspace).points;
        if (!fit.points.allFinite() || shape_size(fit.points) < 1) fit.points = start;
      }
      progress.advance();
    }
  });
  throw_if_stopped(stop);
  progress.end();
  return fits;
}

}  // namespace

double measured_shift(const std::vector<TrainingFace>& faces, const Eigen::Matrix2Xd& mean,
                      std::uint64_t seed, Progress& progress, const std::stop_token& stop) {
  constexpr std::size_t kFaces = 600;  // mirrored ones follow the originals
  const std::vector<TrainingFace> part(
      faces.begin(), faces.begin() + static_cast<std::ptrdiff_t>(std::min(kFaces, faces.size())));
  DescentOptions options;
  options.stages = {{16, 0.4}, {24, 0.3}};
  options.components = 16;
  // Starts are scattered around the annotated points. Weak regularisation lets the fits move away
  // from them.
  options.ridge = 0.2;
  options.seed = seed;
  DescentReport report;
  (void)train_descent(part, scattered_starts(part, mean, 4, seed), options, progress, stop,
                      &report);
  return report.to_the_right;
}

Eigen::Matrix2Xd mean_shape(const std::vector<TrainingFace>& faces) {
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  return shape::train_shape_model(shapes).mean;
}

std::vector<TrainingFace> load_framed_faces(const shape::LandmarkSet& set, bool mirror,
                                            std::uint64_t seed, Progress& progress,
                                            const std::stop_token& stop,
                                            std::vector<std::string>& skipped) {
  constexpr int kMaxFaceSide = 200;  // px of a face: the frames are smaller
  LoadOptions load;
  load.mirror = mirror;
  load.largest = kMaxFaceSide;
  std::vector<TrainingFace> faces = load_training_faces(set, "", load, progress, stop, skipped);
  if (!mirror) return faces;
  const double shift = measured_shift(faces, mean_shape(faces), seed, progress, stop);
  if (std::abs(shift) <= kMinCorrectedShift) return faces;
  load.to_the_right = shift;
  skipped.clear();
  return load_training_faces(set, "", load, progress, stop, skipped);
}

void TrainModelOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(std::isnan(to_the_right) || std::abs(to_the_right) <= 100, "to the right {}",
                  to_the_right);
  shape.check();
  tree_options.check();
  descent_options.check();
  patch_options.check();
}

std::vector<Start> scattered_starts(const std::vector<TrainingFace>& faces,
                                    const Eigen::Matrix2Xd& mean, int each, std::uint64_t seed,
                                    const std::vector<cv::Rect2d>& boxes, const BoxModel& box) {
  TARSIER_REQUIRE(boxes.empty() || boxes.size() == faces.size(), "{} boxes, {} faces", boxes.size(),
                  faces.size());
  std::vector<Start> starts;
  const Rng root(seed);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    Rng rng = root.fork(f);
    const Eigen::Vector2d center = faces[f].points.rowwise().mean();
    const double size = shape_size(faces[f].points);
    const bool has_box = !boxes.empty() && boxes[f].width > 0;
    for (int k = 0; k < each; ++k) {
      Eigen::Vector2d around = center;
      double start_size = size;
      double spread = 1;
      if (has_box && k % 2 == 1) {
        const Eigen::Matrix2Xd start = start_in_box(box, mean, boxes[f]);
        around = start.rowwise().mean();
        start_size = shape_size(start);
        spread = 0.5;
      }
      const double angle = rng.normal(0, kRotation);
      const double scale = std::exp(rng.normal(0, kScale * spread));
      const double dx = rng.normal(0, kShift * spread);
      const double dy = rng.normal(0, kShift * spread);
      const Eigen::Vector2d to = around + start_size * Eigen::Vector2d(dx, dy);
      starts.push_back({static_cast<int>(f), placed(mean, to, start_size * scale, angle)});
    }
  }
  return starts;
}

TrainedModel train_landmark_model(const shape::LandmarkSet& set, const std::string& set_path,
                                  const TrainModelOptions& options, Progress& progress,
                                  const std::stop_token& stop) {
  options.check();
  TrainedModel result;
  LoadOptions load;
  load.mirror = options.mirror;
  std::vector<TrainingFace> faces =
      load_training_faces(set, set_path, load, progress, stop, result.skipped);
  const auto shape_of_faces = [&] {
    std::vector<Eigen::Matrix2Xd> shapes;
    for (const TrainingFace& face : faces) shapes.push_back(face.points);
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
      result.to_the_right = measured_shift(faces, model.shape.mean, options.seed, progress, stop);
    }
    if (std::abs(result.to_the_right) > kMinCorrectedShift) {
      log_info(
          "the points lie {:.2f} px to the right of a symmetric annotation (pixels counted "
          "from 1?); mirrored faces are shifted to match",
          result.to_the_right);
      load.to_the_right = result.to_the_right;
      result.skipped.clear();
      faces = load_training_faces(set, set_path, load, progress, stop, result.skipped);
      model.shape = shape_of_faces();
    }
  }
  model.shape.mirror = set.mirror;
  model.shape.connections = set.connections;
  if (const auto markup = shape::known_markup(set.points())) model.eyes = markup->outer_eyes;
  result.faces = static_cast<int>(
      std::count_if(faces.begin(), faces.end(), [](const TrainingFace& f) { return !f.mirrored; }));

  const std::vector<TrainingFace> real = faces;
  if (options.extra) {
    faces = with_extra_faces(real, options.extra, options.mirror ? set.mirror : std::vector<int>{},
                             load.to_the_right, options.seed, progress, stop);
    result.extra = static_cast<int>(std::count_if(
        faces.begin(), faces.end(), [](const TrainingFace& f) { return f.turned && !f.mirrored; }));
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
  std::vector<Start> starts =
      scattered_starts(faces, model.shape.mean, options.starts, options.seed, boxes, model.box);
  if (options.start_shapes) add_shaped_starts(faces, options, starts, stop);
  if (options.trees) {
    TreesOptions trees = options.tree_options;
    trees.seed = options.seed;
    model.trees = train_trees(faces, starts, trees, progress, stop);
  }
  if (options.descent) {
    // Half of the starts is enough for a linear model. Pairs are taken, so that both kinds of
    // starts are included.
    std::vector<Start> half;
    for (std::size_t i = 0; i < starts.size(); ++i) {
      if (i / 2 % 2 == 0) half.push_back(starts[i]);
    }
    DescentOptions descent = options.descent_options;
    descent.seed = options.seed;
    model.descent = train_descent(faces, half, descent, progress, stop);
  }
  if (options.patches) {
    PatchOptions patches = options.patch_options;
    patches.seed = options.seed;
    model.patches = train_patches(real, model.shape, patches, progress, stop);
  }
  if (options.quality && (model.trees || model.descent || model.patches)) {
    model.quality = train_quality(faces, rated_fits(faces, model, options.seed, progress, stop),
                                  QualityOptions{}, progress, stop);
  }
  return result;
}

}  // namespace tarsier::face::landmarks
