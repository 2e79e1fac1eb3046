// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/detect/cascade.h"
#include "tarsier/face/detect/detector.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::cartoon {
namespace {

constexpr int kMinSize = 16;  // px, of a frame

bool finds_faces(const CartoonOptions& options) {
  return uses_skin(options.mode) && options.skin.face == FaceMode::kAuto;
}

}  // namespace

nlohmann::ordered_json to_json(const CartoonResult& result) {
  nlohmann::ordered_json faces = nlohmann::ordered_json::array();
  for (const cv::Rect& face : result.faces)
    faces.push_back({face.x, face.y, face.width, face.height});
  return {{"mode", name_of(result.mode)},
          {"ms", std::round(result.ms * 100) / 100},
          {"faces", std::move(faces)}};
}

Cartoonizer Cartoonizer::load(const ModelStore& models, const CartoonOptions& options) {
  return {options, models.has(kFaceCascade)
                       ? std::filesystem::absolute(models.path(kFaceCascade)).string()
                       : ""};
}

Cartoonizer::Cartoonizer(const CartoonOptions& options, std::string cascade)
    : cascade_(std::move(cascade)) {
  set_options(options);
}

void Cartoonizer::set_options(const CartoonOptions& options) {
  options.check();
  CartoonOptions complete = options;
  if (complete.skin.cascade.empty()) complete.skin.cascade = cascade_;
  if (finds_faces(complete)) {
    face::FaceDetectorOptions detector;
    if (!complete.skin.cascade.empty()) detector.cascade = complete.skin.cascade;
    // Fails now, not at the first frame; its error says what to do.
    if (face::find_cascade(detector.cascade).empty()) (void)face::FaceDetector(detector);
  }
  options_ = complete;
}

CartoonResult Cartoonizer::process(const Frame& frame, CartoonizerState& state, DebugSink* debug,
                                   Timers* timers, const std::stop_token& stop) const {
  if (!frame.image.empty() && (frame.image.cols < kMinSize || frame.image.rows < kMinSize)) {
    throw InputError(frame.name,
                     fmt::format("{}x{} is too small to draw; at least {}x{} is needed",
                                 frame.image.cols, frame.image.rows, kMinSize, kMinSize));
  }
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  const bool is_same = state.time == frame.time && state.index == frame.index;
  const bool follows = state.time && (frame.time > *state.time || is_same);
  if (frame.still || !follows) state.drawing.reset();
  state.time = frame.time;
  state.index = frame.index;
  CartoonResult result;
  result.image = cartoonize(frame.image, options_, state.drawing, debug, timers, stop);
  result.mode = options_.mode;
  if (finds_faces(options_)) result.faces = state.drawing.faces();
  result.ms = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  return result;
}

}  // namespace tarsier::cartoon
