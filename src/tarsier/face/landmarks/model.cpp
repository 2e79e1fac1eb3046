// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/model.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/shape/show.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace tarsier::face::landmarks {

namespace {

constexpr NameTable<FitMethod, 5> kFitMethods{"method",
                                              {{{FitMethod::kMean, "mean"},
                                                {FitMethod::kTrees, "trees"},
                                                {FitMethod::kDescent, "sdm"},
                                                {FitMethod::kNetwork, "cnn"},
                                                {FitMethod::kPatches, "patch"}}}};

// Error of the network, in sizes of the shape. The error of trees and descent is estimated by their
// distance d (in sizes). Weights by inverse variance give the network the share d^2 / (d^2 +
// kNetworkError^2).
constexpr double kNetworkError = 0.08;

// Starts of the trees relative to the given start: shift (in sizes), scale. The mean of the fits is
// more stable than each fit.
constexpr double kJitter[][3] = {{0, 0, 1},
                                 {0.03, -0.02, 1.03},
                                 {-0.03, 0.02, 0.97},
                                 {0.01, 0.035, 0.99},
                                 {-0.015, -0.03, 1.02}};
static_assert(std::size(kJitter) == 5);  // the max that FitOptions::fields() allows

Eigen::Matrix2Xd fit_with_trees(const regression::Trees& trees, int starts, const cv::Mat& gray,
                                const Eigen::Matrix2Xd& start) {
  const Eigen::Vector2d center = start.rowwise().mean();
  const double size = regression::shape_size(start);
  Eigen::Matrix2Xd sum = Eigen::Matrix2Xd::Zero(2, start.cols());
  for (int k = 0; k < starts; ++k) {
    const double* jitter = kJitter[k];
    const Eigen::Vector2d to = center + size * Eigen::Vector2d(jitter[0], jitter[1]);
    sum +=
        regression::fit_trees(trees, gray, ((start.colwise() - center) * jitter[2]).colwise() + to);
  }
  return sum / starts;
}

// Further starts if the fit from a detector's box scores badly. Boxes are upright, and on turned
// heads they are shifted by a part of their width. Shift x, y (in sizes of the shape), scale, angle
// (degrees).
constexpr double kExtraStarts[][4] = {{0.7, 0, 1, 0},  {-0.7, 0, 1, 0}, {0, 0.6, 1, 0},
                                      {0, -0.6, 1, 0}, {0, 0, 0.75, 0}, {0, 0, 1.3, 0},
                                      {0, 0, 1, 25},   {0, 0, 1, -25}};
constexpr double kConfidentRolledScore = 0.95;  // min detector score of a rolled face that ..
constexpr double kMinRolledScore = 0.25;        // .. needs only this score of both fits
constexpr double kGoodScore = 0.5;              // no other start is tried from this score on
constexpr double kMinScore = 0.1;  // of a confident detection; below it the detection is rejected

// Shows the points on an enlarged part of the image.
void show_points(DebugSink* debug, std::string_view name, const LandmarkModel& model,
                 const cv::Mat& gray, const Eigen::Matrix2Xd& points) {
  if (debug == nullptr) return;
  constexpr double kSide = 480;    // side of the shown part, px
  constexpr double kMargin = 0.5;  // to each side, as a share of the points' extent
  const Eigen::Vector2d low = points.rowwise().minCoeff();
  const Eigen::Vector2d high = points.rowwise().maxCoeff();
  const double extent = std::max(4.0, (high - low).maxCoeff());
  const Eigen::Vector2d corner =
      (low + high) / 2 - Eigen::Vector2d::Constant(extent * (0.5 + kMargin));
  const double scale = kSide / (extent * (1 + 2 * kMargin));
  const cv::Matx23d shown_from_image(scale, 0, -scale * corner.x(), 0, scale, -scale * corner.y());
  cv::Mat shown;
  cv::warpAffine(gray, shown, shown_from_image, cv::Size(cvRound(kSide), cvRound(kSide)));
  cv::cvtColor(shown, shown, cv::COLOR_GRAY2BGR);
  shape::draw_landmarks(shown, scale * (points.colwise() - corner), model.shape.connections, {});
  debug->image(name, shown);
}

}  // namespace

