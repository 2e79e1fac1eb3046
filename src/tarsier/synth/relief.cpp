// SPDX-License-Identifier: MIT
#include "tarsier/synth/relief.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/synth/height_field.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/relief_surface.h"
#include "tarsier/synth/relief_texture.h"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tarsier::synth {
namespace {

constexpr double kDistance = 10;  // of the cameras from what they look at
constexpr double kFar = 100;      // nothing is drawn beyond
constexpr double kRadians = std::numbers::pi / 180;
constexpr double kStepDeg = 7;
constexpr double kSpanDeg = 60;
constexpr double kRingDeg = 42;  // above the ground
constexpr double kLineStep = 0.9;
constexpr double kLineSpan = 12;

const Eigen::Vector3d kMiddle{0, 0, 0.8};  // what arc and ring look at
const Eigen::Vector3d kSun{-0.46, 0.55, 0.697};
constexpr double kAmbient = 0.45;
constexpr double kDirect = 0.75;
const cv::Vec3f kSky{214, 198, 180};
const cv::Vec3f kBare{150, 150, 150};

constexpr double kWallWidth = 51.2;  // units until the wall's texture comes again: beyond the view
constexpr double kWallHeight = 25.6;
constexpr double kFaceCell = 3.2;  // units of the boxes' texture for each face, 8 x 8 of them
constexpr int kFaceCells = 8;
constexpr double kTile = 1.6;  // units, of Content::kRepeated
constexpr double kMaxTexels = 120;
constexpr int kBoxes = 12;
const cv::Vec3f kWhite{250, 250, 250};    // around Content::kSymmetric
const cv::Vec3f kTop{170, 170, 170};      // of its box
constexpr double kSymmetricHalf = 1.5;    // units, of its sides
constexpr double kSymmetricHeight = 2.4;  //
constexpr double kSymmetricDeg = 20;      // of a ring around it, above the ground

enum Stream : std::uint64_t {
  kWallStream = 1,
  kFaceStream,
  kHeightStream,
  kBoxStream,
  kPoseStream,
  kDetailStream
};

struct Hit {
  double t = kFar;
  int box = -1;  // -1: the wall
  int face = 0;  // 0..3: -x, +x, -y, +y, 4: top
  bool is_any = false;
};

// Moves `hit` to the box if it is met earlier. Origin and direction are in the box's own axes.
void meet_box(const Box& box, int number, const Eigen::Vector3d& origin,
              const Eigen::Vector3d& direction, Hit& hit) {
  const double low[3] = {-box.half[0], -box.half[1], 0};
  const double high[3] = {box.half[0], box.half[1], box.top};
  double enter = 0;
  double leave = hit.t;
  int face = -1;
  for (int axis = 0; axis < 3; ++axis) {
    const double inverse = 1 / direction[axis];  // infinite when parallel: the comparisons hold
    double first = (low[axis] - origin[axis]) * inverse;
    double last = (high[axis] - origin[axis]) * inverse;
    int side = 2 * axis;
    if (first > last) {
      std::swap(first, last);
      side = axis == 2 ? 4 : side + 1;
    }
    if (first > enter) {
      enter = first;
      face = side;
    }
    leave = std::min(leave, last);
    if (!(enter < leave)) return;
  }
  if (face >= 0) hit = {enter, number, face, true};
}

// ---- Cameras ------------------------------------------------------------------------------------

geometry::Camera make_camera(const cv::Size& size, double focal) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal;
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  return camera;
}

// A camera at `center`, `up` above in its image but for `roll` degrees.
geometry::Rigid3 look_along(const Eigen::Vector3d& center, const Eigen::Vector3d& direction,
                            const Eigen::Vector3d& up, double roll) {
  const Eigen::Vector3d forward = direction.normalized();
  const Eigen::Vector3d level = forward.cross(up).normalized();
  const Eigen::Vector3d plumb = forward.cross(level);
  const Eigen::Vector3d right =
      std::cos(roll * kRadians) * level + std::sin(roll * kRadians) * plumb;
  const Eigen::Vector3d down = forward.cross(right);
  Eigen::Matrix3d rotation;
  rotation << right.transpose(), down.transpose(), forward.transpose();
  return {rotation, -(rotation * center)};
}

// Steps of `step` with all of them no longer than `span`, even about 0.
double spread(int index, int count, double step, double span) {
  const double stride = count > 1 ? std::min(step, span / (count - 1)) : step;
  return (index - (count - 1) / 2.0) * stride;
}

