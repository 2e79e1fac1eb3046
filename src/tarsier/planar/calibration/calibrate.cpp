// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/calibrate.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/planar/calibration/lens_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tarsier::planar::calibration {
namespace {

using geometry::Camera;
using geometry::Lens;
using geometry::Rigid3;

constexpr std::size_t kStartViews = 24;         // views that select the initial focal length
constexpr double kMaxDuplicateDistance_px = 4;  // views closer than this count as one
constexpr double kMinTurn_deg = 5;              // minimum rotation between the boards of two views
// Maximum for focal lengths, and relative to the image's larger side.
constexpr double kMaxUncertain = 0.03;
constexpr double kCornerError_px = 0.1;  // assumed error of the corners when judging the views
constexpr double kMaxStartRms_px = 2;
constexpr double kPointOutlier = 7;  // times the median error of all points
constexpr int kMaxComparisons = 2000;

// Counts the views that differ from each other, up to `max_count`.
int distinct_views(const std::vector<BoardView>& views, int max_count) {
  std::vector<const BoardView*> distinct;
  for (const BoardView& view : views) {
    if (static_cast<int>(distinct.size()) >= max_count) break;
    const bool is_new = std::all_of(distinct.begin(), distinct.end(), [&](const BoardView* other) {
      return view_distance(view, *other) > kMaxDuplicateDistance_px;
    });
    if (!view.empty() && is_new) distinct.push_back(&view);
  }
  return static_cast<int>(distinct.size());
}

bool is_dots(const BoardSpec& spec) {
  return spec.kind == BoardKind::kCircles || spec.kind == BoardKind::kCirclesGrid;
}

Camera blank_camera(cv::Size size, double focal, Lens lens) {
  Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal;
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  camera.lens = lens;
  return camera;
}

void start_poses(const Camera& camera, std::vector<FitView>& views) {
  for (FitView& view : views) {
    const auto pose = start_pose(camera, view);
    view.used = pose.has_value();
    if (pose) view.camera_from_board = *pose;
  }
}

std::size_t used_points(const std::vector<FitView>& views) {
  std::size_t count = 0;
  for (const FitView& view : views)
    if (view.used) count += view.board.size();
  return count;
}

// The best of several focal lengths, by the cost per point after a short fit of few parameters.
std::optional<Camera> start_camera(const std::vector<FitView>& all, cv::Size size, Lens lens,
                                   const std::stop_token& stop) {
  std::vector<FitView> some;
  const std::size_t step = (all.size() + kStartViews - 1) / kStartViews;
  for (std::size_t i = 0; i < all.size(); i += step) some.push_back(all[i]);
  const bool is_fisheye = lens == Lens::kFisheye;
  const std::vector<double> focals = is_fisheye ? std::vector<double>{0.22, 0.32, 0.45, 0.65, 1.0}
                                                : std::vector<double>{0.5, 0.8, 1.2, 2.0, 4.0};
  std::optional<Camera> best;
  double best_cost = std::numeric_limits<double>::infinity();
  for (const double focal : focals) {
    Camera camera = blank_camera(size, focal * std::max(size.width, size.height), lens);
    std::vector<FitView> views = some;
    start_poses(camera, views);
    const std::size_t points = used_points(views);
    if (2 * points < used_points(some)) continue;
    FitOptions few;
    few.fix_aspect = true;
    few.fix_center = true;
    few.fix_tangential = true;
    few.radial = 1;
    few.loss_px = 3;
    few.max_steps = 25;
    const FitResult result = fit_lens(camera, views, few, stop);
    // A view without a pose for this lens counts as a very bad fit.
    const double missing = static_cast<double>(used_points(some) - points) * 100;
    const double cost = (result.cost + missing) / static_cast<double>(used_points(some));
    if (cost < best_cost) {
      best_cost = cost;
      best = camera;
    }
  }
  return best;
}

FitOptions fit_options(const CalibrateOptions& options, const Camera& camera, double loss_px);

// The caller's initial camera, if it fits the views.
std::optional<Camera> refined_start(const std::vector<FitView>& all, cv::Size size,
                                    const CalibrateOptions& options, const std::stop_token& stop) {
  if (!options.start || options.lens == Lens::kRational || options.start->lens != options.lens ||
      options.start->width != size.width || options.start->height != size.height) {
    return std::nullopt;
  }
  Camera camera = *options.start;
  std::vector<FitView> views = all;
  start_poses(camera, views);
  if (used_points(views) != used_points(all)) return std::nullopt;
  std::vector<double> rms;
  (void)fit_lens(camera, views, fit_options(options, camera, 1), stop);
  rms.reserve(views.size());
  for (const FitView& view : views) rms.push_back(rms_of(camera, view));
  return upper_median(rms) < kMaxStartRms_px ? std::optional<Camera>(camera) : std::nullopt;
}

FitOptions fit_options(const CalibrateOptions& options, const Camera& camera, double loss_px) {
  FitOptions fit;
  fit.fix_aspect = options.square_pixels;
  fit.fix_tangential = !options.tangential;
  fit.radial = camera.lens == Lens::kFisheye ? 4 : options.radial;
  fit.loss_px = loss_px;
  return fit;
}

// Reprojection error of each point of a view, px.
std::vector<double> errors_of(const Camera& camera, const FitView& view) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < view.board.size(); ++i) {
    const auto at = board_pixel(camera, view.camera_from_board, view.board[i]);
    errors.push_back(at ? cv::norm(*at - view.pixels[i]) : std::numeric_limits<double>::infinity());
  }
  return errors;
}

