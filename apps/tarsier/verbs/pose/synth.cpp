// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/edit.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/liveness.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/face/synth_face.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "framework/size_flag.h"
#include "verbs/aam/engine.h"
#include "verbs/pose/pose.h"
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct PoseSynthFlags {
  std::string output;
  std::string appearance;
  std::string head;
  std::string size = "640x480";
  int count = 20;
  int people = 0;
  bool video = false;
  std::string challenge;  // "head", "photo"; empty: none
  int tasks = 3;
  double yaw = 40;
  double pitch = 20;
  double roll = 15;
  double min_distance = 450;
  double max_distance = 800;
  double spread = 0.7;
  synth::FaceSceneOptions scene;
};

// A random position with the whole face inside the image.
geometry::Rigid3 random_pose(const PoseSynthFlags& flags, const geometry::Camera& camera,
                             Rng& rng) {
  constexpr double kHeadMargin_mm = 110;  // mm around the middle of a head
  const face::head::HeadAngles angles{rng.uniform(-flags.yaw, flags.yaw),
                                      rng.uniform(-flags.pitch, flags.pitch),
                                      rng.uniform(-flags.roll, flags.roll)};
  const double distance = rng.uniform(flags.min_distance, flags.max_distance);
  const auto random_offset = [&](double side, double focal) {
    const double max_offset = std::max(0.0, distance * side / (2 * focal) - kHeadMargin_mm);
    return rng.uniform(-max_offset, max_offset);
  };
  return {
      face::head::rotation_of_angles(angles),
      {random_offset(camera.width, camera.fx), random_offset(camera.height, camera.fy), distance}};
}

// A head that turns left and right while it nods more slowly.
geometry::Rigid3 turning_pose(const PoseSynthFlags& flags, double phase) {
  constexpr double kTwoPi = 2 * std::numbers::pi;
  const face::head::HeadAngles angles{flags.yaw * std::sin(kTwoPi * phase),
                                      flags.pitch * std::sin(2 * kTwoPi * phase + 0.5),
                                      flags.roll * std::sin(kTwoPi * phase + 1)};
  const double mean_distance = (flags.min_distance + flags.max_distance) / 2;
  const double swing = (flags.max_distance - flags.min_distance) / 4;
  return {face::head::rotation_of_angles(angles),
          {0, 10, mean_distance + swing * std::sin(kTwoPi * phase)}};
}

// --- a video that performs the challenge of `people liveness --fixed-order` with the same --seed
// ---

constexpr double kChallengeFps = 15;
constexpr double kLookDuration_s = 1.5;  // s, looking into the camera
constexpr double kTaskDuration_s = 2.5;  // s per task, including the return

struct ChallengePose {
  face::head::HeadAngles angles;
  double open = 1;  // opening of the lids
};

// Rises smoothly from 0 to 1 and back between `from` and `to`.
double smooth_pulse(double t, double from, double to) {
  if (t <= from || t >= to) return 0;
  return 0.5 - 0.5 * std::cos(2 * std::numbers::pi * (t - from) / (to - from));
}

ChallengePose challenge_pose_at(const PoseSynthFlags& flags,
                                const std::vector<face::head::LivenessTask>& tasks, double time) {
  ChallengePose challenge_pose;
  challenge_pose.angles = {1.5 * std::sin(1.1 * time), 1.5 * std::sin(0.8 * time + 1),
                           std::sin(0.6 * time + 2)};  // nobody keeps quite still
  const double task_time = time - kLookDuration_s;
  if (task_time < 0) return challenge_pose;
  const auto task_index = static_cast<std::size_t>(task_time / kTaskDuration_s);
  if (task_index >= tasks.size()) return challenge_pose;
  const double t = task_time - kTaskDuration_s * static_cast<double>(task_index);
  if (tasks[task_index] == face::head::LivenessTask::kBlink) {
    // A person who holds a photo tilts it, so that the eyes look narrower.
    if (flags.challenge == "photo")
      challenge_pose.angles.pitch_deg += flags.pitch * smooth_pulse(t, 0.4, 1.6);
    else
      challenge_pose.open = 1 - smooth_pulse(t, 0.8, 1.3);
  } else {
    const double sign = tasks[task_index] == face::head::LivenessTask::kTurnLeft ? -1 : 1;
    challenge_pose.angles.yaw_deg += sign * flags.yaw * smooth_pulse(t, 0.2, 2.2);
  }
  return challenge_pose;
}

