// SPDX-License-Identifier: MIT
#include "tarsier/face/head/liveness.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"

#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::face::head {
namespace {

constexpr NameTable<LivenessState, 4> kStateNames{"state",
                                                  {{{LivenessState::kLook, "look"},
                                                    {LivenessState::kAsk, "ask"},
                                                    {LivenessState::kPassed, "passed"},
                                                    {LivenessState::kFailed, "failed"}}}};

constexpr NameTable<LivenessTask, 3> kTaskNames{"task",
                                                {{{LivenessTask::kBlink, "blink"},
                                                  {LivenessTask::kTurnLeft, "turn left"},
                                                  {LivenessTask::kTurnRight, "turn right"}}}};

constexpr int kNoseTip = 30;
// Nearly coplanar points that expressions move little.
constexpr std::array<int, 8> kPlanarPoints{36, 39, 42, 45, 31, 35, 48, 54};
// Upper and lower lids, pairs for each eye.
constexpr std::array<std::array<int, 4>, 2> kLids{{{37, 41, 38, 40}, {43, 47, 44, 46}}};
// Blinks count only while the head keeps its first direction: the lids of turned or nodding heads
// and images look narrower than the affine map predicts.
constexpr double kMaxFacing_deg = 12;

AffineMap affine_between(const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to) {
  Eigen::Matrix<double, kPlanarPoints.size(), 3> a;
  Eigen::Matrix<double, kPlanarPoints.size(), 2> b;
  for (std::size_t i = 0; i < kPlanarPoints.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    a.row(row) << from.col(kPlanarPoints[i]).transpose(), 1;
    b.row(row) = to.col(kPlanarPoints[i]).transpose();
  }
  return a.colPivHouseholderQr().solve(b).transpose();
}

Eigen::Matrix2Xd mapped(const AffineMap& map, const Eigen::Matrix2Xd& points) {
  return (map.leftCols<2>() * points).colwise() + map.col(2);
}

double lid_distance(const Eigen::Matrix2Xd& points, const std::array<int, 4>& lids) {
  return (points.col(lids[0]) - points.col(lids[1])).norm() +
         (points.col(lids[2]) - points.col(lids[3])).norm();
}

Eigen::Vector2d eye_to_eye(const Eigen::Matrix2Xd& points) {
  return 0.5 * (points.col(42) + points.col(45) - points.col(36) - points.col(39));
}

}  // namespace

std::string_view name_of(LivenessTask task) { return kTaskNames.name(task); }

std::string_view name_of(LivenessState state) { return kStateNames.name(state); }

void LivenessOptions::check() const {
  check_fields(*this);
  blink.check();
}

std::vector<LivenessTask> draw_tasks(int count, std::uint64_t seed) {
  TARSIER_REQUIRE(count >= 1, "{} tasks", count);
  constexpr std::array<LivenessTask, 3> kTasks{LivenessTask::kBlink, LivenessTask::kTurnLeft,
                                               LivenessTask::kTurnRight};
  Rng rng(seed);
  std::vector<LivenessTask> out;
  while (static_cast<int>(out.size()) < count) {
    const auto drawn = kTasks[static_cast<std::size_t>(rng.uniform(0, 2.9999999))];
    if (out.empty() || out.back() != drawn) out.push_back(drawn);
  }
  return out;
}

Liveness::Liveness(std::uint64_t seed, const LivenessOptions& options)
    : options_(options), blinks_(options.blink) {
  options_.check();
  tasks_ = draw_tasks(options_.tasks, seed);
}

void Liveness::fail(std::string reason) {
  status_.state = LivenessState::kFailed;
  status_.task.reset();
  status_.remaining_s = 0;
  status_.reason = std::move(reason);
}

void Liveness::next_task(double time) {
  task_start_ = time;
  blinks_.clear();
  has_flat_turn_ = false;
  if (status_.done == static_cast<int>(tasks_.size())) {
    status_.state = LivenessState::kPassed;
    status_.task.reset();
    status_.remaining_s = 0;
    return;
  }
  status_.state = LivenessState::kAsk;
  status_.task = tasks_[static_cast<std::size_t>(status_.done)];
  status_.remaining_s = options_.task_s;
}

