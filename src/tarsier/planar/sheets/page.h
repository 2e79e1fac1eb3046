// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

// Sheets to print, true to scale: what is on a page, in millimetres, and the files it becomes.
namespace tarsier::planar::sheets {

struct Dot {
  cv::Point2d center;  // mm
  double radius = 0;   // mm
};

// Areas filled as one, so that no hairline shows between neighbours.
struct Fill {
  std::vector<cv::Rect2d> boxes;  // mm, none above another
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
  cv::Point2d at;       // mm, left end of the line the letters stand on
  double height = 2.5;  // mm, of a capital letter
  std::string text;     // printable ASCII
  double gray = 0;
};

// x right, y down, (0, 0) the paper's top left corner; white where nothing is.
struct Page {
  cv::Size2d size;  // mm
  std::vector<Fill> fills;
  std::vector<Line> lines;
  std::vector<Text> texts;

  // Throws std::invalid_argument: sizes outside 10..2000 mm, numbers that are not finite, other
  // letters.
  void check() const;
};

// A PDF of the pages (version 1.4, uncompressed, Helvetica, 1 unit = 25.4 mm / 72), which asks
// viewers not to scale it when it is printed.
[[nodiscard]] std::string pdf_of(const std::vector<Page>& pages, const std::string& title);

[[nodiscard]] std::string svg_of(const Page& page, const std::string& title);

// The page in grey levels (CV_8UC1), each pixel the mean of what it covers; pixels are as wide as
// the page divided by their number, 25.4 / dpi to within half a pixel on the whole page. Throws
// std::invalid_argument for a dpi outside 36..2400 or more than 200 million pixels.
[[nodiscard]] cv::Mat raster_of(const Page& page, double dpi);

// The same as a PNG whose size in millimetres is in it (pHYs).
[[nodiscard]] std::string png_of(const Page& page, double dpi);

// By the file's ending, .pdf, .svg or .png; of several pages PDF is one file, the others are
// numbered: sheet-1.png. Returns the paths. Throws UsageError for another ending, OutputError.
std::vector<std::string> write_pages(const std::string& path, const std::vector<Page>& pages,
                                     const std::string& title, double dpi);

}  // namespace tarsier::planar::sheets
