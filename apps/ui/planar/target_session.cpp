// SPDX-License-Identifier: MIT
#include "ui/planar/target_session.h"

#include "tarsier/core/name_table.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

constexpr int kMinSide = 48;  // px of a rectangle for training
constexpr int kShift = 4;     // fractional bits of drawn coordinates

const std::array<cv::Scalar, 6> kColors = {cv::Scalar{90, 220, 90},  cv::Scalar{60, 180, 255},
                                           cv::Scalar{255, 170, 60}, cv::Scalar{200, 110, 255},
                                           cv::Scalar{80, 230, 230}, cv::Scalar{235, 130, 130}};

constexpr NameTable<TargetOverlay, 4> kTargetOverlays{"overlay",
                                                      {{{TargetOverlay::kOutline, "outline"},
                                                        {TargetOverlay::kAxes, "axes"},
                                                        {TargetOverlay::kBox, "box"},
                                                        {TargetOverlay::kNone, "none"}}}};

std::string_view name_of(TargetOverlay overlay) { return kTargetOverlays.name(overlay); }

void line(cv::Mat& image, const cv::Point2d& a, const cv::Point2d& b, const cv::Scalar& color,
          int width) {
  // Points far outside would overflow the fixed-point coordinates.
  const auto inside = [&](const cv::Point2d& p) {
    return std::abs(p.x) < 20'000 && std::abs(p.y) < 20'000;
  };
  if (!inside(a) || !inside(b)) return;
  const auto fixed = [](const cv::Point2d& p) {
    return cv::Point(cvRound(p.x * (1 << kShift)), cvRound(p.y * (1 << kShift)));
  };
  cv::line(image, fixed(a), fixed(b), color, width, cv::LINE_AA, kShift);
}

}  // namespace

void TargetSessionOptions::check() const { train.check(); }

TargetSession::TargetSession(planar::TargetTracker tracker, TargetSessionOptions options)
    : FrameSession("Image targets"),
      tracker_(std::move(tracker)),
      initial_target_count_(tracker_.targets().size()),
      options_(std::move(options)) {
  options_.check();
}

void TargetSession::process(const Frame& frame) {
  result_ = tracker_.process(frame, state_, watched(options_.debug));
}

void TargetSession::change(std::vector<planar::image_targets::Target> targets) {
  tracker_ = planar::TargetTracker(std::move(targets), tracker_.options());
  redetect(state_);
}

bool TargetSession::act(const std::string& name) {
  if (name == "redetect") redetect(state_);
  const cv::Size size = frame().size();
  if (name == "train" && !size.empty())
    return train({size.width / 4, size.height / 4, size.width / 2, size.height / 2});
  if (name == "forget") {
    std::vector<planar::image_targets::Target> targets = tracker_.targets();
    message_ = fmt::format("targets deleted: {}", targets.size() - initial_target_count_);
    targets.resize(initial_target_count_);
    change(std::move(targets));
    std::erase_if(result_.tracked,
                  [&](const auto& seen) { return seen.target >= initial_target_count_; });
    return true;
  }
  if (name != "overlay") return false;
  options_.overlay = static_cast<TargetOverlay>((static_cast<int>(options_.overlay) + 1) % 4);
  return true;
}

bool TargetSession::mouse(const Event& event) {
  mouse_ = {cvRound(event.x), cvRound(event.y)};
  if (event.mouse == Event::Mouse::kLeftDown) drag_ = mouse_;
  if (event.mouse == Event::Mouse::kRightDown) drag_.reset();
  if (event.mouse != Event::Mouse::kLeftUp || !drag_) return false;
  const cv::Rect box(*drag_, mouse_);
  drag_.reset();
  return box.width >= 4 && box.height >= 4 && train(box);
}

bool TargetSession::train(cv::Rect box) {
  box &= cv::Rect(0, 0, frame().cols, frame().rows);
  if (std::min(box.width, box.height) < kMinSide ||
      std::min(box.width, box.height) * 8 < std::max(box.width, box.height)) {
    message_ = fmt::format("drag a box of at least {0} x {0} px, not a thin strip", kMinSide);
    return false;
  }
  const std::string name =
      fmt::format("image {}", tracker_.targets().size() - initial_target_count_ + 1);
  planar::image_targets::Target trained =
      planar::image_targets::train_target(frame()(box), name, options_.train);
  const planar::image_targets::Quality& quality = trained.quality;
  if (quality.rating < 0.15) {
    message_ =
        "not trained: " + (quality.reasons.empty() ? "unsuitable image" : quality.reasons[0]);
    return false;
  }
  message_ = fmt::format("{} trained, rating {:.2f}", name, quality.rating);
  std::vector<planar::image_targets::Target> targets = tracker_.targets();
  targets.push_back(std::move(trained));
  change(std::move(targets));
  process(latest());
  return true;
}

