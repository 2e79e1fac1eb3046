// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_view.h"

#include "tarsier/core/require.h"
#include "tarsier/render/render.h"
#include "tarsier/sfm/view/framing.h"

#include <algorithm>
#include <memory>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinPoints = 50;             // points
constexpr std::size_t kMaxFrameVertices = 20'000;  // vertices that determine the frame

// The cameras and points; vertices instead where there are too few points. Points indicate the
// subject of the images, while the surface may extend far behind it.
Model framed_model(const TexturedSurface& surface, const Model& model) {
  Model result;
  result.cameras = model.cameras;
  for (const Image& image : model.images) {
    Image camera;
    camera.name = image.name;
    camera.camera = image.camera;
    camera.registered = image.registered;
    camera.pose = image.pose;
    result.images.push_back(std::move(camera));
  }
  for (const sfm::Point& known : model.points) {
    Point point;
    point.position = known.position;
    result.points.push_back(std::move(point));
  }
  if (result.points.size() >= kMinPoints) return result;
  const std::vector<Eigen::Vector3f>& vertices = surface.mesh.vertices;
  const std::size_t stride = std::max<std::size_t>(1, vertices.size() / kMaxFrameVertices);
  for (std::size_t v = 0; v < vertices.size(); v += stride) {
    Point point;
    point.position = vertices[v].cast<double>();
    result.points.push_back(std::move(point));
  }
  return result;
}

class Drawer {
 public:
  Drawer(const TexturedSurface& surface, const Model& model)
      : model_(framed_model(surface, model)) {
    render::Item item;
    item.mesh = std::make_shared<const render::Mesh>(render_mesh(surface));
    scene_.items.push_back(item);
    scene_.antialias = true;
    scene_.light.direction = {0.4, 0.6, 1};
    const bool colored = !surface.mesh.colors.empty();
    scene_.light.ambient = surface.texture ? 1 : colored ? 0.75 : 0.35;
    scene_.light.diffuse = surface.texture ? 0 : colored ? 0.35 : 0.8;
  }

  cv::Mat draw(ViewOptions options) {
    options.cameras = false;
    const Viewpoint view = viewpoint_of(model_, options);
    cv::Mat image(options.size, CV_8UC3, cv::Scalar(options.background));
    scene_.items[0].camera_from_mesh = view.pose;
    scene_.near = 0.01 * view.distance;
    render::render(image, scene_, view.camera);
    return image;
  }

 private:
  Model model_;
  render::Scene scene_;
};

}  // namespace

Eigen::Matrix3d upright_of(const TexturedSurface& surface, const Model& model) {
  return frame_model(framed_model(surface, model), false).base;
}

cv::Mat render_surface(const TexturedSurface& surface, const Model& model,
                       const ViewOptions& options) {
  options.check();
  return Drawer(surface, model).draw(options);
}

void render_surface_turntable(const TexturedSurface& surface, const Model& model,
                              const ViewOptions& options, int frames,
                              const std::function<void(int, const cv::Mat&)>& take) {
  options.check();
  TARSIER_REQUIRE(frames >= 1, "{}", frames);
  Drawer drawer(surface, model);
  for (int i = 0; i < frames; ++i) {
    ViewOptions turned = options;
    turned.yaw_deg += 360.0 * i / frames;
    take(i, drawer.draw(turned));
  }
}

}  // namespace tarsier::sfm
