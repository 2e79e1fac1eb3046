// SPDX-License-Identifier: MIT
#include "ui/cartoon/cartoon_session.h"

#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "ui/save_image.h"
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

using cartoon::Mode;

constexpr double kOutlineSeconds = 2;      // of frame time: how long the face outline shows ...
constexpr double kOutlineFadeAfter = 0.8;  // ... and when it begins to fade
constexpr double kMessageSeconds = 3;      // of frame time: how long "saved .." shows
constexpr double kFpsWeight = 0.1;         // weight of the newest interval
constexpr int kSketchStep = 5;             // per key press of + and -
constexpr int kEvilStep = 1;
constexpr const char* kSketchSlider = "sketch-threshold";
constexpr const char* kEvilSlider = "evil-threshold";

struct ModeAction {
  Mode mode;
  const char* help;
  int key;
};
constexpr ModeAction kModeActions[] = {
    {Mode::kSketch, "pencil sketch", 's'},
    {Mode::kPaint, "painting", 'p'},
    {Mode::kCartoon, "cartoon: painting with pencil lines", 'c'},
    {Mode::kEvil, "evil: heavy ink (again: ink only)", 'e'},
    {Mode::kEvilSketch, "heavy ink only", 0},
    {Mode::kAlien, "alien: another skin colour", 'a'},
    {Mode::kSmooth, "smooth skin", 'm'},
    {Mode::kNone, "the unchanged image", 'n'},
};
constexpr std::size_t kEvilAction = 3;  // the next action is the ink alone

bool draws_evil_lines(Mode mode) { return mode == Mode::kEvil || mode == Mode::kEvilSketch; }

}  // namespace

void CartoonSessionOptions::check() const {
  TARSIER_REQUIRE(!save_folder.empty(), "the folder for saved images has no name");
}

CartoonSession::CartoonSession(cartoon::Cartoonizer cartoonizer, CartoonSessionOptions options)
    : FrameSession("Tarsier cartoon"),
      options_(std::move(options)),
      cartoonizer_(std::move(cartoonizer)),
      settings_(cartoonizer_.options()),
      stages_(options_.debug),
      outline_requested_(settings_.mode == Mode::kAlien) {
  options_.check();
}

// --- the image ---

void CartoonSession::Stages::begin(bool keep) {
  keep_ = keep;
  images_.clear();
  names_.clear();
}

void CartoonSession::Stages::image(std::string_view name, const cv::Mat& image) {
  if (next_ != nullptr) next_->image(name, image);
  if (!keep_) return;
  images_.push_back(image.clone());
  names_.emplace_back(name);
}

cv::Mat CartoonSession::Stages::tiled(cv::Size size) const {
  return images_.empty() ? cv::Mat() : image::draw::tile(images_, names_, size);
}

void CartoonSession::process(const Frame& frame) {
  const std::optional<double> before = std::exchange(last_time_, std::nullopt);
  require_bgr(frame.image);
  if (before && !frame.still) {
    const double seconds = frame.time - *before;
    interval_s_ = seconds <= 0      ? 0  // another video
                  : interval_s_ > 0 ? interval_s_ + kFpsWeight * (seconds - interval_s_)
                                    : seconds;
  }
  draw_cartoon();
  last_time_ = frame.time;
}

void CartoonSession::draw_cartoon() {
  if (std::exchange(outline_requested_, false)) {
    outline_since_.reset();
    if (!still() && settings_.skin.face == cartoon::FaceMode::kOutline)
      outline_since_ = latest().time;
  }
  // The buffer is reused if nobody else holds it. If processing fails nothing is shown.
  drop_drawing();
  result_ = {};
  stages_.begin(debug_);
  DebugSink* sink = debug_ || watched(options_.debug) != nullptr ? &stages_ : nullptr;
  cartoonizer_.set_options(settings_);
  // The processing time is only reported and changes nothing: what a session shows does not depend
  // on a clock.
  result_ = cartoonizer_.process(latest(), state_, sink, options_.timers, options_.stop);
  debug_view_ = debug_ ? stages_.tiled(frame().size()) : cv::Mat();
}

void CartoonSession::on_processed() {
  age_ms_ = source().age_s > 0 ? source().age_s * 1000 + result_.ms : 0;
  if (std::abs(latest().time - message_since_) > kMessageSeconds) message_.clear();
}

bool CartoonSession::idle() {
  if (has_image() && source().age_s > 0) age_ms_ = source().age_s * 1000;
  return false;
}

double CartoonSession::outline_opacity() const {
  if (!outline_since_) return 0;
  const double seconds = latest().time - *outline_since_;
  if (seconds < 0 || seconds >= kOutlineSeconds) return 0;
  return std::min(1.0, (kOutlineSeconds - seconds) / (kOutlineSeconds - kOutlineFadeAfter));
}

// --- what is shown ---

void CartoonSession::draw_shown(cv::Mat& image) {
  if (debug_view_.empty())
    cartoon::draw_face_outline(image, outline_opacity());
  else
    debug_view_.copyTo(image);
  if (draws_status()) draw_banner(image);
}

bool CartoonSession::draw_placeholder(cv::Mat& image) {
  image.create(480, 640, CV_8UC3);
  image.setTo(cv::Scalar(48, 40, 32));
  if (draws_status()) draw_banner(image);
  return true;
}

