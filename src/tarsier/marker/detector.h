// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/marker/decode.h"
#include "tarsier/marker/quads.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::marker {

struct DetectOptions {
  QuadOptions quads;
  RefineOptions refine;
  DecodeOptions decode;
  double min_margin = 0.35;  // of Reading, 0..1
  void check() const;
};

struct Marker {
  int id = 0;
  Quad corners;  // px, the marker's own top left first, clockwise
  Reading reading;
};

// Buffers that a film reuses; one for each thread.
struct DetectWorkspace {
  QuadWorkspace quads;
};

// The markers of one family in `gray` (CV_8UC1), by id; of two in the same place the clearer one.
[[nodiscard]] std::vector<Marker> detect_markers(const cv::Mat& gray, const Dictionary& dictionary,
                                                 const DetectOptions& options,
                                                 DetectWorkspace& workspace);

}  // namespace tarsier::marker