// Held by hand: each camera is a little off its place and aim.
geometry::Rigid3 make_pose(Trajectory trajectory, bool pure_rotation, double ring_deg, int index,
                           int count, const Rng& base) {
  Rng rng = base.fork(static_cast<std::uint64_t>(index));
  const Eigen::Vector3d y_up{0, 1, 0};
  const Eigen::Vector3d shake{rng.uniform(-0.08, 0.08), rng.uniform(-0.35, 0.35),
                              rng.uniform(-0.15, 0.15)};
  const Eigen::Vector3d aim{rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0};
  const double roll = rng.uniform(-2, 2);
  if (pure_rotation) {
    const double yaw = spread(index, count, kStepDeg, kSpanDeg) * kRadians;
    const double pitch = rng.uniform(-5, 5) * kRadians;
    return look_along(
        {0, 0, kDistance},
        {std::sin(yaw) * std::cos(pitch), std::sin(pitch), -std::cos(yaw) * std::cos(pitch)}, y_up,
        roll);
  }
  switch (trajectory) {
    case Trajectory::kArc: {
      const double angle = spread(index, count, kStepDeg, kSpanDeg) * kRadians;
      const Eigen::Vector3d center =
          kMiddle + kDistance * Eigen::Vector3d(std::sin(angle), 0, std::cos(angle)) + shake;
      return look_along(center, kMiddle + aim - center, y_up, roll);
    }
    case Trajectory::kRing: {
      const double angle = 360.0 * index / count * kRadians;
      const double rise = (ring_deg + rng.uniform(-2, 2)) * kRadians;
      const Eigen::Vector3d center =
          kMiddle + kDistance * Eigen::Vector3d(std::cos(rise) * std::cos(angle),
                                                std::cos(rise) * std::sin(angle), std::sin(rise));
      return look_along(center, kMiddle + aim - center, {0, 0, 1}, roll);
    }
    case Trajectory::kLine:
      break;
  }
  const Eigen::Vector3d center{spread(index, count, kLineStep, kLineSpan), 0, kDistance};
  return look_along(center + shake, Eigen::Vector3d(0, 0, -kDistance) + aim, y_up, roll);
}

}  // namespace

void SceneOptions::check() const {
  check_fields(*this);
  const int side = std::max(size.width, size.height);
  TARSIER_REQUIRE(focal_px == 0 || (focal_px >= 0.5 * side && focal_px <= 20.0 * side),
                  "focal length {} px of an image of {} px", focal_px, side);
  TARSIER_REQUIRE(details >= 0 && details <= 0.5, "details {} of a side: expected 0..0.5", details);
  TARSIER_REQUIRE(trajectory >= Trajectory::kArc && trajectory <= Trajectory::kLine,
                  "trajectory {}", static_cast<int>(trajectory));
  TARSIER_REQUIRE(content >= Content::kRelief && content <= Content::kSymmetric, "content {}",
                  static_cast<int>(content));
}

struct ReliefScene::Parts {
  SceneOptions options;
  geometry::Camera camera;
  std::vector<geometry::Rigid3> poses;
  HeightField field;
  std::vector<Box> boxes;
  Texture wall;   // not for kNothing
  Texture faces;  // for boxes
  std::array<std::vector<cv::Rect2d>, 4>
      details;  // of kSymmetric, on each side, units from its middle

  explicit Parts(const SceneOptions& wanted) : options(wanted) {
    const int side = std::max(options.size.width, options.size.height);
    const double focal = options.focal_px > 0 ? options.focal_px : side;
    camera = make_camera(options.size, focal);
    const Rng base(options.seed);
    for (int i = 0; i < options.images; ++i) {
      poses.push_back(make_pose(options.trajectory, options.pure_rotation,
                                options.content == Content::kSymmetric ? kSymmetricDeg : kRingDeg,
                                i, options.images, base.fork(kPoseStream)));
    }
    const Content content = options.content;
    // A little finer than the pixels of a camera at its usual distance.
    const double texels = std::clamp(1.25 * focal / kDistance, 10.0, kMaxTexels);
    if (content == Content::kRelief || content == Content::kRepeated ||
        content == Content::kPatchy || content == Content::kShiny) {
      field = HeightField(base.fork(kHeightStream));
    }
    if (content == Content::kRepeated) {
      wall = Texture(kTile, kTile, texels, base.fork(kWallStream));
    } else if (content != Content::kNothing && content != Content::kSymmetric) {
      wall = Texture(kWallWidth, kWallHeight, texels, base.fork(kWallStream));
    }
    if (content == Content::kSymmetric) {
      place_symmetric_box(base.fork(kDetailStream));
      faces = Texture(kFaceCell * kFaceCells, kFaceCell, texels, base.fork(kFaceStream));
    }
    const bool has_fins = content == Content::kThin;
    if (content == Content::kRelief || content == Content::kBoxes || content == Content::kRoom ||
        has_fins) {
      place_boxes(base.fork(kBoxStream));
      if (content == Content::kRoom) build_room();
      faces =
          Texture(kFaceCell * kFaceCells, kFaceCell * kFaceCells, texels, base.fork(kFaceStream));
    }
  }

