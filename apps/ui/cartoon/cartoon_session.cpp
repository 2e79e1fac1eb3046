// SPDX-License-Identifier: MIT
#include "ui/cartoon/cartoon_session.h"

#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "ui/controls.h"
#include "ui/overlay.h"
#include "ui/save_image.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

namespace tarsier {
namespace {

using cartoon::CartoonOptions;
using cartoon::Mode;

constexpr double kOutlineSeconds = 2;      // of frame time that the face outline shows ...
constexpr double kOutlineFadeAfter = 0.8;  // ... and until it begins to fade
constexpr double kMessageSeconds = 3;      // of frame time that "saved .." shows
constexpr double kFpsMemory = 0.1;         // weight of the newest interval
constexpr int kSketchStep = 5;             // of + and -
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
    {Mode::kEvil, "evil: heavy ink (again: ink alone)", 'e'},
    {Mode::kEvilSketch, "heavy ink alone", 0},
    {Mode::kAlien, "alien: another skin colour", 'a'},
    {Mode::kSmooth, "smooth skin", 'm'},
    {Mode::kNone, "the image as it is", 'n'},
};

// Keeps the stages of a frame for the debug view, and hands them on.
class Stages final : public DebugSink {
 public:
  explicit Stages(DebugSink* next) : next_(next) {}
  void begin(bool keep) {
    keep_ = keep;
    images_.clear();
    names_.clear();
  }
  void image(std::string_view name, const cv::Mat& image) override {
    if (next_ != nullptr) next_->image(name, image);
    if (!keep_) return;
    images_.push_back(image.clone());
    names_.emplace_back(name);
  }
  [[nodiscard]] bool empty() const { return images_.empty(); }
  [[nodiscard]] cv::Mat tiled(cv::Size size) const {
    return image::draw::tile(images_, names_, size);
  }

 private:
  DebugSink* next_;
  bool keep_ = false;
  std::vector<cv::Mat> images_;
  std::vector<std::string> names_;
};

bool draws_evil_lines(Mode mode) { return mode == Mode::kEvil || mode == Mode::kEvilSketch; }

}  // namespace

void CartoonSessionOptions::check() const {
  TARSIER_REQUIRE(!save_folder.empty(), "the folder for saved images has no name");
}

struct CartoonSession::Impl {
  Impl(const cartoon::Cartoonizer& draws, const CartoonSessionOptions& given)
      : options(given), cartoonizer(draws), settings(draws.options()), stages(given.debug) {}

  CartoonSessionOptions options;
  cartoon::Cartoonizer cartoonizer;
  CartoonOptions settings;  // as the user changed them
  cartoon::CartoonizerState state;
  Stages stages;

  Frame frame;  // the last one that was used
  bool has_frame = false;
  cartoon::CartoonResult result;  // of it
  cv::Mat debug_view;
  cv::Mat shown;  // with overlay
  SourceStatus source;
  double age_ms = 0;

  SessionControls controls{true};
  bool debug = false;
  double interval_s = 0;                // smoothed time between frames
  std::optional<double> outline_since;  // frame time
  bool outline_wanted = false;          // from the next frame on
  std::string message;
  double message_since = 0;
  std::string saved;

  // --- the image
  // ----------------------------------------------------------------------------------------

  void process() {
    result = {};  // its buffer is used again if nobody else holds it
    stages.begin(debug);
    DebugSink* sink = debug || watched(options.debug) != nullptr ? &stages : nullptr;
    cartoonizer.set_options(settings);
    // The time it takes is only reported, never acted on: what a session shows does not depend on a
    // clock.
    result = cartoonizer.process(frame, state, sink, options.timers, options.stop);
    debug_view = debug && !stages.empty() ? stages.tiled(frame.image.size()) : cv::Mat();
  }

  [[nodiscard]] double outline_opacity() const {
    if (!outline_since) return 0;
    const double seconds = frame.time - *outline_since;
    if (seconds < 0 || seconds >= kOutlineSeconds) return 0;
    return std::min(1.0, (kOutlineSeconds - seconds) / (kOutlineSeconds - kOutlineFadeAfter));
  }

  void set_mode(Mode mode) {
    if (mode == Mode::kAlien && settings.mode != Mode::kAlien) outline_wanted = true;
    if (mode != Mode::kAlien) {
      outline_since.reset();
      outline_wanted = false;
    }
    settings.mode = mode;
  }

