// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/head_view/view_train.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "verbs/landmarks/landmarks.h"
#include "verbs/pose/pose.h"
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct TrainViewFlags {
  PoseFlags pose;
  std::string pointing;
  std::vector<std::string> truths;
  SetFlags annotated;
  std::string output;
  std::string terms;
  double tilt_share = 0.9;
  bool leave_out = false;
  face::head_view::TrainViewOptions options;
};

// Files of truth are cut into so many parts, each of which is left out in turn.
constexpr int kParts = 7;

// An image: what landmarks make of it, and the truth.
struct Seen {
  std::optional<face::head_view::HeadView> view;
  face::head::HeadPose pose;
  face::head::HeadPose raw;  // before its covariance was calibrated
  Eigen::Matrix2Xd points;   // of the poser
  geometry::Camera camera;
};

class Collector {
 public:
  explicit Collector(const PoseFlags& flags) : Collector(options_of(flags)) {}

  [[nodiscard]] const face::head::HeadPoser& poser() const { return tracker_.finder().poser(); }

  // The one of an image's faces that is meant, with its pose; null: none.
  using Choice =
      std::function<const face::PosedFace*(const std::vector<face::PosedFace>&, cv::Size)>;

  [[nodiscard]] static const face::PosedFace* first(const std::vector<face::PosedFace>& faces,
                                                    cv::Size /*size*/) {
    return !faces.empty() && faces.front().pose ? &faces.front() : nullptr;
  }

  // The face whose box has the middle of `points`.
  [[nodiscard]] static const face::PosedFace* face_at(const std::vector<face::PosedFace>& faces,
                                                      const Eigen::Matrix2Xd& points) {
    const Eigen::Vector2d middle = points.rowwise().mean();
    for (const face::PosedFace& face : faces) {
      if (face.pose && face.face.box.contains(cv::Point2d(middle[0], middle[1]))) return &face;
    }
    return nullptr;
  }

  [[nodiscard]] Seen see(const std::string& path, const Choice& choice) {
    Frame frame;
    frame.image = read_image(path);
    frame.name = path;
    frame.still = true;
    const face::PoseResult result = tracker_.process(frame, state_);
    Seen seen;
    seen.camera = result.camera;
    const face::PosedFace* face = choice(result.faces, frame.image.size());
    if (face == nullptr) return seen;
    seen.pose = *face->pose;
    seen.points = face->face.points(Eigen::all, mapping_.landmarks);
    // The covariance as the poser has it, which a view's answer goes on from.
    Eigen::VectorXd sigma_px;
    if (face->face.visibility.sigma_px.size() > 0)
      sigma_px = face->face.visibility.sigma_px(mapping_.landmarks);
    seen.raw = seen.pose;
    if (const auto again = poser().pose(seen.points, seen.camera, sigma_px); again.pose)
      seen.raw = *again.pose;
    cv::Mat gray;
    seen.view =
        face::head_view::view_of_head(face::gray_of(frame.image, gray), seen.camera,
                                      seen.pose.camera_from_head, poser().model(), seen.points);
    return seen;
  }

  // Where the head of annotated points looks, in the camera's frame.
  [[nodiscard]] std::optional<Eigen::Matrix3d> rotation_of(const Eigen::Matrix2Xd& annotated,
                                                           const geometry::Camera& camera) const {
    const Eigen::Matrix2Xd points = annotated(Eigen::all, mapping_.landmarks);
    const face::head::HeadPoseResult result = poser().pose(points, camera);
    if (!result.pose) return std::nullopt;
    return result.pose->camera_from_head.rotation;
  }

  [[nodiscard]] int landmarks() const { return tracker_.finder().landmarks().points(); }

 private:
  explicit Collector(const face::PoseTrackerOptions& options)
      : Collector(load_pose_models(options), options) {}
  Collector(const face::PoseModels& models, const face::PoseTrackerOptions& options)
      : tracker_(models, options), mapping_(models.mapping) {}

