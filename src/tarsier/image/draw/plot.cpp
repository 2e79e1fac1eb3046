// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/plot.h"

#include "tarsier/core/markup.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

namespace tarsier::image::draw {
namespace {

using Points = std::vector<cv::Point2d>;

// Drawing surface of a plot: px, y down.
class Canvas {
 public:
  virtual ~Canvas() = default;
  virtual void line(const Points& points, const cv::Scalar& color, double width, bool dashed) = 0;
  virtual void disk(cv::Point2d at, double radius, const cv::Scalar& color) = 0;
  virtual void box(const cv::Rect& box, const cv::Scalar& fill, const cv::Scalar& rim) = 0;
  // Draws the text with its `anchor` at `at`; `upwards` rotates it to be read from below.
  virtual void text(std::string_view text, cv::Point2d at, double height, Anchor anchor, bool bold,
                    bool upwards) = 0;
  // Clips all drawing to `box` until unclip().
  virtual void clip(const cv::Rect& box) = 0;
  virtual void unclip() = 0;
};

const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kGrid(225, 225, 225);
const cv::Scalar kPaper(255, 255, 255);

class MatCanvas final : public Canvas {
 public:
  explicit MatCanvas(cv::Size size) : image_(size, CV_8UC3, kPaper), view_(image_) {}
  [[nodiscard]] cv::Mat image() const { return image_; }

  void line(const Points& points, const cv::Scalar& color, double width, bool dashed) override {
    const int thickness = std::max(1, static_cast<int>(std::lround(width)));
    double along = 0;  // px since the start, for dashes
    for (std::size_t i = 1; i < points.size(); ++i) {
      const cv::Point2d a = points[i - 1];
      const cv::Point2d b = points[i];
      if (!dashed) {
        segment(a, b, color, thickness);
        continue;
      }
      const double dash = 4 * width;
      const double length = std::hypot(b.x - a.x, b.y - a.y);
      // A segment far beyond the image would have millions of dashes.
      if (length > 1e5) {
        segment(a, b, color, thickness);
        continue;
      }
      for (double s = 0; s < length;) {
        const double phase = std::fmod(along + s, 2 * dash);
        const double step =
            std::min(length - s, std::max(phase < dash ? dash - phase : 2 * dash - phase, 0.1));
        if (phase < dash)
          segment(a + (b - a) * (s / length), a + (b - a) * ((s + step) / length), color,
                  thickness);
        s += step;
      }
      along += length;
    }
  }
  void disk(cv::Point2d at, double radius, const cv::Scalar& color) override {
    cv::circle(view_, fixed(at), static_cast<int>(std::lround(radius * 16)), color, cv::FILLED,
               cv::LINE_AA, 4);
  }
  void box(const cv::Rect& box, const cv::Scalar& fill, const cv::Scalar& rim) override {
    cv::rectangle(view_, box - offset_, fill, cv::FILLED);
    cv::rectangle(view_, box - offset_, rim, 1);
  }
  void text(std::string_view text, cv::Point2d at, double height, Anchor anchor, bool bold,
            bool upwards) override {
    if (text.empty()) return;
    const TextStyle style{height, kInk, Backing::kNone, {}, 0, bold};
    const cv::Point pixel(static_cast<int>(std::lround(at.x)), static_cast<int>(std::lround(at.y)));
    if (!upwards) {
      put_text(image_, text, pixel, style, anchor);
      return;
    }
    const cv::Size size = text_size(text, height, bold);
    cv::Mat label(size, CV_8UC3, kPaper);
    put_text(label, text, {0, 0}, style);
    cv::rotate(label, label, cv::ROTATE_90_COUNTERCLOCKWISE);
    const cv::Rect target(pixel.x - label.cols / 2, pixel.y - label.rows / 2, label.cols,
                          label.rows);
    const cv::Rect visible = target & cv::Rect({0, 0}, image_.size());
    if (!visible.empty()) label(visible - target.tl()).copyTo(image_(visible));
  }
  void clip(const cv::Rect& box) override {
    view_ = image_(box);
    offset_ = box.tl();
  }
  void unclip() override {
    view_ = image_;
    offset_ = {};
  }