// Lowers the upper lids over the eyes.
void close_eyes(const face::appearance::Synthesis& synthesis,
                const face::appearance::AppearanceModel& model, cv::Mat& image,
                const Eigen::Matrix2Xd& points, double open) {
  constexpr int kLids[4][2] = {{37, 41}, {38, 40}, {43, 47}, {44, 46}};
  Eigen::Matrix2Xd edited = points;
  for (const auto& lid : kLids)
    edited.col(lid[0]) = open * points.col(lid[0]) + (1 - open) * points.col(lid[1]);
  face::appearance::draw_edited(synthesis, model, image, points, edited);
}

// The image as a print that is held at `distance` (mm), where the face has its size, and rotated.
cv::Mat turned_print(const cv::Mat& image, const geometry::Camera& camera, double distance,
                     const face::head::HeadAngles& angles) {
  const Eigen::Matrix3d r = face::head::rotation_of_angles(angles);
  Eigen::Matrix3d k;
  k << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  // For a point of the print at (X, Y, 0): K (R (X, Y, 0) + t), X = (u - cx) distance / f.
  Eigen::Matrix3d on_print;
  on_print << distance / camera.fx, 0, -camera.cx * distance / camera.fx, 0, distance / camera.fy,
      -camera.cy * distance / camera.fy, 0, 0, 1;
  Eigen::Matrix3d camera_from_plane;
  camera_from_plane << r.col(0), r.col(1), Eigen::Vector3d(0, 0, distance);
  const Eigen::Matrix3d h = k * camera_from_plane * on_print;
  cv::Mat map(3, 3, CV_64F);
  for (int row = 0; row < 3; ++row)
    for (int col = 0; col < 3; ++col) map.at<double>(row, col) = h(row, col);
  cv::Mat out;
  cv::warpPerspective(image, out, map, image.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT,
                      cv::Scalar(70, 80, 75));
  return out;
}

nlohmann::ordered_json truth_line(const std::string& image, const synth::FaceTruth& truth,
                                  const geometry::Camera& camera) {
  const face::head::HeadAngles angles =
      face::head::angles_of_rotation(truth.camera_from_head.rotation);
  nlohmann::ordered_json line{{"image", image}};
  line["rotation"] = geometry::row_major(truth.camera_from_head.rotation);
  const Eigen::Vector3d& t = truth.camera_from_head.translation;
  line["translation"] = {t[0], t[1], t[2]};
  line["yaw"] = angles.yaw_deg;
  line["pitch"] = angles.pitch_deg;
  line["roll"] = angles.roll_deg;
  line["focal"] = camera.fx;
  line["points"] = nlohmann::json::array();
  for (Eigen::Index i = 0; i < truth.points.cols(); ++i)
    line["points"].push_back({truth.points(0, i), truth.points(1, i)});
  return line;
}

