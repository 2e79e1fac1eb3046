// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/shape/import.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Detectors of faces or other annotated objects, trained on boxes: a linear filter on histograms of
// oriented gradients, applied at every position and size (Dalal and Triggs, CVPR 2005; features of
// Felzenszwalb et al., PAMI 2010). Trained by a structural SVM over whole images (King, "Max-margin
// object detection", arXiv:1502.00046; dlib's implementation).
namespace tarsier::face::landmarks {

inline constexpr int kHogPlanes = 31;

struct HogDetector {
  int width = 80;  // px, the window: the smallest object that is detected
  int height = 80;
  int cell = 8;             // px of a histogram's cell
  int padding = 1;          // cells around the window
  Eigen::MatrixXf weights;  // kHogPlanes x (rows * columns): the filter of a plane, row by row
  double threshold = 0;     // minimum of filter . features for a detection
  // Non-maximum suppression: of two detections with a larger intersection over union, the weaker is
  // removed,
  double overlap = 0.3;
  double covered = 1;  // or if this share of the smaller one is covered by the other
  // Position of shapes in its boxes (see BoxModel); empty if it was trained on boxes alone.
  std::optional<BoxModel> box;

  // Cells of the filter, including padding.
  [[nodiscard]] cv::Size cells() const;
  void check() const;
};

struct HogOptions {
  int window = 80;        // px, square root of the window's area
  double c = 5;           // weight of the losses relative to that of a large margin
  double epsilon = 0.02;  // stop when the risk is within this distance of its minimum
  int rounds = 500;       // max number, of the optimisation
  bool mirror = true;     // also train on mirrored images
  int upsample = 0;       // number of doublings of an image with a small object
  int largest = 640;      // px; longer images are reduced
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"window", window, range(40, 200), "--window",
             "px, detection window (square root of its area): the smallest object found"},
            {"c", c, range(1e-6, 1e6), "--c", "cost C of a training error, against a large margin"},
            {"epsilon", epsilon, range(1e-4, 1), "--epsilon", "accuracy of the optimisation"},
            {"rounds", rounds, range(1, 100000)},
            {"upsample", upsample, range(0, 3), "--upsample",
             "number of times to double images with objects smaller than the window"},
            {"largest", largest, range(100, 4000)}};
  }
  void check() const { check_fields(*this); }
};

struct HogTraining {
  HogDetector detector;
  int images = 0;   // without mirrored ones
  int boxes = 0;    // used for training
  int ignored = 0;  // too small, cut off by the border, or with another aspect ratio
  int found = 0;    // of the boxes, by the trained detector
  int rounds = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Each image is scaled so that its smallest object is 1 to 1.5 times the window (random, by the
// seed), so that the filter is trained for all sizes between two pyramid levels. The window has the
// median aspect ratio of the boxes. Memory: about 5 kB per 1000 px of the scaled images. The result
// does not depend on the number of threads. Throws InputError(set_path) if no box is usable,
// Interrupted.
[[nodiscard]] HogTraining train_hog_detector(const std::vector<shape::BoxedImage>& images,
                                             const std::string& set_path, const HogOptions& options,
                                             Progress& progress, const std::stop_token& stop);

struct ScoredBox {
  cv::Rect2d box;    // px
  double score = 0;  // above the threshold
};

// A detector that is ready for use. Not thread-safe.
class HogFinder {
 public:
  explicit HogFinder(const HogDetector& detector);
  ~HogFinder();
  HogFinder(HogFinder&&) noexcept;
  HogFinder& operator=(HogFinder&&) noexcept;
  [[nodiscard]] const HogDetector& detector() const;
  // Objects of at least `min_size` px (square root of the area) in `gray` (CV_8UC1), best first.
  // The image is enlarged at most four times and to 2 MP. `margin`: also returns detections that
  // are below the threshold by up to this value.
  [[nodiscard]] std::vector<ScoredBox> find(const cv::Mat& gray, double min_size,
                                            double margin = 0);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Files of type "face-detector". read throws ModelError that names path and reason.
void write_hog_detector(const std::string& path, const HogDetector& detector,
                        const nlohmann::json& provenance);
[[nodiscard]] HogDetector read_hog_detector(const std::string& path);

// The filter as oriented strokes: on the left, edge directions with positive weights are bright; on
// the right, those with negative weights (CV_8UC3, `zoom` px per cell).
[[nodiscard]] cv::Mat draw_hog_detector(const HogDetector& detector, int zoom);

}  // namespace tarsier::face::landmarks