// Fits all parameters, with a loss scale that follows the median error.
void fit_robustly(Camera& camera, std::vector<FitView>& views, const CalibrateOptions& options,
                  const std::stop_token& stop) {
  for (const double factor : {3.0, 1.5}) {
    std::vector<double> rms;
    for (const FitView& view : views)
      if (view.used) rms.push_back(rms_of(camera, view));
    const double loss = std::clamp(factor * upper_median(rms), 0.3, 30.0);
    (void)fit_lens(camera, views, fit_options(options, camera, loss), stop);
  }
  // A plane has two poses; some views may have started with the wrong or an inaccurate one.
  for (FitView& view : views) {
    const auto again = start_pose(camera, view);
    if (!again) continue;
    FitView other = view;
    other.camera_from_board = *again;
    // By the median: a pose that fits many points is right even if some corners are wrong.
    if (!view.used ||
        upper_median(errors_of(camera, other)) < 0.5 * upper_median(errors_of(camera, view))) {
      view.camera_from_board = *again;
      view.used = true;
    }
  }
}

// The centre of a dot's image is not the image of its centre. Returns the difference, px: the
// centroid of the projected rim minus the projected centre.
cv::Point2d dot_bias(const Camera& camera, const Rigid3& pose, const cv::Point2d& center,
                     double radius) {
  constexpr int kRim = 24;
  std::array<cv::Point2d, kRim> rim;
  for (std::size_t k = 0; k < kRim; ++k) {
    const double angle = 2 * CV_PI * static_cast<double>(k) / kRim;
    const auto at =
        board_pixel(camera, pose, center + radius * cv::Point2d(std::cos(angle), std::sin(angle)));
    if (!at) return {};
    rim[k] = *at;
  }
  const auto center_pixel = board_pixel(camera, pose, center);
  if (!center_pixel) return {};
  double area = 0;
  cv::Point2d sum;
  // Area and centroid of the polygon, relative to the centre.
  for (std::size_t k = 0; k < kRim; ++k) {
    const cv::Point2d a = rim[k] - *center_pixel;
    const cv::Point2d b = rim[(k + 1) % kRim] - *center_pixel;
    const double cross = a.x * b.y - a.y * b.x;
    area += cross / 2;
    sum += cross / 6 * (a + b);
  }
  return std::abs(area) > 1e-9 ? sum * (1 / area) : cv::Point2d();
}

