// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/linalg/network.h"
#include "tarsier/plate/networks/quad.h"

#include <opencv2/core.hpp>

#include <vector>

// The three networks of the default pipeline: one finds plates, one finds their corners and their
// line of text, one reads the line. All take grey images.
namespace tarsier::plate {

// --- finding ---

// A fully convolutional network over a pyramid. Each cell of kCell px says whether it lies in a
// plate whose width there is about kPlateLow..kPlateHigh px, and where the corners are, in units of
// kCornerUnit px from its centre (after Silva and Jung, "License plate detection and recognition in
// unconstrained scenarios", ECCV 2018, who predict an affine map).
inline constexpr int kCell = 8;
inline constexpr float kCornerUnit = 32;
inline constexpr float kPlateLow = 26;
inline constexpr float kPlateHigh = 84;

struct Detection {
  Quad corners{};
  float score = 0;  // of its surest cell, 0..1
};

struct DetectorOptions {
  float threshold = 0.6F;
  double max_pixels = 0.6e6;  // of the finest level; larger images are reduced to it
  float overlap = 0.3F;       // of boxes of the same plate
  int most = 120;             // plates of one image
  // In images so large that a plate of `small_plate` px is narrower than kPlateLow in the finest level,
  // the places where that level has cells of `hint` and more, and no plate that is wide enough there, are
  // searched once more, larger: the surest `max_tiles`.
  double small_plate = 56;
  float hint = 0.1F;
  int max_tiles = 32;
  bool parallel = false;  // use OpenCV's threads

  [[nodiscard]] OptionFields fields() {
    return {{"threshold", threshold, inside(0, 1), "--find-threshold",
             "of the detector; lower: more, slower"},
            {"max_pixels", max_pixels, range(1e4, 1e8), "--find-pixels",
             "larger images are searched at this many; more: smaller plates, slower"},
            {"overlap", overlap, inside(0, 1)},
            {"most", most, range(1, 10000)},
            {"small_plate", small_plate, range(kPlateLow, 10000)},
            {"hint", hint, inside(0, 1)},
            {"max_tiles", max_tiles, range(0, 10000)}};
  }
  void check() const { check_fields(*this); }
};

[[nodiscard]] linalg::Network detector_network();

// Local contrast: (value - local mean) / (local deviation + floor), so that night and day look
// alike. CV_8UC1 -> CV_32FC1.
[[nodiscard]] cv::Mat local_contrast(const cv::Mat& gray);

// Best first; overlapping finds are merged. `where`: the part of the image that is searched, as finely
// as the whole would be; empty: all of it.
[[nodiscard]] std::vector<Detection> detect(const cv::Mat& gray, const linalg::Network& network,
                                            const DetectorOptions& options,
                                            linalg::Workspace& workspace,
                                            const cv::Rect& where = {});

// --- aligning ---

// The window that the aligner sees: the quad so far lies at aligner_quad().
inline constexpr int kAlignWidth = 128;
inline constexpr int kAlignHeight = 48;
[[nodiscard]] Quad aligner_quad();
[[nodiscard]] linalg::Network aligner_network();

struct Alignment {
  Quad plate{};
  Quad text{};         // around the ink of all characters
  float score = 0;     // chance that this is a plate, 0..1
  float two_rows = 0;  // chance that it has two rows, 0..1
};

// Refines corners; call again with the result's plate for more.
[[nodiscard]] Alignment align(const cv::Mat& gray, const Quad& corners,
                              const linalg::Network& network, linalg::Workspace& workspace);

// --- reading ---

// The line of text, its ink from column kLineMargin to width - kLineMargin and from row kLineTop to
// kLineBottom. One row of a two-row plate takes kHalfWidth columns.
inline constexpr int kLineHeight = 32;
inline constexpr int kLineWidth = 176;
inline constexpr int kHalfWidth = 96;
inline constexpr int kLineMargin = 14;
inline constexpr int kLineTop = 6;
inline constexpr int kLineBottom = 26;
inline constexpr int kColumn = 4;  // px of the canvas for one column of the output
[[nodiscard]] linalg::Network line_network();
[[nodiscard]] Quad line_quad(int width);

// Zero mean and unit deviation, the input of aligner and line reader.
void normalize(const cv::Mat& gray, std::vector<float>& values);

// Class probabilities, width / kColumn rows x kClasses, CV_32F. `features`, if given, becomes what the
// last layer makes them of: as many rows x the layer's planes, CV_32F.
[[nodiscard]] cv::Mat read_line(const cv::Mat& gray, const Quad& text, int width,
                                const linalg::Network& network, linalg::Workspace& workspace,
                                cv::Mat* features = nullptr);

}  // namespace tarsier::plate