std::string_view name_of(FitMethod method) { return kFitMethods.name(method); }

FitMethod parse_fit_method(std::string_view name) { return kFitMethods.parse(name); }

bool LandmarkModel::has(FitMethod method) const {
  switch (method) {
    case FitMethod::kMean:
      return trees && descent;
    case FitMethod::kTrees:
      return trees.has_value();
    case FitMethod::kDescent:
      return descent.has_value();
    case FitMethod::kNetwork:
      return network.has_value();
    case FitMethod::kPatches:
      return patches.has_value();
  }
  return false;
}

FitMethod LandmarkModel::best_method() const {
  for (const FitMethod method : {FitMethod::kMean, FitMethod::kDescent, FitMethod::kNetwork,
                                 FitMethod::kTrees, FitMethod::kPatches}) {
    if (has(method)) return method;
  }
  TARSIER_REQUIRE(false, "the model has no part that fits points");
  return FitMethod::kMean;
}

void LandmarkModel::check() const {
  shape.check();
  box.check();
  const int n = points();
  for (const int eye : eyes) TARSIER_REQUIRE(eye >= -1 && eye < n, "eye {} of {} points", eye, n);
  TARSIER_REQUIRE(!trees || trees->points() == n, "trees have {} points", trees->points());
  TARSIER_REQUIRE(!descent || descent->points() == n, "descent has {} points", descent->points());
  TARSIER_REQUIRE(!network || network->points() == n, "the network has {} points",
                  network->points());
  if (network) network->check();
  TARSIER_REQUIRE(!patches || patches->points() == n, "there are {} patches", patches->points());
  TARSIER_REQUIRE(!quality || quality->mean.cols() == n, "quality has {} points",
                  quality->mean.cols());
  TARSIER_REQUIRE(!visibility || visibility->points() == n, "visibility have {} points",
                  visibility->points());
  if (visibility) visibility->check();
}

void FitOptions::check() const {
  check_fields(*this);
  patches.check();
}

Fit fit_points(const LandmarkModel& model, const FitOptions& options, const cv::Mat& gray,
               const Eigen::Matrix2Xd& start, FitWorkspace& workspace, DebugSink* debug) {
  require_gray(gray);
  TARSIER_REQUIRE(start.cols() == model.points(), "{} points, the model has {}", start.cols(),
                  model.points());
  const FitMethod method = options.method.value_or(model.best_method());
  TARSIER_REQUIRE(model.has(method), "the model has no {}", name_of(method));
  show_points(debug, "start", model, gray, start);
  Fit fit;
  Eigen::Matrix2Xd rated;  // the points that are scored, if they differ from those of the fit
  switch (method) {
    case FitMethod::kTrees:
      fit.points = fit_with_trees(*model.trees, options.starts, gray, start);
      break;
    case FitMethod::kDescent:
      fit.points = regression::fit_descent(*model.descent, gray, start, workspace.descent);
      break;
    case FitMethod::kNetwork:
      fit.points = regression::fit_network(*model.network, gray, start, workspace.network);
      break;
    case FitMethod::kMean: {
      const Eigen::Matrix2Xd by_trees = fit_with_trees(*model.trees, options.starts, gray, start);
      const Eigen::Matrix2Xd by_descent =
          regression::fit_descent(*model.descent, gray, start, workspace.descent);
      show_points(debug, "trees", model, gray, by_trees);
      show_points(debug, "sdm", model, gray, by_descent);
      fit.points = 0.5 * (by_trees + by_descent);
      if (model.network && fit.points.allFinite() && regression::shape_size(fit.points) > 1) {
        const Eigen::Matrix2Xd by_network =
            regression::fit_network(*model.network, gray, fit.points, workspace.network);
        show_points(debug, "cnn", model, gray, by_network);
        // The network returns the shape of a face for any input. So false detections are rejected
        // by the score of the fit before it.
        rated = fit.points;
        const double distance =
            (by_trees - by_descent).colwise().norm().mean() / regression::shape_size(fit.points);
        const double share =
            distance * distance / (distance * distance + kNetworkError * kNetworkError);
        fit.points += share * (by_network - fit.points);
      }
      break;
    }
    case FitMethod::kPatches:
      fit.points = regression::fit_patches(*model.patches, model.shape, options.patches, gray,
                                           start, workspace.patches, debug)
                       .points;
      break;
  }
  if (model.quality) {
    fit.score = regression::quality_of(*model.quality, gray, rated.size() > 0 ? rated : fit.points,
                                       workspace.descent);
  }
  if (model.visibility)
    fit.visibility =
        regression::visibility_of(*model.visibility, gray, fit.points, workspace.visibility);
  show_points(debug, name_of(method), model, gray, fit.points);
  return fit;
}

