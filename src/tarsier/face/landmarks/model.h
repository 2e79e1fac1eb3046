// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/landmarks/descent.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/landmarks/patches.h"
#include "tarsier/face/landmarks/quality.h"
#include "tarsier/face/landmarks/regression_network.h"
#include "tarsier/face/landmarks/trees.h"
#include "tarsier/face/landmarks/visibility.h"
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

// How points are fitted.
enum class FitMethod {
  kMean,     // mean of trees, descent and, if there is one, network: they err in different ways
  kTrees,    // regression trees
  kDescent,  // supervised descent
  kNetwork,  // direct regression by a convolutional network
  kPatches,  // patch models and shape model
};
[[nodiscard]] std::string_view name_of(FitMethod method);  // "mean", "trees", "sdm", "cnn", "patch"
// Throws std::invalid_argument naming the choices.
[[nodiscard]] FitMethod parse_fit_method(std::string_view name);

// All that is needed to find the points of a kind of object; parts that were not trained are
// missing. Const in use, shared by threads.
struct LandmarkModel {
  shape::ShapeModel shape;
  BoxModel box;
  std::array<int, 2> eyes{-1, -1};  // points by whose distance errors are measured; -1: not known
  std::optional<Trees> trees;
  std::optional<Descent> descent;
  std::optional<RegressionNetwork> network;
  std::optional<PatchModels> patches;
  std::optional<Quality> quality;
  std::optional<VisibilityModel> visibility;

  [[nodiscard]] int points() const { return shape.points(); }
  // kMean where trees and descent are there, else a part that is; throws std::invalid_argument where none is.
  [[nodiscard]] FitMethod best_method() const;
  [[nodiscard]] bool has(FitMethod method) const;
  void check() const;
};

// Files of type "landmark-tracker". read throws ModelError, also where parts do not fit together.
void write_landmark_model(const std::string& path, const LandmarkModel& model,
                          const nlohmann::json& provenance);
[[nodiscard]] LandmarkModel read_landmark_model(const std::string& path);
// What such a file says of where it comes from. Throws ModelError.
[[nodiscard]] nlohmann::json landmark_model_provenance(const std::string& path);

struct FitOptions {
  std::optional<FitMethod> method;  // nothing: the model's best
  int starts = 3;                   // of the trees: fits from slightly different places, averaged
  PatchFitOptions patches;

  [[nodiscard]] OptionFields fields() {
    return {{"starts", starts, range(1, 5), "--starts", "number of averaged fits of the trees"}};
  }
  void check() const;
};

// Buffers. One for each thread.
struct FitWorkspace {
  DescentWorkspace descent;
  PatchWorkspace patches;
  RegressionNetworkWorkspace network;
  VisibilityWorkspace visibility;
};

struct Fit {
  Eigen::Matrix2Xd points;  // 2 x n, px
  // 0..1, what the fit is worth (Quality), with kMean before the network; 1 where the model has no such part.
  double score = 1;
  Visibility visibility;  // of the points; empty where the model has no such part
};

// From a shape near the object (CV_8UC1). `debug` gets the start, what each method makes of it, and
// the fit.
[[nodiscard]] Fit fit_points(const LandmarkModel& model, const FitOptions& options,
                             const cv::Mat& gray, const Eigen::Matrix2Xd& start,
                             FitWorkspace& workspace, DebugSink* debug = nullptr);
// The mean shape where `points` lie: a start for the next frame. Turned as they are with `turn`.
[[nodiscard]] Eigen::Matrix2Xd restart(const LandmarkModel& model, const Eigen::Matrix2Xd& points,
                                       bool turn);

inline constexpr double kMinRoll = 20 * CV_PI / 180;  // radians

// The mean shape where the finder saw something.
[[nodiscard]] Eigen::Matrix2Xd start_at(const LandmarkModel& model, const FaceFinder& finder,
                                        const Candidate& candidate);

// The fit of a face that was found rolled, from a start that is rolled as it is; nothing where no
// two fits, one from where the other ended, score `min_score` or where the points stand almost
// upright: such a face is found without turning the image. Needs LandmarkModel::quality.
[[nodiscard]] std::optional<Fit> fit_rolled(const LandmarkModel& model, const FitOptions& options,
                                            const cv::Mat& gray, const FaceFinder& finder,
                                            const Candidate& candidate, FitWorkspace& workspace,
                                            double min_score, DebugSink* debug = nullptr);
// Radians, clockwise in the image: by how much the points are turned against the mean shape.
[[nodiscard]] double roll_of(const LandmarkModel& model, const Eigen::Matrix2Xd& points);

struct FoundFace {
  cv::Rect2d box;  // of the detector
  Fit fit;
  double detection = 1;  // score of the detector, 0..1
  bool sure = true;      // found by the strict search, see Candidate
};

// All faces of an image (CV_8UC1), surest first where they overlap, else largest first. Where the model
// rates fits, faces that only the less strict search saw are kept when their score is at least
// `min_score`; where the fit of a sure one is bad, others from places around it are tried, and it is
// kept from 0.1 on. Each is fitted once more from where its points were found. Where none has a
// good fit, the image is searched again with its border pixels repeated around it, for a face that fills it (a
// crop without a margin): its box and points may reach beyond the image. Where none has a good fit still, faces
// rolled by more than kMinRoll are looked for in the image turned to either side and added where both of
// their fits are good; with RolledSearch::kAlways in any case.
[[nodiscard]] std::vector<FoundFace> find_faces(const LandmarkModel& model,
                                                const FitOptions& options, const cv::Mat& gray,
                                                FaceFinder& finder, FitWorkspace& workspace,
                                                double min_score = 0.5, DebugSink* debug = nullptr);

}  // namespace tarsier::face::landmarks