// Moves the points of dots from the centres of their images to the images of their centres.
void correct_dots(const Camera& camera, const BoardSpec& spec,
                  const std::vector<BoardView>& board_views, std::vector<FitView>& views) {
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (std::size_t i = 0; views[v].used && i < views[v].board.size(); ++i) {
      views[v].pixels[i] = cv::Point2d(board_views[v].pixels[i]) -
                           dot_bias(camera, views[v].camera_from_board, views[v].board[i],
                                    0.5 * spec.ratio * spec.pitch);
    }
  }
}

// Removes single outlier points (for example a corner under a finger) of views whose other points
// fit. Returns whether any was removed.
bool drop_points(const Camera& camera, std::vector<FitView>& views,
                 const CalibrateOptions& options) {
  std::vector<double> all;
  for (const FitView& view : views) {
    if (!view.used) continue;
    const std::vector<double> errors = errors_of(camera, view);
    all.insert(all.end(), errors.begin(), errors.end());
  }
  const double limit = std::max(options.outlier_px, kPointOutlier * upper_median(all));
  bool dropped = false;
  for (FitView& view : views) {
    if (!view.used) continue;
    const std::vector<double> errors = errors_of(camera, view);
    FitView inliers = view;
    inliers.board.clear();
    inliers.pixels.clear();
    for (std::size_t i = 0; i < view.board.size(); ++i) {
      if (errors[i] > limit) continue;
      inliers.board.push_back(view.board[i]);
      inliers.pixels.push_back(view.pixels[i]);
    }
    if (inliers.board.size() == view.board.size()) continue;
    if (4 * inliers.board.size() < 3 * view.board.size() || inliers.board.size() < 6) continue;
    view = inliers;
    dropped = true;
  }
  return dropped;
}

// Excludes outlier views; returns whether there were any.
bool drop_outliers(const Camera& camera, std::vector<FitView>& views,
                   const CalibrateOptions& options) {
  std::vector<double> rms;
  for (const FitView& view : views)
    if (view.used) rms.push_back(rms_of(camera, view));
  const double limit = std::max(options.outlier_px, options.outlier * upper_median(rms));
  bool dropped = false;
  for (FitView& view : views) {
    if (!view.used || rms_of(camera, view) <= limit) continue;
    view.used = false;
    dropped = true;
  }
  return dropped;
}

int count_used(const std::vector<FitView>& views) {
  return static_cast<int>(
      std::count_if(views.begin(), views.end(), [](const FitView& v) { return v.used; }));
}

// Variances for residuals of variance 1 (px2 in each direction).
Eigen::VectorXd variances_of(const Eigen::MatrixXd& information) {
  const Eigen::Index n = information.rows();
  Eigen::VectorXd scale(n);
  for (Eigen::Index k = 0; k < n; ++k)
    scale[k] = information(k, k) > 0 ? 1 / std::sqrt(information(k, k)) : 0;
  Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  for (Eigen::Index k = 0; k < n; ++k)
    if (scale[k] == 0) scaled(k, k) = 1;
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(scaled);
  Eigen::VectorXd variances = Eigen::VectorXd::Zero(n);
  for (Eigen::Index e = 0; e < n; ++e) {
    const double value = std::max(eigen.values[e], 1e-15);
    for (Eigen::Index k = 0; k < n; ++k) {
      const double part = eigen.vectors(k, e) * scale[k];
      variances[k] += part * part / value;
    }
  }
  return variances;
}

Deviations deviations_of(const Eigen::VectorXd& variances, double sigma) {
  const auto at = [&](Eigen::Index k) { return sigma * std::sqrt(variances[k]); };
  Deviations d{at(0), at(1), at(2), at(3), {}};
  for (Eigen::Index k = 4; k < variances.size(); ++k)
    d.distortion[static_cast<std::size_t>(k - 4)] = at(k);
  return d;
}