  // A box, and for each of its sides rectangles until they cover the wanted share of it, or as much as fits.
  void place_symmetric_box(Rng rng) {
    Box box;
    box.half[0] = box.half[1] = kSymmetricHalf;
    box.top = kSymmetricHeight;
    box.tint = {1, 1, 1};
    boxes.push_back(box);
    const double wanted = options.details * 2 * kSymmetricHalf * kSymmetricHeight;
    constexpr int kTries = 1000;
    for (std::vector<cv::Rect2d>& side : details) {
      double covered = 0;
      for (int i = 0; i < kTries && covered < wanted; ++i) {
        const double left = std::min(0.6, std::sqrt(wanted - covered));
        cv::Rect2d detail;
        detail.width = std::min(left, rng.uniform(0.3, 0.6));
        detail.height = std::min(left, rng.uniform(0.3, 0.6));
        detail.x = rng.uniform(-kSymmetricHalf, kSymmetricHalf - detail.width);
        detail.y = rng.uniform(-kSymmetricHeight / 2, kSymmetricHeight / 2 - detail.height);
        if (std::any_of(side.begin(), side.end(),
                        [&](const cv::Rect2d& other) { return (other & detail).area() > 0; }))
          continue;
        side.push_back(detail);
        covered += detail.area();
      }
    }
  }

  // One in each field of a 4 x 3 board, so that they spread and hardly touch.
  void place_boxes(Rng rng) {
    const bool on_plane = options.content != Content::kRelief;
    const double pitch_x = on_plane ? 2.1 : 2.7;
    const double pitch_y = on_plane ? 2.1 : 2.5;
    for (int i = 0; i < kBoxes; ++i) {
      Box box;
      box.x = (i % 4 - 1.5 + rng.uniform(-0.2, 0.2)) * pitch_x;
      box.y = (i / 4 - 1.0 + rng.uniform(-0.2, 0.2)) * pitch_y;
      for (double& half : box.half) half = rng.uniform(0.35, 0.8);
      if (options.content == Content::kThin) box.half[1] *= 0.08;
      // Smaller than a cell of the faces' texture.
      box.top = on_plane ? rng.uniform(0.6, 2.6) : field.height(box.x, box.y) + rng.uniform(0.4, 1);
      const double turn = rng.uniform(-45, 45) * kRadians;
      box.cosine = std::cos(turn);
      box.sine = std::sin(turn);
      for (int c = 0; c < 3; ++c) box.tint[c] = static_cast<float>(rng.uniform(0.72, 1.08));
      boxes.push_back(box);
    }
  }

  // Walls to the left and the right, a floor below.
  void build_room() {
    const auto add = [&](double x, double y, double half_x, double half_y, double top) {
      Box box;
      box.x = x;
      box.y = y;
      box.half[0] = half_x;
      box.half[1] = half_y;
      box.top = top;
      box.tint = {1, 1, 1};
      boxes.push_back(box);
    };
    add(-4.8, 0, 0.6, 5, 3.5);
    add(4.8, 0, 0.6, 5, 3.5);
    add(0, -3.6, 5, 0.6, 3.5);
  }

  [[nodiscard]] const geometry::Rigid3& pose_of(int index) const {
    TARSIER_REQUIRE(index >= 0 && index < options.images, "image {} of {}", index, options.images);
    return poses[static_cast<std::size_t>(index)];
  }

  // What one camera needs for its rays.
  struct View {
    Eigen::Matrix3d to_world = Eigen::Matrix3d::Zero();
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    std::vector<Eigen::Vector3d> in_box;  // the centre, in each box's own axes
    std::vector<cv::Rect2d> around;       // each box in the image, px
  };