  void begin_outline() {
    if (!outline_wanted) return;
    outline_wanted = false;
    outline_since.reset();
    if (!frame.still && settings.skin.face == cartoon::FaceMode::kOutline)
      outline_since = frame.time;
  }

  void measure_interval(double time, double before) {
    const double seconds = time - before;
    if (seconds <= 0) {  // another video
      interval_s = 0;
    } else {
      interval_s = interval_s > 0 ? interval_s + kFpsMemory * (seconds - interval_s) : seconds;
    }
  }

  // --- what is shown
  // --------------------------------------------------------------------------------------

  [[nodiscard]] double fps() const { return interval_s > 0 ? 1 / interval_s : 0; }

  [[nodiscard]] std::string status() const {
    std::string text(cartoon::name_of(settings.mode));
    if (settings.steady.on) text += "  steady";
    if (fps() > 0) text += fmt::format("  {:.1f} fps", fps());
    if (age_ms > 0) text += fmt::format("  age {:.0f} ms", age_ms);
    if (source.state != SourceState::kLive && source.state != SourceState::kEnded) {
      text += fmt::format("  {}", name_of(source.state));
    }
    if (controls.paused()) text += "  paused";
    return text;
  }

  void draw_banner(cv::Mat& image) const {
    const bool away = source.state == SourceState::kConnecting ||
                      source.state == SourceState::kStale || source.state == SourceState::kLost;
    if (!away) return;
    std::string text(source.state == SourceState::kStale  ? "no new image"
                     : source.state == SourceState::kLost ? "camera lost"
                                                          : "connecting ...");
    if (!source.detail.empty()) text += '\n' + source.detail;
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

  [[nodiscard]] nlohmann::json state_json() const {
    nlohmann::json json = {{"fps", std::round(fps() * 100) / 100},
                           {"age_ms", std::round(age_ms * 10) / 10},
                           {"source", name_of(source.state)},
                           {"paused", controls.paused()},
                           {"debug", debug},
                           {"steady", settings.steady.on},
                           {"help", controls.help()},
                           {"frame", has_frame ? frame.index : -1},
                           {"sketch_threshold", settings.sketch.threshold},
                           {"evil_threshold", settings.evil.threshold}};
    json.update(nlohmann::json(cartoon::to_json(has_frame ? result : cartoon::CartoonResult())));
    json["mode"] = cartoon::name_of(settings.mode);  // that the next image is drawn in
    if (!saved.empty()) json["saved"] = saved;
    return json;
  }

  View view(const std::vector<Action>& actions, bool has_bar) {
    View result_view;
    if (options.overlay) {
      const cv::Mat& base = !has_frame ? cv::Mat() : debug_view.empty() ? result.image : debug_view;
      if (has_frame) {
        base.copyTo(shown);
      } else {
        shown.create(480, 640, CV_8UC3);
        shown.setTo(cv::Scalar(48, 40, 32));
      }
      if (has_frame && debug_view.empty()) cartoon::draw_face_outline(shown, outline_opacity());
      if (has_bar) {
        draw_banner(shown);
        image::draw::status_bar(shown, status(), message.empty() ? "h: help" : message);
        if (controls.help()) draw_help(shown, "Tarsier cartoon", actions);
      }
      result_view.image = shown;
    } else {
      result_view.image = result.image;
    }
    result_view.status = status();
    if (!message.empty()) result_view.status += "  " + message;
    result_view.state = state_json();
    result_view.finished = controls.finished();
    return result_view;
  }

  // --- what the user does
  // ---------------------------------------------------------------------------------

  void say(std::string text) {
    message = std::move(text);
    message_since = frame.time;
  }

  void save() {
    if (!has_frame) {
      say("nothing to save yet");
      return;
    }
    try {
      saved = save_numbered(options.save_folder, result.image);
      say(fmt::format("saved {}", saved));
    } catch (const OutputError& error) {  // no reason to end a live image
      log_warning("cannot save: {}", error.what());
      say("cannot save: see the log");
    }
  }

  void change_threshold(int direction) {
    if (draws_evil_lines(settings.mode)) {
      settings.evil.threshold = std::clamp(settings.evil.threshold + direction * kEvilStep, 0, 255);
      say(fmt::format("threshold {}", settings.evil.threshold));
    } else {
      settings.sketch.threshold =
          std::clamp(settings.sketch.threshold + direction * kSketchStep, 0, 255);
      say(fmt::format("threshold {}", settings.sketch.threshold));
    }
  }
};

CartoonSession::CartoonSession(const cartoon::Cartoonizer& cartoonizer,
                               const CartoonSessionOptions& options) {
  options.check();
  impl_ = std::make_unique<Impl>(cartoonizer, options);
  impl_->outline_wanted = cartoonizer.options().mode == Mode::kAlien;
}

CartoonSession::~CartoonSession() = default;

View CartoonSession::on_frame(const Frame& frame, const SourceStatus& source) {
  Impl& my = *impl_;
  require_bgr(frame.image);
  my.source = source;
  if (my.controls.paused() && my.has_frame)
    return my.view(actions(), draws_status());  // the first one is shown all the same
  const bool follows = my.has_frame && !frame.still;
  const double before = my.frame.time;
  my.frame = frame;
  if (follows) my.measure_interval(frame.time, before);
  my.has_frame = false;  // nothing to show if this one fails
  my.begin_outline();
  my.process();
  my.has_frame = true;
  my.age_ms = source.age_s > 0 ? source.age_s * 1000 + my.result.ms : 0;
  if (!my.message.empty() && std::abs(frame.time - my.message_since) > kMessageSeconds)
    my.message.clear();
  View view = my.view(actions(), draws_status());
  view.output = my.result.image;
  return view;
}

View CartoonSession::on_idle(const SourceStatus& source) {
  Impl& my = *impl_;
  my.source = source;
  if (my.has_frame && source.age_s > 0) my.age_ms = source.age_s * 1000;
  return my.view(actions(), draws_status());
}

View CartoonSession::on_event(const Event& event) {
  Impl& my = *impl_;
  std::string name = action_of(event, actions());
  if (event.kind == Event::Kind::kKey && name == "evil" && my.settings.mode == Mode::kEvil)
    name = "evil-sketch";

  bool toggle_fullscreen = false;
  bool redo = false;  // the image would now be another
  if (event.kind == Event::Kind::kSlider) {
    const int value = static_cast<int>(std::lround(std::clamp(event.value, 0.0, 255.0)));
    redo = true;
    if (event.name == kSketchSlider) {
      my.settings.sketch.threshold = value;
    } else if (event.name == kEvilSlider) {
      my.settings.evil.threshold = value;
    } else {
      redo = false;
      log_warning("no slider '{}'", event.name);
    }
  } else if (!name.empty()) {
    my.message.clear();
    const auto* mode =
        std::find_if(std::begin(kModeActions), std::end(kModeActions),
                     [&](const ModeAction& a) { return cartoon::name_of(a.mode) == name; });
    redo = true;
    if (mode != std::end(kModeActions)) {
      my.set_mode(mode->mode);
    } else if (name == "debug") {
      my.debug = !my.debug;
    } else if (name == "steady") {
      my.settings.steady.on = !my.settings.steady.on;
    } else if (name == "threshold-up") {
      my.change_threshold(+1);
    } else if (name == "threshold-down") {
      my.change_threshold(-1);
    } else {
      redo = false;
      if (name == "save") {
        my.save();
      } else if (name == "fullscreen") {
        toggle_fullscreen = true;
      } else if (!my.controls.act(name)) {
        log_warning("no action '{}'", name);
      }
    }
  }
  // A moving image changes with its next frame; one that stands has to be made again.
  redo = redo && my.has_frame && (my.frame.still || my.controls.paused());
  if (redo) {
    my.begin_outline();
    my.process();
  } else if (!my.debug) {
    my.debug_view.release();
  }
  View view = my.view(actions(), draws_status());
  if (redo && my.frame.still) view.output = my.result.image;
  view.toggle_fullscreen = toggle_fullscreen;
  return view;
}

std::vector<Action> CartoonSession::actions() const {
  std::vector<Action> result;
  for (const ModeAction& mode : kModeActions) {
    result.push_back({std::string(cartoon::name_of(mode.mode)), mode.help, mode.key});
  }
  result.push_back({"threshold-up", "fewer lines", '+'});
  result.push_back({"threshold-down", "more lines", '-'});
  result.push_back({"steady", "steady lines on, off", 't'});
  result.push_back({"debug", "all stages side by side", 'd'});
  result.push_back({"save", "save the image", 'w'});
  result.push_back({"fullscreen", "full screen", 'f'});
  return impl_->controls.after(std::move(result));
}

std::vector<Slider> CartoonSession::sliders() const {
  return {{kSketchSlider, 0, 255, 1, static_cast<double>(impl_->settings.sketch.threshold)},
          {kEvilSlider, 0, 255, 1, static_cast<double>(impl_->settings.evil.threshold)}};
}

}  // namespace tarsier
