// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/annotate_session.h"
#include "ui/overlay.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier {
namespace {

const cv::Scalar kAcceptedColor{80, 220, 80};
const cv::Scalar kProposedColor{40, 180, 255};
const cv::Scalar kHiddenColor{150, 150, 150};
const cv::Scalar kSelectedColor{255, 255, 255};
const cv::Scalar kLineColor{220, 190, 60};
const cv::Scalar kLeftColor{60, 140, 255};
const cv::Scalar kRightColor{255, 190, 60};
const cv::Scalar kAxisColor{240, 240, 240};
const cv::Scalar kUnpairedColor{200, 60, 220};
constexpr double kMaxClickDistance = 14;  // of the view: maximum distance of a click from its point
constexpr double kMinNumberSpacing = 15;  // px, minimum distance to the next point
constexpr double kMargin = 6;             // px around a fully visible image
constexpr double kMaxZoom = 64;
constexpr int kMagnifierSide = 176;   // px, side of the magnifier
constexpr double kMagnification = 3;  // times the view's scale, at least 6 px per image pixel

cv::Point fixed(cv::Point2d p) {
  constexpr double kFar = 1e5;
  return {cvRound(std::clamp(p.x, -kFar, kFar) * 16), cvRound(std::clamp(p.y, -kFar, kFar) * 16)};
}

}  // namespace

const cv::Mat& AnnotateSession::shown_image() const {
  return state_.stage() == AnnotateStage::kPick ? frame_.image : image_;
}

double AnnotateSession::scale() const {
  const cv::Mat& image = shown_image();
  if (image.empty()) return 1;
  const double width = options_.canvas.width - 2 * kMargin;
  const double height = options_.canvas.height - 2 * kMargin - bar_;
  return zoom_ * std::min(width / image.cols, height / image.rows);
}

cv::Point2d AnnotateSession::to_view(cv::Point2d p) const {
  const double s = scale();
  const cv::Point2d center(0.5 * (options_.canvas.width - 1),
                           0.5 * (options_.canvas.height - bar_ - 1));
  const double x = s * (p.x - center_.x);
  return {center.x + (mirrored_ ? -x : x), center.y + s * (p.y - center_.y)};
}

cv::Point2d AnnotateSession::to_image(cv::Point2d v) const {
  const double s = scale();
  const cv::Point2d center(0.5 * (options_.canvas.width - 1),
                           0.5 * (options_.canvas.height - bar_ - 1));
  const double x = (v.x - center.x) / s;
  return {center_.x + (mirrored_ ? -x : x), center_.y + (v.y - center.y) / s};
}

int AnnotateSession::point_near(cv::Point2d in_view) const {
  int best = -1;
  double nearest = kMaxClickDistance;
  for (int i = 0; i < static_cast<int>(positions_.cols()); ++i) {
    if (positions_.col(i).hasNaN()) continue;
    const double distance = cv::norm(to_view({positions_(0, i), positions_(1, i)}) - in_view);
    if (distance > nearest) continue;
    nearest = distance;
    best = i;
  }
  return best;
}

void AnnotateSession::zoom(double factor, cv::Point2d around) {
  const cv::Point2d before = to_image(around);
  zoom_ = std::clamp(zoom_ * factor, 1.0, kMaxZoom);
  center_ += before - to_image(around);
  const cv::Mat& image = shown_image();
  if (zoom_ <= 1 && !image.empty()) center_ = {0.5 * (image.cols - 1), 0.5 * (image.rows - 1)};
}

std::string AnnotateSession::progress_text() const {
  if (state_.stage() == AnnotateStage::kPick)
    return fmt::format("{:.1f} s, {} picked  ?: help", frame_.time, state_.images());
  if (state_.images() == 0) return "?: help";
  return fmt::format("image {}/{}, {} done  ?: help", current_ + 1, state_.images(), state_.done());
}

// Zooms to all points, with some margin.
void AnnotateSession::zoom_to_points() {
  cv::Point2d low(1e9, 1e9);
  cv::Point2d high(-1e9, -1e9);
  for (Eigen::Index i = 0; i < positions_.cols(); ++i) {
    if (positions_.col(i).hasNaN()) continue;
    low = {std::min(low.x, positions_(0, i)), std::min(low.y, positions_(1, i))};
    high = {std::max(high.x, positions_(0, i)), std::max(high.y, positions_(1, i))};
  }
  if (high.x < low.x || state_.stage() == AnnotateStage::kPick || image_.empty()) return;
  const double whole = scale() / zoom_;
  const double fitting_zoom =
      std::min(options_.canvas.width / (1.3 * (high.x - low.x) + 20),
               (options_.canvas.height - bar_) / (1.3 * (high.y - low.y) + 20));
  zoom_ = std::clamp(fitting_zoom / whole, 1.0, kMaxZoom);
  center_ = 0.5 * (low + high);
}