  // From the landmarks alone, by a guessed camera.
  static face::PoseTrackerOptions options_of(const PoseFlags& flags) {
    face::PoseTrackerOptions options = pose_options(flags);
    options.refine = false;
    options.view.clear();
    options.camera.reset();
    return options;
  }

  face::PoseTracker tracker_;
  face::head::LandmarkMapping mapping_;
  face::PoseState state_;
};

struct Data {
  std::vector<Seen> seen;
  std::vector<face::head_view::ViewSample> samples;  // of those with a view, in their order
  std::vector<face::head::PointingOutcome> pointing;
  std::vector<std::string> sources;
  // Index into `seen` of each: -1 where nothing was found.
  std::vector<int> of_pointing;
  std::vector<std::pair<int, face::head::PosePair>> exact;
};

// Adds an image; returns its index, -1 where no head was found. `asked`: the forward direction is
// where a person was asked to look, in the view's frame; else the truth in the camera's.
int add(Data& data, Seen seen, int group, const Eigen::Vector3d& forward, bool asked) {
  if (!seen.view) return -1;
  const Eigen::Vector3d in_view =
      asked ? forward : seen.view->camera_from_view.transpose() * forward;
  data.samples.push_back(
      {*seen.view, face::head_view::direction_of(*seen.view, in_view), group, asked});
  data.seen.push_back(std::move(seen));
  return static_cast<int>(data.seen.size()) - 1;
}

// Adds an image whose rotation is known.
void add_exact(Data& data, Seen seen, int group, const std::string& image,
               const Eigen::Matrix3d& rotation) {
  const int at = add(data, std::move(seen), group, rotation * Eigen::Vector3d(0, 0, -1), false);
  if (at < 0) return;
  face::head::PosePair pair;
  pair.image = image;
  pair.truth = rotation;
  data.exact.emplace_back(at, pair);
}

void add_pointing(const TrainViewFlags& flags, Collector& collector, Data& data, Context& context) {
  // More than what is scored: corrections near its limits are interpolated, not extrapolated.
  const auto images = pointing_images(flags.pointing, 90, 60);
  context.progress->begin("Pointing'04", static_cast<std::int64_t>(images.size()), "images");
  for (const auto& [path, name] : images) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    const Eigen::Vector3d forward =
        face::head::forward_of_gaze({name.pan_deg, name.tilt_deg * flags.tilt_share});
    const auto in_box = [&image = path](const std::vector<face::PosedFace>& faces, cv::Size size) {
      return face_in_head_box(faces, image, size);
    };
    data.of_pointing.push_back(add(data, collector.see(path, in_box), name.person, forward, true));
    face::head::PointingOutcome outcome;
    outcome.image = path;
    outcome.truth = name;
    data.pointing.push_back(std::move(outcome));
  }
  context.progress->end();
  data.sources.emplace_back("Pointing'04");
}

void add_truth(const std::string& file, int number, Collector& collector, Data& data,
               Context& context) {
  const std::vector<face::head::PoseLine> lines = face::head::read_pose_lines(file);
  context.progress->begin(file, static_cast<std::int64_t>(lines.size()), "images");
  int count = 0;
  for (const face::head::PoseLine& line : lines) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    if (!line.rotation) continue;
    const int group = 1000 + kParts * number + count++ % kParts;
    add_exact(data, collector.see(image_of_truth(file, line.image), Collector::first), group,
              line.image, *line.rotation);
  }
  context.progress->end();
  data.sources.push_back(file);
}

