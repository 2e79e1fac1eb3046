// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/sfm/view/render.h"
#include "tarsier/sfm/view/viewer.h"
#include "tarsier/synth/sfm_scene.h"

#include <fmt/format.h>

#include "demo.h"
#include <filesystem>

namespace tarsier::cli {
namespace {

constexpr int kImages = 9;

// The ground truth model: true cameras, and points on the true surface.
sfm::Model true_model(const synth::SfmScene& scene, const sfm::Model& found) {
  sfm::Model model;
  model.cameras = {scene.camera()};
  for (int i = 0; i < scene.count(); ++i) {
    sfm::Image image;
    image.name = found.images[static_cast<std::size_t>(i)].name;
    image.registered = true;
    image.pose = scene.pose(i);
    model.images.push_back(std::move(image));
  }
  const geometry::Camera camera = scene.camera();
  for (const int view : {1, scene.count() / 2, scene.count() - 2}) {
    const cv::Mat rendered = scene.render(view);
    for (int v = 2; v < rendered.rows; v += 5) {
      for (int u = 2; u < rendered.cols; u += 5) {
        const auto depth = scene.depth(view, cv::Point2d(u, v));
        if (!depth) continue;
        sfm::Point point;
        point.position = scene.pose(view).inverse() *
                         Eigen::Vector3d((u - camera.cx) / camera.fx * *depth,
                                         (v - camera.cy) / camera.fy * *depth, *depth);
        point.color = rendered.at<cv::Vec3b>(v, u);
        model.points.push_back(point);
      }
    }
  }
  return model;
}

}  // namespace

void demo_sfm(Context& context, DemoPage& page) {
  page.begin_area(
      "Structure from motion",
      "Structure from motion computes camera poses and a point cloud from images of a scene. This "
      "scene is rendered by the program, so that its ground truth is known.");
  synth::SceneOptions options;
  options.size = {640, 480};
  options.images = kImages;
  const synth::SfmScene scene(options);
  std::vector<sfm::Input> inputs;
  std::vector<DemoImage> images;
  sfm::PoseTruth truth;
  for (int i = 0; i < scene.count(); ++i) {
    throw_if_stopped(context.stop);
    const DemoImage rendered = page.image(fmt::format("sfm-{}", i), scene.render(i));
    const std::string name = std::filesystem::path(rendered.file).filename().string();
    inputs.push_back({name, page.path_of(name)});
    truth[name] = scene.pose(i);
    images.push_back(rendered);
  }
  page.command("tarsier sfm synth -o scene");
  page.heading("Input images");
  page.grid(images);

  sfm::ReconstructorOptions how;
  how.pipeline.camera = scene.camera();
  how.pipeline.features.max_count = 2500;
  const sfm::ReconstructorResult result =
      sfm::Reconstructor(how).run_images(inputs, *context.progress, context.stop);
  throw_if_stopped(context.stop);
  if (result.models().empty()) {
    page.note(result.pipeline.reconstruction.no_model);
    return;
  }
  const sfm::Model& model = result.models()[0];
  page.heading("Reconstruction", "Drag to rotate, scroll to zoom. The pyramids are the cameras.");
  page.command("tarsier sfm reconstruct scene/images --camera-file scene/camera.yaml -o model");
  page.inner_page(sfm::viewer_html(model, "Reconstruction"), "point cloud", 560);
  sfm::ViewOptions view;
  view.size = {720, 480};
  page.grid(
      {page.image("sfm-found", sfm::render_model(model, view), "reconstruction"),
       page.image("sfm-true", sfm::render_model(true_model(scene, model), view), "ground truth")});
  const sfm::PoseScores scores = sfm::evaluate_poses(model, truth, "model");
  const sfm::ModelStatistics statistics = sfm::statistics_of(model);
  page.table(
      {"quantity", "value"},
      {{"images", fmt::format("{} of {}", scores.registered, scores.total)},
       {"points", std::to_string(model.points.size())},
       {"mean track length (images per point)", fmt::format("{:.1f}", statistics.mean_track)},
       {"reprojection error", fmt::format("{:.2f} px", statistics.reprojection_px)},
       {"mean error of camera positions",
        fmt::format("{:.4f} % of the extent", 100 * scores.center_mean / scores.extent)},
       {"mean rotation error", fmt::format("{:.4f} degrees", scores.rotation_mean_deg)}},
      "Comparison with the ground truth");
}

}  // namespace tarsier::cli