// The instruction, in one line.
std::string AnnotateSession::instruction() const {
  if (!message_.empty()) return message_;
  if (is_learning_)
    return state_.done() < 3 ? "Detecting the points..."
                             : fmt::format("Training on {} images...", state_.done());
  if (!read_error_.empty() && state_.stage() != AnnotateStage::kPick)
    return read_error_ + " (n: next image)";
  switch (state_.stage()) {
    case AnnotateStage::kPick:
      if (is_video_over_)
        return state_.images() > 0 ? "The video has ended. Enter: mark points"
                                   : "The video has ended. No frame was picked";
      return paused_ ? "s: pick this frame. Arrows: step. Space: play. Enter: mark points"
                     : "s: pick a frame. Space: pause. Enter: done, mark points";
    case AnnotateStage::kPoints:
      if (state_.points() == 0) return "Click the first point";
      return fmt::format("Click point {}, or drag one. d: delete. Enter: all done",
                         state_.points());
    case AnnotateStage::kConnections:
      if (selected_ >= 0)
        return fmt::format("Point {}: click the point to connect it to", selected_);
      return "Click two points to draw a line between them. Enter: continue";
    case AnnotateStage::kSymmetry: {
      if (selected_ >= 0)
        return fmt::format("Point {}: click its mirrored point, or itself if on the axis",
                           selected_);
      const auto open = std::count(state_.mirror().begin(), state_.mirror().end(), -1);
      return open == 0
                 ? "All points are paired. Enter: continue"
                 : fmt::format("Click two mirrored points; {} left to pair. Enter: continue", open);
    }
    case AnnotateStage::kImages: {
      if (state_.images() == 0 || state_.points() == 0)
        return "No points yet. 2: mark them on the first image";
      const AnnotatedImage& here = state_.image(current_);
      if (selected_ >= 0)
        return fmt::format("Point {}: drag or nudge it (arrows). h: {} it", selected_,
                           here.is_shown(selected_) ? "hide" : "show");
      if (!here.done) return "Drag wrong points. Enter: confirm, next image";
      if (state_.done() == state_.images()) return "All images are done. q: quit";
      return "Done. Enter: next unfinished image";
    }
  }
  return "";
}

