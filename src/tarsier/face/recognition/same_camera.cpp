// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/same_camera.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/evaluation.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace tarsier::face::recognition {
namespace {

// The scores that the background predicts for strangers to a gallery of one person. Such a gallery
// has no impostor scores, so its calibration is this prediction with the constants applied.
struct Expected {
  double mean = 0;
  double deviation = 0;
};
Expected expected_by(const Recognizer& model) {
  if (!model.calibration) throw std::invalid_argument("a gallery of one has no calibration");
  return {model.calibration->location - same_camera_adjustment(model.options.algorithm).shift,
          model.calibration->scale / same_camera_adjustment(model.options.algorithm).spread};
}

struct Gallery {
  Expected expected;
  std::vector<double> scores;  // of strangers
};

}  // namespace

SameCameraFit fit_same_camera(const std::vector<cv::Mat>& faces,
                              const std::vector<std::string>& labels, int training, int draws,
                              const Background& background, Progress& progress,
                              const std::stop_token& stop) {
  TARSIER_REQUIRE(faces.size() == labels.size(), "{} faces, {} labels", faces.size(),
                  labels.size());
  TARSIER_REQUIRE(training >= 1 && draws >= 1 && draws <= 1000, "{} images, {} draws", training,
                  draws);
  if (background.basis.rows() == 0)
    throw std::invalid_argument("needs a background that was learnt (people train)");
  const std::set<std::string> people(labels.begin(), labels.end());
  if (people.size() < 3) throw std::invalid_argument("needs at least three people");
  RecognizerOptions options;
  if (background.network) options.algorithm = Algorithm::kDeep;
  SameCameraFit out;
  out.people = static_cast<int>(people.size());
  // Embeddings do not depend on the gallery, so they are computed once.
  Rows coordinates;
  if (background.network) {
    coordinates.resize(static_cast<Eigen::Index>(faces.size()), coordinate_count(background));
    for (std::size_t i = 0; i < faces.size(); ++i) {
      throw_if_stopped(stop);
      const std::vector<float> row = coordinates_of(background, faces[i]);
      coordinates.row(static_cast<Eigen::Index>(i)) =
          Eigen::Map<const Eigen::RowVectorXf>(row.data(), coordinates.cols());
    }
  }
  std::vector<Gallery> galleries;
  NoProgress quiet;
  progress.begin("galleries of one", static_cast<std::int64_t>(people.size()) * draws, "galleries");
  for (int draw = 0; draw < draws; ++draw) {
    const Split split = split_of(labels, training, static_cast<std::uint64_t>(draw));
    for (const std::string& name : people) {
      throw_if_stopped(stop);
      progress.advance();
      std::vector<cv::Mat> own;
      Rows own_rows(static_cast<Eigen::Index>(split.training.size()), coordinates.cols());
      for (const int i : split.training)
        if (labels[static_cast<std::size_t>(i)] == name) {
          if (background.network)
            own_rows.row(static_cast<Eigen::Index>(own.size())) = coordinates.row(i);
          own.push_back(faces[static_cast<std::size_t>(i)]);
        }
      if (static_cast<int>(own.size()) < training) continue;  // this person has too few images
      const std::vector<std::string> names(own.size(), name);
      const Recognizer model =
          background.network
              ? train_coordinates(own_rows.topRows(static_cast<Eigen::Index>(own.size())), names,
                                  options, quiet, stop, background)
              : train(own, names, options, quiet, stop, &background);
      const auto best = [&](std::size_t i) {
        if (!background.network) return identify(model, faces[i]).front().score;
        const Rows row = templates_of_coordinates(model, background,
                                                  coordinates.row(static_cast<Eigen::Index>(i)));
        return identify_template(model, {row.data(), static_cast<std::size_t>(row.size())})
            .front()
            .score;
      };
      Gallery gallery{expected_by(model), {}};
      for (std::size_t i = 0; i < faces.size(); ++i)
        if (labels[i] != name) gallery.scores.push_back(best(i));
      out.scores += static_cast<long>(gallery.scores.size());
      galleries.push_back(std::move(gallery));
    }
  }
  progress.end();
  if (galleries.empty()) throw std::invalid_argument("nobody has enough images");
  out.galleries = static_cast<int>(galleries.size());
  const auto count = static_cast<double>(out.scores);
  double shift = 0;
  for (const Gallery& gallery : galleries)
    for (const double score : gallery.scores) shift += (score - gallery.expected.mean) / count;
  double square = 0;
  for (const Gallery& gallery : galleries) {
    for (const double score : gallery.scores) {
      const double z = (score - gallery.expected.mean - shift) / gallery.expected.deviation;
      square += z * z / count;
    }
  }
  out.adjustment = {shift, std::sqrt(square)};
  return out;
}

}  // namespace tarsier::face::recognition
