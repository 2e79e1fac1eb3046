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

namespace tarsier {
namespace {

const cv::Scalar kGround{38, 34, 30};
const cv::Scalar kAgreed{80, 220, 80};
const cv::Scalar kProposed{40, 180, 255};
const cv::Scalar kHidden{150, 150, 150};
const cv::Scalar kChosen{255, 255, 255};
const cv::Scalar kLine{220, 190, 60};
const cv::Scalar kLeft{60, 140, 255};
const cv::Scalar kRight{255, 190, 60};
const cv::Scalar kAxis{240, 240, 240};
const cv::Scalar kUnsaid{200, 60, 220};
constexpr double kNearPx = 14;         // of the view: maximum distance of a click from its point
constexpr double kRoomForNumber = 15;  // px, minimum distance to the next point
constexpr double kMargin = 6;          // px around a fully visible image
constexpr double kMaxZoom = 64;
constexpr int kMagnified = 176;       // px, side of the magnifier
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
  const cv::Point2d middle(0.5 * (options_.canvas.width - 1),
                           0.5 * (options_.canvas.height - bar_ - 1));
  const double x = s * (p.x - center_.x);
  return {middle.x + (mirrored_ ? -x : x), middle.y + s * (p.y - center_.y)};
}

cv::Point2d AnnotateSession::to_image(cv::Point2d v) const {
  const double s = scale();
  const cv::Point2d middle(0.5 * (options_.canvas.width - 1),
                           0.5 * (options_.canvas.height - bar_ - 1));
  const double x = (v.x - middle.x) / s;
  return {center_.x + (mirrored_ ? -x : x), center_.y + (v.y - middle.y) / s};
}

int AnnotateSession::point_near(cv::Point2d in_view) const {
  int best = -1;
  double nearest = kNearPx;
  for (int i = 0; i < static_cast<int>(places_.cols()); ++i) {
    if (places_.col(i).hasNaN()) continue;
    const double distance = cv::norm(to_view({places_(0, i), places_(1, i)}) - in_view);
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

std::string AnnotateSession::where() const {
  if (state_.stage() == AnnotateStage::kPick)
    return fmt::format("{:.1f} s, {} picked  ?: help", frame_.time, state_.images());
  if (state_.images() == 0) return "?: help";
  return fmt::format("image {}/{}, {} done  ?: help", current_ + 1, state_.images(), state_.done());
}

// Zooms to all points, with some margin.
void AnnotateSession::zoom_to_points() {
  cv::Point2d least(1e9, 1e9);
  cv::Point2d most(-1e9, -1e9);
  for (Eigen::Index i = 0; i < places_.cols(); ++i) {
    if (places_.col(i).hasNaN()) continue;
    least = {std::min(least.x, places_(0, i)), std::min(least.y, places_(1, i))};
    most = {std::max(most.x, places_(0, i)), std::max(most.y, places_(1, i))};
  }
  if (most.x < least.x || state_.stage() == AnnotateStage::kPick || image_.empty()) return;
  const double whole = scale() / zoom_;
  const double wanted = std::min(options_.canvas.width / (1.3 * (most.x - least.x) + 20),
                                 (options_.canvas.height - bar_) / (1.3 * (most.y - least.y) + 20));
  zoom_ = std::clamp(wanted / whole, 1.0, kMaxZoom);
  center_ = 0.5 * (least + most);
}

// The instruction, in one line.
std::string AnnotateSession::what_to_do() const {
  if (!message_.empty()) return message_;
  if (is_learning_)
    return state_.done() < 3 ? "Looking for the points..."
                             : fmt::format("Learning from {} images...", state_.done());
  if (!unreadable_.empty() && state_.stage() != AnnotateStage::kPick)
    return unreadable_ + " (n: the next)";
  switch (state_.stage()) {
    case AnnotateStage::kPick:
      if (is_video_over_)
        return state_.images() > 0 ? "The video is over. Enter: mark the points"
                                   : "The video is over, and no frame was picked";
      return paused_ ? "s: pick this frame. Arrows: step. Space: play. Enter: mark the points"
                     : "s: pick a frame. Space: pause. Enter: enough, mark the points";
    case AnnotateStage::kPoints:
      if (state_.points() == 0) return "Click the first point";
      return fmt::format("Click point {}, or drag one. d: delete. Enter: all are there",
                         state_.points());
    case AnnotateStage::kConnections:
      if (selected_ >= 0)
        return fmt::format("Point {} - click the point to draw its line to", selected_);
      return "Click two points to draw a line between them. Enter: go on";
    case AnnotateStage::kSymmetry: {
      if (selected_ >= 0)
        return fmt::format("Point {} - click its mirror image, or itself if it is in the middle",
                           selected_);
      const auto open = std::count(state_.mirror().begin(), state_.mirror().end(), -1);
      return open == 0
                 ? "All points have a mirror image. Enter: go on"
                 : fmt::format("Click two points that mirror each other; {} left. Enter: go on",
                               open);
    }
    case AnnotateStage::kImages: {
      if (state_.images() == 0 || state_.points() == 0)
        return "There are no points yet. 2: mark them on the first image";
      const AnnotatedImage& here = state_.image(current_);
      if (selected_ >= 0)
        return fmt::format("Point {}: drag it, arrows nudge it, h {} it", selected_,
                           here.is_shown(selected_) ? "hides" : "shows");
      if (!here.done) return "Drag what is wrong. Enter: all is right, next image";
      if (state_.done() == state_.images()) return "All images are done. q: end";
      return "Done. Enter: the next image that is not";
    }
  }
  return "";
}

void AnnotateSession::draw_points() {
  const AnnotatedImage& here = state_.image(current_);
  const bool is_symmetry = state_.stage() == AnnotateStage::kSymmetry;
  const auto count = static_cast<int>(places_.cols());
  const auto place = [&](int i) { return to_view({places_(0, i), places_(1, i)}); };
  const auto is_seen = [&](int i) {
    return i < count && here.is_shown(i) && !places_.col(i).hasNaN();
  };
  // Distance to the nearest point: dots and numbers need space.
  std::vector<double> room(static_cast<std::size_t>(count), 1e9);
  for (int i = 0; i < count && count <= 500; ++i) {
    for (int k = 0; k < i; ++k) {
      if (places_.col(i).hasNaN() || places_.col(k).hasNaN()) continue;
      const double distance = scale() * (places_.col(i) - places_.col(k)).norm();
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
      cv::line(shown_, fixed(place(line[0])), fixed(place(line[1])), kLine, 1, cv::LINE_AA, 4);
    }
  }
  if (is_symmetry) {
    for (int i = 0; i < count; ++i) {
      const int other = state_.mirror()[static_cast<std::size_t>(i)];
      if (other > i && is_seen(i) && is_seen(other))
        cv::line(shown_, fixed(place(i)), fixed(place(other)), kAxis, 1, cv::LINE_AA, 4);
    }
  }
  for (int i = 0; i < count; ++i) {
    if (places_.col(i).hasNaN()) continue;
    const cv::Point2d at = place(i);
    const double space = room[static_cast<std::size_t>(i)];
    const double radius = std::clamp(0.3 * space, 2.0, largest);
    if (at.x < -50 || at.y < -50 || at.x > shown_.cols + 50 || at.y > shown_.rows + 50) continue;
    cv::Scalar color = here.done ? kAgreed : kProposed;
    const int other = state_.mirror()[static_cast<std::size_t>(i)];
    if (is_symmetry) {
      color = other < 0 ? kUnsaid : other == i ? kAxis : other > i ? kLeft : kRight;
    }
    if (is_seen(i)) {
      image::draw::point(shown_, at, color, radius);
    } else {
      image::draw::cross(shown_, at, kHidden, radius * 1.6);
    }
    if (i == selected_)
      cv::circle(shown_, fixed(at), cvRound(radius * 2.2 * 16), kChosen, 2, cv::LINE_AA, 4);
    if (numbers_ && (i == selected_ || space >= kRoomForNumber)) {
      image::draw::TextStyle style;
      style.height_px = std::clamp(largest * 2.2, 7.0, 14.0);
      style.color = i == selected_ ? kChosen : is_seen(i) ? color : kHidden;
      image::draw::put_text(shown_, std::to_string(i),
                            {cvRound(at.x + radius + 1), cvRound(at.y - radius)}, style,
                            image::draw::Anchor::kBottomLeft);
    }
  }
}

// Enlarges the area below the pointer (or around the selected point while arrows move it).
void AnnotateSession::draw_magnifier() {
  const cv::Mat& image = shown_image();
  cv::Point2d middle = to_image(mouse_);
  cv::Point2d in_view = mouse_;
  if (drag_ == Drag::kPoint || (mouse_.x < 0 && selected_ >= 0)) {
    if (selected_ < 0 || places_.col(selected_).hasNaN()) return;
    middle = {places_(0, selected_), places_(1, selected_)};
    in_view = to_view(middle);
  }
  if (middle.x < 0 || middle.y < 0 || middle.x > image.cols - 1 || middle.y > image.rows - 1)
    return;
  const double times = std::max(6.0, kMagnification * scale());
  const double half = 0.5 * (kMagnified - 1);
  const double sign = mirrored_ ? -1 : 1;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << sign * times, 0, half - sign * times * middle.x, 0,
                       times, half - times * middle.y);
  cv::Mat large;
  cv::warpAffine(image, large, map, {kMagnified, kMagnified}, cv::INTER_LINEAR, cv::BORDER_CONSTANT,
                 kGround);
  for (int i = 0; i < static_cast<int>(places_.cols()); ++i) {
    if (state_.stage() == AnnotateStage::kPick || places_.col(i).hasNaN()) continue;
    const cv::Point2d at(half + sign * times * (places_(0, i) - middle.x),
                         half + times * (places_(1, i) - middle.y));
    if (at.x < 0 || at.y < 0 || at.x >= kMagnified || at.y >= kMagnified) continue;
    cv::circle(large, fixed(at), 3 * 16, i == selected_ ? kChosen : kProposed, 1, cv::LINE_AA, 4);
  }
  // A cross with a free centre.
  for (const double side : {-1.0, 1.0}) {
    for (const bool upright : {false, true}) {
      const cv::Point2d from(half + (upright ? 0 : side * 5), half + (upright ? side * 5 : 0));
      const cv::Point2d to(half + (upright ? 0 : side * 22), half + (upright ? side * 22 : 0));
      cv::line(large, fixed(from), fixed(to), {0, 0, 0}, 3, cv::LINE_AA, 4);
      cv::line(large, fixed(from), fixed(to), kChosen, 1, cv::LINE_AA, 4);
    }
  }
  const int side = std::min({kMagnified, shown_.cols / 3, shown_.rows / 3});
  if (side < kMagnified) cv::resize(large, large, {side, side}, 0, 0, cv::INTER_AREA);
  const bool is_in_the_way = in_view.x > shown_.cols - side - 60 && in_view.y < side + 60;
  const cv::Rect area(is_in_the_way ? 8 : shown_.cols - side - 8, 8, side, side);
  large.copyTo(shown_(area));
  cv::rectangle(shown_, area, kChosen, 1);
}

void AnnotateSession::draw() {
  shown_.create(options_.canvas, CV_8UC3);
  shown_.setTo(kGround);
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
    const cv::Point2d middle = to_view({0.5 * (k - 1), 0.5 * (k - 1)});  // of a reduced pixel
    const cv::Mat map =
        (cv::Mat_<double>(2, 3) << (mirrored_ ? -s : s) * k, 0, middle.x, 0, s * k, middle.y);
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
  shown_(cv::Rect(0, shown_.rows - bar_, shown_.cols, bar_)).setTo(kGround);
  image::draw::status_bar(shown_, what_to_do(), where());
  if (!controls_.help() || !draws_status()) return;
  draw_help(shown_, "Annotation", actions(),
            {{"left mouse", "add, choose, drag; shift: drag all points"},
             {"right mouse", "move the image; wheel: nearer, farther"},
             {"arrows", "nudge the chosen point; else previous, next"}});
}

View AnnotateSession::view() {
  draw();
  View result;
  result.image = shown_;
  result.status = what_to_do();
  result.finished = controls_.finished();
  int seen = 0;
  std::string path;
  bool agreed = false;
  nlohmann::json places = nlohmann::json::array();
  if (state_.images() > 0) {
    const AnnotatedImage& here = state_.image(current_);
    for (int i = 0; i < state_.points(); ++i) {
      seen += here.is_shown(i) ? 1 : 0;
      places.push_back(nullptr);
      if (here.is_shown(i) && i < places_.cols() && !places_.col(i).hasNaN())
        places.back() = {std::round(places_(0, i) * 100) / 100,
                         std::round(places_(1, i) * 100) / 100};
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
                  {"places", std::move(places)},
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
