// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/study.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/image/draw/plot.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

namespace tarsier::face::appearance {

using Eigen::Matrix2Xd;

namespace {

void check_eyes(const std::array<int, 2>& eyes, int points) {
  TARSIER_REQUIRE(
      eyes[0] >= 0 && eyes[1] >= 0 && eyes[0] < points && eyes[1] < points && eyes[0] != eyes[1],
      "eyes at points {} and {} of {}", eyes[0], eyes[1], points);
}

bool is_plausible_box(const cv::Rect2d& box, const Matrix2Xd& points) {
  const Eigen::Vector2d center = points.rowwise().mean();
  const double width = points.row(0).maxCoeff() - points.row(0).minCoeff();
  return box.contains({center.x(), center.y()}) && box.width > 0.5 * width && box.width < 3 * width;
}

using Images = std::vector<TrainingImage>;

// Holds out every third person (image, if there are fewer than three people).
std::pair<Images, Images> split_by_person(const Images& images) {
  std::map<std::string, std::size_t> people;
  for (const TrainingImage& image : images) people.try_emplace(image.person, people.size());
  const bool by_person = people.size() >= 3;
  std::pair<Images, Images> parts;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::size_t number = by_person ? people.at(images[i].person) : i;
    (number % 3 == 2 ? parts.second : parts.first).push_back(images[i]);
  }
  return parts;
}

// Keeps at most `max_images` images, evenly chosen.
void subsample(Images& images, std::size_t max_images) {
  if (images.size() <= max_images) return;
  Images kept;
  for (std::size_t i = 0; i < max_images; ++i)
    kept.push_back(images[i * images.size() / max_images]);
  images = std::move(kept);
}

struct TrialFit {
  double fit_error = 0;  // FitResult::error
  bool is_right = false;
};

// The limit of FitResult::error that separates right and wrong fits with the fewest mistakes.
// Without wrong fits: twice the largest error of the right ones, at most 1.
double choose_lost_error(std::vector<TrialFit> fits) {
  std::sort(fits.begin(), fits.end(), [](const TrialFit& a, const TrialFit& b) {
    return std::pair(a.fit_error, a.is_right) < std::pair(b.fit_error, b.is_right);
  });
  int mistakes = 0;  // with the limit below all errors, each right fit is called lost
  double largest = 0;
  for (const auto& [error, is_right] : fits) {
    mistakes += is_right ? 1 : 0;
    if (is_right) largest = std::max(largest, error);
  }
  if (mistakes == static_cast<int>(fits.size())) return std::min(1.0, 2 * largest);
  int min_mistakes = mistakes;
  double best = 0;
  for (std::size_t i = 0; i < fits.size(); ++i) {
    mistakes += fits[i].is_right ? -1 : 1;
    if (mistakes > min_mistakes) continue;
    min_mistakes = mistakes;
    best =
        i + 1 < fits.size() ? (fits[i].fit_error + fits[i + 1].fit_error) / 2 : fits[i].fit_error;
  }
  return best;
}

}  // namespace

double point_error(const Matrix2Xd& points, const Matrix2Xd& truth,
                   const std::array<int, 2>& eyes) {
  TARSIER_REQUIRE(points.cols() == truth.cols(), "{} points, {} true ones", points.cols(),
                  truth.cols());
  check_eyes(eyes, static_cast<int>(truth.cols()));
  const double distance = (truth.col(eyes[0]) - truth.col(eyes[1])).norm();
  TARSIER_REQUIRE(distance > 0, "eyes {} apart", distance);
  return (points - truth).colwise().norm().mean() / distance;
}

int set_shape_in_box(AppearanceModel& model, const std::vector<TrainingImage>& images,
                     const Detect& detect) {
  std::vector<std::pair<cv::Rect2d, Matrix2Xd>> boxes;
  for (const TrainingImage& image : images) {
    const auto box = detect(image.image);
    if (box && is_plausible_box(*box, image.points)) boxes.emplace_back(*box, image.points);
  }
  if (!boxes.empty()) model.shape_in_box = learn_shape_in_box(boxes);
  return static_cast<int>(boxes.size());
}

std::array<int, 2> farthest_points(const shape::ShapeModel& model) {
  std::array<int, 2> best{0, 0};
  double max_distance = -1;
  for (int i = 0; i < model.points(); ++i) {
    for (int k = i + 1; k < model.points(); ++k) {
      const double distance = (model.mean.col(i) - model.mean.col(k)).norm();
      if (distance <= max_distance) continue;
      max_distance = distance;
      best = {i, k};
    }
  }
  return best;
}