// The truth is the pose of the annotated points.
void add_annotated(const SetFlags& set_flags, int number, Collector& collector, Data& data,
                   Context& context) {
  const face::shape::LandmarkSet set = face::shape::complete_samples(load_set(set_flags));
  if (set.points() != collector.landmarks()) {
    throw InputError(set_flags.input, fmt::format("has {} points, the landmark model has {}",
                                                  set.points(), collector.landmarks()));
  }
  context.progress->begin(set_flags.input, static_cast<std::int64_t>(set.samples.size()), "images");
  int count = 0;
  for (const face::shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    const int group = 1000 + kParts * number + count++ % kParts;
    const auto at_points = [&](const std::vector<face::PosedFace>& faces, cv::Size /*size*/) {
      return Collector::face_at(faces, sample.points);
    };
    Seen seen = collector.see(sample.image, at_points);
    if (!seen.view) continue;
    if (const auto rotation = collector.rotation_of(sample.points, seen.camera))
      add_exact(data, std::move(seen), group, sample.image, *rotation);
  }
  context.progress->end();
  data.sources.push_back(set_flags.input);
}

// Scores of the poses, one of each `seen`.
void print_scores(Data& data, const std::vector<face::head::HeadPose>& poses,
                  const Context& context, const std::string& what) {
  if (!data.pointing.empty()) {
    for (std::size_t i = 0; i < data.pointing.size(); ++i) {
      const int at = data.of_pointing[i];
      if (at < 0) continue;
      const face::head::HeadPose& pose = poses[static_cast<std::size_t>(at)];
      data.pointing[i].rotation = pose.camera_from_head.rotation;
      data.pointing[i].sigma_deg = sigmas_of(pose);
    }
    print_pointing(face::head::score_pointing(data.pointing), context, what);
  }
  if (data.exact.empty()) return;
  std::vector<face::head::PosePair> pairs;
  for (auto& [at, pair] : data.exact) {
    const face::head::HeadPose& pose = poses[static_cast<std::size_t>(at)];
    pair.rotation = pose.camera_from_head.rotation;
    pair.sigma_deg = sigmas_of(pose);
    pair.sigma_floor_deg = pose.sigma_floor_deg;
    pairs.push_back(pair);
  }
  const face::head::PoseScore score =
      face::head::score_poses(pairs, static_cast<int>(pairs.size()));
  if (context.json) {
    nlohmann::ordered_json line{{"set", "truth"},
                                {"what", what},
                                {"images", score.truths},
                                {"pitch_mae", score.pitch_mae_deg},
                                {"yaw_mae", score.yaw_mae_deg},
                                {"roll_mae", score.roll_mae_deg},
                                {"rotation_mean", score.mean_deg}};
    add_coverage(score.coverage, line);
    add_coverage(score.image_coverage, line, "_image");
    print_json(line);
  } else {
    print_text(fmt::format(
        "{}: {} images of exact truth: MAE pitch {:.2f} yaw {:.2f} roll {:.2f}, rotation mean "
        "{:.2f} degrees\n",
        what, score.truths, score.pitch_mae_deg, score.yaw_mae_deg, score.roll_mae_deg,
        score.mean_deg));
    print_text(coverage_text(score.coverage));
    print_text(coverage_text(score.image_coverage, " of the image (without the floor)"));
  }
}

void leave_out(Data& data, const Collector& collector, const TrainViewFlags& flags,
               const Context& context) {
  std::vector<face::head::HeadPose> poses;
  for (const Seen& seen : data.seen) poses.push_back(seen.pose);
  print_scores(data, poses, context, "landmarks alone");
  const std::vector<face::head_view::ViewAnswer> found =
      face::head_view::leave_groups_out(data.samples, flags.options);
  for (std::size_t i = 0; i < data.seen.size(); ++i) {
    const Seen& seen = data.seen[i];
    if (auto pose = face::head_view::refined_pose(found[i], *seen.view, collector.poser(),
                                                  seen.points, seen.camera, seen.raw, nullptr))
      poses[i] = std::move(*pose);
  }
  print_scores(data, poses, context, "refined, each person left out in turn");
}

