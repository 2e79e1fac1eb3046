// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/head/draw_pose.h"
#include "tarsier/face/head/point_file.h"
#include "tarsier/face/head/posit.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "verbs/pose/pose.h"
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

// An object that is flatter than this share of its width looks almost the same from two sides.
constexpr double kNearlyFlat = 0.1;

struct SolveFlags {
  std::string object;
  std::string points;
  std::string camera;
  double focal = 0;
  std::string method = "auto";
  std::string origin;  // empty: corner if there is an image or camera
  int reference = 0;
  bool no_refine = false;
  std::string image;
  std::string output;
  double axes = 0;
};

bool has_center_origin(const SolveFlags& flags) {
  if (flags.origin.empty()) return flags.camera.empty() && flags.image.empty();
  return flags.origin == "center";
}

// The camera for whose pixels the points are given.
geometry::Camera solve_camera(const SolveFlags& flags, const cv::Mat& image) {
  geometry::Camera camera;
  if (!flags.camera.empty()) {
    camera = camera_of(flags.camera);
  } else if (flags.focal > 0) {
    camera.fx = camera.fy = flags.focal;
    if (!image.empty()) {
      camera.cx = (image.cols - 1) / 2.0;
      camera.cy = (image.rows - 1) / 2.0;
    } else if (!has_center_origin(flags)) {
      throw UsageError("--origin corner needs --image or --camera, which give the principal point");
    }
  } else {
    throw UsageError("give --focal PX or --camera FILE");
  }
  if (!image.empty()) {
    if (camera.width > 0 && (camera.width != image.cols || camera.height != image.rows)) {
      throw InputError(flags.image,
                       fmt::format("is {} x {} px, the camera's images are {} x {}", image.cols,
                                   image.rows, camera.width, camera.height));
    }
    camera.width = image.cols;
    camera.height = image.rows;
  }
  // The size is needed only for drawing.
  if (camera.width <= 0) camera.width = static_cast<int>(std::ceil(2 * camera.cx)) + 1;
  if (camera.height <= 0) camera.height = static_cast<int>(std::ceil(2 * camera.cy)) + 1;
  camera.check();
  return camera;
}

struct Solution {
  std::string method;
  std::vector<face::head::PositPose> poses;
  std::string reason;
};

Solution solve(const SolveFlags& flags, const face::head::PositModel& model,
               const Eigen::Matrix2Xd& image, const geometry::Camera& camera) {
  face::head::PositOptions options;
  options.refine_steps = flags.no_refine ? 0 : 20;
  options.method = flags.method == "posit-classic" ? face::head::PositMethod::kClassic
                                                   : face::head::PositMethod::kHomogeneous;
  Solution solution;
  solution.method = flags.method;
  if (flags.method == "auto") {
    solution.method = model.flatness() < kNearlyFlat ? "planar" : "posit";
  }
  const bool planar = solution.method == "planar";
  // A defect of the object is an error of the input.
  const std::string defect = planar ? model.planar_defect() : model.defect();
  if (!defect.empty()) throw InputError(flags.object, defect);
  face::head::PositWorkspace workspace;
  if (!planar) {
    const face::head::PositResult result =
        face::head::posit(model, image, camera, options, workspace);
    if (result.pose) solution.poses.push_back(*result.pose);
    solution.reason = result.reason;
    return solution;
  }
  Eigen::Matrix2Xd normalized(2, image.cols());
  for (Eigen::Index i = 0; i < image.cols(); ++i) {
    const auto x = camera.normalized_of({image(0, i), image(1, i)});
    if (!x) {
      solution.reason = "a point lies where the camera's distortion cannot be undone";
      return solution;
    }
    normalized.col(i) << x->x, x->y;
  }
  const face::head::PlanarPositResult both =
      face::head::posit_planar(model, normalized, options, workspace);
  for (const auto& pose : both.poses) {
    if (!pose) continue;
    solution.poses.push_back(*pose);
    solution.poses.back().rms *= std::sqrt(camera.fx * camera.fy);
  }
  solution.reason = both.reason;
  return solution;
}

