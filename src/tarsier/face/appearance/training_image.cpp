// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/training_image.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

namespace tarsier::face::appearance {

std::vector<TrainingImage> load_training_images(const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const LoadOptions& options, Progress& progress,
                                                const std::stop_token& stop,
                                                std::vector<std::string>& skipped) {
  options.check();
  set.check();
  std::vector<TrainingImage> result;
  progress.begin("reading images", static_cast<std::int64_t>(set.samples.size()), "images");
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
      result.push_back(
          {shape::crop_around_points(read_image(path), sample, options.margin, options.largest),
           sample.image, sample.person});
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

TrainingImage mirrored(const TrainingImage& image, const std::vector<int>& mirror,
                       double to_the_right) {
  return {shape::mirrored(static_cast<const shape::AnnotatedCrop&>(image), mirror, to_the_right),
          image.name, image.person};
}

}  // namespace tarsier::face::appearance
