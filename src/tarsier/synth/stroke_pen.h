// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <array>
#include <vector>

// Draws strokes along skeletons, for stroke_typeface.cpp.
namespace tarsier::synth {

// Parameters shared by the symbols of a typeface. Lengths are relative to the cap height. Positions
// on a skeleton are relative to its box: (0, 0) is its top left corner, (1, 1) its bottom right
// one.
struct StrokeStyle {
  double width = 0.55;          // of a digit
  double letter_ratio = 1;      // width of a letter / width of a digit
  double width_evenness = 0.5;  // 1: narrow and wide letters have the same width as the others
  double stem_width = 0.14;     // of upright strokes
  double bar_width = 0.14;      // of level strokes
  double round = 0.5;           // radius of the bowls / width of the skeleton
  double bowl_aspect = 1;       // vertical / horizontal radius of the bowls
  double power = 2;             // of the superellipse: 2 is a circle, 1 a cut corner
  bool round_ends = false;
  bool round_joins = false;
  double blur_px = 0;
  double aperture = 0.28;
  double waist = 0.48;
  double slab = 0;      // half the width of a slab serif
  double stencil = -1;  // position of the stencil bridge
  // Variant of the form of each symbol.
  int form_0 = 0, form_1 = 0, form_2 = 0, form_3 = 0, form_4 = 0, form_6 = 0, form_7 = 0;
  int form_a = 0, form_g = 0, form_i = 0, form_j = 0, form_k = 0, form_m = 0, form_q = 0;
  int form_r = 0, form_w = 0;
  double lean = 0.3;  // position of the foot of a 7 and the elbow of a K
  double inset = 0.06;
  double corner_radius = 0;  // radius of corners that are right angles in most typefaces (B, D)
};

struct Vertex {
  double x, y;
  double round = 0;  // relative to the typeface's radius
};

// Draws one symbol of a typeface; its width is `width` times the cap height.
class StrokePen {
 public:
  StrokePen(const StrokeStyle& style, double width);

  void closed(const std::vector<Vertex>& path) { trace(path, true); }
  void open(const std::vector<Vertex>& path) { trace(path, false); }
  // Cuts a bridge through all strokes at this share of the width.
  void bridge(double at);
  void slit(const Vertex& from, const Vertex& to);

  // The coverage mask in its final size, cropped to the ink.
  [[nodiscard]] cv::Mat finished() const;

 private:
  struct Point {
    cv::Point2d at;
    bool bend;  // part of a curve: its neighbours are nearly collinear
  };
  [[nodiscard]] cv::Point2d at(const Vertex& v) const {
    return {half_x_ + v.x * box_.x, half_y_ + v.y * box_.y};
  }
  [[nodiscard]] std::vector<Point> curved(const std::vector<Vertex>& path, bool closed) const;
  void fill(const std::array<cv::Point2d, 4>& corners);
  void dot(cv::Point2d p);
  [[nodiscard]] cv::Point2d across(cv::Point2d d) const;
  [[nodiscard]] cv::Point2d end_of(cv::Point2d p, cv::Point2d d) const;
  void join(const Point& point, cv::Point2d d, cv::Point2d next);
  void trace(const std::vector<Vertex>& path, bool closed);

  const StrokeStyle& style_;
  cv::Mat canvas_;
  double half_x_;
  double half_y_;
  cv::Point2d box_;
  cv::Point2d radius_;
};

}  // namespace tarsier::synth
