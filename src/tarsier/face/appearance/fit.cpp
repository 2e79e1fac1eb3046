// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/fit.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/appearance/fit_level.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::face::appearance {

using Eigen::Index;
using Eigen::Matrix2Xd;

namespace {

constexpr NameTable<FitStatus, 3> kStatuses{"status",
                                            {{{FitStatus::kConverged, "converged"},
                                              {FitStatus::kIterations, "iterations"},
                                              {FitStatus::kDiverged, "diverged"}}}};

// Max share of folded triangles: thin ones between closed lips fold even in annotations.
constexpr double kMaxFolded = 0.15;
// A last error that exceeds the best one by this factor means divergence.
constexpr double kMaxErrorRatio = 1.03;

// Number of modes that explain a share of the shape's variance.
int modes_for(const shape::ShapeModel& model, double share) {
  const double total = model.deviation.squaredNorm();
  double sum = 0;
  int count = 0;
  while (count < model.mode_count() && sum < share * total) {
    sum += model.deviation[count] * model.deviation[count];
    ++count;
  }
  return share >= 1 ? model.mode_count() : count;
}

bool is_in_crop(const Matrix2Xd& points, cv::Size size) {
  const Eigen::Vector2d center = points.rowwise().mean();
  return center.x() > 0 && center.y() > 0 && center.x() < size.width && center.y() < size.height;
}

}  // namespace

std::string_view name_of(FitStatus status) { return kStatuses.name(status); }

void FitOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(finest >= 0 && (coarsest == -1 || coarsest >= finest), "levels {} to {}",
                  coarsest, finest);
}

struct Fitter::Impl {
  const AppearanceModel* model;
  FitOptions options;
  std::vector<FitLevel> levels;
};

Fitter::Fitter(const AppearanceModel& model, const FitOptions& options)
    : impl_(std::make_unique<Impl>(Impl{&model, options, {}})) {
  options.check();
  model.check();
  const int count = static_cast<int>(model.levels.size());
  TARSIER_REQUIRE(options.coarsest < count && options.finest < count, "levels {} to {} of {}",
                  options.coarsest, options.finest, count);
  for (int k = 0; k < count; ++k) {
    const double share =
        count == 1 ? 1 : 1 + (options.coarse_modes - 1) * k / static_cast<double>(count - 1);
    impl_->levels.push_back(make_level(model, model.levels[static_cast<std::size_t>(k)], options,
                                       modes_for(model.shape, share)));
    impl_->levels.back().index = k;
  }
}
Fitter::~Fitter() = default;
Fitter::Fitter(Fitter&&) noexcept = default;
Fitter& Fitter::operator=(Fitter&&) noexcept = default;

const AppearanceModel& Fitter::model() const { return *impl_->model; }
const FitOptions& Fitter::options() const { return impl_->options; }
const FitLevel& Fitter::level(int index) const {
  return impl_->levels.at(static_cast<std::size_t>(index));
}

FitResult Fitter::fit(const cv::Mat& image, const Matrix2Xd& start, FitWorkspace& workspace) const {
  const int last = static_cast<int>(impl_->levels.size()) - 1;
  return run(image, start, impl_->options.coarsest < 0 ? last : impl_->options.coarsest,
             impl_->options.finest, false, workspace);
}

FitResult Fitter::follow(const cv::Mat& image, const Matrix2Xd& start,
                         FitWorkspace& workspace) const {
  const int finest = impl_->options.finest;
  return run(image, start, finest, finest, true, workspace);
}

FitResult Fitter::fit_best(const cv::Mat& image, const std::vector<Matrix2Xd>& starts,
                           FitWorkspace& workspace) const {
  TARSIER_REQUIRE(!starts.empty(), "no starts");
  const int last = static_cast<int>(impl_->levels.size()) - 1;
  const int coarsest = impl_->options.coarsest < 0 ? last : impl_->options.coarsest;
  const int finest = impl_->options.finest;
  if (starts.size() == 1) return run(image, starts[0], coarsest, finest, false, workspace);
  std::vector<FitResult> results;
  const bool has_two_stages = coarsest > finest;
  results.reserve(starts.size());
  for (const Matrix2Xd& start : starts)
    results.push_back(
        run(image, start, coarsest, has_two_stages ? finest + 1 : finest, false, workspace));
  const auto better = [](const FitResult& a, const FitResult& b) { return a.error < b.error; };
  std::stable_sort(results.begin(), results.end(), better);
  if (!has_two_stages) return std::move(results.front());
  FitResult best;
  for (std::size_t k = 0; k < std::min<std::size_t>(2, results.size()); ++k) {
    FitResult result = run(image, results[k].points, finest, finest, false, workspace);
    result.iterations += results[k].iterations;
    result.trace.insert(result.trace.begin(), results[k].trace.begin(), results[k].trace.end());
    if (k == 0 || better(result, best)) best = std::move(result);
  }
  return best;
}