Eigen::Vector3d normal_of(const Rigid3& pose) { return pose.rotation.col(2); }

double angle_deg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.dot(b) / (a.norm() * b.norm()), -1.0, 1.0)) * 180 / CV_PI;
}

// The maximum angle between the boards of two used views.
double largest_turn_deg(const std::vector<FitView>& views) {
  double largest = 0;
  int comparisons = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (std::size_t j = 0; j < i && comparisons < kMaxComparisons; ++j) {
      if (!views[i].used || !views[j].used) continue;
      ++comparisons;
      largest = std::max(largest, angle_deg(normal_of(views[i].camera_from_board),
                                            normal_of(views[j].camera_from_board)));
    }
  }
  return largest;
}

// The weakness of the set of views; empty if there is none.
std::string weakness_of(const Camera& camera, const std::vector<FitView>& views,
                        const Eigen::VectorXd& variances, double sigma) {
  const double turn = largest_turn_deg(views);
  if (turn < kMinTurn_deg) {
    return fmt::format(
        "all views show the board from one direction (they differ by {:.1f} degrees): tilt the "
        "board by 20 to 45 degrees to the left, right, up and down",
        turn);
  }
  const double assumed_error = std::max(sigma, kCornerError_px);
  const double focal = assumed_error * std::sqrt(std::max(variances[0], variances[1])) / camera.fx;
  const double center = assumed_error * std::sqrt(std::max(variances[2], variances[3])) /
                        std::max(camera.width, camera.height);
  if (std::max(focal, center) <= kMaxUncertain) return {};
  return fmt::format(
      "these views do not determine the camera ({} stays uncertain by {:.0f} %): take more of "
      "them, with the board tilted by 20 to 45 degrees in different directions and near the "
      "image's corners",
      focal > center ? "the focal length" : "the principal point",
      std::min(999.0, 100 * std::max(focal, center)));
}

std::vector<std::string> warnings_of(const Camera& camera) {
  std::vector<std::string> warnings;
  const double right = camera.width - 1;
  const double bottom = camera.height - 1;
  if (camera.lens == Lens::kFisheye) return warnings;
  for (const cv::Point2d& corner : {cv::Point2d(0, 0), cv::Point2d(right, 0),
                                    cv::Point2d(0, bottom), cv::Point2d(right, bottom)}) {
    if (camera.normalized_of(corner)) continue;
    warnings.emplace_back(
        "the distortion cannot be undone in the image's corners, where no view reaches: take "
        "views there, or fit fewer radial terms (2)");
    break;
  }
  return warnings;
}

std::vector<FitView> fit_views(const std::vector<BoardView>& views, const BoardSpec& spec) {
  std::vector<FitView> result;
  for (const BoardView& view : views) {
    TARSIER_REQUIRE(view.points.size() == view.pixels.size(), "{} points, {} pixels",
                    view.points.size(), view.pixels.size());
    FitView fit;
    for (std::size_t i = 0; i < view.points.size(); ++i) {
      TARSIER_REQUIRE(std::isfinite(view.pixels[i].x) && std::isfinite(view.pixels[i].y),
                      "point {} of a view", i);
      fit.board.push_back(spec.point(view.points[i]));
      fit.pixels.emplace_back(view.pixels[i]);
    }
    result.push_back(std::move(fit));
  }
  return result;
}

void report_views(Calibration& result, const std::vector<BoardView>& board_views,
                  const std::vector<FitView>& views) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    ViewReport& report = result.views[i];
    const auto pose = views[i].used || !views[i].board.empty()
                          ? std::optional<Rigid3>(views[i].camera_from_board)
                          : std::nullopt;
    if (!pose || pose->translation.norm() == 0) {
      report.state = ViewState::kNoPose;
      continue;
    }
    report.state = views[i].used ? ViewState::kUsed : ViewState::kOutlier;
    report.camera_from_board = *pose;
    report.rms = rms_of(result.camera, views[i]);
    report.dropped = static_cast<int>(board_views[i].points.size() - views[i].board.size());
    cv::Point2d center;
    for (const cv::Point2d& p : views[i].board)
      center += p * (1 / static_cast<double>(views[i].board.size()));
    report.tilt_deg = angle_deg(normal_of(*pose), *pose * Eigen::Vector3d(center.x, center.y, 0));
  }
}

}  // namespace

