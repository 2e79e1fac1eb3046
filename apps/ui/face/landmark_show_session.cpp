// SPDX-License-Identifier: MIT
#include "ui/face/landmark_show_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/mode_sliders.h"
#include "ui/overlay.h"
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace tarsier {
namespace {

constexpr int kMaxImageSide = 1000;  // px, larger images are reduced
constexpr int kMinImageSide = 600;   // px, smaller images are enlarged
constexpr int kAnimationSteps = 60;  // steps of a mode's animation
constexpr int kMaxSliders = 6;
const cv::Size kModelView(800, 560);

}  // namespace

LandmarkSetSession::LandmarkSetSession(face::shape::LandmarkSet set, std::string set_path,
                                       const face::shape::LandmarkStyle& style, bool mirrored)
    : set_(std::move(set)), set_path_(std::move(set_path)), style_(style), mirrored_(mirrored) {
  TARSIER_REQUIRE(!set_.samples.empty(), "a set without samples");
  set_.check();
  open();
}

void LandmarkSetSession::open() {
  read_error_.clear();
  try {
    image_ = read_image(
        face::shape::image_path(set_path_, set_.samples[static_cast<std::size_t>(current_)]));
  } catch (const InputError& error) {
    read_error_ = error.what();
    image_ = cv::Mat(480, 640, CV_8UC3, cv::Scalar(50, 45, 40));
  }
}

View LandmarkSetSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  const int count = static_cast<int>(set_.samples.size());
  if (name == "next" || name == "previous") {
    current_ = (current_ + (name == "next" ? 1 : count - 1)) % count;
    open();
  }
  if (name == "mirrored") mirrored_ = !mirrored_;
  if (name == "numbers") style_.numbers = !style_.numbers;
  if (name == "symmetry") style_.symmetry = !style_.symmetry;
  if (name == "lines") style_.connections = !style_.connections;
  controls_.act(name);
  return view();
}

std::vector<Action> LandmarkSetSession::actions() const {
  return controls_.append_to({{"next", "next image (right arrow, space)", 'n'},
                              {"previous", "previous image (left arrow)", 'p'},
                              {"mirrored", "mirror the image, as in training", 'm'},
                              {"numbers", "show point numbers", 'i'},
                              {"symmetry", "colour left and right differently", 'y'},
                              {"lines", "show lines", 'l'}});
}

View LandmarkSetSession::view() {
  face::shape::LandmarkSample sample = set_.samples[static_cast<std::size_t>(current_)];
  cv::Mat source = image_;
  if (mirrored_) {
    // Without a symmetry the points keep their indices.
    std::vector<int> same(static_cast<std::size_t>(sample.points.cols()));
    for (std::size_t i = 0; i < same.size(); ++i) same[i] = static_cast<int>(i);
    sample = face::shape::mirrored(sample, set_.mirror.empty() ? same : set_.mirror, image_.cols);
    cv::Mat turned;  // does not change image_
    cv::flip(image_, turned, 1);
    source = turned;
  }
  const int longest = std::max(source.cols, source.rows);
  const double scale = longest > kMaxImageSide   ? static_cast<double>(kMaxImageSide) / longest
                       : longest < kMinImageSide ? static_cast<double>(kMinImageSide) / longest
                                                 : 1;
  const cv::Size size(std::max(1, cvRound(source.cols * scale)),
                      std::max(1, cvRound(source.rows * scale)));
  cv::resize(source, shown_, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  if (read_error_.empty()) {
    const Eigen::Matrix2Xd points = ((sample.points.array() + 0.5) * scale - 0.5).matrix();
    face::shape::draw_landmarks(shown_, points, set_.connections, set_.mirror, style_);
  } else {
    image::draw::put_text(shown_, read_error_, {shown_.cols / 2, shown_.rows / 2}, {.height_px = 9},
                          image::draw::Anchor::kCenter);
  }
  int missing = 0;
  for (int i = 0; i < static_cast<int>(sample.points.cols()); ++i)
    missing += sample.is_missing(i) ? 1 : 0;
  View result;
  result.status = fmt::format("{}/{} {}{}{}", current_ + 1, set_.samples.size(), sample.image,
                              missing > 0 ? fmt::format(", {} missing", missing) : std::string(),
                              mirrored_ ? ", mirrored" : "");
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status, "h: help");
    if (controls_.help()) draw_help(shown_, "Landmarks", actions());
  }
  result.image = shown_;
  result.finished = controls_.finished();
  result.state = {
      {"image", current_},           {"images", set_.samples.size()}, {"path", sample.image},
      {"missing", missing},          {"mirrored", mirrored_},         {"numbers", style_.numbers},
      {"symmetry", style_.symmetry}, {"lines", style_.connections},   {"help", controls_.help()}};
  return result;
}

