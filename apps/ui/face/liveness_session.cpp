// SPDX-License-Identifier: MIT
#include "ui/face/liveness_session.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rounding.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

using face::head::LivenessState;
using face::head::LivenessTask;

std::string request_of(const face::head::LivenessStatus& status) {
  switch (status.state) {
    case LivenessState::kLook:
      return "look into the camera";
    case LivenessState::kPassed:
      return "passed";
    case LivenessState::kFailed:
      return "not passed: " + status.reason;
    case LivenessState::kAsk:
      break;
  }
  switch (*status.task) {
    case LivenessTask::kBlink:
      return "blink";
    case LivenessTask::kTurnLeft:
      return "turn your head to your left";
    case LivenessTask::kTurnRight:
      break;
  }
  return "turn your head to your right";
}

}  // namespace

LivenessSession::LivenessSession(face::PoseTracker tracker, std::uint64_t seed,
                                 const face::head::LivenessOptions& options)
    : FrameSession("Liveness"),
      tracker_(std::move(tracker)),
      seed_(seed),
      options_(options),
      liveness_(seed, options) {
  TARSIER_REQUIRE(tracker_.landmarks().model().points() == 68, "landmarks of {} points, not 68",
                  tracker_.landmarks().model().points());
}

void LivenessSession::restart() {
  liveness_ = face::head::Liveness(seed_, options_);
  challenged_id_ = 0;
}

void LivenessSession::process(const Frame& frame) {
  result_ = tracker_.process(frame, state_);
  const face::PosedFace* chosen = nullptr;
  for (const face::PosedFace& face : result_.faces) {
    if (challenged_id_ != 0 && face.face.id != challenged_id_) continue;
    if (chosen == nullptr || face.face.box.area() > chosen->face.box.area()) chosen = &face;
  }
  face::head::LivenessFrame seen;
  seen.time = frame.time;
  if (chosen != nullptr) {
    challenged_id_ = chosen->face.id;
    seen.points = chosen->face.points;
    seen.image = frame.image;
    seen.id = challenged_id_;
    if (chosen->pose) {
      seen.yaw_deg = chosen->pose->angles.yaw_deg;
      seen.pitch_deg = chosen->pose->angles.pitch_deg;
    }
  }
  static_cast<void>(liveness_.step(seen));
}

void LivenessSession::draw(cv::Mat& image) {
  const face::head::LivenessStatus& now = liveness_.status();
  const cv::Scalar colour = now.state == LivenessState::kPassed   ? cv::Scalar(60, 200, 60)
                            : now.state == LivenessState::kFailed ? cv::Scalar(60, 60, 220)
                                                                  : cv::Scalar(220, 200, 60);
  for (const face::PosedFace& face : result_.faces)
    if (face.face.id == challenged_id_) cv::rectangle(image, face.face.box, colour, 2);
  image::draw::TextStyle text;
  text.height_px = std::clamp(image.rows * 0.05, 10.0, 40.0);
  image::draw::put_text(image, request_of(now), {10, 10}, text);
}

nlohmann::ordered_json LivenessSession::challenge_json() const {
  const face::head::LivenessStatus& now = liveness_.status();
  const auto text = [](std::string_view value) {
    return value.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(value);
  };
  return {{"state", name_of(now.state)},
          {"task", text(now.task ? name_of(*now.task) : std::string_view())},
          {"done", now.done},
          {"tasks", liveness_.tasks().size()},
          {"left_s", rounded_to_steps(now.remaining_s, 100)},
          {"openness", rounded_to_steps(now.openness, 1000)},
          {"parallax", rounded_to_steps(now.parallax, 1000)},
          {"reason", text(now.reason)}};
}

nlohmann::json LivenessSession::state() const {
  nlohmann::ordered_json all = challenge_json();
  return {{"state", all["state"]},
          {"task", all["task"]},
          {"done", all["done"]},
          {"tasks", all["tasks"]},
          {"reason", all["reason"]}};
}

std::string LivenessSession::status() const {
  const face::head::LivenessStatus& now = liveness_.status();
  return fmt::format("{} of {}: {}", now.done, liveness_.tasks().size(), request_of(now));
}

std::vector<Action> LivenessSession::own_actions() const {
  return {{"again", "restart with another order", 'n'}};
}

bool LivenessSession::act(const std::string& name) {
  if (name != "again") return false;
  ++seed_;
  restart();
  return true;
}

}  // namespace tarsier
