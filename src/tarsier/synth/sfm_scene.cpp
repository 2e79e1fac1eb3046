// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/synth/height_field.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/sfm_scene_objects.h"
#include "tarsier/synth/sfm_scene_paths.h"
#include "tarsier/synth/sfm_scene_solids.h"
#include "tarsier/synth/sfm_scene_streets.h"
#include "tarsier/synth/sfm_scene_surface.h"
#include "tarsier/synth/sfm_scene_texture.h"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace tarsier::synth {
namespace {

const Eigen::Vector3d kSun{-0.46, 0.55, 0.697};
constexpr double kAmbient = 0.45;
constexpr double kDirect = 0.75;
const cv::Vec3f kSky{214, 198, 180};
const cv::Vec3f kUntextured{150, 150, 150};

constexpr double kWallWidth = 51.2;  // units, period of the wall's texture: larger than the view
constexpr double kWallHeight = 25.6;
constexpr double kFaceCell = 3.2;  // units of the boxes' texture per face, 8 x 8 of them
constexpr int kFaceCells = 8;
constexpr double kTile = 1.6;  // units, of Content::kRepeated
constexpr double kMaxTexels = 120;
constexpr int kBoxes = 12;
const cv::Vec3f kWhite{250, 250, 250};  // background of symmetric objects
constexpr double kSymmetricDeg = 20;    // elevation of a ring around them
constexpr double kTallerBy = 0.7;       // units by which the view of temple and toy is higher
constexpr double kParcel = 12.8;        // units of uniform ground, if cameras go far
constexpr double kVillageMargin = 6;    // units of the village beyond the cameras of a grid

enum Stream : std::uint64_t {
  kWallStream = 1,
  kFaceStream,
  kHeightStream,
  kBoxStream,
  kPoseStream,
  kDetailStream
};

geometry::Camera make_camera(const cv::Size& size, double focal) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal;
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  return camera;
}

}  // namespace

void SceneOptions::check() const {
  check_fields(*this);
  const int side = std::max(size.width, size.height);
  TARSIER_REQUIRE(focal_px == 0 || (focal_px >= 0.5 * side && focal_px <= 20.0 * side),
                  "focal length {} px of an image of {} px", focal_px, side);
  TARSIER_REQUIRE(details >= 0 && details <= 0.5, "details {} of a side: expected 0..0.5", details);
  TARSIER_REQUIRE(repeats >= 0 && repeats <= 1, "repeats {}: expected 0..1", repeats);
  TARSIER_REQUIRE(trajectory >= Trajectory::kArc && trajectory <= Trajectory::kCity,
                  "trajectory {}", static_cast<int>(trajectory));
  TARSIER_REQUIRE(content >= Content::kRelief && content <= Content::kToy, "content {}",
                  static_cast<int>(content));
  const bool in_streets = trajectory == Trajectory::kWalk || trajectory == Trajectory::kCity;
  TARSIER_REQUIRE(in_streets == (content == Content::kHouses),
                  "streets and houses: each needs the other");
  TARSIER_REQUIRE(trajectory != Trajectory::kGrid || content == Content::kRelief ||
                      content == Content::kBoxes || content == Content::kPlane,
                  "a grid is flown over relief, boxes or a plane");
  TARSIER_REQUIRE(!in_streets || (images >= 2 && !pure_rotation),
                  "a street needs two images or more, and a camera that moves");
}

struct SfmScene::Parts {
  SceneOptions options;
  geometry::Camera camera;
  std::vector<geometry::Rigid3> poses;
  HeightField field;
  std::vector<Solid> solids;
  std::vector<House> houses;  // appearance of the solids, in streets and in a village
  SymmetricObject object;     // for kSymmetric, kTemple and kToy
  Texture wall;               // not used by kNothing
  Texture faces;              // for boxes