void AnnotateSession::draw_points() {
  const AnnotatedImage& here = state_.image(current_);
  const bool is_symmetry = state_.stage() == AnnotateStage::kSymmetry;
  const auto count = static_cast<int>(positions_.cols());
  const auto position = [&](int i) { return to_view({positions_(0, i), positions_(1, i)}); };
  const auto is_seen = [&](int i) {
    return i < count && here.is_shown(i) && !positions_.col(i).hasNaN();
  };
  // Distance to the nearest point: dots and numbers need space.
  std::vector<double> room(static_cast<std::size_t>(count), 1e9);
  for (int i = 0; i < count && count <= 500; ++i) {
    for (int k = 0; k < i; ++k) {
      if (positions_.col(i).hasNaN() || positions_.col(k).hasNaN()) continue;
      const double distance = scale() * (positions_.col(i) - positions_.col(k)).norm();
      for (const int end : {i, k})
        room[static_cast<std::size_t>(end)] =
            std::min(room[static_cast<std::size_t>(end)], distance);
    }
  }
  const double largest = std::clamp(
      std::min(options_.canvas.width, options_.canvas.height) / (zoom_ > 3 ? 140.0 : 190.0), 2.5,
      8.0);
  if (lines_) {
    for (const auto& line : state_.connections()) {
      if (!is_seen(line[0]) || !is_seen(line[1])) continue;
      cv::line(shown_, fixed(position(line[0])), fixed(position(line[1])), kLineColor, 1,
               cv::LINE_AA, 4);
    }
  }
  if (is_symmetry) {
    for (int i = 0; i < count; ++i) {
      const int other = state_.mirror()[static_cast<std::size_t>(i)];
      if (other > i && is_seen(i) && is_seen(other))
        cv::line(shown_, fixed(position(i)), fixed(position(other)), kAxisColor, 1, cv::LINE_AA, 4);
    }
  }
  for (int i = 0; i < count; ++i) {
    if (positions_.col(i).hasNaN()) continue;
    const cv::Point2d at = position(i);
    const double space = room[static_cast<std::size_t>(i)];
    const double radius = std::clamp(0.3 * space, 2.0, largest);
    if (at.x < -50 || at.y < -50 || at.x > shown_.cols + 50 || at.y > shown_.rows + 50) continue;
    cv::Scalar color = here.done ? kAcceptedColor : kProposedColor;
    const int other = state_.mirror()[static_cast<std::size_t>(i)];
    if (is_symmetry) {
      color = other < 0    ? kUnpairedColor
              : other == i ? kAxisColor
              : other > i  ? kLeftColor
                           : kRightColor;
    }
    if (is_seen(i)) {
      image::draw::point(shown_, at, color, radius);
    } else {
      image::draw::cross(shown_, at, kHiddenColor, radius * 1.6);
    }
    if (i == selected_)
      cv::circle(shown_, fixed(at), cvRound(radius * 2.2 * 16), kSelectedColor, 2, cv::LINE_AA, 4);
    if (numbers_ && (i == selected_ || space >= kMinNumberSpacing)) {
      image::draw::TextStyle style;
      style.height_px = std::clamp(largest * 2.2, 7.0, 14.0);
      style.color = i == selected_ ? kSelectedColor : is_seen(i) ? color : kHiddenColor;
      image::draw::put_text(shown_, std::to_string(i),
                            {cvRound(at.x + radius + 1), cvRound(at.y - radius)}, style,
                            image::draw::Anchor::kBottomLeft);
    }
  }
}

// Enlarges the area below the pointer (or around the selected point while arrows move it).
void AnnotateSession::draw_magnifier() {
  const cv::Mat& image = shown_image();
  cv::Point2d center = to_image(mouse_);
  cv::Point2d in_view = mouse_;
  if (drag_ == Drag::kPoint || (mouse_.x < 0 && selected_ >= 0)) {
    if (selected_ < 0 || positions_.col(selected_).hasNaN()) return;
    center = {positions_(0, selected_), positions_(1, selected_)};
    in_view = to_view(center);
  }
  if (center.x < 0 || center.y < 0 || center.x > image.cols - 1 || center.y > image.rows - 1)
    return;
  const double times = std::max(6.0, kMagnification * scale());
  const double half = 0.5 * (kMagnifierSide - 1);
  const double sign = mirrored_ ? -1 : 1;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << sign * times, 0, half - sign * times * center.x, 0,
                       times, half - times * center.y);
  cv::Mat large;
  cv::warpAffine(image, large, map, {kMagnifierSide, kMagnifierSide}, cv::INTER_LINEAR,
                 cv::BORDER_CONSTANT, kBackground);
  for (int i = 0; i < static_cast<int>(positions_.cols()); ++i) {
    if (state_.stage() == AnnotateStage::kPick || positions_.col(i).hasNaN()) continue;
    const cv::Point2d at(half + sign * times * (positions_(0, i) - center.x),
                         half + times * (positions_(1, i) - center.y));
    if (at.x < 0 || at.y < 0 || at.x >= kMagnifierSide || at.y >= kMagnifierSide) continue;
    cv::circle(large, fixed(at), 3 * 16, i == selected_ ? kSelectedColor : kProposedColor, 1,
               cv::LINE_AA, 4);
  }
  // A cross with a free centre.
  for (const double side : {-1.0, 1.0}) {
    for (const bool upright : {false, true}) {
      const cv::Point2d from(half + (upright ? 0 : side * 5), half + (upright ? side * 5 : 0));
      const cv::Point2d to(half + (upright ? 0 : side * 22), half + (upright ? side * 22 : 0));
      cv::line(large, fixed(from), fixed(to), {0, 0, 0}, 3, cv::LINE_AA, 4);
      cv::line(large, fixed(from), fixed(to), kSelectedColor, 1, cv::LINE_AA, 4);
    }
  }
  const int side = std::min({kMagnifierSide, shown_.cols / 3, shown_.rows / 3});
  if (side < kMagnifierSide) cv::resize(large, large, {side, side}, 0, 0, cv::INTER_AREA);
  const bool is_in_the_way = in_view.x > shown_.cols - side - 60 && in_view.y < side + 60;
  const cv::Rect area(is_in_the_way ? 8 : shown_.cols - side - 8, 8, side, side);
  large.copyTo(shown_(area));
  cv::rectangle(shown_, area, kSelectedColor, 1);
}