namespace {

// The best of `best` and of the fits from starts around `start`.
Fit fit_around(const LandmarkModel& model, const FitOptions& options, const cv::Mat& gray,
               const Eigen::Matrix2Xd& start, Fit best, FitWorkspace& workspace) {
  const Eigen::Vector2d center = start.rowwise().mean();
  const double size = regression::shape_size(start);
  for (const double* extra : kExtraStarts) {
    if (best.score >= kGoodScore) break;
    const double angle = extra[3] * CV_PI / 180;
    const shape::Similarity2d similarity{extra[2] * std::cos(angle), extra[2] * std::sin(angle), 0,
                                         0};
    const Eigen::Vector2d to = center + size * Eigen::Vector2d(extra[0], extra[1]);
    const Eigen::Matrix2Xd there =
        similarity(Eigen::Matrix2Xd(start.colwise() - center)).colwise() + to;
    Fit fit = fit_points(model, options, gray, there, workspace);
    if (fit.score > best.score) best = std::move(fit);
  }
  return best;
}

// Fits the points in a detector's box. Returns nothing if the score shows a false detection.
std::optional<Fit> fit_candidate(const LandmarkModel& model, const FitOptions& options,
                                 const cv::Mat& gray, const Eigen::Matrix2Xd& start, bool confident,
                                 double min_score, FitWorkspace& workspace, DebugSink* debug) {
  const double required = confident ? std::min(min_score, kMinScore) : min_score;
  const auto is_false = [&](const Fit& fit) { return model.quality && fit.score < required; };
  Fit fit = fit_points(model, options, gray, start, workspace, debug);
  // Not for uncertain detections: without a face, one of many fits scores well by chance.
  if (model.quality && confident)
    fit = fit_around(model, options, gray, start, std::move(fit), workspace);
  if (is_false(fit)) return std::nullopt;
  // A start nearer to the face gives smaller errors.
  if (fit.points.allFinite() && regression::shape_size(fit.points) >= 1) {
    const double first = fit.score;
    const Eigen::Matrix2Xd again = start_from_points(model, fit.points, true);
    fit = fit_points(model, options, gray, again, workspace, debug);
    if (!confident) fit.score = std::min(fit.score, first);  // both fits must confirm the face
    if (is_false(fit)) return std::nullopt;
  }
  return fit;
}

}  // namespace

Eigen::Matrix2Xd start_from_points(const LandmarkModel& model, const Eigen::Matrix2Xd& points,
                                   bool with_rotation) {
  shape::Similarity2d similarity = shape::fit_similarity(model.shape.mean, points);
  if (!with_rotation) {
    const Eigen::Vector2d center = points.rowwise().mean();
    similarity = {similarity.scale(), 0, center.x(), center.y()};
  }
  return similarity(model.shape.mean);
}

Eigen::Matrix2Xd start_at(const LandmarkModel& model, const FaceFinder& finder,
                          const Candidate& candidate) {
  return start_in_box(finder.box_model().value_or(model.box), model.shape.mean, candidate.box,
                      candidate.roll);
}

