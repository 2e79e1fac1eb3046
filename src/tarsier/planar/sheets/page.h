// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

// Sheets to print, true to scale: the contents of a page in millimetres, and its output files.
namespace tarsier::planar::sheets {

struct Dot {
  cv::Point2d center;  // mm
  double radius = 0;   // mm
};

// Areas filled in one operation, so that no thin gap shows between neighbours.
struct Fill {
  std::vector<cv::Rect2d> boxes;  // mm, without overlaps
  std::vector<Dot> dots;
  double gray = 0;  // 0 black .. 1 white
};

struct Line {
  cv::Point2d from;    // mm
  cv::Point2d to;      // along x or y
  double width = 0.2;  // mm
  double gray = 0;
};

struct Text {
  cv::Point2d at;       // mm, left end of the baseline
  double height = 2.5;  // mm, of a capital letter
  std::string text;     // printable ASCII
  double gray = 0;
};

// x right, y down, (0, 0) at the paper's top left corner; the background is white.
struct Page {
  cv::Size2d size;  // mm
  std::vector<Fill> fills;
  std::vector<Line> lines;
  std::vector<Text> texts;

  // Throws std::invalid_argument for sizes outside 10..2000 mm, non-finite numbers and unsupported
  // characters.
  void check() const;
};

// A PDF of the pages (version 1.4, uncompressed, Helvetica, 1 unit = 25.4 mm / 72). It requests
// printing without scaling.
[[nodiscard]] std::string pdf_of(const std::vector<Page>& pages, const std::string& title);

[[nodiscard]] std::string svg_of(const Page& page, const std::string& title);

// Rasterises the page in grey levels (CV_8UC1) with area sampling. A pixel is the page's size
// divided by the number of pixels, which differs from 25.4 / dpi by at most half a pixel over the
// whole page. Throws std::invalid_argument for a dpi outside 36..2400 or more than 200 million
// pixels.
[[nodiscard]] cv::Mat raster_of(const Page& page, double dpi);

// The same as a PNG that states its size in millimetres (pHYs).
[[nodiscard]] std::string png_of(const Page& page, double dpi);

// Writes .pdf, .svg or .png, by the file's extension. Several pages give one PDF, or numbered
// files: sheet-1.png. Returns the paths. Throws UsageError for another extension, OutputError.
std::vector<std::string> write_pages(const std::string& path, const std::vector<Page>& pages,
                                     const std::string& title, double dpi);

}  // namespace tarsier::planar::sheets