// Accumulates the reference.
void Liveness::record_reference(const LivenessFrame& frame) {
  if (!frame.yaw_deg || std::abs(*frame.yaw_deg) > kMaxFacing_deg) return;
  if (!start_) {
    start_ = frame.time;
    first_ = frame.points;
    sum_ = Eigen::Matrix2Xd::Zero(2, kFacePoints);
  }
  sum_ += mapped(affine_between(frame.points, first_), frame.points);
  yaw_sum_ += *frame.yaw_deg;
  pitch_sum_ += frame.pitch_deg.value_or(0);
  ++frames_;
  if (frame.time - *start_ < options_.look_s) return;
  reference_ = sum_ / frames_;
  yaw_ = yaw_sum_ / frames_;
  pitch_ = pitch_sum_ / frames_;
  next_task(frame.time);
}

AffineMap Liveness::measure(const LivenessFrame& frame) {
  const AffineMap map = affine_between(reference_, frame.points);
  const Eigen::Matrix2Xd flat = mapped(map, reference_);
  const Eigen::Vector2d across = eye_to_eye(flat);
  const double length = std::max(across.norm(), 1e-6);
  status_.parallax =
      (frame.points.col(kNoseTip) - flat.col(kNoseTip)).dot(across) / (length * length);
  status_.openness = 0;
  for (const auto& lids : kLids)
    status_.openness = std::max(status_.openness, lid_distance(frame.points, lids) /
                                                      std::max(lid_distance(flat, lids), 1e-6));
  return map;
}

void Liveness::check_task(const LivenessFrame& frame) {
  AffineMap map = measure(frame);
  const double turned = frame.yaw_deg ? *frame.yaw_deg - yaw_ : 0;
  bool done = false;
  if (*status_.task == LivenessTask::kBlink) {
    const double nodded = frame.pitch_deg ? *frame.pitch_deg - pitch_ : 0;
    const bool facing =
        frame.yaw_deg && std::abs(turned) <= kMaxFacing_deg && std::abs(nodded) <= kMaxFacing_deg;
    done = facing &&
           blinks_.step(frame.time, status_.openness, eye_patches(frame.image, reference_, map));
  } else {
    // Yaw and parallax are signed by the image's left and right; the person's left is the image's
    // right.
    const double sign = *status_.task == LivenessTask::kTurnLeft ? 1 : -1;
    const bool far_enough = -sign * turned >= options_.turn_deg;
    done = far_enough && sign * status_.parallax >= options_.min_parallax;
    has_flat_turn_ = has_flat_turn_ || (far_enough && !done);
  }
  if (done) {
    ++status_.done;
    next_task(frame.time);
    return;
  }
  status_.remaining_s = std::max(0.0, options_.task_s - (frame.time - task_start_));
  if (status_.remaining_s == 0) fail(has_flat_turn_ ? "flat" : "time");
}

const LivenessStatus& Liveness::step(const LivenessFrame& frame) {
  const bool is_over =
      status_.state == LivenessState::kPassed || status_.state == LivenessState::kFailed;
  if (is_over) return status_;
  TARSIER_REQUIRE(frame.points.cols() == 0 || frame.points.cols() == kFacePoints,
                  "{} points, not 68", frame.points.cols());
  TARSIER_REQUIRE(!last_time_ || frame.time >= *last_time_, "time {} after {}", frame.time,
                  last_time_.value_or(0));
  if (!last_time_) last_face_time_ = task_start_ = frame.time;
  last_time_ = frame.time;
  const bool face = frame.points.cols() > 0 && frame.points.allFinite();
  if (face && id_ == 0) id_ = frame.id;
  if (face && frame.id != id_) {
    fail("another face");
  } else if (face) {
    last_face_time_ = frame.time;
    if (status_.state == LivenessState::kLook) {
      record_reference(frame);
      // A person who never looks into the camera gets no task.
      if (status_.state == LivenessState::kLook && frame.time - task_start_ > options_.task_s)
        fail("time");
    } else {
      check_task(frame);
    }
  } else if (id_ != 0 && frame.time - last_face_time_ > options_.lost_s) {
    fail("no face");
  } else if (frame.time - task_start_ > options_.task_s) {
    fail(status_.state == LivenessState::kLook ? "no face" : "time");
  }
  return status_;
}

}  // namespace tarsier::face::head
