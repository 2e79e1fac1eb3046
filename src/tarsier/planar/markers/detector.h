// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/markers/align.h"
#include "tarsier/planar/markers/decode.h"
#include "tarsier/planar/markers/quads.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::planar::markers {

struct DetectOptions {
  QuadOptions quads;
  RefineOptions refine;
  DecodeOptions decode;
  AlignOptions align;
  // Markers with shorter sides are laid onto the image as a whole (align_marker), larger ones are
  // where their four sides are: long sides are exact by themselves. px
  double align_below_px = 60;

  [[nodiscard]] OptionFields fields() { return {{"align_below_px", align_below_px, at_least(0)}}; }
  void check() const;
};

struct Marker {
  int id = 0;
  Quad corners;         // px, the marker's own top left first, clockwise
  int errors = 0;       // cells that are not as the family has them
  double contrast = 0;  // white less black, grey levels
  double margin = 0;    // how clearly cells are black or white, 0..1
  // Of markers that were laid onto the image (see Alignment), else 0 and nothing.
  double correlation = 0;
  std::vector<double> information;
};

// Buffers that a video reuses; one for each thread.
struct DetectWorkspace {
  QuadWorkspace quads;
};

// The markers of one family in `gray` (CV_8UC1), by id; of two in the same place the clearer one.
// `debug` gets what is dark, the quadrilaterals (green: a marker) and each marker seen squarely.
[[nodiscard]] std::vector<Marker> detect_markers(const cv::Mat& gray, const Dictionary& dictionary,
                                                 const DetectOptions& options,
                                                 DetectWorkspace& workspace,
                                                 DebugSink* debug = nullptr);

}  // namespace tarsier::planar::markers
