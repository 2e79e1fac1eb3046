// SPDX-License-Identifier: MIT
#include "tarsier/face/train/face_turn.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/shape/mesh.h"
#include "tarsier/face/shape/piecewise_warp.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace tarsier::face::train {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Of the image, in face widths: portraits are taken from about one metre.
constexpr double kFocal = 7;
// Depth of the ellipse of the contour, share of its half width.
constexpr double kRoundness = 0.8;
// Radius from which the background does not move, in distances of the farthest point of the head.
constexpr double kRingRadius = 1.75;
constexpr int kRingPoints = 16;
// Points nearer than this are merged, share of the size of the face's shape.
constexpr double kMergeDistance = 0.01;
// Max share of the face's area that may be hidden after the rotation.
constexpr double kMaxHidden = 0.08;
constexpr double kBackgroundDepth_mm = 1e6;

// A camera that looks at the centre of the points.
geometry::Camera camera_of(const Matrix2Xd& points) {
  geometry::Camera camera;
  const Vector2d low = points.rowwise().minCoeff();
  const Vector2d high = points.rowwise().maxCoeff();
  camera.width = camera.height = 1;  // there is no image
  camera.fx = camera.fy = kFocal * std::max(1.0, (high - low).maxCoeff());
  camera.cx = (low.x() + high.x()) / 2;
  camera.cy = (low.y() + high.y()) / 2;
  return camera;
}

// The forehead above the eyebrows: an arc from temple to temple, slightly inclined backwards. In
// shares of the half width of an adult's head, about 74 mm.
Matrix3Xd forehead_of(const Matrix3Xd& shape) {
  constexpr int kPoints = 5;
  const double half = shape.row(0).cwiseAbs().maxCoeff();
  Index brow = 0;
  shape.row(1).minCoeff(&brow);
  Matrix3Xd arc(3, kPoints);
  for (int k = 0; k < kPoints; ++k) {
    const double angle = (k - (kPoints - 1) / 2.0) * 32 * std::numbers::pi / 180;
    const double side = std::sin(angle);
    const double up = std::cos(angle);
    arc.col(k) << 0.75 * half * side, shape(1, brow) - 0.75 * half * up,
        shape(2, brow) + half * (0.2 * up * up + 0.5 * side * side);
  }
  return arc;
}

// The model's points as annotators mark them at this yaw: those of the far side's contour slide.
Matrix3Xd marked_points(const head::HeadModel& model, const Matrix3Xd& shape, double yaw_deg) {
  Matrix3Xd marked = shape;
  const double slope = std::abs(std::tan(yaw_deg * std::numbers::pi / 180));
  for (const int i : model.outline) {
    const double x = shape(0, i);
    // A head that turns to image left shows more of its right side in the image.
    if (x * yaw_deg >= 0) continue;
    const double depth = kRoundness * std::abs(x);
    const double phi = std::atan(kRoundness * slope);
    marked(0, i) = x * std::cos(phi);
    marked(2, i) = shape(2, i) - depth * std::sin(phi);
  }
  return marked;
}

Matrix2Xd project_points(const Matrix3Xd& head_in_camera, const geometry::Camera& camera) {
  Matrix2Xd points(2, head_in_camera.cols());
  for (Index i = 0; i < head_in_camera.cols(); ++i) {
    points.col(i) << camera.cx + camera.fx * head_in_camera(0, i) / head_in_camera(2, i),
        camera.cy + camera.fy * head_in_camera(1, i) / head_in_camera(2, i);
  }
  return points;
}

// The fixed ring, and corners far outside.
Matrix2Xd fixed_ring_points(const Matrix2Xd& before, const Matrix2Xd& after, cv::Size image) {
  const Vector2d center = before.rowwise().mean();
  const double reach =
      kRingRadius * std::max((before.colwise() - center).colwise().norm().maxCoeff(),
                             (after.colwise() - center).colwise().norm().maxCoeff());
  Matrix2Xd points(2, kRingPoints + 4);
  for (int k = 0; k < kRingPoints; ++k) {
    const double angle = 2 * std::numbers::pi * k / kRingPoints;
    points.col(k) = center + reach * Vector2d(std::cos(angle), std::sin(angle));
  }
  const double far = 4 * reach + image.width + image.height;
  for (int k = 0; k < 4; ++k) {
    points.col(kRingPoints + k) = center + far * Vector2d(k % 2 == 0 ? -1 : 1, k < 2 ? -1 : 1);
  }
  return points;
}