 private:
  [[nodiscard]] cv::Point fixed(cv::Point2d at) const {
    // Limits far points: the line's direction inside the image changes by less than a pixel.
    const auto convert = [](double v) {
      return static_cast<int>(std::lround(std::clamp(v, -1e6, 1e6) * 16));
    };
    return {convert(at.x - offset_.x), convert(at.y - offset_.y)};
  }
  void segment(cv::Point2d a, cv::Point2d b, const cv::Scalar& color, int thickness) {
    cv::line(view_, fixed(a), fixed(b), color, thickness, cv::LINE_AA, 4);
  }

  cv::Mat image_;
  cv::Mat view_;
  cv::Point offset_;
};

std::string css(const cv::Scalar& color) {
  const auto byte = [](double v) {
    return static_cast<int>(std::lround(std::clamp(v, 0.0, 255.0)));
  };
  return fmt::format("#{:02x}{:02x}{:02x}", byte(color[2]), byte(color[1]), byte(color[0]));
}

class SvgCanvas final : public Canvas {
 public:
  explicit SvgCanvas(cv::Size size) {
    text_ = fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} "
        "{1}\" "
        "font-family=\"sans-serif\">\n<rect width=\"{0}\" height=\"{1}\" fill=\"{2}\"/>\n",
        size.width, size.height, css(kPaper));
  }
  [[nodiscard]] std::string result() const { return text_ + "</svg>\n"; }

  void line(const Points& points, const cv::Scalar& color, double width, bool dashed) override {
    if (points.size() < 2) return;
    text_ += "<polyline points=\"";
    for (const cv::Point2d& p : points) text_ += fmt::format("{:.2f},{:.2f} ", p.x, p.y);
    text_.back() = '"';
    text_ +=
        fmt::format(" fill=\"none\" stroke=\"{}\" stroke-width=\"{:g}\" stroke-linejoin=\"round\"",
                    css(color), width);
    if (dashed) text_ += fmt::format(" stroke-dasharray=\"{:g}\"", 4 * width);
    text_ += "/>\n";
  }
  void disk(cv::Point2d at, double radius, const cv::Scalar& color) override {
    text_ += fmt::format("<circle cx=\"{:.2f}\" cy=\"{:.2f}\" r=\"{:g}\" fill=\"{}\"/>\n", at.x,
                         at.y, radius, css(color));
  }
  void box(const cv::Rect& box, const cv::Scalar& fill, const cv::Scalar& rim) override {
    text_ += fmt::format(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\" stroke=\"{}\"/>\n",
        box.x + 0.5, box.y + 0.5, box.width - 1, box.height - 1, css(fill), css(rim));
  }
  void text(std::string_view text, cv::Point2d at, double height, Anchor anchor, bool bold,
            bool upwards) override {
    if (text.empty()) return;
    // In common sans-serif fonts, a capital letter is about 0.72 of the font size.
    const double margin = height * 0.3;
    static constexpr std::array<std::string_view, 3> kSides{"start", "middle", "end"};
    const auto column = static_cast<std::size_t>(static_cast<int>(anchor) % 3);
    const int row = static_cast<int>(anchor) / 3;
    const double dx = column == 0 ? margin : column == 2 ? -margin : 0;
    const double dy = row == 0 ? margin + height : row == 1 ? height / 2 : -margin - height * 0.4;
    text_ += fmt::format("<text font-size=\"{:.1f}\" text-anchor=\"{}\" fill=\"{}\"", height / 0.72,
                         kSides[column], css(kInk));
    if (bold) text_ += " font-weight=\"bold\"";
    if (upwards) {
      text_ += fmt::format(
          " transform=\"translate({:.2f} {:.2f}) rotate(-90)\" x=\"{:.2f}\" y=\"{:.2f}\"", at.x,
          at.y, dx, dy);
    } else {
      text_ += fmt::format(" x=\"{:.2f}\" y=\"{:.2f}\"", at.x + dx, at.y + dy);
    }
    text_ += fmt::format(">{}</text>\n", escaped_markup(text));
  }
  void clip(const cv::Rect& box) override {
    text_ += fmt::format(
        "<clipPath id=\"area\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>\n"
        "<g clip-path=\"url(#area)\">\n",
        box.x, box.y, box.width, box.height);
  }
  void unclip() override { text_ += "</g>\n"; }

