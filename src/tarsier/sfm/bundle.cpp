// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <memory>
#include <numeric>
#include <set>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

// What Ceres moves. A pose is an angle-axis vector and a translation; a lens is its focal length,
// the ratio of the two, the centre, and k1 k2 p1 p2 k3.
constexpr double kSharpSize = 5;    // px
constexpr double kScaleHold = 1e4;  // px, of a scale twice as large; thousands of points pull along
using PoseNumbers = std::array<double, 6>;
using LensNumbers = std::array<double, 9>;

PoseNumbers numbers_of(const geometry::Rigid& pose) {
  PoseNumbers numbers{};
  const cv::Vec4d q = geometry::quaternion_of(pose.rotation);
  ceres::QuaternionToAngleAxis(q.val, numbers.data());
  for (int k = 0; k < 3; ++k) numbers[static_cast<std::size_t>(k + 3)] = pose.translation[k];
  return numbers;
}

geometry::Rigid pose_of(const PoseNumbers& numbers) {
  cv::Vec4d q;
  ceres::AngleAxisToQuaternion(numbers.data(), q.val);
  return {geometry::rotation_of(q), {numbers[3], numbers[4], numbers[5]}};
}

LensNumbers numbers_of(const geometry::Camera& camera) {
  return {camera.fx,
          camera.fy / camera.fx,
          camera.cx,
          camera.cy,
          camera.distortion[0],
          camera.distortion[1],
          camera.distortion[2],
          camera.distortion[3],
          camera.distortion[4]};
}

void apply_numbers(const LensNumbers& numbers, geometry::Camera& camera) {
  camera.fx = numbers[0];
  camera.fy = numbers[0] * numbers[1];
  camera.cx = numbers[2];
  camera.cy = numbers[3];
  for (std::size_t k = 0; k < 5; ++k) camera.distortion[k] = numbers[4 + k];
}

// The residual of one observation, px. Camera::pixel_of with numbers that may be Jets.
struct Reprojection {
  double u;
  double v;
  double weight;

  template <typename T>
  bool operator()(const T* pose, const T* point, const T* lens, T* residual) const {
    return with_lens(pose, point, lens, residual);
  }

  template <typename T, typename L>
  bool with_lens(const T* pose, const T* point, const L* lens, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(pose, point, p);
    for (int k = 0; k < 3; ++k) p[k] += pose[3 + k];
    return through_lens(p, lens, residual);
  }

  // `p` in the camera's frame.
  template <typename T, typename L>
  bool through_lens(const T* p, const L* lens, T* residual) const {
    if (p[2] < T(1e-6)) return false;
    const T x = p[0] / p[2];
    const T y = p[1] / p[2];
    const T r2 = x * x + y * y;
    const T radial = T(1) + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]));
    const T xy = T(2) * x * y;
    const T dx = x * radial + lens[6] * xy + lens[7] * (r2 + T(2) * x * x);
    const T dy = y * radial + lens[6] * (r2 + T(2) * y * y) + lens[7] * xy;
    residual[0] = T(weight) * (lens[0] * dx + lens[2] - T(u));
    residual[1] = T(weight) * (lens[0] * lens[1] * dy + lens[3] - T(v));
    return true;
  }
};

using Cost = ceres::AutoDiffCostFunction<Reprojection, 2, 6, 3, 9>;

// The same with a lens that stays: half as many derivatives.
struct FixedLensReprojection {
  Reprojection reprojection;
  const double* lens;

  template <typename T>
  bool operator()(const T* pose, const T* point, T* residual) const {
    return reprojection.with_lens(pose, point, lens, residual);
  }
};

using FixedLensCost = ceres::AutoDiffCostFunction<FixedLensReprojection, 2, 6, 3>;

// The same with a pose that stays as well: a third of those.
struct FixedPoseReprojection {
  Reprojection reprojection;
  const double* lens;
  const geometry::Rigid* pose;

  template <typename T>
  bool operator()(const T* point, T* residual) const {
    T p[3];
    for (int k = 0; k < 3; ++k) {
      const double* row = pose->rotation.val + std::ptrdiff_t{3} * k;
      p[k] = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + pose->translation[k];
    }
    return reprojection.through_lens(p, lens, residual);
  }
};

