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

// A challenge: somebody before a camera is asked to blink and to turn the head, in an order that is
// drawn by chance, each within a time. It tells a face from an image of it that is held, moved and
// turned as a plane. It does not stop a video that shows what is asked, a mask, or a bent image.
//
// The points of the first frames (mean over `look_s`, iBUG's 68) are the reference. In each later
// frame the affine map A that takes the reference's eye corners, corners of the mouth and sides of
// the nose to where they are seen (least squares) is what a flat image would do: with the tip of the
// nose x and a lid's distance d,
//   parallax = (x_seen - A x_reference) . u / |A| e    u: from eye to eye, e: their distance, px
//   openness = d_seen / d_of(A lids of the reference)  the smaller of closing: of both eyes the larger
// so that openness stays about 1 and parallax 0 for a plane, however it is moved. Of a head that is turned by
// the angle a the nose's tip moves by about 0.3 sin a to 0.45 sin a. A blink is judged by openness and by how the
// eyes look at the places of A (blink.h).
namespace tarsier::face::head {

enum class LivenessTask { kBlink, kTurnLeft, kTurnRight };  // their own left and right
// "blink", "turn left", "turn right".
[[nodiscard]] std::string_view name_of(LivenessTask task);

struct LivenessOptions {
  int tasks = 3;               // asked one after the other, never the same twice in a row
  double look_s = 0.7;         // of the reference, s
  double task_s = 6;           // time for each task, s
  double lost_s = 0.5;         // without a face, s, after which it fails
  double turn_deg = 15;        // of yaw, beyond that of the reference
  double min_parallax = 0.06;  // of the distance of the eyes
  BlinkOptions blink;          // eyes shut for longer than its time are no blink

  [[nodiscard]] OptionFields fields() {
    return {{"tasks", tasks, range(2, 20), "--tasks", "tasks that are asked"},
            {"look_s", look_s, range(0.1, 10)},
            {"task_s", task_s, range(1, 60), "--task-time", "s for each task"},
            {"lost_s", lost_s, range(0, 10)},
            {"turn_deg", turn_deg, range(5, 60)},
            {"min_parallax", min_parallax, range(0, 1)}};
  }
  void check() const;  // throws std::invalid_argument
};

// One frame of the face that is asked.
struct LivenessFrame {
  double time = 0;                  // s, rising
  Eigen::Matrix2Xd points;          // 2 x 68 px; none: no face
  cv::Mat image;                    // 8 bits, 1 or 3 channels; may be empty while no blink is asked
  std::optional<double> yaw_deg;    // of the head, + to the image's left; none: not known
  std::optional<double> pitch_deg;  // + up; none: not known
  int id = 0;                       // of the tracked face
};

enum class LivenessState { kLook, kAsk, kPassed, kFailed };
// "look", "ask", "passed", "failed".
[[nodiscard]] std::string_view name_of(LivenessState state);

struct LivenessStatus {
  LivenessState state = LivenessState::kLook;
  std::optional<LivenessTask> task;  // that is asked now
  int done = 0;                      // tasks
  double left_s = 0;                 // of the task's time
  double openness = 1;               // see above; of the latest frame
  double parallax = 0;
  std::string
      reason;  // of kFailed: "time", "flat" (turned, but as a plane turns), "no face", "another face"
};

// Tasks of a seed: each by chance, the same seed gives the same.
[[nodiscard]] std::vector<LivenessTask> draw_tasks(int count, std::uint64_t seed);

class Liveness {
 public:
  // Throws std::invalid_argument for options that do not pass their check.
  explicit Liveness(std::uint64_t seed, const LivenessOptions& options = {});
  // The next frame. Throws std::invalid_argument for points of another number, a time that falls,
  // and an image of another type where a blink is asked.
  // Nothing changes once it passed or failed.
  const LivenessStatus& step(const LivenessFrame& frame);
  [[nodiscard]] const LivenessStatus& status() const { return status_; }
  [[nodiscard]] const std::vector<LivenessTask>& tasks() const { return tasks_; }

 private:
  void look(const LivenessFrame& frame);
  AffineMap measure(const LivenessFrame& frame);  // that a flat image would have been moved by
  void ask(const LivenessFrame& frame);
  void next_task(double time);
  void fail(std::string reason);

  LivenessOptions options_;
  std::vector<LivenessTask> tasks_;
  LivenessStatus status_;
  std::optional<double> start_;      // of looking, s
  std::optional<double> last_time_;  // of any frame
  double seen_ = 0;                  // time of the last frame with a face
  int id_ = 0;
  Eigen::Matrix2Xd sum_;  // of points in the first frame's coordinates
  Eigen::Matrix2Xd first_;
  double yaw_sum_ = 0;
  double pitch_sum_ = 0;
  int frames_ = 0;
  Eigen::Matrix2Xd reference_;
  double yaw_ = 0;  // of the reference, degrees
  double pitch_ = 0;
  double task_start_ = 0;
  BlinkDetector blinks_;
  bool flat_turn_ = false;  // of this task: the yaw was there, the parallax was not
};

}  // namespace tarsier::face::head
