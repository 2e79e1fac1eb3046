// SPDX-License-Identifier: MIT
#include "drawn_templates.h"

#include "tarsier/core/rng.h"

#include <Eigen/Cholesky>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <string>

namespace tarsier::cli {
namespace {

using face::recognition::Background;
using face::recognition::Recognizer;
using face::recognition::Rows;

Rows root_of(const Eigen::MatrixXd& scatter) {
  const double ridge = 1e-9 * scatter.trace();
  const Eigen::LLT<Eigen::MatrixXd> factors(
      scatter + ridge * Eigen::MatrixXd::Identity(scatter.rows(), scatter.cols()));
  return Eigen::MatrixXd(factors.matrixL()).cast<float>();
}

constexpr std::int64_t kLearned = 2000;
constexpr std::int64_t kFirstLearned = 1LL << 40;  // numbers of people used only for training

std::vector<DrawnTemplates::Image> first_images(std::int64_t first, std::int64_t count,
                                                std::int64_t step, std::int64_t person) {
  std::vector<DrawnTemplates::Image> out;
  for (std::int64_t i = first; i < first + count * step; i += step)
    out.push_back({person + i / kDrawnImages, static_cast<int>(i % kDrawnImages)});
  return out;
}

// Trains as for a large gallery, from that many faces of other people.
Recognizer learned(const DrawnTemplates& drawn, const Background& background,
                   const std::stop_token& stop) {
  const auto images = first_images(0, kLearned, 1, kFirstLearned);
  std::vector<std::string> labels;
  for (const DrawnTemplates::Image& image : images)
    labels.push_back(fmt::format("{}", image.person));
  face::recognition::RecognizerOptions options;
  if (background.network) options.algorithm = face::recognition::Algorithm::kDeep;
  NoProgress quiet;
  return face::recognition::train_coordinates(drawn.coordinates(images), labels, options, quiet,
                                              stop, background);
}

}  // namespace

DrawnTemplates::DrawnTemplates(const Background& background, double spread, std::uint64_t seed,
                               const std::stop_token& stop)
    : background_(&background),
      spread_(spread),
      seed_(seed),
      people_(background.variance.cwiseMax(0).cwiseSqrt().cast<float>().transpose()),
      within_(root_of(background.within)),
      recognizer_(learned(*this, background, stop)),
      projection_(recognizer_, background) {}

Rows DrawnTemplates::coordinates(std::span<const Image> images) const {
  const Eigen::Index m = people_.cols();
  const auto n = static_cast<Eigen::Index>(images.size());
  Rows people(n, m);
  Rows chance(n, m);
  cv::parallel_for_({0, static_cast<int>(n)}, [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const Image& image = images[static_cast<std::size_t>(i)];
      const Rng own = Rng(seed_).fork(static_cast<std::uint64_t>(image.person));
      Rng of_person = own.fork(0);
      Rng of_image = own.fork(static_cast<std::uint64_t>(image.image) + 1);
      for (Eigen::Index k = 0; k < m; ++k) {
        people(i, k) = people_(0, k) * static_cast<float>(of_person.normal());
        chance(i, k) = static_cast<float>(of_image.normal());
      }
    }
  });
  Rows out(n, m + 1);
  out.leftCols(m) =
      people + static_cast<float>(spread_) * face::recognition::products(chance, within_);
  // The part outside the directions: many small numbers, whose sum hardly varies.
  out.col(m).setConstant(static_cast<float>(
      background_->residual_variance + spread_ * spread_ * background_->within_residual_variance));
  return out;
}

face::recognition::TemplateSource DrawnTemplates::source(std::int64_t count) const {
  return [this, count](std::int64_t step, const auto& take) {
    constexpr std::int64_t kPiece = 4096;
    std::vector<std::int64_t> ids;
    for (std::int64_t first = 0; first < count; first += kPiece * step) {
      const std::int64_t rows = std::min(kPiece, (count - first + step - 1) / step);
      ids.clear();
      for (std::int64_t i = 0; i < rows; ++i) ids.push_back(first + i * step + 1);
      take(ids, templates(first_images(first, rows, step, 0)));
    }
  };
}

}  // namespace tarsier::cli
