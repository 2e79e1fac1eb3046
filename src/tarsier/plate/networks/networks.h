// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/linalg/network.h"
#include "tarsier/plate/networks/quad.h"

#include <opencv2/core.hpp>

#include <vector>

// The three networks of the default pipeline: the detector, the aligner (corners and line of text)
// and the line reader. All take grey images.
namespace tarsier::plate {

// --- detection ---

// A fully convolutional network, applied to an image pyramid. Each cell of kCellSize px predicts
// whether it lies in a plate that is about kMinPlateWidth..kMaxPlateWidth px wide at this level. It
// also predicts the corners relative to its centre, in units of kCornerUnit px (after Silva and
// Jung, "License plate detection and recognition in unconstrained scenarios", ECCV 2018, who
// predict an affine map).
inline constexpr int kCellSize = 8;
inline constexpr float kCornerUnit = 32;
inline constexpr float kMinPlateWidth = 26;
inline constexpr float kMaxPlateWidth = 84;

struct Detection {
  Quad corners{};
  float score = 0;  // of its best cell, 0..1
};

struct DetectorOptions {
  float threshold = 0.6F;
  double max_pixels = 0.6e6;  // of the finest level; larger images are reduced to this size
  float overlap = 0.3F;       // maximum overlap of the boxes of different plates
  int max_detections = 120;   // maximum number of plates in one image
  // Second search for small plates. It is used if the finest level shows a plate of `small_plate`
  // px narrower than kMinPlateWidth. Regions whose cells reach `hint`, and that hold no
  // sufficiently wide plate, are searched once more at a larger scale: at most the best `max_tiles`
  // of them.
  double small_plate = 56;
  float hint = 0.1F;
  int max_tiles = 32;
  bool parallel = false;  // uses OpenCV's threads

  [[nodiscard]] OptionFields fields() {
    return {{"threshold", threshold, inside(0, 1), "--find-threshold",
             "detector score threshold; lower: more candidates, slower"},
            {"max_pixels", max_pixels, range(1e4, 1e8), "--find-pixels",
             "reduce larger images to this many pixels; higher: finds smaller plates, slower"},
            {"overlap", overlap, inside(0, 1)},
            {"most", max_detections, range(1, 10000)},
            {"small_plate", small_plate, range(kMinPlateWidth, 10000)},
            {"hint", hint, inside(0, 1)},
            {"max_tiles", max_tiles, range(0, 10000)}};
  }
  void check() const { check_fields(*this); }
};

[[nodiscard]] linalg::Network detector_network();

// Local contrast: (value - local mean) / (local deviation + floor). It makes night and day images
// similar. CV_8UC1 -> CV_32FC1.
[[nodiscard]] cv::Mat local_contrast(const cv::Mat& gray);

// Highest score first; overlapping detections are merged. `region` is the part to search, at the
// same scale as a search of the whole image; an empty rectangle means the whole image.
[[nodiscard]] std::vector<Detection> detect(const cv::Mat& gray, const linalg::Network& network,
                                            const DetectorOptions& options,
                                            linalg::Workspace& workspace,
                                            const cv::Rect& region = {});

// --- alignment ---

// Size of the aligner's input window. The current estimate of the quad lies at aligner_quad().
inline constexpr int kAlignWidth = 128;
inline constexpr int kAlignHeight = 48;
[[nodiscard]] Quad aligner_quad();
[[nodiscard]] linalg::Network aligner_network();

struct Alignment {
  Quad plate{};
  Quad text{};         // around all characters
  float score = 0;     // probability that this is a plate, 0..1
  float two_rows = 0;  // probability that it has two rows, 0..1
};

// Refines the corners. Call it again with the resulting plate for a further refinement.
[[nodiscard]] Alignment align(const cv::Mat& gray, const Quad& corners,
                              const linalg::Network& network, linalg::Workspace& workspace);

// --- line reader ---

// The input canvas of the line reader. The characters extend from column kLineMargin to width -
// kLineMargin and from row kLineTop to kLineBottom. One row of a two-row plate takes kHalfLineWidth
// columns.
inline constexpr int kLineHeight = 32;
inline constexpr int kLineWidth = 176;
inline constexpr int kHalfLineWidth = 96;
inline constexpr int kLineMargin = 14;
inline constexpr int kLineTop = 6;
inline constexpr int kLineBottom = 26;
inline constexpr int kColumnStride = 4;  // px of the canvas per output column
[[nodiscard]] linalg::Network line_network();
[[nodiscard]] Quad line_quad(int width);

// Normalises to zero mean and unit deviation: the input of the aligner and the line reader.
void normalize(const cv::Mat& gray, std::vector<float>& values);

// Class probabilities, width / kColumnStride rows x kClasses, CV_32F. `features` may be null; it
// receives the input of the last layer, one row per column, CV_32F.
[[nodiscard]] cv::Mat read_line(const cv::Mat& gray, const Quad& text, int width,
                                const linalg::Network& network, linalg::Workspace& workspace,
                                cv::Mat* features = nullptr);

}  // namespace tarsier::plate
