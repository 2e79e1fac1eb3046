// SPDX-License-Identifier: MIT
#include "tarsier/face/head/liveness.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/testing_eyes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>
#include <stdexcept>

namespace tarsier::face::head {
namespace {

using ::testing::ElementsAreArray;

constexpr Eigen::Index kIris = 12;  // points

// 68 points of a head made by formulas and the outlines of its irises, mm, in the head's frame (x
// right, y down, z away from the camera). `open` is the opening of the lids, 1: open.
Eigen::Matrix3Xd formula_head(double open) {
  Eigen::Matrix3Xd x = Eigen::Matrix3Xd::Zero(3, 68 + 2 * kIris);
  for (int i = 0; i < 17; ++i) {  // outline
    const double a = (i - 8) * 0.19;
    x.col(i) << 68 * std::sin(a), 20 + 75 * std::cos(a), 60 - 50 * std::cos(a);
  }
  for (int i = 0; i < 5; ++i) {  // brows
    x.col(17 + i) << -55 + 10 * i, -22, 2;
    x.col(22 + i) << 15 + 10 * i, -22, 2;
  }
  for (int i = 0; i < 4; ++i) x.col(27 + i) << 0, 12 * i, -4 - 8 * i;  // bridge to tip: -28
  for (int i = 0; i < 5; ++i) x.col(31 + i) << -14 + 7 * i, 42, -10 - 3 * (2 - std::abs(i - 2));
  for (int eye = 0; eye < 2; ++eye) {
    const double center = eye == 0 ? -31 : 31;
    const double dx[6] = {-14, -5, 5, 14, 5, -5};
    const double dy[6] = {0, -5, -5, 0, 5, 5};
    for (int k = 0; k < 6; ++k) x.col(36 + 6 * eye + k) << center + dx[k], open * dy[k], 2;
    for (Eigen::Index k = 0; k < kIris; ++k) {
      const double a = 2 * 3.14159265358979 * static_cast<double>(k) / kIris;
      x.col(68 + kIris * eye + k) << center + 5 * std::cos(a), 5 * std::sin(a), 2;
    }
  }
  for (int k = 0; k < 20; ++k) {  // mouth
    const double a = 2 * 3.14159265358979 * (k < 12 ? k / 12.0 : (k - 12) / 8.0);
    const double r = k < 12 ? 1 : 0.6;
    x.col(48 + k) << -25 * r * std::cos(a), 66 - 9 * r * std::sin(a), -3;
  }
  return x;
}

// Projection with a focal length of 800 px at 600 mm.
Eigen::Matrix2Xd centred_image_of(const Eigen::Matrix3Xd& shape, const HeadAngles& angles,
                                  double noise, Rng& rng) {
  const Eigen::Matrix3d rotation = rotation_of_angles(angles);
  Eigen::Matrix2Xd out(2, shape.cols());
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    const Eigen::Vector3d p = rotation * shape.col(i) + Eigen::Vector3d(0, 0, 600);
    const double dx = noise * rng.normal();
    const double dy = noise * rng.normal();
    out.col(i) << 320 + 800 * p.x() / p.z() + dx, 240 + 800 * p.y() / p.z() + dy;
  }
  return out;
}

// An actor, live or not, that receives the tasks.
struct Motion {
  HeadAngles angles;
  double open = 1;
};
using MotionScript = std::function<Motion(const LivenessStatus&, double time)>;

// A live person: turns by `degrees`, or shuts the eyes for 0.2 s.
MotionScript person(double degrees) {
  return [degrees, since = 0.0, last = -1](const LivenessStatus& status, double time) mutable {
    Motion motion;
    if (status.done != last) {
      last = status.done;
      since = time;
    }
    const double t = time - since;
    if (!status.task) return motion;
    if (*status.task == LivenessTask::kBlink) {
      motion.open = t > 0.8 && t < 1.0 ? 0.1 : 1;
    } else if (t > 0.3) {
      const double turn = std::min(degrees, 40 * (t - 0.3));
      motion.angles.yaw_deg = *status.task == LivenessTask::kTurnLeft ? -turn : turn;
    }
    // The head need not return to the middle before the next task. Each task is measured relative
    // to its own start.
    return motion;
  };
}

LivenessStatus run_challenge(std::uint64_t seed, const MotionScript& script, bool flat,
                             double noise = 0.5, const LivenessOptions& options = {}) {
  Liveness liveness(seed, options);
  Rng rng(seed + 1000);
  for (double time = 0; time < 40; time += 1 / test_support::kFps) {
    const Motion motion = script(liveness.status(), time);
    Eigen::Matrix3Xd shape = formula_head(flat ? 1 : motion.open);
    if (flat) shape.row(2).setZero();
    LivenessFrame frame;
    frame.time = time;
    frame.id = 1;
    frame.points = centred_image_of(shape, motion.angles, noise, rng).leftCols(68);
    if (liveness.status().task == LivenessTask::kBlink)
      frame.image = test_support::image_of_eyes(centred_image_of(shape, motion.angles, 0, rng));
    frame.yaw_deg = motion.angles.yaw_deg + rng.normal();
    frame.pitch_deg = motion.angles.pitch_deg + rng.normal();
    const LivenessStatus& status = liveness.step(frame);
    if (status.state == LivenessState::kPassed || status.state == LivenessState::kFailed) break;
  }
  return liveness.status();
}

TEST(DrawTasks, AreDeterministicAndNeverRepeat) {
  std::set<std::vector<LivenessTask>> orders;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const auto tasks = draw_tasks(4, seed);
    EXPECT_THAT(draw_tasks(4, seed), ElementsAreArray(tasks));
    for (std::size_t i = 1; i < tasks.size(); ++i) EXPECT_NE(tasks[i], tasks[i - 1]);
    orders.insert(tasks);
  }
  EXPECT_EQ(orders.size(), 24U) << "3 * 2 * 2 * 2 of them";
}

