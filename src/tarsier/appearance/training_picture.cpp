// SPDX-License-Identifier: MIT
#include "tarsier/appearance/training_picture.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::appearance {
namespace {

// Pixel centres stay where they were: a reduced pixel k has its centre at (k + 0.5) / scale - 0.5.
TrainingPicture cut_out(const cv::Mat& image, const shape::LandmarkSample& sample,
                        const LoadOptions& options) {
  const Eigen::Vector2d low = sample.points.rowwise().minCoeff();
  const Eigen::Vector2d high = sample.points.rowwise().maxCoeff();
  const double side = std::max((high - low).maxCoeff(), 1.0);
  const double margin = options.margin * side;
  const auto bounded = [](double value, int most) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(most)));
  };
  cv::Rect area(cv::Point(bounded(std::floor(low.x() - margin), image.cols),
                          bounded(std::floor(low.y() - margin), image.rows)),
                cv::Point(bounded(std::ceil(high.x() + margin) + 1, image.cols),
                          bounded(std::ceil(high.y() + margin) + 1, image.rows)));
  if (area.empty()) area = cv::Rect(0, 0, image.cols, image.rows);
  const double scale = std::min(1.0, options.largest / side);

  TrainingPicture result;
  const cv::Size size(std::max(1, static_cast<int>(std::lround(area.width * scale))),
                      std::max(1, static_cast<int>(std::lround(area.height * scale))));
  if (size == area.size()) {
    result.picture = image(area).clone();
  } else {
    cv::resize(image(area), result.picture, size, 0, 0, cv::INTER_AREA);
  }
  const double sx = static_cast<double>(size.width) / area.width;
  const double sy = static_cast<double>(size.height) / area.height;
  result.scale = 1 / sx;
  result.points = sample.points;
  result.points.row(0) = ((sample.points.row(0).array() - area.x + 0.5) * sx - 0.5).matrix();
  result.points.row(1) = ((sample.points.row(1).array() - area.y + 0.5) * sy - 0.5).matrix();
  if (sample.box) {
    result.box = cv::Rect2d((sample.box->x - area.x + 0.5) * sx - 0.5,
                            (sample.box->y - area.y + 0.5) * sy - 0.5, sample.box->width * sx,
                            sample.box->height * sy);
  }
  result.name = sample.image;
  result.person = sample.person;
  return result;
}

}  // namespace

void LoadOptions::check() const {
  TARSIER_REQUIRE(margin >= 0 && margin <= 4, "margin {}", margin);
  TARSIER_REQUIRE(largest >= 50 && largest <= 4000, "largest {}", largest);
}

std::vector<TrainingPicture> load_training_pictures(const shape::LandmarkSet& set,
                                                    const std::string& set_path,
                                                    const LoadOptions& options, Progress& progress,
                                                    const std::stop_token& stop,
                                                    std::vector<std::string>& skipped) {
  options.check();
  set.check();
  std::vector<TrainingPicture> result;
  progress.begin("reading pictures", static_cast<std::int64_t>(set.samples.size()), "pictures");
  for (const shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(stop);
    progress.advance();
    const std::string path = shape::image_path(set_path, sample);
    if (!sample.is_complete() || sample.points.cols() < 3) {
      skipped.push_back(path + ": some points are missing");
      continue;
    }
    const Eigen::Vector2d extent =
        sample.points.rowwise().maxCoeff() - sample.points.rowwise().minCoeff();
    if (!(extent.minCoeff() >= 2)) {
      skipped.push_back(path + ": its points lie on one line or in one place");
      continue;
    }
    try {
      result.push_back(cut_out(read_image(path), sample, options));
    } catch (const InputError& error) {
      skipped.emplace_back(error.what());
    }
  }
  progress.end();
  if (result.empty()) {
    throw InputError(set_path.empty() ? "the set" : set_path,
                     skipped.empty()
                         ? std::string("holds no samples")
                         : fmt::format("no sample can be used; the first: {}", skipped.front()));
  }
  return result;
}

TrainingPicture mirrored(const TrainingPicture& picture, const std::vector<int>& mirror,
                         double to_the_right) {
  shape::LandmarkSample sample;
  sample.points = picture.points;
  sample.box = picture.box;
  const shape::LandmarkSample turned = shape::mirrored(sample, mirror, picture.picture.cols);
  TrainingPicture result;
  cv::flip(picture.picture, result.picture, 1);
  result.points = turned.points;
  result.points.row(0).array() += 2 * to_the_right / picture.scale;
  result.box = turned.box;
  result.name = picture.name;
  result.person = picture.person;
  result.scale = picture.scale;
  return result;
}

}  // namespace tarsier::appearance
