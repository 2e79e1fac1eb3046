// SPDX-License-Identifier: MIT
#include "tarsier/landmarks/training_face.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::landmarks {

namespace {

// The face with its margin, at most as large as asked. Pixel centres stay where they were: a
// reduced pixel k covers the pixels from k / scale on, so that its centre is at
// (k + 0.5) / scale - 0.5.
TrainingFace cut_out(const cv::Mat& gray, const shape::LandmarkSample& sample,
                     const LoadOptions& options) {
  const double left = sample.points.row(0).minCoeff();
  const double right = sample.points.row(0).maxCoeff();
  const double top = sample.points.row(1).minCoeff();
  const double bottom = sample.points.row(1).maxCoeff();
  const double side = std::max({right - left, bottom - top, 1.0});
  const double margin = options.margin * side;
  const cv::Rect wanted(cv::Point(static_cast<int>(std::floor(left - margin)),
                                  static_cast<int>(std::floor(top - margin))),
                        cv::Point(static_cast<int>(std::ceil(right + margin)) + 1,
                                  static_cast<int>(std::ceil(bottom + margin)) + 1));
  cv::Rect area = wanted & cv::Rect(0, 0, gray.cols, gray.rows);
  if (area.empty()) area = cv::Rect(0, 0, gray.cols, gray.rows);
  const double scale = std::min(1.0, options.largest / side);

  TrainingFace face;
  const cv::Size size(std::max(1, static_cast<int>(std::lround(area.width * scale))),
                      std::max(1, static_cast<int>(std::lround(area.height * scale))));
  if (size == area.size()) {
    face.gray = gray(area).clone();
  } else {
    cv::resize(gray(area), face.gray, size, 0, 0, cv::INTER_AREA);
  }
  const double sx = static_cast<double>(size.width) / area.width;
  const double sy = static_cast<double>(size.height) / area.height;
  face.scale = 1 / sx;
  face.points = sample.points;
  face.points.row(0) = ((sample.points.row(0).array() - area.x + 0.5) * sx - 0.5).matrix();
  face.points.row(1) = ((sample.points.row(1).array() - area.y + 0.5) * sy - 0.5).matrix();
  if (sample.box) {
    face.box = cv::Rect2d((sample.box->x - area.x + 0.5) * sx - 0.5,
                          (sample.box->y - area.y + 0.5) * sy - 0.5, sample.box->width * sx,
                          sample.box->height * sy);
  }
  face.name = sample.image;
  face.person = sample.person;
  return face;
}

TrainingFace mirror_of(const TrainingFace& face, const std::vector<int>& mirror,
                       double to_the_right) {
  shape::LandmarkSample sample;
  sample.points = face.points;
  sample.box = face.box;
  const shape::LandmarkSample turned = shape::mirrored(sample, mirror, face.gray.cols);
  TrainingFace result;
  cv::flip(face.gray, result.gray, 1);
  result.points = turned.points;
  result.points.row(0).array() += 2 * to_the_right / face.scale;
  result.scale = face.scale;
  result.box = turned.box;
  result.name = face.name;
  result.person = face.person;
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

std::vector<TrainingFace> load_training_faces(const shape::LandmarkSet& set,
                                              const std::string& set_path,
                                              const LoadOptions& options, Progress& progress,
                                              const std::stop_token& stop,
                                              std::vector<std::string>& skipped) {
  TARSIER_REQUIRE(options.margin >= 0 && options.margin <= 4, "margin {}", options.margin);
  TARSIER_REQUIRE(std::abs(options.to_the_right) <= 100, "to the right {}", options.to_the_right);
  TARSIER_REQUIRE(options.largest >= 50 && options.largest <= 4000, "largest {}", options.largest);
  set.check();
  if (options.mirror && set.mirror.empty()) {
    throw InputError(set_path,
                     "mirrored faces need the symmetry of the points, which this set "
                     "does not say; mark it with `landmarks annotate`");
  }
  std::vector<TrainingFace> faces;
  progress.begin("reading faces", static_cast<std::int64_t>(set.samples.size()), "pictures");
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
    faces.push_back(cut_out(last, sample, options));
    if (options.mirror) {
      faces.push_back(mirror_of(faces.back(), set.mirror, options.to_the_right));
    }
  }
  progress.end();
  if (faces.empty()) {
    throw InputError(set_path, skipped.empty() ? std::string("holds no samples")
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
                        "{}: an extra face is none", faces[f].name);
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

}  // namespace tarsier::landmarks