 private:
  std::string text_;
};

struct Tick {
  double at = 0;  // 0..1 along the axis
  std::string label;
};

// An axis with its limits: maps values to 0..1 and places the ticks.
class Scale {
 public:
  Scale(const Axis& axis, std::vector<double> values, bool pad, int target_ticks)
      : logarithmic_(axis.logarithmic) {
    const auto check = [&](const std::optional<double>& end) {
      TARSIER_REQUIRE(!end || (std::isfinite(*end) && (!logarithmic_ || *end > 0)),
                      "end {} of the axis '{}'", *end, axis.label);
    };
    check(axis.low);
    check(axis.high);
    std::erase_if(values, [&](double v) { return !is_drawable(v); });
    double low = 0;
    double high = 1;
    if (!values.empty()) {
      const auto [min_value, max_value] = std::minmax_element(values.begin(), values.end());
      low = to_linear(*min_value);
      high = to_linear(*max_value);
    } else if (logarithmic_) {
      low = 0;
      high = 1;
    }
    if (axis.low) low = to_linear(*axis.low);
    if (axis.high) high = to_linear(*axis.high);
    TARSIER_REQUIRE(!axis.low || !axis.high || low < high, "axis '{}' from {} to {}", axis.label,
                    *axis.low, *axis.high);
    // A single value, or a given limit beyond the data, still needs a range.
    if (!(high - low > std::abs(low) * 1e-12)) {
      const double half = low == 0 ? 0.5 : std::max(std::abs(low) * 0.1, 1e-300);
      if (axis.low) {
        high = low + 2 * half;
      } else if (axis.high) {
        low = high - 2 * half;
      } else {
        low -= half;
        high += half;
      }
    }
    // Computed from halves, so that the range of doubles cannot overflow.
    step_ = round_step((high / 2 - low / 2) / target_ticks * 2);
    if (logarithmic_) step_ = std::max(1.0, std::round(step_));
    if (pad && !logarithmic_) {
      if (!axis.low) low = std::floor(low / step_ + 1e-9) * step_;
      if (!axis.high) high = std::ceil(high / step_ - 1e-9) * step_;
    }
    low_ = low;
    high_ = high;
  }

  [[nodiscard]] bool is_drawable(double v) const {
    return std::isfinite(v) && (!logarithmic_ || v > 0);
  }
  [[nodiscard]] double share(double v) const {
    const double at = to_linear(v);
    return (at / 2 - low_ / 2) / (high_ / 2 - low_ / 2);
  }
  [[nodiscard]] std::vector<Tick> ticks() const {
    std::vector<Tick> ticks;
    if (logarithmic_) {
      // Decades; if they are few, also their double and fivefold.
      const bool dense = high_ - low_ < 2.5;
      for (double decade = std::floor(low_); decade <= high_ && ticks.size() < 60;
           decade += dense ? 1 : step_) {
        for (const double digit : {1.0, 2.0, 5.0}) {
          if (digit > 1 && !dense) break;
          const double value = digit * std::pow(10.0, decade);
          const double at = share(value);
          if (at > -1e-9 && at < 1 + 1e-9) ticks.push_back({at, fmt::format("{:g}", value)});
        }
      }
      return ticks;
    }
    const double first = std::ceil(low_ / step_ - 1e-9);
    for (int i = 0; i < 60; ++i) {
      const double value = (first + i) * step_;
      const double at = share(value);
      if (!(at < 1 + 1e-9)) break;
      ticks.push_back({at, label(value)});
    }
    return ticks;
  }

 private:
  [[nodiscard]] double to_linear(double v) const { return logarithmic_ ? std::log10(v) : v; }
  // The next of 1, 2, 5, 10 .. that is not below `raw`.
  static double round_step(double raw) {
    const double power = std::pow(10.0, std::floor(std::log10(raw)));
    for (const double digit : {1.0, 2.0, 5.0}) {
      if (digit * power >= raw * (1 - 1e-9)) return digit * power;
    }
    return 10 * power;
  }
  [[nodiscard]] std::string label(double value) const {
    if (std::abs(value) < step_ * 1e-6) return "0";
    const double max_value = std::max(std::abs(low_), std::abs(high_));
    if (max_value >= 1e6 || max_value < 1e-4) return fmt::format("{:g}", value);
    const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step_) + 1e-9)), 0, 12);
    return fmt::format("{:.{}f}", value, decimals);
  }

  bool logarithmic_;
  double low_ = 0;
  double high_ = 1;
  double step_ = 1;
};

