// SPDX-License-Identifier: MIT
#include "ui/face/annotate_session.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier {
namespace {

constexpr double kImageZoom = 1.25;                // per key press or notch
constexpr std::size_t kRecentBytes = 150'000'000;  // bytes of frames kept for stepping back
constexpr double kSkip = 1.0;                      // s, for the up arrow
constexpr double kMinNudge = 0.25;                 // px of the image

}  // namespace

void AnnotateOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!set_path.empty(), "the set's file has no name");
}

AnnotateSession::AnnotateSession(const AnnotateOptions& options, PointProposer propose)
    : options_(options), propose_(std::move(propose)), journal_(options.set_path + ".journal") {
  options_.check();
  is_proposing_ = propose_ != nullptr;
  cv::Mat scratch(options_.canvas, CV_8UC3, cv::Scalar(0, 0, 0));
  bar_ = image::draw::status_bar(scratch, "?").height;
  load();
}

bool AnnotateSession::wants_frame() const {
  if (state_.stage() != AnnotateStage::kPick || is_video_over_ || controls_.finished())
    return false;
  return !paused_ || steps_ > 0 || skip_to_ >= 0 || frame_.image.empty();
}

View AnnotateSession::on_frame(const Frame& frame, const SourceStatus&) {
  if (state_.stage() != AnnotateStage::kPick) return view();
  if (paused_ && steps_ == 0 && skip_to_ < 0 && !frame_.image.empty())
    return view();  // the host continues by itself
  frame_ = frame;
  frame_.image = frame.image.clone();
  recent_.push_back(frame_);
  steps_back_ = 0;
  const std::size_t bytes = std::max<std::size_t>(1, frame_.image.total() * 3);
  while (recent_.size() > std::max<std::size_t>(2, kRecentBytes / bytes)) recent_.pop_front();
  if (steps_ > 0) --steps_;
  if (skip_to_ >= 0 && frame.time >= skip_to_) skip_to_ = -1;
  return view();
}

View AnnotateSession::on_idle(const SourceStatus&) {
  if (is_learning_) propose_now();
  return view();
}

void AnnotateSession::video_ended() {
  is_video_over_ = true;
  steps_ = 0;
  skip_to_ = -1;
}

void AnnotateSession::step_back() {
  if (steps_back_ + 1 >= recent_.size()) {
    message_ = "No earlier frame is kept";
    return;
  }
  ++steps_back_;
  frame_ = recent_[recent_.size() - 1 - steps_back_];
}

View AnnotateSession::on_event(const Event& event) {
  const bool is_move = event.kind == Event::Kind::kMouse && event.mouse == Event::Mouse::kMove;
  if (!is_move) message_.clear();
  if (is_learning_ && !is_move) propose_now();
  if (event.kind == Event::Kind::kMouse) {
    on_mouse(event);
    return view();
  }
  std::string name = event.kind == Event::Kind::kAction ? event.name : std::string();
  if (event.kind == Event::Kind::kKey) {
    const int pressed = event.key;
    const double step = std::clamp(1 / scale(), kMinNudge, 1.0) * (event.shift ? 4 : 1);
    const bool is_picking = state_.stage() == AnnotateStage::kPick;
    const bool is_chosen = selected_ >= 0 && !is_picking;
    if (event.control) {
      name = pressed == 'z' || pressed == 'Z' ? (event.shift ? "redo" : "undo")
             : pressed == 'y'                 ? "redo"
                                              : "";
    } else if (pressed == key::kEscape) {
      name = "quit";
    } else if (pressed == key::kDelete || pressed == key::kBackspace) {
      name = "delete";
    } else if (pressed == '=') {
      name = "nearer";
    } else if (pressed == key::kTab) {
      // Select the next point, so that the hands can stay on the keyboard.
      if (state_.points() > 0) selected_ = (selected_ + 1) % state_.points();
    } else if (is_chosen && (pressed == key::kLeft || pressed == key::kRight)) {
      nudge(pressed == key::kLeft ? -step : step, 0);
    } else if (is_chosen && (pressed == key::kUp || pressed == key::kDown)) {
      nudge(0, pressed == key::kUp ? -step : step);
    } else if (is_picking && pressed == key::kLeft) {
      paused_ = true;
      step_back();
    } else if (is_picking && pressed == key::kRight) {
      paused_ = true;
      if (steps_back_ > 0) {
        --steps_back_;
        frame_ = recent_[recent_.size() - 1 - steps_back_];
      } else {
        ++steps_;
      }
    } else if (is_picking && pressed == key::kUp) {
      skip_to_ = frame_.time + kSkip;
    } else if (pressed == key::kLeft || pressed == key::kRight) {
      name = pressed == key::kLeft ? "previous" : "next";
    } else {
      for (const Action& action : actions())
        if (action.key == pressed) name = action.name;
    }
  }
  act_on_view(name);
  act(name);
  return view();
}

