// SPDX-License-Identifier: MIT
#include "ui/sfm/sfm_session.h"

#include "tarsier/image/draw/text.h"
#include "tarsier/sfm/view/render.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kPointColor{60, 210, 60};
const cv::Scalar kPointRimColor{0, 40, 0};
const cv::Scalar kTextColor{70, 60, 50};
constexpr double kMaxWidth = 1680;  // px, of both panels together
constexpr double kTurnDeg = 10;     // per press of an arrow key
constexpr double kDragDeg = 0.35;   // per pixel
constexpr double kModelZoom = 1.2;  // per key press or notch

// Height of both panels: the frame's own if it fits; even, because videos need it.
int panel_height(cv::Size frame) {
  const double aspect = static_cast<double>(frame.width) / frame.height;
  const double max_height = std::min(720.0, kMaxWidth / (aspect + 4.0 / 3));
  return std::max(2, static_cast<int>(std::clamp(static_cast<double>(frame.height), 240.0,
                                                 std::max(max_height, 120.0))) /
                         2 * 2);
}

// The text in lines of at most this width.
std::string in_lines(const std::string& text, int width, double height_px) {
  std::string lines;
  std::string line;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (!line.empty() && image::draw::text_size(line + " " + word, height_px).width > width) {
      lines += line + "\n";
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
  }
  return lines + line;
}

}  // namespace

SfmSession::SfmSession(sfm::OnlineReconstructor& online, std::stop_token stop, DebugSink* debug)
    : FrameSession("Structure from motion"),
      online_(online),
      stop_(std::move(stop)),
      debug_(debug) {}

void SfmSession::process(const Frame& frame) {
  update(online_.process(frame, stop_, watched(debug_)));
  image_ = online_.image();
}

bool SfmSession::act(const std::string& name) {
  if (name == "left") {
    rotate(-kTurnDeg, 0);
  } else if (name == "right") {
    rotate(kTurnDeg, 0);
  } else if (name == "up") {
    rotate(0, kTurnDeg);
  } else if (name == "down") {
    rotate(0, -kTurnDeg);
  } else if (name == "nearer") {
    zoom(kModelZoom);
  } else if (name == "farther") {
    zoom(1 / kModelZoom);
  } else if (name == "reset") {
    yaw_ = 0;
    pitch_ = 15;
    zoom_ = 1;
    cloud_is_stale_ = true;
  } else if (name == "adjust") {
    if (!image_.empty()) update(online_.refine(stop_));
  } else {
    return false;
  }
  return true;
}

bool SfmSession::mouse(const Event& event) {
  const cv::Point2d position(event.x, event.y);
  switch (event.mouse) {
    case Event::Mouse::kLeftDown:
      drag_ = position;
      return false;
    case Event::Mouse::kLeftUp:
    case Event::Mouse::kDouble:
      drag_.reset();
      return false;
    case Event::Mouse::kMove:
      if (!drag_) return false;
      rotate(-kDragDeg * (position.x - drag_->x), kDragDeg * (position.y - drag_->y));
      drag_ = position;
      return true;
    case Event::Mouse::kWheel:
      zoom(std::pow(kModelZoom, event.wheel));
      return true;
    default:
      return false;
  }
}

std::vector<Action> SfmSession::own_actions() const {
  return {{"left", "rotate left", key::kLeft},
          {"right", "rotate right", key::kRight},
          {"up", "raise the viewpoint", key::kUp},
          {"down", "lower the viewpoint", key::kDown},
          {"nearer", "zoom in", '+'},
          {"farther", "zoom out", '-'},
          {"reset", "reset the view", '0'},
          {"adjust", "refine the whole model", 'r'}};
}

std::vector<image::draw::HelpLine> SfmSession::help_lines() const {
  return {{"arrows", "rotate the points, like dragging the mouse"}};
}

View SfmSession::finish() {
  update(online_.finish(stop_));
  return redraw();
}

void SfmSession::update(sfm::OnlineResult result) {
  result_ = std::move(result);
  cloud_is_stale_ = cloud_is_stale_ || result_.model_changed;
}

void SfmSession::rotate(double yaw, double pitch) {
  yaw_ = std::remainder(yaw_ + yaw, 360);
  pitch_ = std::clamp(pitch_ + pitch, -89.0, 89.0);
  cloud_is_stale_ = true;
}

void SfmSession::zoom(double factor) {
  zoom_ = std::clamp(zoom_ * factor, 0.1, 20.0);
  cloud_is_stale_ = true;
}

std::string SfmSession::counts() const {
  return fmt::format("{} key frame{}, {} in the model, {} points", result_.key_frames,
                     result_.key_frames == 1 ? "" : "s", result_.registered, result_.points);
}

std::string SfmSession::why_no_model() const {
  return "no model yet: " +
         (result_.no_model.empty() ? "move the camera sideways" : result_.no_model);
}

nlohmann::json SfmSession::state() const { return sfm::to_json(result_); }

std::string SfmSession::status() const {
  return fmt::format("{}, {:.0f} ms", counts(), result_.growth_ms);
}

void SfmSession::draw(cv::Mat& image) {
  const int height = panel_height(image_.size());
  const double scale = static_cast<double>(height) / image_.rows;
  const int left = std::max(2, cvRound(image_.cols * scale) / 2 * 2);
  const int right = height * 4 / 3 / 2 * 2;
  image.create(height, left + right, CV_8UC3);
  cv::Mat frame_panel = image(cv::Rect(0, 0, left, height));
  cv::resize(image_, frame_panel, frame_panel.size(), 0, 0,
             scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const int radius = std::max(2, height / 200);
  for (const cv::Point2f& tracked : result_.tracked) {
    const cv::Point2d p = cv::Point2d(tracked) * scale;
    const cv::Point position(cvRound(p.x * 16), cvRound(p.y * 16));
    cv::circle(frame_panel, position, (radius + 1) * 16, kPointRimColor, cv::FILLED, cv::LINE_AA,
               4);
    cv::circle(frame_panel, position, radius * 16, kPointColor, cv::FILLED, cv::LINE_AA, 4);
  }

  const sfm::Model& model = online_.model();
  const cv::Size size(right, height);
  if (cloud_is_stale_ || cloud_.size() != size) {
    sfm::ViewOptions view;
    view.size = size;
    view.yaw_deg = yaw_;
    view.pitch_deg = pitch_;
    if (zoom_ != 1 && !model.points.empty())
      view.distance = sfm::viewpoint_of(model, view).distance / zoom_;
    cloud_ = sfm::render_model(model, view);
    cloud_is_stale_ = false;
  }
  cv::Mat panel = image(cv::Rect(left, 0, right, height));
  cloud_.copyTo(panel);
  image::draw::TextStyle style;
  style.height_px = std::max(8.0, height / 45.0);
  style.color = kTextColor;
  style.backing = image::draw::Backing::kOutline;
  style.backing_color = cv::Scalar(250, 248, 246);
  image::draw::put_text(panel, counts(), {8, 8}, style);
  if (model.images.empty()) {
    image::draw::put_text(panel, in_lines(why_no_model(), right - 16, style.height_px),
                          {right / 2, height / 2}, style, image::draw::Anchor::kCenter);
  }
}

}  // namespace tarsier