void draw_solution(cv::Mat& image, const SolveFlags& flags, const Eigen::Matrix3Xd& object,
                   const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
                   const face::head::PositPose& pose) {
  const Eigen::Vector3d extent = object.rowwise().maxCoeff() - object.rowwise().minCoeff();
  const double length = flags.axes > 0 ? flags.axes : 0.6 * extent.maxCoeff();
  face::head::draw_axes(image, camera, pose.camera_from_object, {length, length, length});
  for (Eigen::Index i = 0; i < object.cols(); ++i) {
    if (const auto pixel = camera.project(pose.camera_from_object * object.col(i))) {
      image::draw::cross(image, *pixel, {0, 220, 255}, 6);
    }
    image::draw::point(image, {points(0, i), points(1, i)}, {255, 120, 40}, 2.5);
  }
}

nlohmann::ordered_json json_of(const face::head::PositPose& pose,
                               const std::optional<face::head::PositSigma>& sigma) {
  nlohmann::ordered_json object;
  object["rotation"] = geometry::row_major(pose.camera_from_object.rotation);
  const Eigen::Vector3d& t = pose.camera_from_object.translation;
  object["translation"] = {t[0], t[1], t[2]};
  if (sigma) {
    const Eigen::Vector3d& rotation = sigma->rotation_deg;
    object["turn_sigma_deg"] = {rotation[0], rotation[1], rotation[2]};
    const Eigen::Vector3d& shift = sigma->translation;
    object["translation_sigma"] = {shift[0], shift[1], shift[2]};
  }
  object["rms_px"] = pose.rms;
  object["iterations"] = pose.iterations;
  object["converged"] = pose.converged;
  return object;
}

std::string text_of(const face::head::PositPose& pose,
                    const std::optional<face::head::PositSigma>& sigma) {
  std::string text;
  const Eigen::Matrix3d& r = pose.camera_from_object.rotation;
  for (int row = 0; row < 3; ++row) {
    text += fmt::format("{:>12}  {:9.5f} {:9.5f} {:9.5f}\n", row == 0 ? "rotation" : "", r(row, 0),
                        r(row, 1), r(row, 2));
  }
  const Eigen::Vector3d& t = pose.camera_from_object.translation;
  text += fmt::format("{:>12}  {:9.3f} {:9.3f} {:9.3f}\n", "translation", t[0], t[1], t[2]);
  if (sigma) {
    const Eigen::Vector3d& shift = sigma->translation;
    text += fmt::format("{:>12}  {:9.3f} {:9.3f} {:9.3f}\n", "+-", shift[0], shift[1], shift[2]);
    const Eigen::Vector3d& rotation = sigma->rotation_deg;
    text += fmt::format("{:>12}  {:9.3f} {:9.3f} {:9.3f} degrees about x, y, z\n", "turn +-",
                        rotation[0], rotation[1], rotation[2]);
  }
  return text + fmt::format("{:>12}  {:.3f} px, {} iterations{}\n", "rms", pose.rms,
                            pose.iterations, pose.converged ? "" : ", not converged");
}

