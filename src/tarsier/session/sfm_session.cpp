// SPDX-License-Identifier: MIT
#include "tarsier/session/sfm_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/session/overlay.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kGreen{60, 210, 60};
const cv::Scalar kRim{0, 40, 0};
const cv::Scalar kInk{70, 60, 50};
constexpr int kLongestSide = 960;    // px, of the pictures in which points are followed
constexpr std::size_t kRecent = 12;  // key frames from which points can be followed
constexpr std::size_t kMaxFollowed = 400;
constexpr double kBackPx = 1.0;    // off after following there and back: lost
constexpr double kWidest = 1680;   // px, of both panels
constexpr double kTurnDeg = 10;    // of an arrow key
constexpr double kDragDeg = 0.35;  // of a pixel
constexpr double kZoom = 1.2;      // of a key or a notch

std::size_t at(int i) { return static_cast<std::size_t>(i); }

double reduction(cv::Size size) {
  return std::min(1.0, static_cast<double>(kLongestSide) / std::max(size.width, size.height));
}

cv::Mat reduced_gray(const cv::Mat& image) {
  cv::Mat gray;
  if (image.channels() == 1) {
    gray = image.clone();
  } else {
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  }
  const double scale = reduction(image.size());
  if (scale < 1) cv::resize(gray, gray, {}, scale, scale, cv::INTER_AREA);
  return gray;
}

// Height of both panels: the frame's own where there is room; even, as videos need it.
int panel_height(cv::Size frame) {
  const double aspect = static_cast<double>(frame.width) / frame.height;
  const double most = std::min(720.0, kWidest / (aspect + 4.0 / 3));
  return std::max(2, static_cast<int>(std::clamp(static_cast<double>(frame.height), 240.0,
                                                 std::max(most, 120.0))) /
                         2 * 2);
}

}  // namespace

void SfmSessionOptions::check() const {
  keyframes.check();
  TARSIER_REQUIRE(every >= 1 && every <= 1000, "{} key frames", every);
}

SfmSession::SfmSession(sfm::OnlineMapper& mapper, Keep keep, const SfmSessionOptions& options,
                       const std::stop_token& stop)
    : mapper_(mapper),
      keep_(std::move(keep)),
      options_(options),
      stop_(stop),
      picker_(options.keyframes) {
  options_.check();
  TARSIER_REQUIRE(keep_ != nullptr, "key frames must be kept");
}

View SfmSession::on_frame(const Frame& frame, const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  if (paused_) return view(false);  // a camera goes on while nobody looks
  latest_ = frame;
  gray_ = reduced_gray(frame.image);
  if (options_.every_frame) {
    take({frame.image, frame.index, frame.time, 0, 0}, frame);
  } else if (const auto key_frame = picker_.offer(frame.image, frame.index, frame.time)) {
    take(*key_frame, frame);
  }
  follow();
  draw();
  return view(true);
}

View SfmSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  return view(false);
}

View SfmSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  if (name == "left") turn(-kTurnDeg, 0);
  if (name == "right") turn(kTurnDeg, 0);
  if (name == "up") turn(0, kTurnDeg);
  if (name == "down") turn(0, -kTurnDeg);
  if (name == "nearer") zoom(kZoom);
  if (name == "farther") zoom(1 / kZoom);
  if (name == "reset") {
    yaw_ = 0;
    pitch_ = 15;
    zoom_ = 1;
    cloud_is_old_ = true;
  }
  if (name == "adjust" && !latest_.image.empty()) {
    grow(true);
    follow();
  }
  if (event.kind == Event::Kind::kMouse) {
    const cv::Point2d where(event.x, event.y);
    switch (event.mouse) {
      case Event::Mouse::kLeftDown:
        drag_ = where;
        break;
      case Event::Mouse::kLeftUp:
        drag_.reset();
        break;
      case Event::Mouse::kMove:
        if (drag_) {
          turn(-kDragDeg * (where.x - drag_->x), kDragDeg * (where.y - drag_->y));
          drag_ = where;
        }
        break;
      case Event::Mouse::kWheel:
        zoom(std::pow(kZoom, event.wheel));
        break;
      case Event::Mouse::kDouble:
        drag_.reset();
        break;
      default:
        break;
    }
  }
  if (!latest_.image.empty()) draw();
  return view(false);
}

