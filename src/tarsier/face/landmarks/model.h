// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/regression/quality.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/face/regression/visibility.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::face::landmarks {

// Methods that fit the points.
enum class FitMethod {
  kMean,     // mean of trees, descent and (if present) network; their errors differ
  kTrees,    // regression trees
  kDescent,  // supervised descent
  kNetwork,  // direct regression by a convolutional network
  kPatches,  // patch models and shape model
};
[[nodiscard]] std::string_view name_of(FitMethod method);  // "mean", "trees", "sdm", "cnn", "patch"
// Throws std::invalid_argument naming the choices.
[[nodiscard]] FitMethod parse_fit_method(std::string_view name);

// All parts that find the points of one kind of object. Parts that were not trained are empty. Used
// as const, so threads can share it.
struct LandmarkModel {
  shape::ShapeModel shape;
  BoxModel box;
  // Indices of two points; errors are divided by their distance. -1: unknown.
  std::array<int, 2> eyes{-1, -1};
  std::optional<regression::Trees> trees;
  std::optional<regression::Descent> descent;
  std::optional<regression::RegressionNetwork> network;
  std::optional<regression::PatchModels> patches;
  std::optional<regression::Quality> quality;
  std::optional<regression::VisibilityModel> visibility;

  [[nodiscard]] int points() const { return shape.points(); }
  // kMean if trees and descent are present, else a part that is. Throws std::invalid_argument if
  // there is none.
  [[nodiscard]] FitMethod best_method() const;
  [[nodiscard]] bool has(FitMethod method) const;
  void check() const;
};

// Files of type "landmark-tracker". read_landmark_model() throws ModelError, also if the parts do
// not match each other.
void write_landmark_model(const std::string& path, const LandmarkModel& model,
                          const nlohmann::json& provenance);
[[nodiscard]] LandmarkModel read_landmark_model(const std::string& path);
// The provenance that the file states. Throws ModelError.
[[nodiscard]] nlohmann::json landmark_model_provenance(const std::string& path);

struct FitOptions {
  std::optional<FitMethod> method;  // empty: best_method()
  int starts = 3;                   // fits of the trees from slightly different starts, averaged
  regression::PatchFitOptions patches;

  [[nodiscard]] OptionFields fields() {
    return {{"starts", starts, range(1, 5), "--starts", "number of averaged fits of the trees"}};
  }
  void check() const;
};

// Buffers, one object for each thread.
struct FitWorkspace {
  regression::DescentWorkspace descent;
  regression::PatchWorkspace patches;
  regression::RegressionNetworkWorkspace network;
  regression::VisibilityWorkspace visibility;
};

struct Fit {
  Eigen::Matrix2Xd points;  // 2 x n, px
  // Estimated quality of the fit, 0..1 (Quality). With kMean it rates the points before the
  // network. 1 if the model has no Quality.
  double score = 1;
  regression::Visibility visibility;  // of the points; empty if the model has no VisibilityModel
};

// Fits the points from a start shape near the object. `gray` is CV_8UC1. `debug` receives the
// start, the result of each method, and the fit.
[[nodiscard]] Fit fit_points(const LandmarkModel& model, const FitOptions& options,
                             const cv::Mat& gray, const Eigen::Matrix2Xd& start,
                             FitWorkspace& workspace, DebugSink* debug = nullptr);
// The mean shape at the position and scale of `points`, as a start for the next frame. With
// `with_rotation` it also has their rotation.
[[nodiscard]] Eigen::Matrix2Xd start_from_points(const LandmarkModel& model,
                                                 const Eigen::Matrix2Xd& points,
                                                 bool with_rotation);

// Faces with a smaller roll are found without turning the image (radians).
inline constexpr double kMinRoll = 20 * CV_PI / 180;

// The mean shape, placed in the candidate's box and with its roll.
[[nodiscard]] Eigen::Matrix2Xd start_at(const LandmarkModel& model, const FaceFinder& finder,
                                        const Candidate& candidate);

// Fits a rolled candidate from a start with the same roll. A second fit begins where the first one
// ended. Returns nothing if one of the two fits scores below `min_score`, or if the roll of the
// points is below kMinRoll: such a face is found without turning the image. A candidate of which
// the detector is very confident needs a lower score only. Needs LandmarkModel::quality.
[[nodiscard]] std::optional<Fit> fit_rolled(const LandmarkModel& model, const FitOptions& options,
                                            const cv::Mat& gray, const FaceFinder& finder,
                                            const Candidate& candidate, FitWorkspace& workspace,
                                            double min_score, DebugSink* debug = nullptr);
// Roll of the points relative to the mean shape, radians, clockwise in the image.
[[nodiscard]] double roll_of(const LandmarkModel& model, const Eigen::Matrix2Xd& points);

struct FittedFace {
  cv::Rect2d box;  // as the detector draws it
  Fit fit;
  double detection = 1;   // score of the detector, 0..1
  bool confident = true;  // found by the strict search, see Candidate
};

// All faces of an image (CV_8UC1), largest first. Of overlapping faces the one with the best score
// is kept. Scores need LandmarkModel::quality; without it every fit counts as good. The steps:
// - A face that only the less strict search found needs a score of at least `min_score`.
// - If the fit of a confident face is bad, other starts around it are tried. The face needs a
//   score of 0.1.
// - Each face is fitted a second time, from the points of its first fit.
// - If no face has a good fit, the image is searched again with its border pixels repeated around
//   it. This finds a face that fills the image (a crop without a margin). Its box and points may
//   reach beyond the image.
// - If still no face with a roll below kMinRoll has a good fit, the image is turned to both sides
//   and searched for rolled faces. A rolled face is added if both of its fits are good.
//   RolledSearch::kAlways does this for every image.
[[nodiscard]] std::vector<FittedFace> find_faces(const LandmarkModel& model,
                                                 const FitOptions& options, const cv::Mat& gray,
                                                 FaceFinder& finder, FitWorkspace& workspace,
                                                 double min_score = 0.5,
                                                 DebugSink* debug = nullptr);

}  // namespace tarsier::face::landmarks