FitResult Fitter::run(const cv::Mat& image, const Matrix2Xd& start, int coarsest, int finest,
                      bool reuse_texture, FitWorkspace& w) const {
  const AppearanceModel& model = *impl_->model;
  const FitOptions& options = impl_->options;
  TARSIER_REQUIRE(start.cols() == model.points(), "a start of {} points, the model has {}",
                  start.cols(), model.points());
  TARSIER_REQUIRE(start.allFinite() && start.cwiseAbs().maxCoeff() <= 1e7,
                  "a start that is not finite, or far outside any image");
  FitResult result;
  result.points = start;
  // Discard the templates of earlier images, unless they are requested.
  if (!reuse_texture) {
    for (FitTemplate& fit_template : w.templates) fit_template.level = nullptr;
  }
  LevelState best;
  bool has_left_crop = false;
  for (int l = coarsest; l >= finest; --l) {
    const FitLevel& level = impl_->levels[static_cast<std::size_t>(l)];
    const shape::ShapeFit now = shape::fit_shape(model.shape, result.points, {}, options.sigmas);
    TARSIER_REQUIRE(now.image_from_model.scale() > 1e-6, "points that coincide");
    const shape::Similarity2d image_from_crop =
        now.image_from_model * level.crop.crop_from_model.inverse();
    make_upright_crop(image, image_from_crop, level.crop.size, level.texture->channels, w.upright);
    const double scale = level.texture->px_per_unit;
    w.p = scale * now.b;
    if (level.parameters - 4 < w.p.size()) w.p.tail(w.p.size() - (level.parameters - 4)).setZero();
    set_points(level, 1, 0, {level.crop.crop_from_model.tx, level.crop.crop_from_model.ty}, w);
    w.best_points = w.points;
    w.best_p = w.p;
    LevelState state;
    best = {};
    best.error = 2;
    result.status = FitStatus::kIterations;
    bool is_out = false;
    double last_error = 2;
    for (int iteration = 0;; ++iteration) {
      sample_texture(level, w, state);
      if (iteration == 0) result.start_error = state.error;
      if (state.error < best.error) {
        best = state;
        w.best_points = w.points;
        w.best_p = w.p;
      }
      if (options.trace) result.trace.push_back({l, state.error, image_from_crop(w.points)});
      if (result.status == FitStatus::kConverged || iteration >= options.iterations) break;
      if (iteration > 0 && std::abs(last_error - state.error) < options.error_tolerance) {
        result.status = FitStatus::kConverged;
        break;
      }
      last_error = state.error;
      if (options.method == Method::kAlternating) {
        if (iteration == 0) {
          const auto index = static_cast<std::size_t>(l);
          if (reuse_texture && index < w.templates.size() && w.templates[index].level == &level) {
            w.c = w.templates[index].c;
          } else {
            init_texture(level, w, l == coarsest && !reuse_texture);
          }
        }
        solve_alternating(level, options, w);
      } else if (options.robust) {
        solve_robust(level, w, level.descent);
      } else {
        solve_project_out(level, w);
      }
      ++result.iterations;
      if (!update_warp(level, options, w) || !is_in_crop(w.points, level.crop.size)) {
        is_out = true;
        break;
      }
      const double step = std::sqrt((w.points - w.last_points).squaredNorm() /
                                    static_cast<double>(w.points.cols()));
      // One more iteration, to compute the error at the final points.
      if (step < options.tolerance) result.status = FitStatus::kConverged;
    }
    if (is_out || state.error > kMaxErrorRatio * best.error) {
      result.status = FitStatus::kDiverged;
      w.points = w.best_points;
      w.p = w.best_p;
    }
    if (l == finest) {
      has_left_crop = is_out;
      if (result.status == FitStatus::kDiverged) sample_texture(level, w, state);
      const auto& texture = *level.texture;
      const double root = std::sqrt(static_cast<double>(texture.size()));
      const double part = static_cast<double>(w.mode_coefficients[0]) / root;
      result.c =
          w.mode_coefficients.tail(texture.mode_count()).cast<double>() / (part > 1e-9 ? part : 1);
      result.offset = state.offset;
      result.gain = state.gain;
      result.error = state.error;
      result.inside = state.inside;
    }
    result.points = image_from_crop(w.points);
    result.shape = {image_from_crop, w.p / scale};
  }
  result.shape.image_from_model =
      shape::fit_similarity(shape::shape_of(model.shape, result.shape.b), result.points);
  const int folded = shape::count_folded(model.mesh, model.extended(result.points));
  result.lost = has_left_crop || result.inside < 0.5 || result.gain <= 0 ||
                (model.lost_error > 0 && result.error > model.lost_error) ||
                folded > kMaxFolded * static_cast<double>(model.mesh.size());
  return result;
}

}  // namespace tarsier::face::appearance
