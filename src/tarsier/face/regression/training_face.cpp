// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/training_face.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/shape/annotated_crop.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <utility>

namespace tarsier::face::regression {

namespace {

TrainingFace face_of(shape::AnnotatedCrop crop, const std::string& name,
                     const std::string& person) {
  TrainingFace face;
  face.gray = std::move(crop.image);
  face.points = std::move(crop.points);
  face.box = crop.box;
  face.scale = crop.scale;
  face.name = name;
  face.person = person;
  return face;
}

TrainingFace mirror_of(const TrainingFace& face, const std::vector<int>& mirror,
                       double to_the_right) {
  const shape::AnnotatedCrop crop{face.gray, face.points, face.box, face.scale};
  TrainingFace result =
      face_of(shape::mirrored(crop, mirror, to_the_right), face.name, face.person);
  result.mirrored = true;
  result.turned = face.turned;
  return result;
}

}  // namespace

double shape_size(const Eigen::Matrix2Xd& points) {
  if (points.cols() == 0) return 0;
  const Eigen::Vector2d center = points.rowwise().mean();
  return std::sqrt((points.colwise() - center).colwise().squaredNorm().mean());
}

Eigen::Matrix2Xd mean_shape(const std::vector<TrainingFace>& faces) {
  std::vector<Eigen::Matrix2Xd> shapes;
  shapes.reserve(faces.size());
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  return shape::train_shape_model(shapes).mean;
}

std::vector<TrainingFace> load_training_faces(const shape::LandmarkSet& set,
                                              const std::string& set_path,
                                              const LoadOptions& options, Progress& progress,
                                              const std::stop_token& stop,
                                              std::vector<std::string>& skipped) {
  options.check();
  set.check();
  const std::string name = set_path.empty() ? "the set" : set_path;
  if (options.mirror && set.mirror.empty()) {
    throw InputError(name,
                     "mirrored faces need the symmetry of the points, which this set "
                     "does not say; mark it with `landmarks annotate`");
  }
  std::vector<TrainingFace> faces;
  progress.begin("reading faces", static_cast<std::int64_t>(set.samples.size()), "images");
  std::string last_path;
  cv::Mat last;
  for (const shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(stop);
    progress.advance();
    const std::string path = shape::image_path(set_path, sample);
    if (!sample.is_complete()) {
      skipped.push_back(path + ": some points are missing");
      continue;
    }
    try {
      if (path != last_path || last.empty()) {
        last = read_gray_image(path);
        last_path = path;
      }
    } catch (const InputError& error) {
      last.release();
      skipped.emplace_back(error.what());
      continue;
    }
    if (shape_size(sample.points) < 2) {
      skipped.push_back(path + ": its points lie in one place");
      continue;
    }
    faces.push_back(
        face_of(shape::crop_around_points(last, sample, options.margin, options.largest),
                sample.image, sample.person));
    if (options.mirror) {
      faces.push_back(mirror_of(faces.back(), set.mirror, options.to_the_right));
    }
  }
  progress.end();
  if (faces.empty()) {
    throw InputError(name, skipped.empty() ? std::string("holds no samples")
                                           : fmt::format("no sample can be used; the first: {}",
                                                         skipped.front()));
  }
  return faces;
}

std::vector<TrainingFace> with_extra_faces(const std::vector<TrainingFace>& faces,
                                           const ExtraFaces& extra, const std::vector<int>& mirror,
                                           double to_the_right, std::uint64_t seed,
                                           Progress& progress, const std::stop_token& stop) {
  std::vector<std::vector<TrainingFace>> made(faces.size());
  const Rng root(seed);
  progress.begin("turning faces", static_cast<std::int64_t>(faces.size()), "faces");
  cv::parallel_for_(cv::Range(0, static_cast<int>(faces.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto f = static_cast<std::size_t>(i);
      progress.advance();
      if (faces[f].mirrored || faces[f].turned) continue;
      Rng rng = root.fork(f);
      for (TrainingFace& face : extra(faces[f], rng())) {
        TARSIER_REQUIRE(face.points.cols() == faces[f].points.cols() && face.points.allFinite() &&
                            face.gray.type() == CV_8UC1 && !face.gray.empty(),
                        "{}: an extra face has no grey image or other points", faces[f].name);
        face.turned = true;
        made[f].push_back(std::move(face));
        if (mirror.empty()) continue;
        const TrainingFace mirrored = mirror_of(made[f].back(), mirror, to_the_right);
        made[f].push_back(mirrored);
      }
    }
  });
  throw_if_stopped(stop);
  progress.end();
  std::vector<TrainingFace> all;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    all.push_back(faces[f]);
    if (f + 1 < faces.size() && faces[f + 1].mirrored) all.push_back(faces[++f]);
    const std::size_t source = faces[f].mirrored && f > 0 ? f - 1 : f;
    for (TrainingFace& face : made[source]) all.push_back(std::move(face));
  }
  return all;
}

}  // namespace tarsier::face::regression
