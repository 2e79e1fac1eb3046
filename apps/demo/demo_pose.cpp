// SPDX-License-Identifier: MIT
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/head/draw_pose.h"
#include "tarsier/face/head/posit.h"
#include "tarsier/face/head/surface.h"
#include "tarsier/media/image_file.h"
#include "tarsier/render/builtin.h"
#include "tarsier/render/render.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "demo.h"
#include "ui/face/pose_session.h"
#include "verbs/pose/engine.h"
#include "verbs/program/sample_images.h"
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

const std::string kFaceImage = sample_image("messi5.jpg");

geometry::Camera demo_camera(int width, int height) {
  geometry::Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 760;
  camera.cx = (width - 1) / 2.0;
  camera.cy = (height - 1) / 2.0;
  return camera;
}

// A cube of 100 mm on a table, drawn with its true pose.
cv::Mat cube_image(const geometry::Camera& camera, const geometry::Rigid3& camera_from_cube) {
  cv::Mat image(camera.height, camera.width, CV_8UC3, cv::Scalar(222, 226, 230));
  render::Scene scene;
  scene.antialias = true;
  render::Item cube;
  cube.mesh = std::make_shared<const render::Mesh>(render::make_cube());
  cube.scale = 100;
  cube.camera_from_mesh = camera_from_cube;
  const geometry::Rigid3 cube_on_table{Eigen::Matrix3d::Identity(), {0, 0, 50}};
  render::Item shadow = cube;
  const Eigen::Vector3d light(0.9, 0.5, -1.2);
  shadow.mesh = std::make_shared<const render::Mesh>(
      render::planar_shadow(*cube.mesh, cube_on_table, cube.scale, light));
  shadow.scale = 1;
  shadow.camera_from_mesh = camera_from_cube * cube_on_table.inverse();
  shadow.role = render::Role::kShadow;
  scene.light.direction = camera_from_cube.rotation * light;
  scene.items = {shadow, cube};
  render::render(image, scene, camera);
  return image;
}

// The corners with 0.5 px of noise, and the pose estimated from them.
DemoImage cube_with_axes(DemoPage& page, Context& context) {
  const geometry::Camera camera = demo_camera(480, 360);
  const Eigen::Matrix3d upright{{1, 0, 0}, {0, 0, -1}, {0, 1, 0}};  // z up, y away from the camera
  const face::head::HeadAngles tilt{0, -28, 0};
  const double turn = 0.6;
  const Eigen::Matrix3d about_z{
      {std::cos(turn), -std::sin(turn), 0}, {std::sin(turn), std::cos(turn), 0}, {0, 0, 1}};
  const geometry::Rigid3 truth{face::head::rotation_of_angles(tilt) * upright * about_z,
                               {-12, 14, 430}};
  cv::Mat image = cube_image(camera, truth);
  Eigen::Matrix3Xd object(3, 8);
  Eigen::Matrix2Xd projected(2, 8);
  Rng rng(context.seed);
  for (int i = 0; i < 8; ++i) {
    object.col(i) << ((i & 1) != 0 ? 50 : -50), ((i & 2) != 0 ? 50 : -50),
        ((i & 4) != 0 ? 50 : -50);
    const auto pixel = camera.project(truth * object.col(i));
    projected.col(i) << pixel->x + 0.5 * rng.normal(), pixel->y + 0.5 * rng.normal();
  }
  face::head::PositOptions options;
  options.refine_steps = 10;
  face::head::PositWorkspace workspace;
  const face::head::PositResult result =
      face::head::posit(face::head::PositModel(object), projected, camera, options, workspace);
  std::string text = "no pose";
  if (result.pose) {
    const geometry::Rigid3& pose = result.pose->camera_from_object;
    face::head::draw_axes(image, camera, pose, {90, 90, 90});
    text = fmt::format(
        "a cube of 100 mm, observed corners with 0.5 px of noise: {} iterations, errors of {:.2f} "
        "degrees and {:.1f} mm",
        result.pose->iterations,
        geometry::angle_of(pose.rotation * truth.rotation.transpose()) * 180 / CV_PI,
        (pose.translation - truth.translation).norm());
  }
  return page.drawing("pose-cube", image, text);
}

// The enlarged face with the drawings of `pose track --draw`. The camera is that of the whole
// image.
struct Portrait {
  cv::Mat image;
  geometry::Camera camera;
};

std::optional<Portrait> portrait_of(const cv::Mat& image, const face::LandmarkTracker& tracker) {
  Frame frame;
  frame.image = image;
  frame.still = true;
  face::LandmarkState state;
  const std::vector<face::landmarks::TrackedFace> found = tracker.process(frame, state).faces;
  if (found.empty()) return std::nullopt;
  const cv::Rect2d& box = found.front().box;
  const cv::Rect around =
      cv::Rect(cvRound(box.x - 0.9 * box.width), cvRound(box.y - 0.9 * box.height),
               cvRound(2.8 * box.width), cvRound(2.6 * box.height)) &
      cv::Rect(0, 0, image.cols, image.rows);
  const double zoom = 440.0 / around.width;
  Portrait portrait;
  cv::resize(image(around), portrait.image, {}, zoom, zoom, cv::INTER_CUBIC);
  geometry::Camera& camera = portrait.camera;
  camera = face::head::guess_camera(image.size());
  camera.width = portrait.image.cols;
  camera.height = portrait.image.rows;
  camera.fx *= zoom;
  camera.fy *= zoom;
  camera.cx = (camera.cx - around.x + 0.5) * zoom - 0.5;
  camera.cy = (camera.cy - around.y + 0.5) * zoom - 0.5;
  return portrait;
}