  [[nodiscard]] View view_of(const geometry::Rigid3& pose) const {
    View view{pose.rotation.transpose(), pose.center(), {}, {}};
    for (const Box& box : boxes) {
      view.in_box.push_back(box.to_own(view.center - Eigen::Vector3d(box.x, box.y, 0)));
      double left = 1e9;
      double right = -1e9;
      double upper = 1e9;
      double lower = -1e9;
      for (unsigned k = 0; k < 8; ++k) {
        const Eigen::Vector3d corner{(k & 1U) != 0 ? box.half[0] : -box.half[0],
                                     (k & 2U) != 0 ? box.half[1] : -box.half[1],
                                     (k & 4U) != 0 ? box.top : 0};
        const Eigen::Vector3d at = pose * (box.from_own(corner) + Eigen::Vector3d(box.x, box.y, 0));
        if (at[2] < 0.1) {  // beside or behind the camera: look everywhere
          left = upper = -1e9;
          right = lower = 1e9;
          break;
        }
        const double u = camera.fx * at[0] / at[2] + camera.cx;
        const double v = camera.fy * at[1] / at[2] + camera.cy;
        left = std::min(left, u - 1);
        right = std::max(right, u + 1);
        upper = std::min(upper, v - 1);
        lower = std::max(lower, v + 1);
      }
      view.around.emplace_back(left, upper, right - left, lower - upper);
    }
    return view;
  }

  // Of length 1 along the camera's axis, so that t of a hit is its depth.
  [[nodiscard]] Eigen::Vector3d ray(const View& view, double u, double v) const {
    return view.to_world *
           Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
  }