void AnnotateSession::act_on_view(const std::string& name) {
  const cv::Point2d center(0.5 * options_.canvas.width, 0.5 * options_.canvas.height);
  // Zoom towards the point that is being edited.
  cv::Point2d around = mouse_.x >= 0 ? mouse_ : center;
  if (selected_ >= 0 && selected_ < positions_.cols() && !positions_.col(selected_).hasNaN())
    around = to_view({positions_(0, selected_), positions_(1, selected_)});
  controls_.act(name);
  if (name == "numbers") numbers_ = !numbers_;
  if (name == "lines") lines_ = !lines_;
  if (name == "mirror") mirrored_ = !mirrored_;
  if (name == "magnifier") magnifier_ = !magnifier_;
  if (name == "nearer") zoom(kImageZoom, around);
  if (name == "farther") zoom(1 / kImageZoom, around);
  if (name == "whole") zoom(0, center);
  if (name == "fit") zoom_to_points();
  if (name == "pause" && state_.stage() == AnnotateStage::kPick) paused_ = !paused_;
}

std::vector<Action> AnnotateSession::actions() const {
  return {{"pick", "pick this frame of the video", 's'},
          {"pause", "pause or play the video", key::kSpace},
          {"go-on", "confirm and continue", key::kEnter},
          {"next", "next image", 'n'},
          {"previous", "previous image", 'p'},
          {"undo", "undo (or Ctrl-Z)", 'u'},
          {"redo", "redo (or Ctrl-Y)", 'r'},
          {"delete", "delete the point (in later images: hide it)", 'd'},
          {"hide", "hide or show the point in this image", 'h'},
          {"propose", "propose the points again", 'a'},
          {"larger", "enlarge all points", ']'},
          {"smaller", "shrink all points", '['},
          {"turn-left", "rotate all points to the left", '<'},
          {"turn-right", "rotate all points to the right", '>'},
          {"numbers", "show point numbers", 'i'},
          {"lines", "show lines", 'l'},
          {"mirror", "mirror the view", 'm'},
          {"magnifier", "show the magnifier", 'g'},
          {"nearer", "zoom in", '+'},
          {"farther", "zoom out", '-'},
          {"whole", "show the whole image", '0'},
          {"fit", "zoom to the points", 'f'},
          {"stage-pick", "pick frames", '1'},
          {"stage-points", "mark points on the first image", '2'},
          {"stage-connections", "draw lines between points", '3'},
          {"stage-symmetry", "pair mirrored points", '4'},
          {"stage-images", "annotate all images", '5'},
          {"help", "show this list", '?'},
          {"quit", "quit", 'q'}};
}

void AnnotateSession::on_mouse(const Event& event) {
  const cv::Point2d position(event.x, event.y);
  mouse_ = position;
  switch (event.mouse) {
    case Event::Mouse::kMove:
      on_move(position);
      break;
    case Event::Mouse::kLeftDown:
    case Event::Mouse::kDouble:  // some toolkits report the second click only like this
      on_left_down(position, event.shift);
      break;
    case Event::Mouse::kLeftUp:
      on_move(position);
      on_left_up();
      break;
    case Event::Mouse::kRightDown:
    case Event::Mouse::kMiddleDown:
      drag_ = Drag::kPan;
      drag_origin_ = position;
      center_at_drag_ = center_;
      break;
    case Event::Mouse::kRightUp:
    case Event::Mouse::kMiddleUp:
      if (drag_ == Drag::kPan) drag_ = Drag::kNone;
      break;
    case Event::Mouse::kWheel:
      zoom(std::pow(kImageZoom, std::clamp(event.wheel, -20, 20)), position);
      break;
  }
}

void AnnotateSession::on_move(cv::Point2d in_view) {
  if (drag_ == Drag::kNone) return;
  if (drag_ == Drag::kPan) {
    cv::Point2d by = (in_view - drag_origin_) / scale();
    if (mirrored_) by.x = -by.x;
    center_ = center_at_drag_ - by;
    const cv::Mat& image = shown_image();
    center_.x = std::clamp(center_.x, 0.0, std::max(0.0, image.cols - 1.0));
    center_.y = std::clamp(center_.y, 0.0, std::max(0.0, image.rows - 1.0));
    return;
  }
  if (positions_.cols() != drag_start_.cols()) return;
  const cv::Point2d by = to_image(in_view) - drag_origin_;
  const Eigen::Vector2d step(by.x, by.y);
  if (drag_ == Drag::kAll) {
    positions_ = drag_start_.colwise() + step;
    return;
  }
  if (selected_ < 0) return;
  // A click with a small movement is not a drag.
  if (cv::norm(by) * scale() < 1.5 && positions_.col(selected_) == drag_start_.col(selected_))
    return;
  Eigen::Vector2d position = drag_start_.col(selected_) + step;
  position.x() = std::clamp(position.x(), 0.0, std::max(0.0, image_.cols - 1.0));
  position.y() = std::clamp(position.y(), 0.0, std::max(0.0, image_.rows - 1.0));
  positions_.col(selected_) = position;
}

}  // namespace tarsier