  explicit Parts(const SceneOptions& scene_options) : options(scene_options) {
    const int side = std::max(options.size.width, options.size.height);
    const double focal = options.focal_px > 0 ? options.focal_px : side;
    camera = make_camera(options.size, focal);
    const Rng base(options.seed);
    const Content content = options.content;
    // Slightly finer than the pixels of a camera at its usual distance.
    const double texels = std::clamp(1.25 * focal / kCameraDistance, 10.0, kMaxTexels);
    if (content == Content::kHouses) {
      build_streets(base);
    } else {
      for (int i = 0; i < options.images; ++i) {
        geometry::Rigid3 pose = make_pose(options.trajectory, options.pure_rotation,
                                          is_symmetric() ? kSymmetricDeg : kRingDeg, i,
                                          options.images, base.fork(kPoseStream));
        if (content == Content::kTemple || content == Content::kToy)
          pose.translation -= pose.rotation * Eigen::Vector3d(0, 0, kTallerBy);
        poses.push_back(pose);
      }
    }
    if (content == Content::kRelief || content == Content::kRepeated ||
        content == Content::kPatchy || content == Content::kShiny) {
      field = HeightField(base.fork(kHeightStream));
    }
    if (is_symmetric()) {
      const auto kind = content == Content::kTemple ? SymmetricObject::Kind::kTemple
                        : content == Content::kToy  ? SymmetricObject::Kind::kToy
                                                    : SymmetricObject::Kind::kBox;
      object = SymmetricObject(kind, options.details, texels, base.fork(kDetailStream),
                               base.fork(kFaceStream));
      solids = object.solids();
    } else if (content == Content::kRepeated) {
      wall = Texture(kTile, kTile, texels, base.fork(kWallStream));
    } else if (content != Content::kNothing) {
      wall = Texture(kWallWidth, kWallHeight, texels, base.fork(kWallStream));
    }
    if (options.trajectory == Trajectory::kGrid) {
      if (content != Content::kPlane) build_village(base.fork(kBoxStream));
      return;
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

  [[nodiscard]] bool is_symmetric() const {
    return options.content == Content::kSymmetric || options.content == Content::kTemple ||
           options.content == Content::kToy;
  }

  // Whether cameras see more than one period of the texture.
  [[nodiscard]] bool repeats_texture() const {
    return options.trajectory == Trajectory::kGrid || options.content == Content::kHouses;
  }

  void build_streets(const Rng& base) {
    Streets streets = options.trajectory == Trajectory::kWalk
                          ? make_walk(options.images, options.repeats, base.fork(kBoxStream))
                          : make_city(options.images, options.repeats, base.fork(kBoxStream));
    solids = std::move(streets.solids);
    houses = std::move(streets.houses);
    poses = poses_along(streets.path, options.images, base.fork(kPoseStream));
  }

  void build_village(const Rng& rng) {
    Eigen::Array2d low(1e9, 1e9);
    Eigen::Array2d high(-1e9, -1e9);
    for (const geometry::Rigid3& pose : poses) {
      const Eigen::Array2d at = pose.center().head<2>().array();
      low = low.min(at - kVillageMargin);
      high = high.max(at + kVillageMargin);
    }
    Streets village = make_village({low[0], low[1], high[0] - low[0], high[1] - low[1]}, rng);
    solids = std::move(village.solids);
    houses = std::move(village.houses);
    for (Solid& solid : solids) solid.top += field.height(solid.x, solid.y);
  }

  // One box in each field of a 4 x 3 grid, so that they are spread and hardly touch.
  void place_boxes(Rng rng) {
    const bool on_plane = options.content != Content::kRelief;
    const double pitch_x = on_plane ? 2.1 : 2.7;
    const double pitch_y = on_plane ? 2.1 : 2.5;
    for (int i = 0; i < kBoxes; ++i) {
      Solid box;
      box.x = (i % 4 - 1.5 + rng.uniform(-0.2, 0.2)) * pitch_x;
      box.y = (i / 4 - 1.0 + rng.uniform(-0.2, 0.2)) * pitch_y;
      for (double& half : box.half) half = rng.uniform(0.35, 0.8);
      if (options.content == Content::kThin) box.half[1] *= 0.08;
      // Smaller than a cell of the faces' texture.
      box.top = on_plane ? rng.uniform(0.6, 2.6) : field.height(box.x, box.y) + rng.uniform(0.4, 1);
      const double turn = rng.uniform(-45, 45) * kRadiansPerDegree;
      box.cosine = std::cos(turn);
      box.sine = std::sin(turn);
      for (int c = 0; c < 3; ++c) box.tint[c] = static_cast<float>(rng.uniform(0.72, 1.08));
      solids.push_back(box);
    }
  }

  // Walls on the left and the right, a floor below.
  void build_room() {
    const auto add = [&](double x, double y, double half_x, double half_y, double top) {
      Solid box;
      box.x = x;
      box.y = y;
      box.half[0] = half_x;
      box.half[1] = half_y;
      box.top = top;
      box.tint = {1, 1, 1};
      solids.push_back(box);
    };
    add(-4.8, 0, 0.6, 5, 3.5);
    add(4.8, 0, 0.6, 5, 3.5);
    add(0, -3.6, 5, 0.6, 3.5);
  }

  [[nodiscard]] const geometry::Rigid3& pose_of(int index) const {
    TARSIER_REQUIRE(index >= 0 && index < options.images, "image {} of {}", index, options.images);
    return poses[static_cast<std::size_t>(index)];
  }

  // The data of one camera for its rays.
  struct View {
    struct VisibleSolid {
      std::size_t solid = 0;
      // The camera's centre, in the solid's own axes.
      Eigen::Vector3d from = Eigen::Vector3d::Zero();
      cv::Rect2d around;  // bounding box in the image, px
    };
    Eigen::Matrix3d to_world = Eigen::Matrix3d::Zero();
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    std::vector<VisibleSolid> visible;  // solids that may be visible
  };

  [[nodiscard]] View view_of(const geometry::Rigid3& pose) const {
    View view{pose.rotation.transpose(), pose.center(), {}};
    for (std::size_t i = 0; i < solids.size(); ++i) {
      const Solid& solid = solids[i];
      const Eigen::Vector3d offset(solid.x, solid.y, 0);
      double left = 1e9;
      double right = -1e9;
      double upper = 1e9;
      double lower = -1e9;
      double nearest = 1e9;
      double farthest = -1e9;
      for (unsigned k = 0; k < 8; ++k) {
        const bool is_round = solid.form == Solid::Form::kColumn;
        const double half_y = is_round ? solid.half[0] : solid.half[1];
        const Eigen::Vector3d corner{(k & 1U) != 0 ? solid.half[0] : -solid.half[0],
                                     (k & 2U) != 0 ? half_y : -half_y,
                                     (k & 4U) != 0 ? solid.top : solid.bottom};
        const Eigen::Vector3d at = pose * (solid.from_local(corner) + offset);
        nearest = std::min(nearest, at[2]);
        farthest = std::max(farthest, at[2]);
        const double u = camera.fx * at[0] / at[2] + camera.cx;
        const double v = camera.fy * at[1] / at[2] + camera.cy;
        left = std::min(left, u - 1);
        right = std::max(right, u + 1);
        upper = std::min(upper, v - 1);
        lower = std::max(lower, v + 1);
      }
      if (farthest <= 0 || nearest >= kMaxDistance) continue;
      if (nearest < 0.1) {  // beside the camera: the whole image
        left = upper = -1e9;
        right = lower = 1e9;
      }
      view.visible.push_back({i, solid.to_local(view.center - offset),
                              cv::Rect2d(left, upper, right - left, lower - upper)});
    }
    return view;
  }

  // Has length 1 along the camera's axis, so that t of a hit is its depth.
  [[nodiscard]] Eigen::Vector3d ray(const View& view, double u, double v) const {
    return view.to_world *
           Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
  }

  // The wall is not met before `clear`.
  [[nodiscard]] Hit trace(const View& view, const Eigen::Vector3d& direction, double u, double v,
                          double clear = 0) const {
    Hit hit;
    for (const View::VisibleSolid& candidate : view.visible) {
      if (!candidate.around.contains(cv::Point2d(u, v))) continue;
      const Solid& solid = solids[candidate.solid];
      intersect(solid, static_cast<int>(candidate.solid), candidate.from, solid.to_local(direction),
                hit);
    }
    const double t = field.first_hit(view.center, direction, hit.t, clear);
    if (t < hit.t) hit = {t, -1, 0, true};
    return hit;
  }

  // A box (x, y) around everything that the cameras see, from rays in steps of a 32nd of each
  // image.
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
        const double t = field.first_hit(view.center, direction, kMaxDistance);
        if (!(t < kMaxDistance)) continue;
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

  // Colour of the ground at (x, y).
  [[nodiscard]] cv::Vec3f ground(double x, double y, double footprint) const {
    if (!repeats_texture()) return wall.at(x + kWallWidth / 2, y + kWallHeight / 2, footprint);
    const auto column = static_cast<std::uint32_t>(floor_of(x / kParcel));
    const auto row = static_cast<std::uint32_t>(floor_of(y / kParcel));
    const std::uint64_t key = (std::uint64_t{1} << 62U) + (std::uint64_t{column} << 31U) + row;
    return patchwork(wall, kWallWidth, kWallHeight, key, x, y, footprint);
  }

  // For kPatchy: squares of 1.5 units without texture.
  [[nodiscard]] bool is_untextured(const Eigen::Vector3d& at) const {
    if (options.content != Content::kPatchy) return false;
    const int column = floor_of(at[0] / 1.5);
    const int row = floor_of(at[1] / 1.5);
    return wrapped(column + 2 * row, 3) == 0;
  }

  // Highlight of the sun, after Phong, "Illumination for computer generated pictures", CACM 1975.
  [[nodiscard]] static cv::Vec3f highlight(const Eigen::Vector3d& normal,
                                           const Eigen::Vector3d& direction) {
    const Eigen::Vector3d mirrored = 2 * normal.dot(kSun) * normal - kSun;
    const double cosine = std::max(0.0, -mirrored.dot(direction.normalized()));
    const auto level = static_cast<float>(150 * std::pow(cosine, 12));
    return {level, level, level};
  }

  [[nodiscard]] cv::Vec3f colour(const View& view, const Eigen::Vector3d& direction,
                                 const Hit& hit) const {
    if (hit.solid < 0 && is_symmetric()) return kWhite;
    if (!hit.is_hit) return kSky;
    // Two samples per pixel width.
    const double reach = std::sqrt(direction.dot(direction));
    const auto footprint = [&](const Eigen::Vector3d& normal) {
      const double cosine = std::max(0.05, -normal.dot(direction) / reach);
      return 0.5 * hit.t / camera.fx / std::sqrt(cosine);
    };
    const auto light = [](const Eigen::Vector3d& normal) {
      return static_cast<float>(kAmbient + kDirect * std::max(0.0, normal.dot(kSun)));
    };
    if (hit.solid < 0) {
      const Eigen::Vector3d at = view.center + hit.t * direction;
      const cv::Vec2d slope = field.slope(at[0], at[1]);
      const Eigen::Vector3d normal = Eigen::Vector3d(-slope[0], -slope[1], 1).normalized();
      if (options.content == Content::kNothing || is_untextured(at))
        return light(normal) * kUntextured;
      const cv::Vec3f matt = light(normal) * ground(at[0], at[1], footprint(normal));
      return options.content == Content::kShiny ? matt + highlight(normal, direction) : matt;
    }
    const auto number = static_cast<std::size_t>(hit.solid);
    const Solid& solid = solids[number];
    const Eigen::Vector3d offset(solid.x, solid.y, 0);
    const Eigen::Vector3d at =
        solid.to_local(view.center - offset) + hit.t * solid.to_local(direction);
    const Eigen::Vector3d normal = solid.from_local(solid.normal(hit.face, at));
    if (is_symmetric())
      return light(normal) * object.colour(hit.solid, hit.face, at, footprint(normal));
    if (!houses.empty()) {
      return light(normal) * house_colour(houses[number], solid, hit.face, at, wall, kWallWidth,
                                          kWallHeight, footprint(normal))
                                 .mul(solid.tint);
    }
    const int cell = hit.solid * 5 + hit.face;
    const double u = (hit.face < 2 ? at[1] : at[0]) + kFaceCell * (cell % kFaceCells + 0.5);
    const double v = (hit.face == kTopFace ? at[1] : at[2] - solid.top / 2) +
                     kFaceCell * (cell / kFaceCells + 0.5);
    return light(normal) * faces.at(u, v, footprint(normal)).mul(solid.tint);
  }
};

SfmScene::SfmScene(const SceneOptions& options) {
  options.check();
  parts_ = std::make_shared<const Parts>(options);
}

int SfmScene::count() const { return parts_->options.images; }

geometry::Camera SfmScene::camera() const { return parts_->camera; }

geometry::Rigid3 SfmScene::pose(int index) const { return parts_->pose_of(index); }

cv::Mat SfmScene::render(int index, const std::stop_token& stop) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  cv::Mat image(parts.options.size, CV_8UC3);
  // The free distance to the wall is found for a block of pixels, then for each pixel, then for its
  // four samples.
  constexpr int kBlock = 8;
  constexpr double kSample = 0.25;  // px from the centre of a pixel
  const auto spread = [&](double pixels) { return std::sqrt(2.0) * pixels / parts.camera.fx; };
  const int across = (image.cols + kBlock - 1) / kBlock;
  const int down = (image.rows + kBlock - 1) / kBlock;
  cv::parallel_for_(cv::Range(0, across * down), [&](const cv::Range& blocks) {
    for (int block = blocks.start; block < blocks.end && !stop.stop_requested(); ++block) {
      const int left = block % across * kBlock;
      const int top = block / across * kBlock;
      const double center = (kBlock - 1) / 2.0;
      const double block_clear = parts.field.free_distance(
          view.center, parts.ray(view, left + center, top + center), spread(center + kSample), 0);
      for (int y = top; y < std::min(top + kBlock, image.rows); ++y) {
        auto* out = image.ptr<cv::Vec3b>(y);
        for (int x = left; x < std::min(left + kBlock, image.cols); ++x) {
          const double clear = parts.field.free_distance(view.center, parts.ray(view, x, y),
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

std::optional<double> SfmScene::depth(int index, cv::Point2d pixel) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  const Hit hit = parts.trace(view, parts.ray(view, pixel.x, pixel.y), pixel.x, pixel.y);
  if (!hit.is_hit) return std::nullopt;
  return hit.t;
}

SceneSurface SfmScene::surface(double step, const std::stop_token& stop) const {
  TARSIER_REQUIRE(step >= 0.005 && step <= 1, "steps of {} units", step);
  const Parts& parts = *parts_;
  return triangulate(parts.field, parts.solids, parts.camera, parts.poses, parts.region_in_view(),
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
  Rng positions = base.fork(1);
  for (int i = 0; i < points; ++i) {
    const double x = positions.uniform(-3, 3);
    const double y = positions.uniform(-2, 2);
    problem.points.emplace_back(kSceneCenter + Eigen::Vector3d(x, y, positions.uniform(-1.5, 1.5)));
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
      PointProblem::Observation observation{i, k, exact, rng.uniform() < outlier_share};
      if (observation.outlier) {
        do {
          observation.pixel.x = rng.uniform(0, size.width - 1);
          observation.pixel.y = rng.uniform(0, size.height - 1);
        } while (cv::norm(observation.pixel - exact) <= 10);
      } else {
        observation.pixel.x += rng.normal(0, noise_px);
        observation.pixel.y += rng.normal(0, noise_px);
      }
      problem.observations.push_back(observation);
    }
  }
  return problem;
}

}  // namespace tarsier::synth