  // The wall is not met before `clear`.
  [[nodiscard]] Hit trace(const View& view, const Eigen::Vector3d& direction, double u, double v,
                          double clear = 0) const {
    Hit hit;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      if (!view.around[i].contains(cv::Point2d(u, v))) continue;
      meet_box(boxes[i], static_cast<int>(i), view.in_box[i], boxes[i].to_own(direction), hit);
    }
    const double t = field.first_hit(view.center, direction, hit.t, clear);
    if (t < hit.t) hit = {t, -1, 0, true};
    return hit;
  }

  // A box (x, y) around what the cameras see, by rays of each in steps of a 32nd of its image.
  [[nodiscard]] cv::Rect2d region_in_view() const {
    constexpr int kRays = 32;
    Eigen::Array2d low(1e9, 1e9);
    Eigen::Array2d high(-1e9, -1e9);
    for (const geometry::Rigid3& pose : poses) {
      const View view = view_of(pose);
      for (int k = 0; k < (kRays + 1) * (kRays + 1); ++k) {
        const double u = static_cast<double>(k % (kRays + 1)) / kRays * (camera.width - 1);
        const double v = static_cast<double>(k / (kRays + 1)) / kRays * (camera.height - 1);
        const Eigen::Vector3d direction = ray(view, u, v);
        const double t = field.first_hit(view.center, direction, kFar);
        if (!(t < kFar)) continue;
        const Eigen::Array2d at = (view.center + t * direction).head<2>().array();
        low = low.min(at);
        high = high.max(at);
      }
    }
    if (!(low[0] <= high[0])) return {};
    const double margin = 0.02 * (high - low).maxCoeff();
    return {low[0] - margin, low[1] - margin, high[0] - low[0] + 2 * margin,
            high[1] - low[1] + 2 * margin};
  }

  // A side of the symmetric box as it is seen from outside: u to the right and v upwards, units from its middle.
  [[nodiscard]] cv::Vec3f symmetric_colour(const Eigen::Vector3d& at, int face,
                                           double footprint) const {
    if (face == 4) return kTop;
    const double u = face == 0 ? -at[1] : face == 1 ? at[1] : face == 2 ? at[0] : -at[0];
    const double v = at[2] - kSymmetricHeight / 2;
    const std::vector<cv::Rect2d>& side = details[static_cast<std::size_t>(face)];
    const bool is_detail = std::any_of(side.begin(), side.end(), [&](const cv::Rect2d& detail) {
      return detail.contains(cv::Point2d(u, v));
    });
    const int cell = is_detail ? 1 + face : 0;
    return faces.at(u + kFaceCell * (cell + 0.5), v + kFaceCell * 0.5, footprint);
  }

  // Squares of 1.5 units without texture, of kPatchy.
  [[nodiscard]] bool is_bare(const Eigen::Vector3d& at) const {
    if (options.content != Content::kPatchy) return false;
    const int column = floor_of(at[0] / 1.5);
    const int row = floor_of(at[1] / 1.5);
    return wrapped(column + 2 * row, 3) == 0;
  }

  // Of the sun, after Phong, "Illumination for computer generated pictures", CACM 1975.
  [[nodiscard]] static cv::Vec3f highlight(const Eigen::Vector3d& normal,
                                           const Eigen::Vector3d& direction) {
    const Eigen::Vector3d mirrored = 2 * normal.dot(kSun) * normal - kSun;
    const double cosine = std::max(0.0, -mirrored.dot(direction.normalized()));
    const auto level = static_cast<float>(150 * std::pow(cosine, 12));
    return {level, level, level};
  }

  [[nodiscard]] cv::Vec3f colour(const View& view, const Eigen::Vector3d& direction,
                                 const Hit& hit) const {
    if (options.content == Content::kSymmetric && hit.box < 0) return kWhite;
    if (!hit.is_any) return kSky;
    // Two samples in a pixel's width.
    const double reach = std::sqrt(direction.dot(direction));
    const auto footprint = [&](const Eigen::Vector3d& normal) {
      const double cosine = std::max(0.05, -normal.dot(direction) / reach);
      return 0.5 * hit.t / camera.fx / std::sqrt(cosine);
    };
    const auto light = [](const Eigen::Vector3d& normal) {
      return static_cast<float>(kAmbient + kDirect * std::max(0.0, normal.dot(kSun)));
    };
    if (hit.box < 0) {
      const Eigen::Vector3d at = view.center + hit.t * direction;
      const cv::Vec2d slope = field.slope(at[0], at[1]);
      const Eigen::Vector3d normal = Eigen::Vector3d(-slope[0], -slope[1], 1).normalized();
      if (options.content == Content::kNothing || is_bare(at)) return light(normal) * kBare;
      const cv::Vec3f matt = light(normal) * wall.at(at[0] + kWallWidth / 2,
                                                     at[1] + kWallHeight / 2, footprint(normal));
      return options.content == Content::kShiny ? matt + highlight(normal, direction) : matt;
    }
    const auto number = static_cast<std::size_t>(hit.box);
    const Box& box = boxes[number];
    const Eigen::Vector3d at = view.in_box[number] + hit.t * box.to_own(direction);
    Eigen::Vector3d own{0, 0, 0};
    own[hit.face / 2] = hit.face == 4 || hit.face % 2 == 1 ? 1 : -1;
    const Eigen::Vector3d normal = box.from_own(own);
    if (options.content == Content::kSymmetric)
      return light(normal) * symmetric_colour(at, hit.face, footprint(normal));
    const int cell = hit.box * 5 + hit.face;
    const double u = (hit.face < 2 ? at[1] : at[0]) + kFaceCell * (cell % kFaceCells + 0.5);
    const double v =
        (hit.face == 4 ? at[1] : at[2] - box.top / 2) + kFaceCell * (cell / kFaceCells + 0.5);
    return light(normal) * faces.at(u, v, footprint(normal)).mul(box.tint);
  }
};

ReliefScene::ReliefScene(const SceneOptions& options) {
  options.check();
  parts_ = std::make_shared<const Parts>(options);
}

int ReliefScene::count() const { return parts_->options.images; }

geometry::Camera ReliefScene::camera() const { return parts_->camera; }

geometry::Rigid3 ReliefScene::pose(int index) const { return parts_->pose_of(index); }