DemoImage posed_image(DemoPage& page, const Portrait& portrait, const std::string& name,
                      PoseOverlay overlay, const std::string& caption) {
  face::PoseTrackerOptions options = pose_options({});
  options.camera = portrait.camera;
  PoseSessionOptions drawing;
  drawing.overlay = overlay;
  if (overlay == PoseOverlay::kObject) {
    drawing.object = std::make_shared<const render::Mesh>(render::make_glasses());
  }
  PoseSession session(face::PoseTracker(load_pose_models(options), options), drawing);
  Frame frame;
  frame.image = portrait.image;
  frame.still = true;
  frame.name = kFaceImage;
  const View view = session.on_frame(frame, {});
  std::string text = caption;
  if (!session.faces().empty() && session.faces().front().pose) {
    const face::head::HeadAngles& angles = session.faces().front().pose->angles;
    text += fmt::format(": yaw {:+.0f}, pitch {:+.0f}, roll {:+.0f} degrees", angles.yaw_deg,
                        angles.pitch_deg, angles.roll_deg);
  }
  return page.image(name, view.output.clone(), text);
}

// The shipped head, learnt from flat images, in three poses; two of them wear drawn objects.
DemoImage draw_trained_head(DemoPage& page) {
  const face::head::HeadModel model = read_head("");
  const face::head::HeadSurface surface = face::head::head_surface(model, model.mean);
  auto skin = std::make_shared<render::Mesh>();
  render::Material material;
  material.color = {0.62F, 0.72F, 0.86F};
  skin->materials.push_back(material);
  for (Eigen::Index i = 0; i < surface.points.cols(); ++i) {
    const Eigen::Vector3f x = surface.points.col(i).cast<float>();
    skin->positions.emplace_back(x[0], x[1], x[2]);
  }
  for (const std::array<int, 3>& corners : surface.triangles) {
    render::Triangle triangle;
    triangle.position = corners;
    triangle.material = 0;
    skin->triangles.push_back(triangle);
  }
  render::add_normals(*skin, 60);
  const geometry::Camera camera = demo_camera(720, 300);
  cv::Mat image(camera.height, camera.width, CV_8UC3, cv::Scalar(232, 230, 226));
  render::Scene scene;
  scene.antialias = true;
  scene.shading = render::Shading::kPhong;
  scene.light.specular = 0.15;
  std::vector<geometry::Rigid3> poses;
  for (int i = 0; i < 3; ++i) {
    const geometry::Rigid3 pose{face::head::rotation_of_angles({35.0 - 35 * i, 5.0 * i, 0}),
                                {250.0 * (i - 1), 25, 860}};
    render::Item item;
    item.mesh = skin;
    item.camera_from_mesh = pose;
    scene.items.push_back(item);
    if (i > 0) {
      item.mesh = std::make_shared<const render::Mesh>(i == 1 ? render::make_glasses()
                                                              : render::make_hat());
      scene.items.push_back(item);
    }
    poses.push_back(pose);
  }
  render::render(image, scene, camera);
  face::head::draw_head(image, camera, poses[0], model, model.mean);
  return page.drawing("pose-head", image,
                      "the included head model: 68 points and a skull behind them, at yaw 35, 0 "
                      "and -35 degrees; glasses and hat are drawn by --draw");
}

}  // namespace

void demo_pose(Context& context, DemoPage& page) {
  page.begin_area(
      "Head and object pose",
      "The pose of a known object from one image, by POSIT and Levenberg-Marquardt. The pose of a "
      "head uses 3D points that were learned from images of a thousand faces.");
  page.command("tarsier pose solve --object cube.txt --points seen.txt --focal 760");
  page.grid({cube_with_axes(page, context)});
  page.grid({draw_trained_head(page)});
  // The turning head of the appearance model is inserted here.
  throw_if_stopped(context.stop);
  page.command(fmt::format("tarsier pose track {} -o posed.png", kFaceImage));
  if (!std::filesystem::exists(kFaceImage)) {
    page.note(
        "No image: the package opencv-doc is not installed. Install it and run the demo again.");
    demo_turning_head(context, page);
    return;
  }
  const std::optional<Portrait> portrait =
      portrait_of(read_image(kFaceImage), load_landmark_tracker({}));
  if (!portrait) return;
  std::vector<DemoImage> images;
  images.push_back(posed_image(page, *portrait, "pose-messi", PoseOverlay::kAxes, "--draw axes"));
  throw_if_stopped(context.stop);
  images.push_back(posed_image(page, *portrait, "pose-glasses", PoseOverlay::kObject,
                               "--draw glasses: the head hides what is behind it"));
  page.grid(images);
  demo_turning_head(context, page);
}

}  // namespace tarsier::cli