double roll_of(const LandmarkModel& model, const Eigen::Matrix2Xd& points) {
  const shape::Similarity2d similarity = shape::fit_similarity(model.shape.mean, points);
  return std::atan2(similarity.b, similarity.a);
}

std::optional<Fit> fit_rolled(const LandmarkModel& model, const FitOptions& options,
                              const cv::Mat& gray, const FaceFinder& finder,
                              const Candidate& candidate, FitWorkspace& workspace, double min_score,
                              DebugSink* debug) {
  if (!model.quality) return std::nullopt;
  const bool confident = candidate.confident && candidate.score >= kConfidentRolledScore;
  std::optional<Fit> fit = fit_candidate(
      model, options, gray, start_at(model, finder, candidate), false,
      confident ? kMinRolledScore : std::max(min_score, kGoodScore), workspace, debug);
  if (fit && std::abs(roll_of(model, fit->points)) < kMinRoll) fit.reset();
  return fit;
}

namespace {

// Two fits whose boxes overlap by this share of the smaller box are the same face.
constexpr double kMinOverlap = 0.6;

// Keeps each face once, with its best fit; largest first.
std::vector<FittedFace> without_duplicates(const LandmarkModel& model,
                                           std::vector<FittedFace> fits) {
  std::vector<FittedFace> faces;
  std::stable_sort(fits.begin(), fits.end(), [](const FittedFace& a, const FittedFace& b) {
    return a.fit.score > b.fit.score;
  });
  for (FittedFace& face : fits) {
    const cv::Rect2d area = box_around(model.box, face.fit.points);
    const bool again = std::any_of(faces.begin(), faces.end(), [&](const FittedFace& other) {
      return overlap_of_smaller(area, box_around(model.box, other.fit.points)) > kMinOverlap;
    });
    if (!again) faces.push_back(std::move(face));
  }
  std::stable_sort(faces.begin(), faces.end(), [](const FittedFace& a, const FittedFace& b) {
    return a.box.area() > b.box.area();
  });
  return faces;
}

// The candidates that their fits confirm as faces, each face once, largest first.
std::vector<FittedFace> fit_all_candidates(const LandmarkModel& model, const FitOptions& options,
                                           const cv::Mat& gray,
                                           const std::vector<Candidate>& candidates,
                                           const FaceFinder& finder, FitWorkspace& workspace,
                                           double min_score, DebugSink* debug) {
  std::vector<FittedFace> fits;
  for (const Candidate& candidate : candidates) {
    FittedFace face;
    face.box = candidate.box;
    face.detection = candidate.score;
    face.confident = candidate.confident;
    std::optional<Fit> fit = fit_candidate(model, options, gray, start_at(model, finder, candidate),
                                           candidate.confident, min_score, workspace, debug);
    if (!fit) continue;
    face.fit = *std::move(fit);
    fits.push_back(std::move(face));
  }
  return without_duplicates(model, std::move(fits));
}

// Detectors are trained on faces with some background. They miss a face in a crop that ends at
// brows and chin. With the border pixels repeated by this share of the longer side they find it.
constexpr double kBorder = 0.3;
// Min width of a face that this search looks for, as a share of the image's smaller side.
constexpr double kMinFillingShare = 0.7;
// Longer side of the image that is enough to find such faces, px.
constexpr double kFillingSearchSide = 200;

int border_of(cv::Size size) { return cvRound(kBorder * std::max(size.width, size.height)); }

cv::Mat with_border(const cv::Mat& gray) {
  const int border = border_of(gray.size());
  cv::Mat out;
  cv::copyMakeBorder(gray, out, border, border, border, border, cv::BORDER_REPLICATE);
  return out;
}

// Detects faces that fill the image; boxes in px of with_border(gray).
std::vector<Candidate> find_filling(const cv::Mat& gray, FaceFinder& finder) {
  const double smallest = kMinFillingShare * std::min(gray.cols, gray.rows);
  const double longer = std::max(gray.cols, gray.rows);
  // The image is not reduced below the size at which the finder can detect this face.
  const double min_scale = finder.min_face(gray.size()) / smallest;
  const double scale = std::min(1.0, std::max(kFillingSearchSide / longer, min_scale));
  cv::Mat small = gray;
  if (scale < 1) cv::resize(gray, small, {}, scale, scale, cv::INTER_AREA);
  std::vector<Candidate> out;
  const cv::Rect2d inside({0, 0}, cv::Size2d(gray.size()));
  const double ratio = longer / std::max(small.cols, small.rows);
  const cv::Point2d from(border_of(small.size()), border_of(small.size()));
  const cv::Point2d to(border_of(gray.size()), border_of(gray.size()));
  for (Candidate candidate : finder.find(with_border(small))) {
    const cv::Rect2d& box = candidate.box;
    candidate.box = {(box.tl() - from) * ratio, (box.br() - from) * ratio};
    const cv::Point2d center = 0.5 * (candidate.box.tl() + candidate.box.br());
    if (candidate.box.width < smallest || !inside.contains(center)) continue;
    candidate.box += to;
    out.push_back(candidate);
  }
  return out;
}

std::vector<FittedFace> filling_faces(const LandmarkModel& model, const FitOptions& options,
                                      const cv::Mat& gray, FaceFinder& finder,
                                      FitWorkspace& workspace, double min_score, DebugSink* debug) {
  const std::vector<Candidate> filling = find_filling(gray, finder);
  if (filling.empty()) return {};
  const double border = border_of(gray.size());
  std::vector<FittedFace> faces = fit_all_candidates(model, options, with_border(gray), filling,
                                                     finder, workspace, min_score, debug);
  for (FittedFace& face : faces) {
    face.box -= cv::Point2d(border, border);
    face.fit.points.array() -= border;
  }
  return faces;
}

bool has_good_fit(const std::vector<FittedFace>& faces) {
  return std::any_of(faces.begin(), faces.end(),
                     [](const FittedFace& face) { return face.fit.score >= kGoodScore; });
}

}  // namespace