std::vector<Action> TargetSession::own_actions() const {
  return {{"train", "train the centre of the image (or drag a box with the mouse)", 't'},
          {"redetect", "detect all targets again", 'd'},
          {"forget", "delete the targets trained here", 'c'},
          {"overlay", "choose the overlay", 'v'}};
}

void TargetSession::draw_target(cv::Mat& image,
                                const planar::image_targets::TrackedTarget& seen) const {
  const planar::image_targets::Target& target = result_.target_of(seen);
  const cv::Scalar& color = kColors[seen.target % kColors.size()];
  const int width = std::max(2, cvRound(std::min(image.cols, image.rows) / 240.0));
  for (std::size_t i = 0; i < 4; ++i)
    line(image, seen.corners[i], seen.corners[(i + 1) % 4], color, width);
  image::draw::point(image, seen.corners[0], color, width + 2.0);
  const bool in_space = seen.pose && result_.camera && options_.overlay != TargetOverlay::kOutline;
  if (in_space) {
    const geometry::Rigid3& pose = seen.pose->camera_from_plane;
    const auto edge = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const cv::Scalar& c) {
      const auto p = result_.camera->project(pose * a);
      const auto q = result_.camera->project(pose * b);
      if (p && q) line(image, *p, *q, c, width);
    };
    const double size = 0.5 * std::min(target.width, target.height);
    if (options_.overlay == TargetOverlay::kAxes) {
      edge({0, 0, 0}, {size, 0, 0}, cv::Scalar(60, 60, 240));
      edge({0, 0, 0}, {0, size, 0}, cv::Scalar(60, 200, 60));
      edge({0, 0, 0}, {0, 0, size}, cv::Scalar(240, 120, 40));
    } else {
      const double x = target.width / 2;
      const double y = target.height / 2;
      const double corner[4][2] = {{-x, y}, {x, y}, {x, -y}, {-x, -y}};
      for (int i = 0; i < 4; ++i) {
        const double* a = corner[i];
        const double* b = corner[(i + 1) % 4];
        edge({a[0], a[1], 0}, {a[0], a[1], size}, color);
        edge({a[0], a[1], size}, {b[0], b[1], size}, color);
      }
    }
  }
  image::draw::TextStyle style;
  style.height_px = std::clamp(image.rows * 0.022, 8.0, 24.0);
  style.color = color;
  style.backing = image::draw::Backing::kBox;
  const cv::Point at(std::clamp(cvRound(seen.corners[0].x), 0, image.cols - 1),
                     std::clamp(cvRound(seen.corners[0].y) - width - 4, 20, image.rows - 1));
  image::draw::put_text(image, target.name.substr(0, 40), at, style,
                        image::draw::Anchor::kBottomLeft);
}

void TargetSession::draw(cv::Mat& image) {
  if (options_.overlay == TargetOverlay::kNone) return;
  for (const planar::image_targets::TrackedTarget& s : result_.tracked) draw_target(image, s);
}

void TargetSession::draw_shown(cv::Mat& image) {
  if (!drag_) return;
  cv::rectangle(image, cv::Rect(*drag_, mouse_) & cv::Rect(0, 0, image.cols, image.rows),
                cv::Scalar(60, 200, 255), 2);
}

nlohmann::json TargetSession::state() const {
  auto list = nlohmann::json::array();
  for (const planar::image_targets::TrackedTarget& s : result_.tracked) {
    auto corners = nlohmann::json::array();
    for (const cv::Point2d& c : s.corners)
      corners.push_back({std::round(c.x * 10) / 10, std::round(c.y * 10) / 10});
    list.push_back({{"id", s.target}, {"name", result_.target_of(s).name}, {"corners", corners}});
  }
  return {{"targets", list},
          {"trained", tracker_.targets().size() - initial_target_count_},
          {"message", message_},
          {"draw", name_of(options_.overlay)}};
}

std::string TargetSession::status() const {
  return fmt::format("{} of {} images{}", result_.tracked.size(), tracker_.targets().size(),
                     message_.empty() ? "" : ": " + message_);
}

}  // namespace tarsier
