// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head/blink.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// A liveness challenge: a person in front of a camera must blink and turn the head, in random
// order, each within a time limit. It distinguishes a face from a flat image of it that is held,
// moved and turned. It does not detect a video that shows the requested tasks, a mask, or a bent
// image.
//
// The reference is the mean of the points (iBUG's 68) over the first `look_s`. In each later frame,
// the affine map A from the reference's eye corners, mouth corners and sides of the nose to the
// current ones (least squares) predicts the motion of a flat image. With the nose tip x and a lid
// distance d,
//   parallax = (x_seen - A x_reference) . u / |A| e    u: from eye to eye, e: their distance, px
//   openness = d_seen / d_of(A lids of the reference)  the larger of both eyes
// For a plane, openness stays about 1 and parallax about 0, whatever its motion. For a head that is
// turned by the angle a, the nose tip moves by about 0.3 sin a to 0.45 sin a. A blink is detected
// from openness and from the appearance of the eyes at the positions given by A (blink.h).
namespace tarsier::face::head {

enum class LivenessTask { kBlink, kTurnLeft, kTurnRight };  // the person's own left and right
// "blink", "turn left", "turn right".
[[nodiscard]] std::string_view name_of(LivenessTask task);

struct LivenessOptions {
  int tasks = 3;               // number of tasks, never the same twice in a row
  double look_s = 0.7;         // duration of the reference, s
  double task_s = 6;           // time limit of each task, s
  double lost_s = 0.5;         // s without a face after which the challenge fails
  double turn_deg = 15;        // yaw relative to the reference
  double min_parallax = 0.06;  // in eye distances
  BlinkOptions blink;          // eyes that are shut for longer than its time are no blink

  [[nodiscard]] OptionFields fields() {
    return {{"tasks", tasks, range(2, 20), "--tasks", "number of tasks"},
            {"look_s", look_s, range(0.1, 10)},
            {"task_s", task_s, range(1, 60), "--task-time", "s, time limit of each task"},
            {"lost_s", lost_s, range(0, 10)},
            {"turn_deg", turn_deg, range(5, 60)},
            {"min_parallax", min_parallax, range(0, 1)}};
  }
  void check() const;  // throws std::invalid_argument
};

// One frame of the tested face.
struct LivenessFrame {
  double time = 0;          // s, rising
  Eigen::Matrix2Xd points;  // 2 x 68 px; empty: no face
  cv::Mat image;            // 8 bits, 1 or 3 channels; may be empty unless the task is a blink
  std::optional<double> yaw_deg;    // of the head, + to the image's left; empty: unknown
  std::optional<double> pitch_deg;  // + up; empty: unknown
  int id = 0;                       // of the tracked face
};

enum class LivenessState { kLook, kAsk, kPassed, kFailed };
// "look", "ask", "passed", "failed".
[[nodiscard]] std::string_view name_of(LivenessState state);

struct LivenessStatus {
  LivenessState state = LivenessState::kLook;
  std::optional<LivenessTask> task;  // the current task
  int done = 0;                      // completed tasks
  double remaining_s = 0;            // remaining time of the task
  double openness = 1;               // see above; of the latest frame
  double parallax = 0;
  std::string
      reason;  // for kFailed: "time", "flat" (turned, but like a plane), "no face", "another face"
};

// Random tasks, deterministic by the seed.
[[nodiscard]] std::vector<LivenessTask> draw_tasks(int count, std::uint64_t seed);

class Liveness {
 public:
  // Throws std::invalid_argument for invalid options.
  explicit Liveness(std::uint64_t seed, const LivenessOptions& options = {});
  // Processes the next frame. Throws std::invalid_argument for another number of points, a
  // decreasing time, and an unsupported image type if the task is a blink. Does nothing after the
  // challenge has passed or failed.
  const LivenessStatus& step(const LivenessFrame& frame);
  [[nodiscard]] const LivenessStatus& status() const { return status_; }
  [[nodiscard]] const std::vector<LivenessTask>& tasks() const { return tasks_; }

 private:
  void record_reference(const LivenessFrame& frame);
  AffineMap measure(const LivenessFrame& frame);  // returns the affine map A
  void check_task(const LivenessFrame& frame);
  void next_task(double time);
  void fail(std::string reason);

  LivenessOptions options_;
  std::vector<LivenessTask> tasks_;
  LivenessStatus status_;
  std::optional<double> start_;      // of the reference, s
  std::optional<double> last_time_;  // of any frame
  double last_face_time_ = 0;        // time of the last frame with a face
  int id_ = 0;
  Eigen::Matrix2Xd sum_;  // sum of points in the first frame's coordinates
  Eigen::Matrix2Xd first_;
  double yaw_sum_ = 0;
  double pitch_sum_ = 0;
  int frames_ = 0;
  Eigen::Matrix2Xd reference_;
  double yaw_ = 0;  // of the reference, degrees
  double pitch_ = 0;
  double task_start_ = 0;
  BlinkDetector blinks_;
  bool has_flat_turn_ = false;  // in this task the yaw was large enough, but not the parallax
};

}  // namespace tarsier::face::head