double learn_lost_error(const std::vector<TrainingImage>& images, const std::vector<int>& mirror,
                        const AppearanceOptions& options, std::uint64_t seed, Progress& progress,
                        const std::stop_token& stop) {
  constexpr std::size_t kMaxTrainingImages = 400;
  constexpr std::size_t kMaxTestImages = 150;
  constexpr Disturbance kSmallDisturbance{0.1, 8, 0.08};
  constexpr Disturbance kLargeDisturbance{0.4, 60, 0.8};
  constexpr double kGoodError = 0.06;  // share of the widest distance in the shape
  if (images.size() < 6) return 0;
  auto [learnt, left_out] = split_by_person(images);
  subsample(learnt, kMaxTrainingImages);
  subsample(left_out, kMaxTestImages);
  AppearanceOptions plain = options;
  plain.colour = false;
  const AppearanceModel model = train_appearance_model(learnt, mirror, plain, progress, stop);
  const std::array<int, 2> ends = farthest_points(model.shape);
  FitOptions fit;
  fit.method = Method::kAlternating;
  const Fitter fitter(model, fit);
  std::vector<TrialFit> fits(2 * left_out.size());
  progress.begin("right and wrong fits", static_cast<std::int64_t>(left_out.size()), "images");
  cv::parallel_for_(cv::Range(0, static_cast<int>(left_out.size())), [&](const cv::Range& range) {
    FitWorkspace workspace;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto index = static_cast<std::size_t>(i);
      const TrainingImage& image = left_out[index];
      const Matrix2Xd mean =
          shape::fit_similarity(model.shape.mean, image.points)(model.shape.mean);
      for (std::size_t far = 0; far < 2; ++far) {
        const Matrix2Xd start = disturbed(mean, far == 1 ? kLargeDisturbance : kSmallDisturbance,
                                          seed * 7919 + 2 * index + far);
        const FitResult found = fitter.fit(image.image, start, workspace);
        fits[2 * index + far] = {found.error,
                                 point_error(found.points, image.points, ends) < kGoodError};
      }
      progress.advance();
    }
  });
  progress.end();
  throw_if_stopped(stop);
  return choose_lost_error(std::move(fits));
}

void ConvergenceOptions::check(int points) const {
  check_eyes(eyes, points);
  TARSIER_REQUIRE(tries >= 1 && tries <= 10000 && limit > 0, "{} tries, limit {}", tries, limit);
  for (const double step : steps) TARSIER_REQUIRE(step >= 0 && step <= 10, "a step of {}", step);
}

std::vector<ConvergencePoint> study_convergence(const Fitter& fitter,
                                                const std::vector<TrainingImage>& images,
                                                const ConvergenceOptions& options,
                                                Progress& progress, const std::stop_token& stop) {
  options.check(fitter.model().points());
  const int steps = static_cast<int>(options.steps.size());
  const int each = steps * options.tries;
  std::vector<double> errors(images.size() * static_cast<std::size_t>(each), 0);
  progress.begin("random starts", static_cast<std::int64_t>(images.size()), "images");
  cv::parallel_for_(cv::Range(0, static_cast<int>(images.size())), [&](const cv::Range& range) {
    FitWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      const TrainingImage& image = images[static_cast<std::size_t>(i)];
      // Start from the mean shape at the face's position, not from the face's own shape.
      const Matrix2Xd mean =
          shape::fit_similarity(fitter.model().shape.mean, image.points)(fitter.model().shape.mean);
      for (int k = 0; k < each && !stop.stop_requested(); ++k) {
        const double share = options.steps[static_cast<std::size_t>(k / options.tries)];
        const Disturbance disturbance{share * options.max_disturbance.scale,
                                      share * options.max_disturbance.angle_deg,
                                      share * options.max_disturbance.shift};
        const auto number = static_cast<std::uint64_t>(i) * static_cast<std::uint64_t>(each) +
                            static_cast<std::uint64_t>(k);
        const Matrix2Xd start = disturbed(mean, disturbance, options.seed * 1000003 + number);
        errors[number] = point_error(fitter.fit(image.image, start, workspace).points, image.points,
                                     options.eyes);
      }
      progress.advance();
    }
  });
  progress.end();
  throw_if_stopped(stop);
  std::vector<ConvergencePoint> curve;
  for (int s = 0; s < steps; ++s) {
    ConvergencePoint point;
    point.disturbance = options.steps[static_cast<std::size_t>(s)];
    for (std::size_t i = 0; i < images.size(); ++i) {
      for (int t = 0; t < options.tries; ++t) {
        const double error = errors[i * static_cast<std::size_t>(each) +
                                    static_cast<std::size_t>(s * options.tries + t)];
        ++point.tries;
        if (error >= options.limit) continue;
        ++point.converged;
        point.mean_error += error;
      }
    }
    if (point.converged > 0) point.mean_error /= point.converged;
    curve.push_back(point);
  }
  return curve;
}

cv::Mat draw_convergence(const std::vector<ConvergenceCurve>& curves,
                         const ConvergenceOptions& options, cv::Size size) {
  image::draw::Plot plot;
  plot.title = fmt::format("Fits within {:.1f} % of the eye distance", 100 * options.limit);
  plot.x.label =
      fmt::format("start moved by this share of scale +-{:.0f} %, {:.0f} deg, shift {:.0f} %",
                  100 * options.max_disturbance.scale, options.max_disturbance.angle_deg,
                  100 * options.max_disturbance.shift);
  plot.y.label = "converged (%)";
  plot.y.low = 0;
  plot.y.high = 100;
  plot.legend = image::draw::LegendPosition::kBottomLeft;
  for (const ConvergenceCurve& curve : curves) {
    image::draw::Series series;
    series.name = curve.name;
    series.markers = true;
    for (const ConvergencePoint& point : curve.points) {
      series.x.push_back(point.disturbance);
      series.y.push_back(point.tries > 0 ? 100.0 * point.converged / point.tries : 0);
    }
    plot.series.push_back(std::move(series));
  }
  return image::draw::plot_image(plot, size);
}

}  // namespace tarsier::face::appearance