nlohmann::json provenance(const TrainViewFlags& flags, const Data& data) {
  const face::head_view::TrainViewOptions& o = flags.options;
  nlohmann::json result{{"program", fmt::format("tarsier {}", version())},
                        {"data", data.sources},
                        {"views", data.samples.size()},
                        {"options",
                         {{"components", o.components},
                          {"offset_weight", o.offset_weight},
                          {"angle_weight", o.angle_weight},
                          {"gamma", o.gamma},
                          {"ridge", o.ridge},
                          {"group_error", o.group_error},
                          {"mirror", o.mirror},
                          {"tilt_share", flags.tilt_share}}}};
  if (!flags.terms.empty()) result["terms"] = flags.terms;
  return result;
}

ExitStatus run_train(TrainViewFlags& flags, Context& context) {
  if (flags.pointing.empty() && flags.truths.empty() && flags.annotated.input.empty())
    throw UsageError("give --pointing DIR, --truth FILE or --annotated SET");
  if (flags.output.empty() && !flags.leave_out) throw UsageError("give -o FILE or --leave-out");
  flags.options.check();
  flags.pose.refine = "none";
  Collector collector(flags.pose);
  Data data;
  if (!flags.pointing.empty()) add_pointing(flags, collector, data, context);
  for (std::size_t i = 0; i < flags.truths.size(); ++i)
    add_truth(flags.truths[i], static_cast<int>(i), collector, data, context);
  if (!flags.annotated.input.empty()) {
    const auto number = static_cast<int>(flags.truths.size());
    add_annotated(flags.annotated, number, collector, data, context);
  }
  std::string input = flags.pointing;
  if (input.empty()) input = flags.truths.empty() ? flags.annotated.input : flags.truths.front();
  try {
    if (flags.leave_out) leave_out(data, collector, flags, context);
    if (flags.output.empty()) return ExitStatus::kDone;
    const face::head_view::ViewModel model =
        face::head_view::train_view_model(data.samples, flags.options);
    face::head_view::write_view_model(flags.output, model, provenance(flags, data));
  } catch (const std::invalid_argument& error) {
    throw InputError(input, error.what());  // too few heads, or all alike
  }
  if (context.json) {
    print_json(nlohmann::ordered_json{{"output", flags.output}, {"views", data.samples.size()}});
  } else {
    print_text(fmt::format("{}: {} views\n", flags.output, data.samples.size()));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, TrainViewFlags& flags) {
  add_landmark_flags(verb, flags.pose.landmarks);
  verb.add_option("--head", flags.pose.head, "head model [head.json, which ships]");
  verb.add_option("--mapping", flags.pose.mapping,
                  "which landmark each head point is: lines \"head_point landmark\", from 0");
  verb.add_option("--focal", flags.pose.focal,
                  "focal length in px [1.3 times the image's larger side]")
      .check(above(0));
  verb.add_option("--pointing", flags.pointing,
                  "folder of the Pointing'04 head pose set: names carry the angles");
  verb.add_option("--tilt-share", flags.tilt_share,
                  "how much of the tilts in Pointing'04's names heads really tilted")
      .check(range(0.1, 1.5))
      .show_default();
  verb.add_option("--truth", flags.truths,
                  "JSON lines {\"image\", \"rotation\": [9 numbers]}, as `pose synth` writes them; "
                  "several may be given");
  verb.add_option("--annotated", flags.annotated.input,
                  "annotated faces, as `pose train-head` takes them: their truth is the pose of "
                  "the annotated points");
  verb.add_option("-o,--output", flags.output, "model file to write (.json)");
  verb.add_option("--terms", flags.terms, "terms of the data, kept in the model");
  verb.add_flag("--leave-out", flags.leave_out,
                "prints how good it is on people it has not seen: each is left out in turn "
                "(of --truth and --annotated, a seventh of the images)");
  face::head_view::TrainViewOptions& options = flags.options;
  bind_all(verb, options);
}

}  // namespace

void add_pose_train_view(Command& area, Context& context) {
  add_verb<TrainViewFlags>(area, "train-view",
                           "learns from images of known poses how heads "
                           "look, to correct poses (--view)",
                           context, add_flags, run_train);
}

}  // namespace tarsier::cli
