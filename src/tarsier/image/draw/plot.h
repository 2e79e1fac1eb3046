// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <optional>
#include <string>
#include <vector>

namespace tarsier::image::draw {

// Plots of measured curves. The image and the SVG text show the same drawing.

struct Series {
  // Name in the legend; empty: not listed.
  std::string name{};
  // In the unit of the axis. Points that are not finite (on a logarithmic axis, not above 0) are
  // skipped and break the line.
  std::vector<double> x;
  // Same length as x.
  std::vector<double> y{};
  // Lower and upper ends of error bars, same length as y; empty: no bars.
  std::vector<double> low{};
  std::vector<double> high{};
  // BGR; default: the next colour of a palette for colour-blind readers.
  std::optional<cv::Scalar> color{};
  bool line = true;
  bool dashed = false;
  bool markers = false;
};

struct Axis {
  std::string label{};          // with its unit: "threshold (grey levels)"
  std::optional<double> low{};  // ends of the axis; default: round numbers around the data
  std::optional<double> high{};
  bool logarithmic = false;
};

enum class LegendPosition { kTopRight, kTopLeft, kBottomRight, kBottomLeft };

struct Plot {
  std::string title;
  Axis x;
  Axis y;
  std::vector<Series> series;  // may be empty: only the axes
  LegendPosition legend = LegendPosition::kTopRight;
};

// `size` in px, each 120..8000. Both throw std::invalid_argument for another size, series of
// unequal lengths, and axis ends that are not finite, not in order, or not above 0 on a logarithmic
// axis.
[[nodiscard]] cv::Mat plot_image(const Plot& plot, cv::Size size = {800, 500});  // CV_8UC3
[[nodiscard]] std::string plot_svg(const Plot& plot, cv::Size size = {800, 500});

}  // namespace tarsier::image::draw