ShapeModelSession::ShapeModelSession(face::shape::ShapeModel model)
    : model_(std::move(model)), sigmas_(Eigen::VectorXd::Zero(model_.mode_count())) {
  model_.check();
  animated_ = model_.mode_count() > 0;
}

View ShapeModelSession::on_idle(const SourceStatus&) {
  if (animated_ && model_.mode_count() > 0) {
    phase_ = (phase_ + 1) % kAnimationSteps;
    if (phase_ == 0) mode_ = (mode_ + 1) % std::min(model_.mode_count(), kMaxSliders);
    sigmas_.setZero();
    sigmas_[mode_] = kMaxSigmas * std::sin(2 * std::numbers::pi * phase_ / kAnimationSteps);
  }
  return view();
}

View ShapeModelSession::on_event(const Event& event) {
  if (event.kind == Event::Kind::kSlider) {
    for (int k = 0; k < std::min(model_.mode_count(), kMaxSliders); ++k) {
      if (event.name != fmt::format("mode {}", k + 1)) continue;
      if (animated_) sigmas_.setZero();
      animated_ = false;
      mode_ = k;
      sigmas_[k] = std::clamp(event.value, -kMaxSigmas, kMaxSigmas);
    }
    return view();
  }
  const std::string name = action_of(event, actions());
  const int count = model_.mode_count();
  if ((name == "next" || name == "previous") && count > 0) {
    mode_ = (mode_ + (name == "next" ? 1 : count - 1)) % count;
    phase_ = 0;
    sigmas_.setZero();
  }
  if ((name == "more" || name == "less") && count > 0) {
    animated_ = false;
    sigmas_[mode_] =
        std::clamp(sigmas_[mode_] + (name == "more" ? 0.25 : -0.25), -kMaxSigmas, kMaxSigmas);
  }
  if (name == "mean") {
    animated_ = false;
    sigmas_.setZero();
  }
  if (name == "animate" && count > 0) animated_ = !animated_;
  controls_.act(name);
  return view();
}

std::vector<Action> ShapeModelSession::actions() const {
  return controls_.append_to({{"next", "next mode (right arrow)", 'n'},
                              {"previous", "previous mode (left arrow)", 'p'},
                              {"more", "add 1/4 standard deviation", '+'},
                              {"less", "subtract 1/4 standard deviation", '-'},
                              {"mean", "show the mean", '0'},
                              {"animate", "animate the mode", key::kSpace}});
}

std::vector<Slider> ShapeModelSession::sliders() const {
  std::vector<Slider> result;
  for (int k = 0; k < std::min(model_.mode_count(), kMaxSliders); ++k)
    result.push_back({fmt::format("mode {}", k + 1), -kMaxSigmas, kMaxSigmas, 0.25, sigmas_[k]});
  return result;
}

View ShapeModelSession::view() {
  const Eigen::VectorXd b = sigmas_.cwiseProduct(model_.deviation);
  const std::string title = model_.mode_count() == 0
                                ? std::string("no modes")
                                : fmt::format("mode {} of {}: {:+.2f} standard deviations",
                                              mode_ + 1, model_.mode_count(), sigmas_[mode_]);
  // The drawing has a bar at its bottom; the status is drawn below it.
  const cv::Mat drawing = face::shape::draw_shape(model_, b, kModelView, title);
  const int room = draws_status() ? kStatusHeight : 0;
  shown_.create(kModelView.height + room, kModelView.width, CV_8UC3);
  shown_.setTo(cv::Scalar(38, 34, 30));
  drawing.copyTo(shown_(cv::Rect({0, 0}, kModelView)));
  View result;
  result.status =
      fmt::format("{} points, {} modes, {:.1f} % of the variance, {} shapes", model_.points(),
                  model_.mode_count(), 100 * model_.variance_kept, model_.trained_on);
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status, "h: help");
    if (controls_.help()) draw_help(shown_, "Shape model", actions());
  }
  result.image = shown_;
  result.finished = controls_.finished();
  result.state = {{"mode", mode_},
                  {"modes", model_.mode_count()},
                  {"values", std::vector<double>(sigmas_.data(), sigmas_.data() + sigmas_.size())},
                  {"animated", animated_},
                  {"help", controls_.help()}};
  return result;
}

}  // namespace tarsier