using FixedPoseCost = ceres::AutoDiffCostFunction<FixedPoseReprojection, 2, 3>;

// Keeps one number of a pose.
struct ScaleHold {
  int number;
  double value;
  double weight;

  template <typename T>
  bool operator()(const T* pose, T* residual) const {
    residual[0] = T(weight) * (pose[number] - T(value));
    return true;
  }
};

std::unique_ptr<ceres::LossFunction> loss_of(double loss_px) {
  if (loss_px <= 0) return nullptr;
  return std::make_unique<ceres::CauchyLoss>(loss_px);
}

class StopWhenAsked final : public ceres::IterationCallback {
 public:
  explicit StopWhenAsked(const std::stop_token& stop) : stop_(stop) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return stop_.stop_requested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const std::stop_token& stop_;
};

// Which lens numbers stay.
std::vector<int> fixed_lens(const BundleOptions& options) {
  std::vector<int> fixed{1, 8};
  const auto keep = [&](bool is_free, std::initializer_list<int> numbers) {
    if (!is_free) std::copy(numbers.begin(), numbers.end(), std::back_inserter(fixed));
  };
  keep(options.focal, {0});
  keep(options.center, {2, 3});
  keep(options.distortion, {4, 5, 6, 7});
  return fixed;
}

// A large feature is not located as well as a small one: by how much its residual counts.
double weight_of(const Photograph& image, int feature) {
  if (image.sizes.empty()) return 1;
  const auto size = static_cast<double>(image.sizes[static_cast<std::size_t>(feature)]);
  return 1 / std::clamp(size / kSharpSize, 0.7, 4.0);
}