double area_of(const shape::Triangle& t, const Matrix2Xd& points) {
  const Vector2d a = points.col(t[1]) - points.col(t[0]);
  const Vector2d b = points.col(t[2]) - points.col(t[0]);
  return a.x() * b.y() - a.y() * b.x();
}

// The visible triangles of the image after the rotation: farthest first, without those that face
// away. Empty if more than kMaxHidden of the face would be hidden. Only the first `movable`
// vertices belong to the head; `depth` is theirs.
std::optional<std::vector<shape::Triangle>> visible_triangles(const Matrix2Xd& before,
                                                              const Matrix2Xd& after,
                                                              const Eigen::VectorXd& depth) {
  const auto movable = static_cast<int>(depth.size());
  const Matrix2Xd head = before.leftCols(movable);
  const double size =
      std::sqrt((head.colwise() - head.rowwise().mean()).colwise().squaredNorm().mean());
  std::vector<int> distinct;
  for (int i = 0; i < before.cols(); ++i) {
    const bool is_new = std::none_of(distinct.begin(), distinct.end(), [&](int k) {
      return (before.col(i) - before.col(k)).norm() < kMergeDistance * size;
    });
    if (is_new) distinct.push_back(i);
  }
  struct Piece {
    double depth = 0;
    shape::Triangle corners{};
  };
  std::vector<Piece> pieces;
  double face = 0;
  double hidden = 0;
  for (const shape::Triangle& t : shape::delaunay(before(Eigen::all, distinct))) {
    Piece piece;
    bool is_face = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const int i = distinct[static_cast<std::size_t>(t[k])];
      piece.corners[k] = i;
      is_face = is_face && i < movable;
      piece.depth += i < movable ? depth[i] : kBackgroundDepth_mm;
    }
    const bool is_visible = area_of(piece.corners, after) > 0;
    if (is_face) {
      face += area_of(piece.corners, before);
      if (!is_visible) hidden += area_of(piece.corners, before);
    }
    if (is_visible) pieces.push_back(piece);
  }
  if (hidden > kMaxHidden * face) return std::nullopt;
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const Piece& a, const Piece& b) { return a.depth > b.depth; });
  std::vector<shape::Triangle> triangles;
  for (const Piece& piece : pieces) triangles.push_back(piece.corners);
  return triangles;
}

}  // namespace

FaceTurner::FaceTurner(const head::HeadModel& head) : estimator_(head) {}

std::optional<TurnedFace> FaceTurner::turn(const cv::Mat& gray, const Matrix2Xd& points,
                                           double pitch_deg, double yaw_deg) const {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "no 8 bit gray image");
  const head::HeadModel& model = estimator_.model();
  const Index n = model.points();
  TARSIER_REQUIRE(points.cols() == n && points.allFinite(), "{} points for a head of {}",
                  points.cols(), n);
  const geometry::Camera camera = camera_of(points);
  const auto found = estimator_.pose(points, camera);
  if (!found.pose) return std::nullopt;
  const auto& [rotation, translation] = found.pose->camera_from_head;

  TurnedFace result;
  result.before = found.pose->angles;
  result.after = result.before;
  result.after.pitch_deg += pitch_deg;
  result.after.yaw_deg += yaw_deg;
  if (std::abs(result.after.pitch_deg) > 80 || std::abs(result.after.yaw_deg) > 80)
    return std::nullopt;
  const Matrix3d turned = head::rotation_of_angles(result.after);

  const Matrix3Xd shape = head::shape_of(model, found.pose->b);
  const Matrix3Xd marked = marked_points(model, shape, result.before.yaw_deg);
  const Matrix3Xd marked_after = marked_points(model, shape, result.after.yaw_deg);
  const Matrix3Xd forehead = forehead_of(shape);
  Matrix3Xd head_after(3, n + forehead.cols());
  for (Index i = 0; i < n; ++i) {
    const double depth = rotation.row(2).dot(marked.col(i)) + translation.z();
    if (!(depth > 1)) return std::nullopt;
    const Vector3d camera_point(depth * (points(0, i) - camera.cx) / camera.fx,
                                depth * (points(1, i) - camera.cy) / camera.fy, depth);
    const Vector3d annotated = rotation.transpose() * (camera_point - translation);
    head_after.col(i) = annotated + marked_after.col(i) - marked.col(i);
  }
  head_after.rightCols(forehead.cols()) = forehead;
  Matrix2Xd before(2, head_after.cols());
  before << points, project_points((rotation * forehead).colwise() + translation, camera);
  const Matrix3Xd head_in_camera = (turned * head_after).colwise() + translation;
  Matrix2Xd after = project_points(head_in_camera, camera);
  if (!after.allFinite()) return std::nullopt;
  after.colwise() += points.rowwise().mean() - after.leftCols(n).rowwise().mean();
  result.points = after.leftCols(n);

  const Matrix2Xd fixed_points = fixed_ring_points(before, after, gray.size());
  Matrix2Xd all_before(2, before.cols() + fixed_points.cols());
  all_before << before, fixed_points;
  Matrix2Xd all_after(2, before.cols() + fixed_points.cols());
  all_after << after, fixed_points;
  const auto triangles = visible_triangles(all_before, all_after, head_in_camera.row(2));
  if (!triangles) return std::nullopt;
  result.gray = gray.clone();
  shape::PiecewiseWarp(all_before, *triangles, gray.size())
      .from_frame(gray, all_after, result.gray);
  return result;
}