// Okabe and Ito's palette, without black and the yellow that is invisible on paper. BGR.
cv::Scalar palette(std::size_t index) {
  static const std::array<cv::Scalar, 6> kColors{
      {{178, 114, 0}, {0, 94, 213}, {115, 158, 0}, {167, 121, 204}, {0, 159, 230}, {233, 180, 86}}};
  return kColors[index % kColors.size()];
}

void paint(const Plot& plot, cv::Size size, Canvas& canvas) {
  TARSIER_REQUIRE(
      size.width >= 120 && size.height >= 120 && size.width <= 8000 && size.height <= 8000,
      "plot of {}x{} px", size.width, size.height);
  std::vector<double> xs;
  std::vector<double> ys;
  for (const Series& s : plot.series) {
    TARSIER_REQUIRE(s.x.size() == s.y.size(), "series '{}' has {} x and {} y", s.name, s.x.size(),
                    s.y.size());
    TARSIER_REQUIRE(s.low.size() == s.high.size() && (s.low.empty() || s.low.size() == s.y.size()),
                    "series '{}' has {} points, {} lower and {} upper ends", s.name, s.y.size(),
                    s.low.size(), s.high.size());
    xs.insert(xs.end(), s.x.begin(), s.x.end());
    ys.insert(ys.end(), s.y.begin(), s.y.end());
    ys.insert(ys.end(), s.low.begin(), s.low.end());
    ys.insert(ys.end(), s.high.begin(), s.high.end());
  }
  const double letter = std::clamp(std::min(size.width, size.height) / 45.0, 7.0, 40.0);
  const double heading = letter * 1.25;
  const int line = text_size("X", letter).height;
  const Scale x(plot.x, std::move(xs), false,
                std::clamp(static_cast<int>(size.width / (letter * 9)), 2, 10));
  const Scale y(plot.y, std::move(ys), true,
                std::clamp(static_cast<int>(size.height / (letter * 5)), 2, 10));
  const std::vector<Tick> x_ticks = x.ticks();
  const std::vector<Tick> y_ticks = y.ticks();

  int y_width = line;
  for (const Tick& tick : y_ticks) y_width = std::max(y_width, text_size(tick.label, letter).width);
  const int mark = std::max(3, static_cast<int>(letter * 0.5));
  const int left = y_width + mark + (plot.y.label.empty() ? mark : line + mark);
  const int top =
      plot.title.empty() ? line / 2 + mark : text_size("X", heading, true).height + mark;
  const int right = x_ticks.empty()
                        ? line
                        : std::max(line / 2, text_size(x_ticks.back().label, letter).width / 2 + 1);
  const int bottom = line + mark + (plot.x.label.empty() ? mark : line);
  const cv::Rect area(left, top, std::max(10, size.width - left - right),
                      std::max(10, size.height - top - bottom));
  const double width = area.width - 1;
  const double height = area.height - 1;
  const auto at_x = [&](double share) { return area.x + share * width; };
  const auto at_y = [&](double share) { return area.y + (1 - share) * height; };
  const double stroke = std::max(1.0, letter / 6);
  const double x_end = area.x + width;
  const double y_end = area.y + height;

  for (const Tick& tick : x_ticks) {
    const double px = std::round(at_x(tick.at));
    canvas.line({{px, static_cast<double>(area.y)}, {px, y_end}}, kGrid, 1, false);
    canvas.line({{px, y_end}, {px, y_end + mark}}, kInk, 1, false);
    canvas.text(tick.label, {px, y_end + mark}, letter, Anchor::kTop, false, false);
  }
  for (const Tick& tick : y_ticks) {
    const double py = std::round(at_y(tick.at));
    canvas.line({{static_cast<double>(area.x), py}, {x_end, py}}, kGrid, 1, false);
    canvas.line({{static_cast<double>(area.x - mark), py}, {static_cast<double>(area.x), py}}, kInk,
                1, false);
    canvas.text(tick.label, {static_cast<double>(area.x - mark), py}, letter, Anchor::kRight, false,
                false);
  }

  canvas.clip(area);
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    const Series& s = plot.series[i];
    const cv::Scalar color = s.color.value_or(palette(i));
    Points run;
    const auto flush = [&] {
      if (s.line && run.size() > 1) canvas.line(run, color, stroke, s.dashed);
      run.clear();
    };
    for (std::size_t k = 0; k < s.x.size(); ++k) {
      if (!x.is_drawable(s.x[k]) || !y.is_drawable(s.y[k])) {
        flush();
        continue;
      }
      const cv::Point2d p(at_x(x.share(s.x[k])), at_y(y.share(s.y[k])));
      run.push_back(p);
      if (!s.low.empty() && y.is_drawable(s.low[k]) && y.is_drawable(s.high[k])) {
        const double from = at_y(y.share(s.low[k]));
        const double to = at_y(y.share(s.high[k]));
        const double cap = letter * 0.4;
        canvas.line({{p.x, from}, {p.x, to}}, color, std::max(1.0, stroke * 0.6), false);
        canvas.line({{p.x - cap, from}, {p.x + cap, from}}, color, std::max(1.0, stroke * 0.6),
                    false);
        canvas.line({{p.x - cap, to}, {p.x + cap, to}}, color, std::max(1.0, stroke * 0.6), false);
      }
      if (s.markers || !s.line) canvas.disk(p, stroke * 1.7, color);
    }
    flush();
  }
  canvas.unclip();

  const cv::Point2d corner(area.x, y_end);
  canvas.line({{corner.x, static_cast<double>(area.y)}, corner, {x_end, corner.y}}, kInk, 1, false);
  canvas.text(plot.title, {area.x + width / 2, mark / 2.0}, heading, Anchor::kTop, true, false);
  canvas.text(plot.x.label, {area.x + width / 2, static_cast<double>(size.height)}, letter,
              Anchor::kBottom, false, false);
  canvas.text(plot.y.label, {line / 2.0 + mark / 2.0, area.y + height / 2}, letter, Anchor::kCenter,
              false, true);

  int entries = 0;
  int widest = 0;
  for (const Series& s : plot.series) {
    if (s.name.empty()) continue;
    ++entries;
    widest = std::max(widest, text_size(s.name, letter).width);
  }
  if (entries == 0) return;
  const int sample = static_cast<int>(letter * 3);
  const int row = static_cast<int>(line * 0.85);
  const cv::Size box(sample + widest + 2 * mark, row * entries + mark);
  const bool at_right =
      plot.legend == LegendPosition::kTopRight || plot.legend == LegendPosition::kBottomRight;
  const bool at_top =
      plot.legend == LegendPosition::kTopRight || plot.legend == LegendPosition::kTopLeft;
  const cv::Point origin(at_right ? area.x + area.width - box.width - mark : area.x + mark,
                         at_top ? area.y + mark : area.y + area.height - box.height - mark);
  canvas.box({origin, box}, kPaper, {180, 180, 180});
  double py = origin.y + mark / 2.0 + row / 2.0;
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    const Series& s = plot.series[i];
    if (s.name.empty()) continue;
    const cv::Scalar color = s.color.value_or(palette(i));
    const double from = origin.x + mark;
    if (s.line) canvas.line({{from, py}, {from + sample, py}}, color, stroke, s.dashed);
    if (s.markers || !s.line) canvas.disk({from + sample / 2.0, py}, stroke * 1.7, color);
    canvas.text(s.name, {from + sample, py}, letter, Anchor::kLeft, false, false);
    py += row;
  }
}

}  // namespace

cv::Mat plot_image(const Plot& plot, cv::Size size) {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0 && size.width <= 8000 && size.height <= 8000,
                  "plot of {}x{} px", size.width, size.height);
  MatCanvas canvas(size);
  paint(plot, size, canvas);
  return canvas.image();
}

std::string plot_svg(const Plot& plot, cv::Size size) {
  SvgCanvas canvas(size);
  paint(plot, size, canvas);
  return canvas.result();
}

}  // namespace tarsier::image::draw