double rms(const Model& model, const std::vector<int>& points) {
  double sum = 0;
  std::int64_t count = 0;
  for (const int p : points) {
    const Point& point = model.points[static_cast<std::size_t>(p)];
    for (const Observation& seen : point.track) {
      const Photograph& image = model.images[static_cast<std::size_t>(seen.image)];
      if (!image.registered) continue;
      const auto pixel = model.cameras[static_cast<std::size_t>(image.camera)].project(
          image.pose * point.position);
      if (!pixel) continue;
      const cv::Point2d d =
          *pixel - cv::Point2d(image.features[static_cast<std::size_t>(seen.feature)]);
      sum += d.dot(d);
      ++count;
    }
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0;
}

// Whether an adjustment may leave a lens like this behind.
bool is_lens(const geometry::Camera& after, const geometry::Camera& before) {
  const auto is_finite = [](double number) { return std::isfinite(number); };
  if (!std::all_of(after.distortion.begin(), after.distortion.end(), is_finite) ||
      !std::isfinite(after.cx) || !std::isfinite(after.cy)) {
    return false;
  }
  const double larger = std::max(after.width, after.height);
  const auto allowed = [&](double focal, double start) {
    return focal >= std::min(start, kMinFocalShare * larger) &&
           focal <= std::max(start, kMaxFocalShare * larger);
  };
  return allowed(after.fx, before.fx) && allowed(after.fy, before.fy);
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

BundleReport adjust(Model& model, const BundleOptions& options, const std::stop_token& stop) {
  BundleReport report;
  // What moves, in the order of the model. Everything below is as large as what takes part, not as
  // the model: a local adjustment costs the same in a model of ten thousand.
  std::vector<int> movers = options.images;
  if (movers.empty()) {
    movers.resize(model.images.size());
    std::iota(movers.begin(), movers.end(), 0);
  }
  std::erase_if(movers,
                [&](int i) { return !model.images[static_cast<std::size_t>(i)].registered; });
  std::sort(movers.begin(), movers.end());
  const auto place = [](const std::vector<int>& sorted, int value) {
    const auto found = std::lower_bound(sorted.begin(), sorted.end(), value);
    return found != sorted.end() && *found == value
               ? static_cast<std::size_t>(found - sorted.begin())
               : sorted.size();
  };

  std::vector<int> points = options.points;
  if (points.empty()) {
    for (std::size_t p = 0; p < model.points.size(); ++p) {
      const auto& track = model.points[p].track;
      if (std::any_of(track.begin(), track.end(), [&](const Observation& seen) {
            return place(movers, seen.image) < movers.size();
          })) {
        points.push_back(static_cast<int>(p));
      }
    }
  }
  if (points.empty()) return report;
  report.before_px = rms(model, points);

  std::vector<int> cameras;  // of all that see the points
  {
    std::vector<bool> known(model.cameras.size(), false);
    for (const int p : points) {
      for (const Observation& seen : model.points[static_cast<std::size_t>(p)].track) {
        const int camera = model.images[static_cast<std::size_t>(seen.image)].camera;
        if (known[static_cast<std::size_t>(camera)]) continue;
        known[static_cast<std::size_t>(camera)] = true;
        cameras.push_back(camera);
      }
    }
    std::sort(cameras.begin(), cameras.end());
  }
  std::vector<PoseNumbers> poses;
  poses.reserve(movers.size());
  for (const int i : movers)
    poses.push_back(numbers_of(model.images[static_cast<std::size_t>(i)].pose));
  std::vector<LensNumbers> lenses;
  lenses.reserve(cameras.size());
  for (const int c : cameras) {
    const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(c)];
    TARSIER_REQUIRE(camera.lens == geometry::Lens::kPinhole, "a {} lens", name_of(camera.lens));
    lenses.push_back(numbers_of(camera));
  }

  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  const auto loss = loss_of(options.loss_px);
  const std::vector<int> fixed = fixed_lens(options);
  const bool lens_stays = fixed.size() == 9 || !options.images.empty();
  std::set<std::size_t> used;  // places in `movers` of those that see points
  bool any_fixed = false;      // others that see their points
  std::set<std::size_t> used_lenses;
  for (const int p : points) {
    Point& point = model.points[static_cast<std::size_t>(p)];
    for (const Observation& seen : point.track) {
      const Photograph& image = model.images[static_cast<std::size_t>(seen.image)];
      if (!image.registered) continue;
      const cv::Point2f& at = image.features[static_cast<std::size_t>(seen.feature)];
      const std::size_t lens = place(cameras, image.camera);
      const std::size_t mover = place(movers, seen.image);
      const Reprojection reprojection{static_cast<double>(at.x), static_cast<double>(at.y),
                                      weight_of(image, seen.feature)};
      if (mover == movers.size()) {  // then the lens stays too
        problem.AddResidualBlock(new FixedPoseCost(new FixedPoseReprojection{
                                     reprojection, lenses[lens].data(), &image.pose}),
                                 loss.get(), point.position.val);
        any_fixed = true;
        ++report.residuals;
        continue;
      }
      if (lens_stays) {
        problem.AddResidualBlock(
            new FixedLensCost(new FixedLensReprojection{reprojection, lenses[lens].data()}),
            loss.get(), poses[mover].data(), point.position.val);
      } else {
        problem.AddResidualBlock(new Cost(new Reprojection(reprojection)), loss.get(),
                                 poses[mover].data(), point.position.val, lenses[lens].data());
      }
      used.insert(mover);
      used_lenses.insert(lens);
      ++report.residuals;
    }
  }

  for (const std::size_t lens : used_lenses)
    if (!lens_stays) problem.SetManifold(lenses[lens].data(), new ceres::SubsetManifold(9, fixed));
  const auto image_of = [&](std::size_t mover) -> Photograph& {
    return model.images[static_cast<std::size_t>(movers[mover])];
  };
  if (!any_fixed) {
    // The first stays, and one coordinate of the farthest one keeps the scale. As a residual, which
    // is zero whatever the others want: taking it out of the pose would make blocks of two sizes,
    // for which Ceres has no fast code.
    const std::size_t first = *used.begin();
    problem.SetParameterBlockConstant(poses[first].data());
    std::size_t far = first;
    double longest = 0;
    const cv::Vec3d origin = image_of(first).pose.center();
    for (const std::size_t i : used) {
      const double distance = cv::norm(image_of(i).pose.center() - origin);
      if (distance > longest) {
        longest = distance;
        far = i;
      }
    }
    if (far != first) {
      const cv::Vec3d& t = image_of(far).pose.translation;
      int axis = 0;
      for (int k = 1; k < 3; ++k)
        if (std::abs(t[k]) > std::abs(t[axis])) axis = k;
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<ScaleHold, 1, 6>(
              new ScaleHold{3 + axis, t[axis], kScaleHold / std::max(1e-12, std::abs(t[axis]))}),
          nullptr, poses[far].data());
    }
  }

  ceres::Solver::Options solver;
  solver.linear_solver_type = used.size() <= 300 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  // Ceres orders the blocks of a group by their addresses. Each group is in one array: which of two
  // arrays lies lower changes from run to run, and with it the last digits.
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const int p : points)
    ordering->AddElementToGroup(model.points[static_cast<std::size_t>(p)].position.val, 0);
  for (const std::size_t i : used) ordering->AddElementToGroup(poses[i].data(), 1);
  for (const std::size_t lens : used_lenses)
    if (!lens_stays) ordering->AddElementToGroup(lenses[lens].data(), 2);
  solver.linear_solver_ordering = ordering;
  solver.max_num_iterations = options.most_iterations;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.function_tolerance = options.tolerance;
  StopWhenAsked stop_callback(stop);
  solver.callbacks.push_back(&stop_callback);
  std::vector<cv::Vec3d> positions;  // Ceres moves the points where they are
  positions.reserve(points.size());
  for (const int p : points)
    positions.push_back(model.points[static_cast<std::size_t>(p)].position);
  const auto put_back = [&] {
    for (std::size_t k = 0; k < points.size(); ++k)
      model.points[static_cast<std::size_t>(points[k])].position = positions[k];
  };
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (stop.stop_requested()) {
    put_back();
    throw_if_stopped(stop);
  }
  report.iterations = static_cast<int>(summary.iterations.size());
  if (!summary.IsSolutionUsable()) {
    put_back();
    report.after_px = report.before_px;
    report.trouble = one_line(summary.message);
    return report;
  }
  for (const std::size_t lens : used_lenses) {
    const geometry::Camera& before = model.cameras[static_cast<std::size_t>(cameras[lens])];
    geometry::Camera after = before;
    apply_numbers(lenses[lens], after);
    if (lens_stays || is_lens(after, before)) continue;
    put_back();
    BundleOptions again = options;
    again.focal = again.center = again.distortion = false;
    again.points = std::move(points);
    report = adjust(model, again, stop);
    report.trouble =
        fmt::format("the focal length {:.4g} px came out, of a lens of {:.4g} px: it stays",
                    after.fx, before.fx) +
        (report.trouble.empty() ? "" : "; " + report.trouble);
    return report;
  }

  for (const std::size_t i : used) image_of(i).pose = pose_of(poses[i]);
  for (const std::size_t lens : used_lenses)
    apply_numbers(lenses[lens], model.cameras[static_cast<std::size_t>(cameras[lens])]);
  report.after_px = rms(model, points);
  return report;
}

void adjust_pose(geometry::Rigid& pose, const geometry::Camera& camera,
                 const std::vector<Sighting>& seen, double loss_px) {
  if (seen.size() < 3) return;
  PoseNumbers numbers = numbers_of(pose);
  const LensNumbers lens = numbers_of(camera);
  std::vector<cv::Vec3d> points;
  points.reserve(seen.size());
  for (const Sighting& sighting : seen) points.push_back(sighting.position);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  const auto loss = loss_of(loss_px);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    problem.AddResidualBlock(new FixedLensCost(new FixedLensReprojection{
                                 {seen[k].pixel.x, seen[k].pixel.y, 1}, lens.data()}),
                             loss.get(), numbers.data(), points[k].val);
    problem.SetParameterBlockConstant(points[k].val);
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.max_num_iterations = 30;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (summary.IsSolutionUsable()) pose = pose_of(numbers);
}

}  // namespace tarsier::sfm
