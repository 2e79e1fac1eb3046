// SPDX-License-Identifier: MIT
#include "tarsier/synth/face/synth_face.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/render/render.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace tarsier::synth {

namespace {

constexpr double kMaxDeviations = 2.5;
constexpr double kRoom = 0.6;  // margin of the wide texture around the frame, relative to its size

// Smooth blobs of colour.
void draw_background(cv::Mat& image, Rng& rng) {
  cv::Mat coarse(6, 8, CV_8UC3);
  const std::array<int, 3> base{rng.integer(60, 190), rng.integer(60, 190), rng.integer(60, 190)};
  for (int y = 0; y < coarse.rows; ++y) {
    for (int x = 0; x < coarse.cols; ++x) {
      const int light = rng.integer(-45, 45);
      for (int k = 0; k < 3; ++k) {
        coarse.ptr<cv::Vec3b>(y)[x][k] = cv::saturate_cast<std::uint8_t>(
            base[static_cast<std::size_t>(k)] + light + rng.integer(-12, 12));
      }
    }
  }
  cv::resize(coarse, image, image.size(), 0, 0, cv::INTER_CUBIC);
}

void add_noise(cv::Mat& image, double sigma, Rng& rng) {
  if (sigma <= 0) return;
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<std::uint8_t>(y);
    for (int i = 0; i < 3 * image.cols; ++i)
      row[i] = cv::saturate_cast<std::uint8_t>(row[i] + sigma * rng.normal());
  }
}

}  // namespace

FaceSynth::FaceSynth(const face::appearance::AppearanceModel& appearance,
                     face::head::HeadModel head)
    : appearance_(appearance), synthesis_(appearance), head_(std::move(head)) {
  head_.check();
  TARSIER_REQUIRE(head_.points() == appearance.points(), "a head of {} points, a face of {}",
                  head_.points(), appearance.points());
  TARSIER_REQUIRE(appearance.outer.empty(), "a face with a margin around its points");
  const face::shape::PiecewiseWarp& warp = synthesis_.texture().warp;
  const int room = static_cast<int>(kRoom * std::max(warp.size().width, warp.size().height));
  inner_ = {{room, room}, warp.size()};
  outside_ = cv::Mat(warp.size().height + 2 * room, warp.size().width + 2 * room, CV_8UC1,
                     cv::Scalar(255));
  // One pixel smaller than the mesh, because its edge pixels are only partly covered.
  cv::Mat inside;
  cv::erode(warp.mask(), inside, {}, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(0));
  outside_(inner_).setTo(0, inside);
  points_at_ = warp.frame_points().colwise() + Eigen::Vector2d(room, room);
  const face::shape::Similarity2d front =
      face::shape::fit_similarity(head_.mean.topRows(2), points_at_);
  px_per_mm_ = front.scale();
  px_origin_ = {front.tx, front.ty};
  // For each pixel outside, the nearest pixel of the face.
  cv::Mat distance;
  cv::Mat labels;
  cv::distanceTransform(outside_, distance, labels, cv::DIST_L2, cv::DIST_MASK_5,
                        cv::DIST_LABEL_PIXEL);
  std::vector<int> pixel_of_label;
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      if (outside_.at<std::uint8_t>(y, x) != 0) continue;
      const auto label = static_cast<std::size_t>(labels.at<int>(y, x));
      if (pixel_of_label.size() <= label) pixel_of_label.resize(label + 1, 0);
      pixel_of_label[label] = y * labels.cols + x;
    }
  }
  nearest_inside_.create(labels.size(), CV_32S);
  for (int y = 0; y < labels.rows; ++y)
    for (int x = 0; x < labels.cols; ++x)
      nearest_inside_.at<int>(y, x) =
          pixel_of_label[static_cast<std::size_t>(labels.at<int>(y, x))];
}

FacePerson FaceSynth::person(std::uint64_t seed, double spread) const {
  Rng rng(seed);
  const auto draw = [&](const Eigen::VectorXd& deviation) {
    Eigen::VectorXd values(deviation.size());
    for (Eigen::Index k = 0; k < values.size(); ++k)
      values[k] = spread * std::clamp(rng.normal(), -kMaxDeviations, kMaxDeviations) * deviation[k];
    return values;
  };
  FacePerson person;
  person.b = draw(head_.deviation);
  person.c = draw(synthesis_.texture().deviation);
  const double light = rng.uniform(0.15, 1);
  person.hair[2] = cv::saturate_cast<std::uint8_t>(light * rng.uniform(80, 150));
  person.hair[1] = cv::saturate_cast<std::uint8_t>(light * rng.uniform(60, 120));
  person.hair[0] = cv::saturate_cast<std::uint8_t>(light * rng.uniform(40, 90));
  return person;
}

cv::Mat FaceSynth::texture(const FacePerson& person) const {
  cv::Mat wide(outside_.size(), CV_8UC3, cv::Scalar::all(0));
  synthesis_.frame(person.c).copyTo(wide(inner_));
  // Outside, the face's own colours continue, smoother with the distance.
  for (int y = 0; y < wide.rows; ++y) {
    for (int x = 0; x < wide.cols; ++x) {
      if (outside_.at<std::uint8_t>(y, x) == 0) continue;
      const int from = nearest_inside_.at<int>(y, x);
      wide.at<cv::Vec3b>(y, x) = wide.at<cv::Vec3b>(from / wide.cols, from % wide.cols);
    }
  }
  cv::Mat smooth;
  cv::GaussianBlur(wide, smooth, {}, 0.07 * inner_.width);
  smooth.copyTo(wide, outside_);
  return wide;
}

FaceTruth FaceSynth::draw(cv::Mat& image, const FacePerson& person, const geometry::Camera& camera,
                          const geometry::Rigid3& camera_from_head, const FaceSceneOptions& options,
                          std::uint64_t seed) const {
  options.check();
  camera.check();
  Rng rng(seed);
  if (options.with_background) {
    image.create(camera.height, camera.width, CV_8UC3);
    draw_background(image, rng);
  }
  TARSIER_REQUIRE(image.cols == camera.width && image.rows == camera.height,
                  "an image of {}x{} px for a camera of {}x{}", image.cols, image.rows,
                  camera.width, camera.height);
  render::Scene scene;
  render::Item item;
  item.mesh = std::make_shared<render::Mesh>(mesh(person));
  item.camera_from_mesh = camera_from_head;
  scene.items.push_back(item);
  const double angle = options.light_yaw * std::numbers::pi / 180;
  scene.light = {{-std::sin(angle), 0.4, std::cos(angle)}, options.ambient, options.diffuse, 0, 30};
  scene.antialias = true;
  scene.near = 10;
  render::render(image, scene, camera);
  if (options.blur_px > 0) cv::GaussianBlur(image, image, {}, options.blur_px);
  add_noise(image, options.noise, rng);

  FaceTruth truth;
  truth.camera_from_head = camera_from_head;
  const Eigen::Matrix3Xd shape = face::head::shape_of(head_, [&] {
    Eigen::VectorXd b = Eigen::VectorXd::Zero(head_.mode_count());
    b.head(std::min(b.size(), person.b.size())) =
        person.b.head(std::min(b.size(), person.b.size()));
    return b;
  }());
  truth.points.resize(2, shape.cols());
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    const auto at = camera.project(camera_from_head * shape.col(i));
    TARSIER_REQUIRE(at.has_value(), "a head behind the camera");
    truth.points.col(i) = Eigen::Vector2d(at->x, at->y);
  }
  return truth;
}

}  // namespace tarsier::synth