ExitStatus run_solve(const SolveFlags& flags, Context& context) {
  if (!flags.output.empty() && flags.image.empty() && flags.camera.empty()) {
    throw UsageError("-o needs --image, the image to draw on, or --camera");
  }
  const Eigen::Matrix3Xd object = face::head::read_point_file(flags.object, 3);
  Eigen::Matrix2Xd points = face::head::read_point_file(flags.points, 2);
  if (points.cols() != object.cols()) {
    throw InputError(flags.points,
                     fmt::format("has {} points, the object {}", points.cols(), object.cols()));
  }
  if (flags.reference >= object.cols()) {
    throw UsageError(fmt::format("--reference {}: the object has points 0..{}", flags.reference,
                                 object.cols() - 1));
  }
  cv::Mat image;
  if (!flags.image.empty()) image = read_image(flags.image);
  const geometry::Camera camera = solve_camera(flags, image);
  if (has_center_origin(flags)) points.colwise() += Eigen::Vector2d(camera.cx, camera.cy);
  const face::head::PositModel model(object, {}, flags.reference);
  const Solution solution = solve(flags, model, points, camera);
  if (!flags.output.empty() && !solution.poses.empty()) {
    if (image.empty()) {
      image = cv::Mat(camera.height, camera.width, CV_8UC3, cv::Scalar(250, 248, 246));
    }
    draw_solution(image, flags, object, points, camera, solution.poses.front());
    write_image(flags.output, image);
  }
  const auto sigma_of = [&](const face::head::PositPose& pose) {
    return face::head::posit_sigma(object, points, camera, pose.camera_from_object);
  };
  if (context.json) {
    nlohmann::ordered_json line;
    line["points"] = object.cols();
    line["method"] = solution.method;
    line["flatness"] = model.flatness();
    line["poses"] = nlohmann::ordered_json::array();
    for (const face::head::PositPose& pose : solution.poses)
      line["poses"].push_back(json_of(pose, sigma_of(pose)));
    if (solution.poses.empty()) line["reason"] = solution.reason;
    print_json(line);
  } else if (solution.poses.empty()) {
    print_text(fmt::format("no pose: {}\n", solution.reason));
  } else {
    print_text(fmt::format("{} points, method {}{}\n", object.cols(), solution.method,
                           solution.poses.size() > 1
                               ? ": nearly flat, so there are two poses, the better one first"
                               : ""));
    for (const face::head::PositPose& pose : solution.poses)
      print_text(text_of(pose, sigma_of(pose)));
  }
  return solution.poses.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_flags(Command& verb, SolveFlags& flags) {
  verb.add_option("--object", flags.object, "object points: x y z a line, '#' begins a comment")
      .required();
  verb.add_option("--points", flags.points,
                  "image points in the same order: x y a line, px, x right, y down")
      .required();
  Flag& camera = verb.add_option("--camera", flags.camera,
                                 "camera file of `calibrate`, or fx,fy,cx,cy[,k1,k2,p1,p2[,k3]]");
  verb.add_option("--focal", flags.focal,
                  "focal length, px; principal point at the image centre [none: this or --camera]")
      .check(above(0))
      .excludes(camera);
  verb.add_option("--origin", flags.origin,
                  "origin of --points: corner (centre of the top left pixel) or center (principal "
                  "point) [corner with --image or --camera]")
      .check(one_of({"corner", "center"}));
  verb.add_option("--method", flags.method,
                  "posit (homogeneous), posit-classic, planar (both poses), or auto: planar for "
                  "flat objects, else posit")
      .check(one_of({"auto", "posit", "posit-classic", "planar"}))
      .show_default();
  verb.add_option(
          "--reference", flags.reference,
          "index of the reference point of posit-classic, whose projection is taken as exact")
      .check(range(0, 1000000))
      .show_default();
  verb.add_flag("--no-refine", flags.no_refine,
                "POSIT without Levenberg-Marquardt refinement (planar poses are always refined)");
  verb.add_option("--image", flags.image, "image to draw on");
  verb.add_option("-o,--output", flags.output,
                  "output image: axes, image points (dots) and reprojections (crosses)");
  verb.add_option("--axes", flags.axes,
                  "length of the axes, object units [0.6 of the object's extent]")
      .check(above(0));
}

}  // namespace

void add_pose_solve(Command& area, Context& context) {
  add_verb<SolveFlags>(area, "solve", "estimate the pose of an object from its points in one image",
                       context, add_flags, run_solve);
}

}  // namespace tarsier::cli
