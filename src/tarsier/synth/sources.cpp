// SPDX-License-Identifier: MIT
#include "tarsier/synth/sources.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/synth/boards.h"
#include "tarsier/synth/clock.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/portrait.h"
#include "tarsier/synth/scene.h"
#include "tarsier/synth/street.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

namespace tarsier::synth {
namespace {

using Clock = std::chrono::steady_clock;

enum class Image { kScene, kPortrait, kClock, kBars, kCar, kDrive, kBoard, kPlanar };

struct Settings {
  std::string text;  // as given, with "synth:"
  std::string name;
  Image image = Image::kScene;
  cv::Size size{640, 480};
  double fps = 25;
  std::int64_t frames = 100;
  std::uint64_t seed = 1;
  bool live = false;
  double noise = 0;
  synth::StreetOptions street;
  std::string board = "chess:9x6";
  synth::PlanarSourceOptions planar;
};

constexpr double kBoardPitch = 0.025;  // m
constexpr std::string_view kNames =
    "scene, portrait, clock, bars, car, drive, board, markers, planar";
constexpr std::string_view kKeys = "size=640x480, fps=25, frames=100, seed=1, live=0, noise=2";
constexpr std::string_view kStreetKeys =
    "light=day|night|infrared, kind=spain|europe|us|brazil|all, and of a drive seconds=60, cars=6, "
    "parked=1, far=1";

template <typename Number>
bool parse_number(std::string_view text, Number& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

// Keys of streets only. False if `key` is not one of them.
bool parse_street(std::string_view key, std::string_view value, Settings& settings, bool& is_good) {
  synth::StreetOptions& street = settings.street;
  if (settings.image != Image::kCar && settings.image != Image::kDrive) return false;
  using synth::PlateKind;
  using synth::StreetLight;
  if (key == "light") {
    is_good = value == "day" || value == "night" || value == "infrared";
    street.light = value == "night"      ? StreetLight::kNight
                   : value == "infrared" ? StreetLight::kInfrared
                                         : StreetLight::kDay;
  } else if (key == "kind") {
    is_good = true;
    if (value == "spain")
      street.kinds = {PlateKind::kSpain};
    else if (value == "europe")
      street.kinds = {PlateKind::kEurope};
    else if (value == "us")
      street.kinds = {PlateKind::kUs};
    else if (value == "brazil")
      street.kinds = {PlateKind::kBrazil};
    else if (value == "all")
      street.kinds = {PlateKind::kSpain, PlateKind::kSpainSquare, PlateKind::kEurope,
                      PlateKind::kUs, PlateKind::kBrazil};
    else
      is_good = false;
  } else if (settings.image == Image::kDrive && key == "seconds") {
    is_good = parse_number(value, street.seconds) && street.seconds > 0 && street.seconds <= 86400;
  } else if (settings.image == Image::kDrive && key == "cars") {
    is_good = parse_number(value, street.cars) && street.cars >= 1 && street.cars <= 60;
  } else if (settings.image == Image::kDrive && key == "parked") {
    is_good = parse_number(value, street.parked) && street.parked >= 0 && street.parked <= 3;
  } else if (settings.image == Image::kDrive && key == "far") {
    is_good = parse_number(value, street.distant) && street.distant >= 0 && street.distant <= 3;
  } else {
    return false;
  }
  return true;
}

Settings parse_settings(std::string_view text, const SourceOptions& options) {
  Settings settings;
  settings.text = fmt::format("synth:{}", text);
  const auto refuse = [&](const std::string& reason) { throw InputError(settings.text, reason); };
  const std::size_t question = std::min(text.find('?'), text.size());
  settings.name = text.substr(0, question);
  if (settings.name == "scene") {
    settings.image = Image::kScene;
    settings.noise = 2;
  } else if (settings.name == "portrait") {
    settings.image = Image::kPortrait;
    settings.noise = 2;
  } else if (settings.name == "clock") {
    settings.image = Image::kClock;
  } else if (settings.name == "board") {
    settings.image = Image::kBoard;
    settings.noise = 1.5;
  } else if (settings.name == "markers" || settings.name == "planar") {
    settings.image = Image::kPlanar;
    settings.planar.posters = settings.name == "planar";
    settings.noise = 2;
  } else if (settings.name == "bars") {
    settings.image = Image::kBars;
  } else if (settings.name == "car" || settings.name == "drive") {
    settings.image = settings.name == "car" ? Image::kCar : Image::kDrive;
    settings.size = {1280, 720};
    settings.noise = 2;
  } else {
    refuse(fmt::format("no synthetic source '{}'; there are: {}", settings.name, kNames));
  }
  const bool is_street = settings.image == Image::kCar || settings.image == Image::kDrive;
  const std::string keys =
      is_street                          ? fmt::format("{}, {}", kKeys, kStreetKeys)
      : settings.image == Image::kBoard  ? fmt::format("{}, board=chess:9x6", kKeys)
      : settings.image == Image::kPlanar ? fmt::format("{}, {}", kKeys, synth::kPlanarSourceKeys)
                                         : std::string(kKeys);
  if (options.width > 0) settings.size.width = options.width;
  if (options.height > 0) settings.size.height = options.height;
  if (options.fps > 0) settings.fps = options.fps;
  bool has_frames = false;
  std::string_view rest = question < text.size() ? text.substr(question + 1) : std::string_view();
  while (!rest.empty()) {
    const std::size_t end = rest.find('&');
    const std::string_view item = rest.substr(0, end);
    rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
    const std::size_t equals = std::min(item.find('='), item.size());
    const std::string_view key = item.substr(0, equals);
    const std::string_view value =
        equals < item.size() ? item.substr(equals + 1) : std::string_view();
    bool is_good = false;
    if (key == "size") {
      const std::size_t x = std::min(value.find('x'), value.size());
      is_good = x < value.size() && parse_number(value.substr(0, x), settings.size.width) &&
                parse_number(value.substr(x + 1), settings.size.height);
    } else if (key == "fps") {
      is_good = parse_number(value, settings.fps) && settings.fps > 0 && settings.fps <= 1000;
    } else if (key == "frames") {
      is_good = parse_number(value, settings.frames) && settings.frames >= 0;
      has_frames = true;
    } else if (key == "seed") {
      is_good = parse_number(value, settings.seed);
    } else if (key == "live") {
      is_good = value == "0" || value == "1";
      settings.live = value == "1";
    } else if (key == "noise") {
      is_good = parse_number(value, settings.noise) && settings.noise >= 0 && settings.noise <= 64;
    } else if (key == "board" && settings.image == Image::kBoard) {
      settings.board = value;
      is_good = true;  // parse_board() reports the error
    } else if (settings.image == Image::kPlanar &&
               synth::set_planar_source(key, value, settings.planar, is_good)) {
    } else if (!parse_street(key, value, settings, is_good)) {
      refuse(fmt::format("unknown key '{}'; there are: {}", key, keys));
    }
    if (!is_good)
      refuse(fmt::format("bad value '{}' of {}; expected for example {}", value, key, keys));
  }
  if ((settings.image == Image::kBoard || settings.image == Image::kPlanar) &&
      (settings.size.width < 160 || settings.size.height < 120 || settings.size.width > 4096 ||
       settings.size.height > 4096)) {
    refuse(fmt::format("a size of {}x{} is not between 160x120 and 4096x4096", settings.size.width,
                       settings.size.height));
  }
  const int least = settings.image == Image::kClock || is_street ? 64 : 16;
  if (settings.size.width < least || settings.size.height < (least == 64 ? 48 : 16) ||
      settings.size.width > 8192 || settings.size.height > 8192) {
    refuse(fmt::format("a size of {}x{} is not between {}x{} and 8192x8192", settings.size.width,
                       settings.size.height, least, least == 64 ? 48 : 16));
  }
  if (!has_frames && settings.image == Image::kDrive)
    settings.frames =
        std::max<std::int64_t>(1, std::llround(settings.street.seconds * settings.fps));
  if (!has_frames && settings.live) settings.frames = 0;
  if (settings.street.parked + settings.street.distant > settings.street.cars)
    refuse("more cars are parked or far than there are");
  settings.street.size = settings.size;
  settings.street.seed = settings.seed;
  return settings;
}

nlohmann::json plates_json(const std::vector<synth::StreetPlate>& plates) {
  nlohmann::json list = nlohmann::json::array();
  for (const synth::StreetPlate& plate : plates) {
    nlohmann::json corners = nlohmann::json::array();
    double left = 1e9;
    double top = 1e9;
    double right = -1e9;
    double bottom = -1e9;
    for (const cv::Point2f& p : plate.corners) {
      const auto x = static_cast<double>(p.x);
      const auto y = static_cast<double>(p.y);
      corners.push_back({x, y});
      left = std::min(left, x);
      right = std::max(right, x);
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
    list.push_back({{"id", plate.id},
                    {"text", plate.text},
                    {"corners", std::move(corners)},
                    {"box", {left, top, right - left, bottom - top}},
                    {"visible", plate.visible}});
  }
  return list;
}

class SynthSource final : public FrameSource {
 public:
  explicit SynthSource(Settings settings) : settings_(std::move(settings)) {
    if (settings_.image == Image::kDrive) drive_.emplace(settings_.street);
    if (settings_.image == Image::kBoard) {
      video_.emplace(settings_.size, planar::calibration::parse_board(settings_.board, kBoardPitch),
                     settings_.seed);
    }
    if (settings_.image == Image::kPlanar) {
      planar_.emplace(synth::planar_source_video(settings_.planar, settings_.size, settings_.fps,
                                                 settings_.seed));
    }
    if (settings_.image == Image::kCar) (void)synth::load_glyphs();  // reports missing typefaces
  }

  std::optional<Frame> next(std::chrono::milliseconds timeout,
                            const std::stop_token& stop) override {
    if (ended() || stop.stop_requested()) return std::nullopt;
    if (settings_.live && !wait_until_due(timeout, stop)) return std::nullopt;
    Frame frame;
    frame.index = at_++;
    frame.time = static_cast<double>(frame.index) / settings_.fps;
    frame.name = settings_.text;
    frame.captured = settings_.live ? due_of(frame.index) : Clock::now();
    newest_ = frame.captured;
    draw(frame);
    add_noise(frame.image, settings_.noise,
              settings_.seed * 0x9e3779b97f4a7c15U + static_cast<std::uint64_t>(frame.index));
    return frame;
  }

  [[nodiscard]] bool ended() const override {
    return settings_.frames > 0 && at_ >= settings_.frames;
  }
  [[nodiscard]] bool is_live() const override { return settings_.live; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    status.state = ended() ? SourceState::kEnded : SourceState::kLive;
    status.detail =
        fmt::format("{}x{} {}", settings_.size.width, settings_.size.height, settings_.name);
    if (settings_.live && at_ > 0) {
      status.age_s = std::chrono::duration<double>(Clock::now() - newest_).count();
    }
    status.received = at_;
    status.dropped = dropped_;
    return status;
  }
  [[nodiscard]] double fps() const override { return settings_.fps; }
  [[nodiscard]] std::int64_t count() const override { return settings_.frames; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  [[nodiscard]] Clock::time_point due_of(std::int64_t index) const {
    const std::chrono::duration<double> since(static_cast<double>(index) / settings_.fps);
    return start_ + std::chrono::duration_cast<Clock::duration>(since);
  }

  // The rate of a camera: frames that were not read in time are lost.
  bool wait_until_due(std::chrono::milliseconds timeout, const std::stop_token& stop) {
    const Clock::time_point now = Clock::now();
    if (at_ == 0 && start_ == Clock::time_point{}) start_ = now;
    const double elapsed_s = std::chrono::duration<double>(now - start_).count();
    auto newest = static_cast<std::int64_t>(std::floor(elapsed_s * settings_.fps));
    if (settings_.frames > 0) newest = std::min(newest, settings_.frames - 1);
    if (newest > at_) {
      dropped_ += newest - at_;
      at_ = newest;
    }
    const Clock::time_point due = due_of(at_);
    if (due <= now) return true;
    const bool comes_in_time = due <= now + timeout;
    const auto pause =
        comes_in_time ? std::chrono::ceil<std::chrono::milliseconds>(due - now) : timeout;
    return sleep_unless_stopped(pause, stop) && comes_in_time;
  }

  void draw(Frame& frame) const {
    nlohmann::json truth = {{"source", settings_.name}, {"frame", frame.index}};
    switch (settings_.image) {
      case Image::kScene:
        frame.image = render_scene(settings_.size, frame.time, settings_.seed);
        truth["time"] = frame.time;
        break;
      case Image::kPortrait: {
        Portrait portrait = render_portrait(settings_.size, frame.time, settings_.seed);
        frame.image = std::move(portrait.image);
        const auto point = [](const cv::Point2d& p) { return nlohmann::json::array({p.x, p.y}); };
        const PortraitTruth& t = portrait.truth;
        truth["box"] = {t.box.x, t.box.y, t.box.width, t.box.height};
        truth["eyes"] = {point(t.eyes[0]), point(t.eyes[1])};
        truth["nose"] = point(t.nose);
        truth["mouth"] = {point(t.mouth[0]), point(t.mouth[1])};
        break;
      }
      case Image::kClock: {
        ClockReading reading;
        reading.frame = static_cast<std::uint32_t>(frame.index);
        // Live: the time of sending; otherwise a fixed time per frame.
        reading.time_us = settings_.live
                              ? clock_now_us()
                              : static_cast<std::int64_t>(std::llround(frame.time * 1e6));
        frame.image = render_clock(settings_.size, reading);
        truth["time_us"] = reading.time_us;
        break;
      }
      case Image::kCar:
      case Image::kDrive: {
        synth::StreetImage street =
            drive_ ? drive_->at(frame.time)
                   : synth::render_car(settings_.street, static_cast<std::uint64_t>(frame.index));
        frame.image = std::move(street.image);
        truth["plates"] = plates_json(street.plates);
        if (!drive_ && !settings_.live) {  // each is a separate scene
          frame.still = true;
          frame.name = fmt::format("car-{:05}", frame.index);
        }
        break;
      }
      case Image::kBoard: {
        frame.image = video_->image_at(frame.time);
        const geometry::Camera& camera = video_->camera();
        truth["camera"] = {{"fx", camera.fx},
                           {"fy", camera.fy},
                           {"cx", camera.cx},
                           {"cy", camera.cy},
                           {"distortion", camera.distortion}};
        break;
      }
      case Image::kPlanar:
        frame.image = planar_->image_at(frame.time);
        truth.update(nlohmann::json::parse(synth::planar_source_truth(*planar_, frame.time)));
        break;
      case Image::kBars:
        frame.image = render_bars(settings_.size, frame.index);
        break;
    }
    frame.truth = truth.dump();
  }

  const Settings settings_;
  std::optional<synth::Drive> drive_;
  std::optional<BoardVideo> video_;
  std::optional<synth::PlanarVideo> planar_;
  std::int64_t at_ = 0;  // index of the next frame
  std::int64_t dropped_ = 0;
  Clock::time_point start_;
  Clock::time_point newest_;
  const std::vector<std::string> skipped_;
};

}  // namespace

std::unique_ptr<FrameSource> open_synth_source(std::string_view text,
                                               const SourceOptions& options) {
  options.check();
  return std::make_unique<SynthSource>(parse_settings(text, options));
}

Scheme synth_scheme() {
  return {"synth", [](std::string_view text, const SourceOptions& options) {
            return open_synth_source(text, options);
          }};
}

}  // namespace tarsier::synth