ExitStatus make_heads(PoseSynthFlags& flags, Context& context) {
  const bool performs_challenge = !flags.challenge.empty();
  if (performs_challenge) {
    flags.video = true;
    flags.count = cvCeil(kChallengeFps * (kLookDuration_s + kTaskDuration_s * flags.tasks));
  }
  const auto tasks = performs_challenge ? face::head::draw_tasks(flags.tasks, context.seed)
                                        : std::vector<face::head::LivenessTask>();
  if (flags.min_distance > flags.max_distance)
    throw UsageError(
        fmt::format("--near {} is beyond --far {}", flags.min_distance, flags.max_distance));
  flags.scene.check();
  const cv::Size size = parse_size(flags.size, 64, 4096);
  geometry::Camera camera = face::head::guess_camera(size);
  const std::string path = flags.appearance.empty() ? shipped_appearance_model() : flags.appearance;
  const face::appearance::AppearanceModel model = face::appearance::read_appearance_model(path);
  if (!model.colour) throw ModelError(path, "has no colour texture to draw faces with");
  face::head::HeadModel head = read_head(flags.head);
  if (head.points() != model.points())
    throw ModelError(path,
                     fmt::format("has {} points, the head {}", model.points(), head.points()));
  const synth::FaceSynth faces(model, std::move(head));
  const face::appearance::Synthesis synthesis(model);
  cv::Mat print;

  const fs::path folder = flags.output;
  make_folder((folder / "images").string());
  geometry::write_camera_file((folder / "camera.yaml").string(), camera);
  face::shape::LandmarkSet set;
  if (const auto markup = face::shape::known_markup(model.points())) {
    set.mirror = markup->mirror;
    set.connections = markup->connections;
  }
  const int people = flags.people > 0 ? flags.people : flags.video ? 1 : flags.count;
  const Rng seeds(context.seed);
  std::string lines;
  context.progress->begin("drawing", flags.count, "images");
  for (int i = 0; i < flags.count; ++i) {
    throw_if_stopped(context.stop);
    Rng rng = seeds.fork(static_cast<std::uint64_t>(i));
    const int person_index = i % people;
    const ChallengePose challenge_pose =
        performs_challenge ? challenge_pose_at(flags, tasks, i / kChallengeFps) : ChallengePose();
    const double distance = (flags.min_distance + flags.max_distance) / 2;
    const bool photo = flags.challenge == "photo";
    const geometry::Rigid3 pose =
        performs_challenge
            ? geometry::Rigid3{face::head::rotation_of_angles(photo ? face::head::HeadAngles()
                                                                    : challenge_pose.angles),
                               {0, 10, distance}}
        : flags.video ? turning_pose(flags, static_cast<double>(i) / flags.count)
                      : random_pose(flags, camera, rng);
    // In a video only the noise changes.
    cv::Mat image;
    const synth::FacePerson person =
        faces.person(context.seed * 1000 + static_cast<std::uint64_t>(person_index), flags.spread);
    const std::uint64_t ground = flags.video ? context.seed : rng();
    const synth::FaceTruth truth = faces.draw(image, person, camera, pose, flags.scene, ground);
    if (performs_challenge && !photo && challenge_pose.open < 1)
      close_eyes(synthesis, model, image, truth.points, challenge_pose.open);
    if (photo) {
      if (print.empty()) print = image.clone();
      image = turned_print(print, camera, distance, challenge_pose.angles);
    }
    const std::string name = fmt::format("images/{:04}.png", i);
    write_image((folder / name).string(), image);
    const nlohmann::ordered_json line = truth_line(name, truth, camera);
    lines += line.dump() + "\n";
    if (context.json) print_json(line);
    face::shape::LandmarkSample sample;
    sample.image = name;
    sample.points = truth.points;
    sample.person = fmt::format("p{:03}", person_index);
    set.samples.push_back(std::move(sample));
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), lines);
  face::shape::write_landmark_set((folder / "set.json").string(), set, folder.string());
  if (!context.json && !context.quiet)
    print_text(
        fmt::format("{}: {} images of {} synthetic people\n", flags.output, flags.count, people));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, PoseSynthFlags& flags) {
  verb.add_option("-o,--output", flags.output, "output folder").required();
  verb.add_option("--count", flags.count, "images").check(range(1, 100000)).show_default();
  verb.add_option(
          "--people", flags.people,
          "number of different people, in turn; 0: a new one for each image; with --video one")
      .check(range(0, 100000))
      .show_default();
  verb.add_flag("--video", flags.video, "render one rotating head, frame by frame");
  verb.add_option("--challenge", flags.challenge,
                  "render a video (15 fps) for `people liveness --fixed-order` with this --seed: "
                  "of a live head or a rotated photo")
      .check(one_of({"head", "photo"}));
  verb.add_option("--tasks", flags.tasks, "number of tasks of --challenge")
      .check(range(1, 20))
      .show_default();
  verb.add_option("--size", flags.size, "px").show_default();
  verb.add_option("--yaw", flags.yaw, "degrees, maximum absolute yaw")
      .check(range(0.0, 80.0))
      .show_default();
  verb.add_option("--pitch", flags.pitch, "degrees, maximum absolute pitch")
      .check(range(0.0, 60.0))
      .show_default();
  verb.add_option("--roll", flags.roll, "degrees, maximum absolute roll")
      .check(range(0.0, 180.0))
      .show_default();
  verb.add_option("--near", flags.min_distance, "minimum distance, mm")
      .check(range(200.0, 10000.0))
      .show_default();
  verb.add_option("--far", flags.max_distance, "maximum distance, mm")
      .check(range(200.0, 10000.0))
      .show_default();
  verb.add_option("--spread", flags.spread, "variation between people; 1: as in reality")
      .check(range(0.0, 2.0))
      .show_default();
  bind_field(verb, flags.scene, flags.scene.noise);
  bind_field(verb, flags.scene, flags.scene.blur_px);
  verb.add_option("--appearance", flags.appearance, "appearance model [aam68.json, shipped]");
  verb.add_option("--head", flags.head, "head model [head.json, shipped]");
}

}  // namespace

void add_pose_synth(Command& area, Context& context) {
  add_verb<PoseSynthFlags>(
      area, "synth",
      "render synthetic heads with ground truth: images/, truth.jsonl, set.json, camera.yaml",
      context, add_flags, make_heads);
}

}  // namespace tarsier::cli
