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
  // Markers with shorter sides are refined by align_marker(), larger ones by lines fitted to their
  // four sides. Long sides are exact enough by themselves. px
  double align_below_px = 60;

  [[nodiscard]] OptionFields fields() { return {{"align_below_px", align_below_px, at_least(0)}}; }
  void check() const;
};

struct Marker {
  int id = 0;
  Quad corners;         // px, the marker's own top left first, clockwise
  int errors = 0;       // cells that differ from the family's code
  double contrast = 0;  // difference of white and black, grey levels
  double margin = 0;    // clarity of the cells, 0..1
  // Set if the marker was refined by align_marker() (see Alignment), otherwise 0 and empty.
  double correlation = 0;
  std::vector<double> information;
};

// Buffers that a video reuses; use one for each thread.
struct DetectWorkspace {
  QuadWorkspace quads;
};

// Finds the markers of one family in `gray` (CV_8UC1), sorted by id. Of two markers at the same
// place the clearer one is kept. `debug` receives the dark regions, the quadrilaterals (green: a
// marker) and the rectified image of each marker.
[[nodiscard]] std::vector<Marker> detect_markers(const cv::Mat& gray, const Dictionary& dictionary,
                                                 const DetectOptions& options,
                                                 DetectWorkspace& workspace,
                                                 DebugSink* debug = nullptr);

}  // namespace tarsier::planar::markers