void CartoonSession::draw_banner(cv::Mat& image) const {
  const SourceState is = source().state;
  if (is != SourceState::kConnecting && is != SourceState::kStale && is != SourceState::kLost)
    return;
  std::string text(is == SourceState::kStale  ? "no new image"
                   : is == SourceState::kLost ? "camera lost"
                                              : "connecting ...");
  if (!source().detail.empty()) text += '\n' + source().detail;
  image::draw::TextStyle style;
  style.color = {80, 220, 255};
  style.backing = image::draw::Backing::kBox;
  style.height_px = image::draw::fitting_text_height(image.size());
  const cv::Size size = image::draw::text_size(text, style.height_px);
  if (size.width > image.cols)
    style.height_px = std::max(4.0, style.height_px * image.cols / size.width);
  image::draw::put_text(image, text, {image.cols / 2, image.rows / 4}, style,
                        image::draw::Anchor::kCenter);
}

std::string CartoonSession::status() const {
  std::string text(cartoon::name_of(settings_.mode));
  if (settings_.steady.on) text += "  steady";
  if (fps() > 0) text += fmt::format("  {:.1f} fps", fps());
  if (age_ms_ > 0) text += fmt::format("  age {:.0f} ms", age_ms_);
  if (!message_.empty()) text += "  " + message_;
  return text;
}

nlohmann::json CartoonSession::state() const {
  nlohmann::json json = {{"fps", std::round(fps() * 100) / 100},
                         {"age_ms", std::round(age_ms_ * 10) / 10},
                         {"source", name_of(source().state)},
                         {"debug", debug_},
                         {"steady", settings_.steady.on},
                         {"help", shows_help()},
                         {"frame", has_image() ? latest().index : -1},
                         {"sketch_threshold", settings_.sketch.threshold},
                         {"evil_threshold", settings_.evil.threshold}};
  json.update(nlohmann::json(cartoon::to_json(result_)));
  json["mode"] = cartoon::name_of(settings_.mode);  // mode of the next image
  if (!saved_.empty()) json["saved"] = saved_;
  return json;
}

// --- what the user does ---

std::vector<Action> CartoonSession::own_actions() const {
  std::vector<Action> result;
  for (const ModeAction& mode : kModeActions)
    result.push_back({std::string(cartoon::name_of(mode.mode)), mode.help, mode.key});
  // The key of evil, pressed again, selects the ink alone.
  if (settings_.mode == Mode::kEvil)
    std::swap(result[kEvilAction].key, result[kEvilAction + 1].key);
  result.push_back({"threshold-up", "fewer lines", '+'});
  result.push_back({"threshold-down", "more lines", '-'});
  result.push_back({"steady", "steady lines on or off", 't'});
  result.push_back({"debug", "show all stages side by side", 'd'});
  result.push_back({"save", "save the image", 'w'});
  result.push_back({"fullscreen", "full screen", 'f'});
  return result;
}

bool CartoonSession::act(const std::string& name) {
  if (name.empty()) return false;
  message_.clear();
  const auto* mode =
      std::find_if(std::begin(kModeActions), std::end(kModeActions),
                   [&](const ModeAction& a) { return cartoon::name_of(a.mode) == name; });
  if (mode != std::end(kModeActions)) {
    set_mode(mode->mode);
  } else if (name == "debug") {
    debug_ = !debug_;
    if (!debug_) debug_view_.release();
  } else if (name == "steady") {
    settings_.steady.on = !settings_.steady.on;
  } else if (name == "threshold-up") {
    change_threshold(+1);
  } else if (name == "threshold-down") {
    change_threshold(-1);
  } else {
    if (name == "save") {
      save();
    } else if (name == "fullscreen") {
      toggle_fullscreen();
    } else {
      log_warning("unknown action '{}'", name);
    }
    return false;
  }
  return changed();
}

bool CartoonSession::slide(const Event& event) {
  const int value = static_cast<int>(std::lround(std::clamp(event.value, 0.0, 255.0)));
  if (event.name == kSketchSlider) {
    settings_.sketch.threshold = value;
  } else if (event.name == kEvilSlider) {
    settings_.evil.threshold = value;
  } else {
    log_warning("unknown slider '{}'", event.name);
    return false;
  }
  return changed();
}

bool CartoonSession::changed() {
  if (!has_image() || !(still() || paused())) return false;
  draw_cartoon();
  return true;
}

void CartoonSession::set_mode(Mode mode) {
  if (mode == Mode::kAlien && settings_.mode != Mode::kAlien) outline_requested_ = true;
  if (mode != Mode::kAlien) {
    outline_since_.reset();
    outline_requested_ = false;
  }
  settings_.mode = mode;
}

void CartoonSession::change_threshold(int direction) {
  const bool evil = draws_evil_lines(settings_.mode);
  int& threshold = evil ? settings_.evil.threshold : settings_.sketch.threshold;
  threshold = std::clamp(threshold + direction * (evil ? kEvilStep : kSketchStep), 0, 255);
  show_message(fmt::format("threshold {}", threshold));
}

void CartoonSession::show_message(std::string text) {
  message_ = std::move(text);
  message_since_ = latest().time;
}

void CartoonSession::save() {
  if (!has_image()) {
    show_message("nothing to save yet");
    return;
  }
  try {
    saved_ = save_numbered(options_.save_folder, result_.image);
    show_message(fmt::format("saved {}", saved_));
  } catch (const OutputError& error) {  // a live session continues
    log_warning("cannot save: {}", error.what());
    show_message("cannot save: see the log");
  }
}

std::vector<Slider> CartoonSession::sliders() const {
  return {{kSketchSlider, 0, 255, 1, static_cast<double>(settings_.sketch.threshold)},
          {kEvilSlider, 0, 255, 1, static_cast<double>(settings_.evil.threshold)}};
}

}  // namespace tarsier