TEST(Liveness, PassesAPersonWhoPerformsTheTasks) {
  int passed = 0;
  for (std::uint64_t seed = 0; seed < 50; ++seed)
    passed += run_challenge(seed, person(25), false).state == LivenessState::kPassed ? 1 : 0;
  EXPECT_GE(passed, 49);
}

TEST(Liveness, RejectsTurnedFlatImage) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const LivenessStatus status = run_challenge(seed, person(35), true);
    EXPECT_EQ(status.state, LivenessState::kFailed) << seed;
  }
}

// A plane is moved in every direction, fast and slow, and nodded so that the eyes look narrower.
TEST(Liveness, RejectsWavedFlatImage) {
  int flat = 0;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const double rate = 0.5 + 0.1 * static_cast<double>(seed % 20);
    const LivenessStatus status = run_challenge(
        seed,
        [&](const LivenessStatus& now, double time) {
          Motion motion;
          if (!now.task) return motion;
          motion.angles = {45 * std::sin(rate * time), 50 * std::sin(0.7 * rate * time),
                           15 * std::sin(1.3 * rate * time)};
          return motion;
        },
        true);
    EXPECT_EQ(status.state, LivenessState::kFailed) << seed;
    flat += status.reason == "flat" ? 1 : 0;
  }
  EXPECT_GT(flat, 0) << "and says why";
}

TEST(Liveness, FailsWithoutMotionOrWithWrongMotion) {
  const auto still = [](const LivenessStatus&, double) { return Motion{}; };
  EXPECT_EQ(run_challenge(1, still, false).reason, "time");
  LivenessOptions turn;
  turn.tasks = 2;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto wrong = [&](const LivenessStatus& now, double time) {
      Motion motion = person(25)(now, time);
      if (!now.task) return motion;
      motion.angles.yaw_deg =
          *now.task == LivenessTask::kTurnLeft ? 25 : -25;  // the wrong direction
      return motion;
    };
    EXPECT_EQ(run_challenge(seed, wrong, false, 0.5, turn).state, LivenessState::kFailed) << seed;
  }
}

TEST(Liveness, FailsWithoutAFaceOrWithAnotherId) {
  Rng rng(1);
  const auto frame = [&](double time, int id) {
    LivenessFrame out;
    out.time = time;
    out.id = id;
    out.points = centred_image_of(formula_head(1), {}, 0.3, rng).leftCols(68);
    out.yaw_deg = 0;
    return out;
  };
  Liveness other(1);
  (void)other.step(frame(0, 1));
  EXPECT_EQ(other.step(frame(0.1, 2)).reason, "another face");
  EXPECT_EQ(other.step(frame(0.2, 1)).state, LivenessState::kFailed) << "it stays so";
  Liveness gone(1);
  (void)gone.step(frame(0, 1));
  LivenessFrame empty;
  empty.time = 0.4;
  EXPECT_EQ(gone.step(empty).state, LivenessState::kLook);
  empty.time = 0.6;
  EXPECT_EQ(gone.step(empty).reason, "no face");
  Liveness no_face(1);
  for (empty.time = 0; empty.time < 5; empty.time += 0.5)
    EXPECT_EQ(no_face.step(empty).state, LivenessState::kLook);
  empty.time = 7;
  EXPECT_EQ(no_face.step(empty).reason, "no face");
}

TEST(Liveness, RejectsInvalidArguments) {
  LivenessOptions bad;
  bad.blink.min_closing = -0.5;
  EXPECT_THROW(Liveness(1, bad), std::invalid_argument);
  Liveness liveness(1);
  LivenessFrame frame;
  frame.points = Eigen::Matrix2Xd::Zero(2, 5);
  EXPECT_THROW((void)liveness.step(frame), std::invalid_argument);
  frame.points.resize(2, 0);
  frame.time = 2;
  (void)liveness.step(frame);
  frame.time = 1;
  EXPECT_THROW((void)liveness.step(frame), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head