std::vector<Action> SfmSession::actions() const {
  return {{"pause", "pause and go on", key::kSpace},
          {"left", "turn left", key::kLeft},
          {"right", "turn right", key::kRight},
          {"up", "look from higher", key::kUp},
          {"down", "look from lower", key::kDown},
          {"nearer", "nearer", '+'},
          {"farther", "farther", '-'},
          {"reset", "the first view", '0'},
          {"adjust", "adjust all of the model", 'r'},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

View SfmSession::finish() {
  if (!options_.every_frame && !latest_.image.empty()) {
    if (const auto key_frame = picker_.finish()) take(*key_frame, latest_);
  }
  if (waiting_ > 0) grow(false);
  if (!latest_.image.empty()) {
    follow();
    draw();
  }
  return view(!latest_.image.empty());
}

void SfmSession::take(const sfm::Keyframe& key_frame, const Frame& latest) {
  inputs_.push_back(keep_(key_frame, latest));
  try {
    mapper_.add(inputs_.back(), stop_);
  } catch (const Interrupted&) {
    return;
  } catch (const InputError& error) {  // one image of many
    log_warning("{} (left out)", error.what());
    return;
  }
  recent_.emplace_back(mapper_.count() - 1, reduced_gray(key_frame.image));
  if (recent_.size() > kRecent) recent_.pop_front();
  if (++waiting_ >= options_.every) grow(false);
}

void SfmSession::grow(bool again) {
  try {
    if (again) {
      mapper_.refine(stop_);
    } else {
      mapper_.grow(stop_);
    }
  } catch (const Interrupted&) {
    return;  // the host is about to end
  }
  waiting_ = 0;
  cloud_is_old_ = true;
  choose_points();
}

// Points are followed from the latest image of the model, evenly over those it shows.
void SfmSession::choose_points() {
  followed_ = {};
  const sfm::Model& model = mapper_.model();
  for (auto entry = recent_.rbegin(); entry != recent_.rend(); ++entry) {
    if (at(entry->first) >= model.images.size()) continue;
    const sfm::Image& image = model.images[at(entry->first)];
    if (!image.registered) continue;
    const double scale =
        reduction({model.cameras[at(image.camera)].width, model.cameras[at(image.camera)].height});
    std::vector<cv::Point2f> seen;
    for (std::size_t f = 0; f < image.points.size(); ++f)
      if (image.points[f] >= 0) seen.push_back(image.features[f] * scale);
    const std::size_t step = std::max<std::size_t>(1, seen.size() / kMaxFollowed);
    for (std::size_t k = 0; k < seen.size(); k += step) followed_.from.push_back(seen[k]);
    followed_.gray = entry->second;
    followed_.to = followed_.from;
    followed_.is_lost.assign(followed_.from.size(), 0);
    return;
  }
}

void SfmSession::follow() {
  if (followed_.from.empty() || followed_.gray.size() != gray_.size()) {
    followed_.from.clear();
    return;
  }
  const cv::Size window(21, 21);
  const cv::TermCriteria enough(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.03);
  std::vector<cv::Point2f> back = followed_.from;
  std::vector<std::uint8_t> there;
  std::vector<std::uint8_t> here;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(followed_.gray, gray_, followed_.from, followed_.to, there, error,
                           window, 4, enough, cv::OPTFLOW_USE_INITIAL_FLOW);
  cv::calcOpticalFlowPyrLK(gray_, followed_.gray, followed_.to, back, here, error, window, 4,
                           enough, cv::OPTFLOW_USE_INITIAL_FLOW);
  for (std::size_t k = 0; k < followed_.from.size(); ++k) {
    const bool is_found =
        there[k] != 0 && here[k] != 0 && cv::norm(back[k] - followed_.from[k]) <= kBackPx;
    followed_.is_lost[k] = is_found ? 0 : 1;
    if (!is_found) followed_.to[k] = followed_.from[k];  // where it is looked for next time
  }
}

void SfmSession::turn(double yaw, double pitch) {
  yaw_ = std::remainder(yaw_ + yaw, 360);
  pitch_ = std::clamp(pitch_ + pitch, -89.0, 89.0);
  cloud_is_old_ = true;
}

void SfmSession::zoom(double factor) {
  zoom_ = std::clamp(zoom_ * factor, 0.1, 20.0);
  cloud_is_old_ = true;
}

std::string SfmSession::counts() const {
  return fmt::format("{} key frame{}, {} in the model, {} points", inputs_.size(),
                     inputs_.size() == 1 ? "" : "s", mapper_.registered(),
                     mapper_.model().points.size());
}

void SfmSession::draw() {
  const int height = panel_height(latest_.image.size());
  const double scale = static_cast<double>(height) / latest_.image.rows;
  const int left = std::max(2, cvRound(latest_.image.cols * scale) / 2 * 2);
  const int right = height * 4 / 3 / 2 * 2;
  output_.create(height, left + right, CV_8UC3);
  cv::Mat shown = output_(cv::Rect(0, 0, left, height));
  cv::resize(latest_.image, shown, shown.size(), 0, 0,
             scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const double from_reduced = scale / reduction(latest_.image.size());
  const int radius = std::max(2, height / 200);
  for (std::size_t k = 0; k < followed_.from.size(); ++k) {
    if (followed_.is_lost[k] != 0) continue;
    const cv::Point2d p = cv::Point2d(followed_.to[k]) * from_reduced;
    const cv::Point where(cvRound(p.x * 16), cvRound(p.y * 16));
    cv::circle(shown, where, (radius + 1) * 16, kRim, cv::FILLED, cv::LINE_AA, 4);
    cv::circle(shown, where, radius * 16, kGreen, cv::FILLED, cv::LINE_AA, 4);
  }

  const sfm::Model& model = mapper_.model();
  const cv::Size size(right, height);
  if (cloud_is_old_ || cloud_.size() != size) {
    sfm::ViewOptions view;
    view.size = size;
    view.yaw_deg = yaw_;
    view.pitch_deg = pitch_;
    if (zoom_ != 1 && !model.points.empty())
      view.distance = sfm::viewpoint_of(model, view).distance / zoom_;
    cloud_ = sfm::render_model(model, view);
    cloud_is_old_ = false;
  }
  cv::Mat panel = output_(cv::Rect(left, 0, right, height));
  cloud_.copyTo(panel);
  image::draw::TextStyle style;
  style.height_px = std::max(8.0, height / 45.0);
  style.color = kInk;
  style.backing = image::draw::Backing::kOutline;
  style.backing_color = cv::Scalar(250, 248, 246);
  image::draw::put_text(panel, counts(), {8, 8}, style);
  if (model.images.empty()) {
    image::draw::put_text(panel, "no model yet: move the camera sideways", {right / 2, height / 2},
                          style, image::draw::Anchor::kCenter);
  }
}

View SfmSession::view(bool fresh) {
  const auto followed = followed_.from.empty()
                            ? 0
                            : std::count(followed_.is_lost.begin(), followed_.is_lost.end(), 0);
  View result;
  result.state = {{"key_frames", inputs_.size()},
                  {"registered", mapper_.registered()},
                  {"points", mapper_.model().points.size()},
                  {"followed", followed},
                  {"paused", paused_}};
  result.status =
      fmt::format("{}, {:.0f} ms{}", counts(), 1000 * mapper_.seconds(), paused_ ? ", paused" : "");
  result.finished = finished_;
  if (output_.empty()) return result;
  output_.copyTo(shown_);
  image::draw::status_bar(shown_, result.status, source_.empty() ? "h: help" : source_);
  if (help_) {
    draw_help(shown_, "Structure from motion", actions(),
              {{"arrows", "turn the cloud, as a dragged mouse does"}});
  }
  result.image = shown_;
  if (fresh) result.output = output_;
  return result;
}

}  // namespace tarsier