std::vector<Matrix2Xd> FaceTurner::shapes_near(const Matrix2Xd& points, int count,
                                               std::uint64_t seed) const {
  const head::HeadModel& model = estimator_.model();
  TARSIER_REQUIRE(points.cols() == model.points(), "{} points for a head of {}", points.cols(),
                  model.points());
  const geometry::Camera camera = camera_of(points);
  const auto found = estimator_.pose(points, camera);
  std::vector<Matrix2Xd> shapes;
  if (!found.pose) return shapes;
  Rng rng(seed);
  const head::HeadAngles& angles = found.pose->angles;
  for (int k = 0; k < count; ++k) {
    head::HeadPose pose = *found.pose;
    const double share = rng.uniform(0.6, 1.1);
    const double pitch = std::clamp(angles.pitch_deg * share + rng.normal(0, 5), -80.0, 80.0);
    const double yaw = angles.yaw_deg * share + rng.normal(0, 5);
    pose.camera_from_head.rotation = head::rotation_of_angles({yaw, pitch, angles.roll_deg});
    pose.b *= rng.uniform();
    Matrix2Xd shape = estimator_.project(pose, camera);
    if (!shape.allFinite()) continue;
    shape.colwise() += points.rowwise().mean() - shape.rowwise().mean();
    shapes.push_back(std::move(shape));
  }
  return shapes;
}

void CopyOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_pitch_deg <= max_pitch_deg, "pitch from {} to {}", min_pitch_deg,
                  max_pitch_deg);
}

namespace {

bool is_within_limits(const TurnedFace& turned, const CopyOptions& options) {
  const double before = std::abs(turned.before.yaw_deg);
  const double after = std::abs(turned.after.yaw_deg);
  return before - after <= options.max_back_deg && after <= options.farthest_yaw_deg &&
         std::abs(turned.after.pitch_deg) <= options.farthest_pitch_deg;
}

}  // namespace

std::vector<regression::TrainingFace> turned_copies(const FaceTurner& turner,
                                                    const regression::TrainingFace& face,
                                                    const CopyOptions& options,
                                                    std::uint64_t seed) {
  options.check();
  Rng rng(seed);
  std::vector<regression::TrainingFace> copies;
  for (int k = 0; k < options.copies; ++k) {
    for (int attempt = 0; attempt < options.attempts; ++attempt) {
      // Up and down alternate, so that few copies are balanced too.
      const double sign = (k + rng.integer(0, 1)) % 2 == 0 ? 1 : -1;
      const double pitch = sign * rng.uniform(options.min_pitch_deg, options.max_pitch_deg);
      const double yaw = rng.uniform(-options.max_yaw_deg, options.max_yaw_deg);
      std::optional<TurnedFace> turned = turner.turn(face.gray, face.points, pitch, yaw);
      if (!turned || !is_within_limits(*turned, options)) continue;
      regression::TrainingFace copy = face;
      copy.gray = std::move(turned->gray);
      copy.points = std::move(turned->points);
      copy.box.reset();
      copy.turned = true;
      copies.push_back(std::move(copy));
      break;
    }
  }
  return copies;
}

}  // namespace tarsier::face::train
