// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/upright_model.h"

#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/sensor_image.h"

#include <Eigen/Geometry>

namespace tarsier::sfm {

void turn_upright(Model& model) {
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  bool any = false;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    any = any || image.turns != 0;
    down += image.pose.rotation.transpose() * down_direction(image.turns);
  }
  if (!any || !(down.norm() > 1e-3)) return;
  geometry::Sim3 upright;
  upright.rotation =
      Eigen::Quaterniond::FromTwoVectors(down, Eigen::Vector3d::UnitY()).toRotationMatrix();
  transform(model, upright);
}

}  // namespace tarsier::sfm