cv::Mat ReliefScene::render(int index, const std::stop_token& stop) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  cv::Mat image(parts.options.size, CV_8UC3);
  // How far the way to the wall is clear is found for a block of pixels, then for each pixel, then for its four samples.
  constexpr int kBlock = 8;
  constexpr double kSample = 0.25;  // px from the middle of a pixel
  const auto spread = [&](double pixels) { return std::sqrt(2.0) * pixels / parts.camera.fx; };
  const int across = (image.cols + kBlock - 1) / kBlock;
  const int down = (image.rows + kBlock - 1) / kBlock;
  cv::parallel_for_(cv::Range(0, across * down), [&](const cv::Range& blocks) {
    for (int block = blocks.start; block < blocks.end && !stop.stop_requested(); ++block) {
      const int left = block % across * kBlock;
      const int top = block / across * kBlock;
      const double middle = (kBlock - 1) / 2.0;
      const double block_clear = parts.field.clear_until(
          view.center, parts.ray(view, left + middle, top + middle), spread(middle + kSample), 0);
      for (int y = top; y < std::min(top + kBlock, image.rows); ++y) {
        auto* out = image.ptr<cv::Vec3b>(y);
        for (int x = left; x < std::min(left + kBlock, image.cols); ++x) {
          const double clear = parts.field.clear_until(view.center, parts.ray(view, x, y),
                                                       spread(kSample), block_clear);
          cv::Vec3f sum{0, 0, 0};
          for (int k = 0; k < 4; ++k) {
            const double u = x + (k % 2 == 0 ? -kSample : kSample);
            const double v = y + (k / 2 == 0 ? -kSample : kSample);
            const Eigen::Vector3d direction = parts.ray(view, u, v);
            sum += parts.colour(view, direction, parts.trace(view, direction, u, v, clear));
          }
          for (int c = 0; c < 3; ++c) out[x][c] = cv::saturate_cast<std::uint8_t>(sum[c] / 4);
        }
      }
    }
  });
  throw_if_stopped(stop);
  add_noise(image, parts.options.noise,
            Rng(parts.options.seed).fork(1000 + static_cast<std::uint64_t>(index))());
  return image;
}

std::optional<double> ReliefScene::depth(int index, cv::Point2d pixel) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  const Hit hit = parts.trace(view, parts.ray(view, pixel.x, pixel.y), pixel.x, pixel.y);
  if (!hit.is_any) return std::nullopt;
  return hit.t;
}

SceneSurface ReliefScene::surface(double step, const std::stop_token& stop) const {
  TARSIER_REQUIRE(step >= 0.005 && step <= 1, "steps of {} units", step);
  const Parts& parts = *parts_;
  return triangulate(parts.field, parts.boxes, parts.camera, parts.poses, parts.region_in_view(),
                     step, stop);
}

PointProblem make_point_problem(std::uint64_t seed, int images, int points, double noise_px,
                                double outlier_share) {
  TARSIER_REQUIRE(images >= 1 && images <= 1000, "{} images", images);
  TARSIER_REQUIRE(points >= 1 && points <= 1000000, "{} points", points);
  TARSIER_REQUIRE(noise_px >= 0 && noise_px <= 100, "noise {} px", noise_px);
  TARSIER_REQUIRE(outlier_share >= 0 && outlier_share <= 1, "share {}", outlier_share);
  PointProblem problem;
  const cv::Size size(640, 480);
  problem.camera = make_camera(size, size.width);
  const geometry::Camera& camera = problem.camera;
  const Rng base(seed);
  Rng places = base.fork(1);
  for (int i = 0; i < points; ++i) {
    const double x = places.uniform(-3, 3);
    const double y = places.uniform(-2, 2);
    problem.points.push_back(kMiddle + Eigen::Vector3d(x, y, places.uniform(-1.5, 1.5)));
  }
  const cv::Rect2d image(-0.5, -0.5, size.width, size.height);
  for (int i = 0; i < images; ++i) {
    problem.poses.push_back(make_pose(Trajectory::kArc, false, kRingDeg, i, images, base.fork(2)));
    Rng rng = base.fork(100 + static_cast<std::uint64_t>(i));
    for (int k = 0; k < points; ++k) {
      const Eigen::Vector3d at = problem.poses.back() * problem.points[static_cast<std::size_t>(k)];
      if (at[2] <= 0) continue;
      const cv::Point2d exact(camera.fx * at[0] / at[2] + camera.cx,
                              camera.fy * at[1] / at[2] + camera.cy);
      if (!image.contains(exact)) continue;
      PointProblem::Seen seen{i, k, exact, rng.uniform() < outlier_share};
      if (seen.outlier) {
        do {
          seen.pixel.x = rng.uniform(0, size.width - 1);
          seen.pixel.y = rng.uniform(0, size.height - 1);
        } while (cv::norm(seen.pixel - exact) <= 10);
      } else {
        seen.pixel.x += rng.normal(0, noise_px);
        seen.pixel.y += rng.normal(0, noise_px);
      }
      problem.seen.push_back(seen);
    }
  }
  return problem;
}

}  // namespace tarsier::synth