std::vector<FittedFace> find_faces(const LandmarkModel& model, const FitOptions& options,
                                   const cv::Mat& gray, FaceFinder& finder, FitWorkspace& workspace,
                                   double min_score, DebugSink* debug) {
  options.check();
  std::vector<FittedFace> faces = fit_all_candidates(model, options, gray, finder.find(gray),
                                                     finder, workspace, min_score, debug);
  if (!has_good_fit(faces)) {
    if (std::vector<FittedFace> filling =
            filling_faces(model, options, gray, finder, workspace, min_score, debug);
        !filling.empty()) {
      std::move(filling.begin(), filling.end(), std::back_inserter(faces));
      faces = without_duplicates(model, std::move(faces));
    }
  }
  const RolledSearch rolled = finder.rolled_search();
  if (rolled == RolledSearch::kNever || !model.quality) return faces;
  const auto is_good = [&](const FittedFace& face) { return face.fit.score >= kGoodScore; };
  if (rolled == RolledSearch::kAuto &&
      std::any_of(faces.begin(), faces.end(), [&](const FittedFace& face) {
        return is_good(face) && std::abs(roll_of(model, face.fit.points)) < kMinRoll;
      }))
    return faces;
  std::vector<FittedFace> added;
  for (const Candidate& candidate : finder.find_rolled(gray)) {
    std::optional<Fit> fit =
        fit_rolled(model, options, gray, finder, candidate, workspace, min_score, debug);
    if (!fit) continue;
    const cv::Rect2d area = box_around(model.box, fit->points);
    // A well-fitted upright face is kept.
    const bool known = std::any_of(faces.begin(), faces.end(), [&](const FittedFace& face) {
      return is_good(face) &&
             overlap_of_smaller(area, box_around(model.box, face.fit.points)) > kMinOverlap;
    });
    if (!known)
      added.push_back({candidate.box, *std::move(fit), candidate.score, candidate.confident});
  }
  if (added.empty()) return faces;
  std::move(added.begin(), added.end(), std::back_inserter(faces));
  return without_duplicates(model, std::move(faces));
}

}  // namespace tarsier::face::landmarks
