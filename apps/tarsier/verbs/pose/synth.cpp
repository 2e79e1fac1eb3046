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

struct SynthFlags {
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
  double near = 450;
  double far = 800;
  double spread = 0.7;
  synth::FaceSceneOptions scene;
};

// A random position with the whole face inside the image.
geometry::Rigid3 random_pose(const SynthFlags& flags, const geometry::Camera& camera, Rng& rng) {
  constexpr double kRoom = 110;  // mm around the middle of a head
  const face::head::HeadAngles angles{rng.uniform(-flags.yaw, flags.yaw),
                                      rng.uniform(-flags.pitch, flags.pitch),
                                      rng.uniform(-flags.roll, flags.roll)};
  const double distance = rng.uniform(flags.near, flags.far);
  const auto across = [&](double side, double focal) {
    const double most = std::max(0.0, distance * side / (2 * focal) - kRoom);
    return rng.uniform(-most, most);
  };
  return {face::head::rotation_of_angles(angles),
          {across(camera.width, camera.fx), across(camera.height, camera.fy), distance}};
}

// A head that turns left and right while it nods more slowly.
geometry::Rigid3 turning_pose(const SynthFlags& flags, double phase) {
  constexpr double kTurn = 2 * std::numbers::pi;
  const face::head::HeadAngles angles{flags.yaw * std::sin(kTurn * phase),
                                      flags.pitch * std::sin(2 * kTurn * phase + 0.5),
                                      flags.roll * std::sin(kTurn * phase + 1)};
  const double middle = (flags.near + flags.far) / 2;
  const double swing = (flags.far - flags.near) / 4;
  return {face::head::rotation_of_angles(angles),
          {0, 10, middle + swing * std::sin(kTurn * phase)}};
}

// --- a video that performs the challenge of `people liveness --fixed-order` with the same --seed
// ---

constexpr double kActFps = 15;
constexpr double kActLook = 1.5;  // s, looking into the camera
constexpr double kActTask = 2.5;  // s per task, including the return

struct Act {
  face::head::HeadAngles angles;
  double open = 1;  // opening of the lids
};

// Rises smoothly from 0 to 1 and back between `from` and `to`.
double swell(double t, double from, double to) {
  if (t <= from || t >= to) return 0;
  return 0.5 - 0.5 * std::cos(2 * std::numbers::pi * (t - from) / (to - from));
}

Act act_at(const SynthFlags& flags, const std::vector<face::head::LivenessTask>& tasks,
           double time) {
  Act act;
  act.angles = {1.5 * std::sin(1.1 * time), 1.5 * std::sin(0.8 * time + 1),
                std::sin(0.6 * time + 2)};  // nobody keeps quite still
  const double since = time - kActLook;
  if (since < 0) return act;
  const auto which = static_cast<std::size_t>(since / kActTask);
  if (which >= tasks.size()) return act;
  const double t = since - kActTask * static_cast<double>(which);
  if (tasks[which] == face::head::LivenessTask::kBlink) {
    // A person who holds a photo tilts it, so that the eyes look narrower.
    if (flags.challenge == "photo")
      act.angles.pitch_deg += flags.pitch * swell(t, 0.4, 1.6);
    else
      act.open = 1 - swell(t, 0.8, 1.3);
  } else {
    const double sign = tasks[which] == face::head::LivenessTask::kTurnLeft ? -1 : 1;
    act.angles.yaw_deg += sign * flags.yaw * swell(t, 0.2, 2.2);
  }
  return act;
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
  Eigen::Matrix3d place;
  place << r.col(0), r.col(1), Eigen::Vector3d(0, 0, distance);
  const Eigen::Matrix3d h = k * place * on_print;
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

ExitStatus make_faces(SynthFlags& flags, Context& context) {
  const bool acted = !flags.challenge.empty();
  if (acted) {
    flags.video = true;
    flags.count = cvCeil(kActFps * (kActLook + kActTask * flags.tasks));
  }
  const auto tasks = acted ? face::head::draw_tasks(flags.tasks, context.seed)
                           : std::vector<face::head::LivenessTask>();
  if (flags.near > flags.far)
    throw UsageError(fmt::format("--near {} is beyond --far {}", flags.near, flags.far));
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
    const int who = i % people;
    const Act act = acted ? act_at(flags, tasks, i / kActFps) : Act();
    const double distance = (flags.near + flags.far) / 2;
    const bool photo = flags.challenge == "photo";
    const geometry::Rigid3 pose =
        acted ? geometry::Rigid3{face::head::rotation_of_angles(photo ? face::head::HeadAngles()
                                                                      : act.angles),
                                 {0, 10, distance}}
        : flags.video ? turning_pose(flags, static_cast<double>(i) / flags.count)
                      : random_pose(flags, camera, rng);
    // In a video only the noise changes.
    cv::Mat image;
    const synth::FacePerson person =
        faces.person(context.seed * 1000 + static_cast<std::uint64_t>(who), flags.spread);
    const std::uint64_t ground = flags.video ? context.seed : rng();
    const synth::FaceTruth truth = faces.draw(image, person, camera, pose, flags.scene, ground);
    if (acted && !photo && act.open < 1)
      close_eyes(synthesis, model, image, truth.points, act.open);
    if (photo) {
      if (print.empty()) print = image.clone();
      image = turned_print(print, camera, distance, act.angles);
    }
    const std::string name = fmt::format("images/{:04}.png", i);
    write_image((folder / name).string(), image);
    const nlohmann::ordered_json line = truth_line(name, truth, camera);
    lines += line.dump() + "\n";
    if (context.json) print_json(line);
    face::shape::LandmarkSample sample;
    sample.image = name;
    sample.points = truth.points;
    sample.person = fmt::format("p{:03}", who);
    set.samples.push_back(std::move(sample));
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), lines);
  face::shape::write_landmark_set((folder / "set.json").string(), set, folder.string());
  if (!context.json && !context.quiet)
    print_text(fmt::format("{}: {} images of {} faces that nobody has\n", flags.output, flags.count,
                           people));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SynthFlags& flags) {
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
  verb.add_option("--near", flags.near, "minimum distance, mm")
      .check(range(200.0, 10000.0))
      .show_default();
  verb.add_option("--far", flags.far, "maximum distance, mm")
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
  add_verb<SynthFlags>(
      area, "synth",
      "render synthetic heads with ground truth: images/, truth.jsonl, set.json, camera.yaml",
      context, add_flags, make_faces);
}

}  // namespace tarsier::cli
