// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/detect/face_training.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/train/face_turn.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/train_boxes.h"
#include "verbs/pose/pose.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct FaceNetworkFlags : TrainingFlags {
  std::vector<std::string> without;
  std::string head;
  face::train::CopyOptions turned{.copies = 0};
  face::FaceTrainingOptions options;
};

std::vector<cv::Point2d> points_of(const Eigen::Matrix2Xd& shape) {
  std::vector<cv::Point2d> points;
  for (Eigen::Index i = 0; i < shape.cols(); ++i) points.emplace_back(shape(0, i), shape(1, i));
  return points;
}

// Uses boxes in the convention of the cascade if the landmarks are known, else the given boxes.
face::FaceImage face_image(face::shape::BoxedImage image) {
  face::FaceImage result;
  result.image = std::move(image.image);
  result.ignored = std::move(image.ignored);
  for (std::size_t i = 0; i < image.boxes.size(); ++i) {
    const bool known =
        i < image.shapes.size() && image.shapes[i].cols() == 68 && image.shapes[i].allFinite();
    result.faces.push_back(
        known ? face::landmarks::box_around(face::landmarks::cascade_box(), image.shapes[i])
              : image.boxes[i]);
    result.points.push_back(known ? points_of(image.shapes[i]) : std::vector<cv::Point2d>());
  }
  return result;
}

constexpr double kTurnedFace = 100;  // px, width of rotated faces

// Images of the faces that have the head model's points, rotated in 3D and cropped to the face.
std::vector<face::FaceImage> turned_faces(const FaceNetworkFlags& flags,
                                          const std::vector<face::shape::BoxedImage>& images,
                                          Context& context) {
  const face::train::FaceTurner turner(read_head(flags.head));
  const face::landmarks::BoxModel box = face::landmarks::cascade_box();
  std::vector<std::vector<face::FaceImage>> found(images.size());
  context.progress->begin("turning", static_cast<std::int64_t>(images.size()), "images");
  const auto turn = [&](std::size_t number) {
    const face::shape::BoxedImage& image = images[number];
    for (std::size_t i = 0; i < image.shapes.size(); ++i) {
      const Eigen::Matrix2Xd& points = image.shapes[i];
      if (points.cols() != turner.points() || !points.allFinite()) continue;
      const cv::Mat whole = read_gray_image(image.image);
      const cv::Rect2d around = face::landmarks::box_around(box, points);
      const cv::Rect area = cv::Rect(cv::Rect2d(around.x - around.width, around.y - around.width,
                                                3 * around.width, 3 * around.width)) &
                            cv::Rect(0, 0, whole.cols, whole.rows);
      if (area.empty()) continue;
      face::regression::TrainingFace face;
      const double scale = std::min(1.0, kTurnedFace / around.width);
      cv::resize(whole(area), face.gray, cv::Size(), scale, scale, cv::INTER_AREA);
      const Eigen::Vector2d corner(area.x - 0.5, area.y - 0.5);  // of the crop's first pixel
      face.points = ((points.colwise() - corner) * scale).array() - 0.5;
      const std::uint64_t seed = Rng(context.seed).fork(number).fork(i)();
      for (const face::regression::TrainingFace& copy :
           face::train::turned_copies(turner, face, flags.turned, seed)) {
        found[number].push_back({image.image + ", turned",
                                 {face::landmarks::box_around(box, copy.points)},
                                 {},
                                 copy.gray,
                                 {points_of(copy.points)}});
      }
    }
  };
  cv::parallel_for_(cv::Range(0, static_cast<int>(images.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !context.stop.stop_requested(); ++i) {
      try {
        turn(static_cast<std::size_t>(i));
      } catch (const InputError&) {  // the training reports images that cannot be read
      }
      context.progress->advance();
    }
  });
  context.progress->end();
  throw_if_stopped(context.stop);
  std::vector<face::FaceImage> all;
  for (std::vector<face::FaceImage>& part : found) {
    std::move(part.begin(), part.end(), std::back_inserter(all));
  }
  return all;
}

ExitStatus train_networks(FaceNetworkFlags& flags, Context& context) {
  const Stopwatch watch;
  flags.options.seed = context.seed;
  std::vector<face::shape::BoxedImage> boxed = load_boxes(flags.set, flags.hold_out, Part::kOthers);
  std::vector<face::FaceImage> images;
  if (flags.turned.copies > 0) images = turned_faces(flags, boxed, context);
  const std::size_t turned = images.size();
  if (flags.turned.copies > 0 && turned == 0) {
    throw UsageError(
        "--turned: no face has the points of the head; --head takes one that `pose train-head` "
        "learnt from such a set");
  }
  for (const std::string& folder : flags.without) add_images_without(folder, boxed);
  for (face::shape::BoxedImage& image : boxed) images.push_back(face_image(std::move(image)));
  const face::FaceTraining trained = face::train_face_networks(
      images, flags.set.input, flags.options, *context.progress, context.stop);
  warn_of_skipped(trained.skipped);
  const double seconds = rounded(watch.seconds(), 1);
  nlohmann::json about = box_training_provenance(flags, context);
  about.update({{"faces", trained.faces},
                {"turned", turned},
                {"without", trained.without_faces},
                {"drawings", flags.options.drawings},
                {"held_out", trained.held_out},
                {"held_out_likely", trained.held_out_likely},
                {"held_out_alarms", trained.held_out_alarms}});
  face::write_face_networks(flags.output, trained.networks, about);
  if (context.json) {
    const nlohmann::ordered_json line = {
        {"output", flags.output},
        {"faces", trained.faces},
        {"turned", turned},
        {"without", trained.without_faces},
        {"sure", trained.networks.confident_score},
        {"held_out", trained.held_out},
        {"held_out_likely", trained.held_out_likely},
        {"held_out_alarms", trained.held_out_alarms},
        {"mistakes",
         {trained.scan_false_positives, trained.refine_false_positives,
          trained.verify_false_positives}},
        {"seconds", seconds}};
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format(
        "{}: {} faces, {} images without faces; hard examples of the three networks: {}, {}, {}; "
        "{} s\n"
        "a face is certain above a score of {:.3f}: {} false alarms in {} held-out images\n",
        flags.output, trained.faces, trained.without_faces, trained.scan_false_positives,
        trained.refine_false_positives, trained.verify_false_positives, seconds,
        trained.networks.confident_score, trained.held_out_alarms, trained.held_out));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, FaceNetworkFlags& flags) {
  add_training_flags(verb, flags);
  verb.add_option("--without", flags.without,
                  "folders of images without faces: negatives; every third is held out to set the "
                  "threshold")
      .required();
  bind_field(verb, flags.options, flags.options.false_alarms);
  bind_field(verb, flags.turned, flags.turned.copies, {},
             "number of copies of each face with landmarks to add, rotated in 3D");
  verb.add_option("--head", flags.head, "3D head model for the rotated copies (.json)");
  bind_field(verb, flags.options, flags.options.disguised);
  bind_field(verb, flags.options, flags.options.drawings);
  bind_field(verb, flags.options, flags.options.scan_steps);
  bind_field(verb, flags.options, flags.options.refine_steps);
  bind_field(verb, flags.options, flags.options.verify_steps);
}

}  // namespace

void add_landmarks_train_networks(Command& parent, Context& context) {
  add_verb<FaceNetworkFlags>(
      parent, "face-networks",
      "train the face detection networks, for faces of any size, from boxes or landmarks", context,
      add_flags, train_networks);
}

}  // namespace tarsier::cli