void AnnotateSession::draw() {
  shown_.create(options_.canvas, CV_8UC3);
  shown_.setTo(kBackground);
  const cv::Mat& image = shown_image();
  if (!image.empty()) {
    if (image.size() != fitted_) {
      fitted_ = image.size();
      zoom_ = 1;
      center_ = {0.5 * (image.cols - 1), 0.5 * (image.rows - 1)};
    }
    const double s = scale();
    // If the view is smaller, k x k pixels are averaged first.
    const int k = std::clamp(static_cast<int>(1 / s), 1, std::min(image.cols, image.rows));
    if (k != reduced_by_ || image.data != reduced_from_.data) {
      reduced_from_ = image;
      reduced_by_ = k;
      const cv::Size size(image.cols / k, image.rows / k);
      if (k == 1) {
        reduced_ = image;
      } else {
        reduced_ = cv::Mat();
        cv::resize(image(cv::Rect({0, 0}, size * k)), reduced_, size, 0, 0, cv::INTER_AREA);
      }
    }
    const cv::Point2d center = to_view({0.5 * (k - 1), 0.5 * (k - 1)});  // of a reduced pixel
    const cv::Mat map =
        (cv::Mat_<double>(2, 3) << (mirrored_ ? -s : s) * k, 0, center.x, 0, s * k, center.y);
    cv::warpAffine(reduced_, shown_, map, shown_.size(),
                   s > 12 ? cv::INTER_NEAREST : cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
    if (state_.stage() != AnnotateStage::kPick && state_.images() > 0) draw_points();
    if (magnifier_ && !is_learning_ && state_.stage() != AnnotateStage::kPick) draw_magnifier();
  }
  image::draw::TextStyle title;
  title.height_px = 9;
  std::string name = state_.stage() == AnnotateStage::kPick ? frame_.name
                     : state_.images() > 0
                         ? std::filesystem::path(state_.image(current_).path).filename().string()
                         : std::string();
  if (mirrored_) name += " (mirrored)";
  if (!name.empty()) image::draw::put_text(shown_, name, {8, 8}, title);
  // The bar has its own background, without image content behind it.
  shown_(cv::Rect(0, shown_.rows - bar_, shown_.cols, bar_)).setTo(kBackground);
  image::draw::status_bar(shown_, instruction(), progress_text());
  if (!controls_.help() || !draws_status()) return;
  draw_help(shown_, "Annotation", actions(),
            {{"left mouse", "add, select, drag; shift: drag all points"},
             {"right mouse", "move the image; wheel: zoom"},
             {"arrows", "nudge the selected point; else previous, next"}});
}

View AnnotateSession::view() {
  draw();
  View result;
  result.image = shown_;
  result.status = instruction();
  result.finished = controls_.finished();
  int seen = 0;
  std::string path;
  bool agreed = false;
  nlohmann::json positions = nlohmann::json::array();
  if (state_.images() > 0) {
    const AnnotatedImage& here = state_.image(current_);
    for (int i = 0; i < state_.points(); ++i) {
      seen += here.is_shown(i) ? 1 : 0;
      positions.push_back(nullptr);
      if (here.is_shown(i) && i < positions_.cols() && !positions_.col(i).hasNaN())
        positions.back() = {std::round(positions_(0, i) * 100) / 100,
                            std::round(positions_(1, i) * 100) / 100};
    }
    path = here.path;
    agreed = here.done;
  }
  result.state = {{"stage", name_of(state_.stage())},
                  {"image", current_},
                  {"images", state_.images()},
                  {"done", state_.done()},
                  {"points", state_.points()},
                  {"shown", seen},
                  {"places", std::move(positions)},
                  {"selected", selected_},
                  {"agreed", agreed},
                  {"learning", is_learning_},
                  {"path", path},
                  {"zoom", zoom_},
                  {"view", {to_view({0, 0}).x, to_view({0, 0}).y, scale()}},
                  {"frame", frame_.index},
                  {"paused", paused_},
                  {"help", controls_.help()},
                  {"message", message_}};
  return result;
}

}  // namespace tarsier
