// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <optional>
#include <string>
#include <vector>

namespace tarsier::image::draw {

// Plots of measured curves: the same drawing as an image and as SVG text.

struct Series {
  // In the legend; empty: not there.
  std::string name{};
  // In the unit of the axis. Points that are not finite (on a logarithmic axis, not above 0) are
  // left out and break the line.
  std::vector<double> x;
  // As many as in x.
  std::vector<double> y{};
  // Lower and upper ends of error bars, as many as in y; empty: no bars.
  std::vector<double> low{};
  std::vector<double> high{};
  // BGR; by default the next of a palette that colour-blind people can tell apart.
  std::optional<cv::Scalar> color{};
  bool line = true;
  bool dashed = false;
  bool markers = false;
};

struct Axis {
  std::string label{};          // with the unit, "threshold (grey levels)"
  std::optional<double> low{};  // ends of the axis; none: from the data, at round numbers
  std::optional<double> high{};
  bool logarithmic = false;
};

enum class LegendPlace { kTopRight, kTopLeft, kBottomRight, kBottomLeft };

struct Plot {
  std::string title;
  Axis x;
  Axis y;
  std::vector<Series> series;  // may be empty: the axes alone
  LegendPlace legend = LegendPlace::kTopRight;
};

// `size` in px, each 120..8000. Both throw std::invalid_argument for another size, series of
// unequal lengths, and axis ends that are not finite, not in order, or not above 0 on a logarithmic
// axis.
[[nodiscard]] cv::Mat plot_image(const Plot& plot, cv::Size size = {800, 500});  // CV_8UC3
[[nodiscard]] std::string plot_svg(const Plot& plot, cv::Size size = {800, 500});

}  // namespace tarsier::image::draw