Calibration calibrate(const std::vector<BoardView>& board_views, const BoardSpec& spec,
                      cv::Size size, const CalibrateOptions& options, const std::stop_token& stop) {
  spec.check();
  options.check();
  TARSIER_REQUIRE(size.width > 0 && size.height > 0, "{}x{} px", size.width, size.height);
  Calibration result;
  result.views.resize(board_views.size());
  for (ViewReport& report : result.views) report.state = ViewState::kNoPose;
  const auto too_few = [&](int count, const std::string& what) {
    result.refusal = fmt::format(
        "{} {}: at least {} are needed that differ; 10 to 20 are good, with the board tilted in "
        "different directions and in all parts of the image",
        count, what, options.min_views);
  };
  std::vector<FitView> views = fit_views(board_views, spec);
  const auto boards = static_cast<int>(std::count_if(
      board_views.begin(), board_views.end(), [](const BoardView& v) { return !v.empty(); }));
  if (boards < options.min_views) {
    too_few(boards, boards == 1 ? "view of the board" : "views of the board");
    return result;
  }
  if (const int distinct = distinct_views(board_views, options.min_views);
      distinct < options.min_views) {
    too_few(distinct, fmt::format("different views among the {}: the board stands still", boards));
    return result;
  }

  // A rational lens is initialised as the similar pinhole.
  const Lens first = options.lens == Lens::kFisheye ? Lens::kFisheye : Lens::kPinhole;
  auto start = refined_start(views, size, options, stop);
  if (!start) start = start_camera(views, size, first, stop);
  if (!start) {
    result.refusal =
        "no camera explains these views: check the size of the board and that the images "
        "are of one camera";
    return result;
  }
  Camera& camera = result.camera = *start;
  start_poses(camera, views);
  fit_robustly(camera, views, options, stop);
  for (int turn = 0; turn < 3 && is_dots(spec); ++turn) {
    correct_dots(camera, spec, board_views, views);
    (void)fit_lens(camera, views, fit_options(options, camera, 0.5), stop);
  }
  (void)drop_points(camera, views, options);
  for (int turn = 0; turn < 4; ++turn) {
    (void)fit_lens(camera, views, fit_options(options, camera, 0), stop);
    const bool fewer_points = drop_points(camera, views, options);
    if (!drop_outliers(camera, views, options) && !fewer_points) break;
  }
  if (options.lens == Lens::kRational) {
    camera.lens = Lens::kRational;
    (void)fit_lens(camera, views, fit_options(options, camera, 0), stop);
  }
  result.used = count_used(views);
  const FitOptions last = fit_options(options, camera, 0);
  const FitResult fit = fit_lens(camera, views, last, stop);
  if (result.used < options.min_views) {
    too_few(result.used, "views fit together");
    return result;
  }

  const auto points = static_cast<double>(used_points(views));
  camera.rms = std::sqrt(fit.cost / points);
  const double freedom = 2 * points - parameter_count(camera) - 6.0 * result.used;
  const double sigma = std::sqrt(fit.cost / std::max(1.0, freedom));
  const Eigen::VectorXd variances = variances_of(fit.information);
  result.deviations = deviations_of(variances, sigma);
  if (options.square_pixels) result.deviations.fy = result.deviations.fx;
  report_views(result, board_views, views);
  result.refusal = weakness_of(camera, views, variances, sigma);
  if (result.ok()) result.warnings = warnings_of(camera);
  return result;
}

}  // namespace tarsier::planar::calibration
