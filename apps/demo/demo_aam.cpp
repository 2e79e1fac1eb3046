// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/head/draw_pose.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/sfm/view/animation.h"
#include "tarsier/synth/face/synth_face.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "demo.h"
#include "ui/face/pose_session.h"
#include "verbs/aam/engine.h"
#include "verbs/pose/engine.h"
#include <cmath>
#include <numbers>

namespace tarsier::cli {
namespace {

constexpr int kHeadFrameCount = 36;  // of the turning head

cv::Mat cropped(const cv::Mat& image, const Eigen::Matrix2Xd& points) {
  const Eigen::Vector2d low = points.rowwise().minCoeff();
  const Eigen::Vector2d high = points.rowwise().maxCoeff();
  const double size = 1.7 * (high - low).maxCoeff();
  const Eigen::Vector2d center = (low + high) / 2;
  const cv::Rect box = cv::Rect(cvRound(center.x() - size / 2), cvRound(center.y() - size / 2),
                                cvRound(size), cvRound(size)) &
                       cv::Rect(0, 0, image.cols, image.rows);
  cv::Mat large;
  cv::resize(image(box), large, {300, 300}, 0, 0, cv::INTER_AREA);
  return large;
}

// Start, some iterations, the end, and the model's synthesis there.
std::vector<DemoImage> fit_sequence(DemoPage& page, const face::appearance::AppearanceModel& model,
                                    const synth::FaceSynth& faces) {
  const geometry::Camera camera = face::head::guess_camera({800, 800});
  cv::Mat image;
  const synth::FaceTruth truth =
      faces.draw(image, faces.person(11), camera,
                 {face::head::rotation_of_angles({12, -4, 6}), {0, 10, 620}}, {}, 11);
  face::shape::Similarity2d start_transform =
      face::shape::fit_similarity(model.shape.mean, truth.points);
  start_transform.tx += 22;
  start_transform.ty -= 18;
  face::appearance::FitOptions options;
  options.method = face::appearance::Method::kAlternating;
  options.trace = true;
  const face::appearance::Fitter fitter(model, options);
  face::appearance::FitWorkspace workspace;
  const face::appearance::FitResult fit =
      fitter.fit(image, start_transform(model.shape.mean), workspace);
  std::vector<DemoImage> strip;
  const std::size_t last = fit.trace.size() - 1;
  const double eyes = (truth.points.col(36) - truth.points.col(45)).norm();
  for (const std::size_t step :
       {std::size_t{0}, std::size_t{1}, std::size_t{2}, std::min<std::size_t>(4, last), last}) {
    cv::Mat overlay = image.clone();
    const Eigen::Matrix2Xd& points = fit.trace[step].points;
    face::appearance::draw_mesh(model, points, overlay);
    const double error = 100 * (points - truth.points).colwise().norm().mean() / eyes;
    const std::string name = step == 0      ? "start"
                             : step == last ? "end"
                                            : fmt::format("step {}", step);
    strip.push_back(page.image(fmt::format("aam-fit-{}", strip.size()),
                               cropped(overlay, truth.points),
                               fmt::format("{}: {:.1f} % of the eye distance", name, error)));
  }
  cv::Mat made = image.clone();
  const face::appearance::Synthesis synthesis(model);
  const face::appearance::TextureFit seen = synthesis.fit_texture(image, fit.points);
  synthesis.draw(seen.c, seen.offset, seen.gain, fit.points, made);
  strip.push_back(page.image("aam-fit-made", cropped(made, truth.points), "the fitted model"));
  return strip;
}

}  // namespace

void demo_aam(Context& context, DemoPage& page) {
  const face::appearance::AppearanceModel model =
      face::appearance::read_appearance_model(shipped_appearance_model());
  const synth::FaceSynth faces(model, read_head(""));
  page.begin_area("Active appearance model of faces",
                  "An active appearance model describes shape and texture by a few modes each. It "
                  "was trained on a thousand faces. Every face here is synthetic.");
  page.command("tarsier aam explore --grid modes.png");
  page.grid({page.image("aam-grid", face::appearance::draw_mode_grid(model, 3, 120, context.seed),
                        "three shape modes and three texture modes, at -3 to 3 standard "
                        "deviations; below, random faces")});
  throw_if_stopped(context.stop);
  page.heading("Fitting",
               "The fit starts at a wrong position. Each step warps the image to the mean shape "
               "and updates the parameters by the remaining difference. The head is rendered, so "
               "that its ground truth is known.");
  page.command(
      "tarsier pose synth --count 1 -o heads && tarsier aam fit heads/images/0000.png -o "
      "fitted.png");
  page.strip(fit_sequence(page, model, faces));
}

// A synthetic head that turns, with the axes of the estimated pose. Like `pose track` it uses only
// the image.
void demo_turning_head(Context& context, DemoPage& page) {
  const face::appearance::AppearanceModel model =
      face::appearance::read_appearance_model(shipped_appearance_model());
  const synth::FaceSynth faces(model, read_head(""));
  const face::PoseTrackerOptions options = pose_options({});
  const geometry::Camera camera = face::head::guess_camera({360, 360});
  PoseSession session(face::PoseTracker(load_pose_models(options), options), {});
  std::vector<cv::Mat> frames;
  double error = 0;
  int posed = 0;
  for (int i = 0; i < kHeadFrameCount; ++i) {
    throw_if_stopped(context.stop);
    const double phase = 2 * std::numbers::pi * i / kHeadFrameCount;
    const geometry::Rigid3 truth{
        face::head::rotation_of_angles(
            {32 * std::sin(phase), 10 * std::sin(2 * phase), 6 * std::cos(phase)}),
        {0, 10, 520}};
    Frame frame;
    frame.name = "turning head";
    frame.index = i;
    frame.time = i / 12.0;
    faces.draw(frame.image, faces.person(21), camera, truth, {}, 5);
    frames.push_back(session.on_frame(frame, {}).output.clone());
    if (session.faces().empty() || !session.faces().front().pose) continue;
    const Eigen::Matrix3d estimated = session.faces().front().pose->camera_from_head.rotation;
    error += geometry::angle_of(estimated * truth.rotation.transpose()) * 180 / std::numbers::pi;
    ++posed;
  }
  const std::string file = page.path_of("pose-turning.gif");
  sfm::write_gif(file, frames, 12);
  page.heading(
      "A rotating head",
      "The head is rendered with a known pose. The axes show the pose estimated from the image.");
  page.command(
      "tarsier pose synth --video --count 36 -o head && tarsier pose track head/images "
      "--sequence -o posed");
  page.grid(
      {DemoImage{"img/pose-turning.gif",
                 posed > 0 ? fmt::format("found in {} of {} frames, mean error {:.1f} degrees",
                                         posed, kHeadFrameCount, error / posed)
                           : std::string("not found"),
                 360, 360}});
}

}  // namespace tarsier::cli
