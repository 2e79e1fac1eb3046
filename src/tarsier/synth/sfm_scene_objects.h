// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/sfm_scene_solids.h"
#include "tarsier/synth/sfm_scene_texture.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <vector>

// The symmetric objects on white of sfm_scene.h. Internal to this module.
namespace tarsier::synth {

class SymmetricObject {
 public:
  enum class Kind {
    kBox,     // 3 x 3 x 2.4 units, four identical sides
    kTemple,  // 4.6 x 3.2 x 3.1 units, 16 identical columns; symmetric under half a turn
    kToy,     // 2.0 x 2.4 x 3.0 units, identical front and back
  };

  SymmetricObject() = default;
  // `details`: unique share of each face except tops and bottoms, 0..0.5; `rng`: of the positions
  // of the details; `texture_rng`: of the texture.
  SymmetricObject(Kind kind, double details, double texels_per_unit, Rng rng,
                  const Rng& texture_rng);

  [[nodiscard]] const std::vector<Solid>& solids() const { return solids_; }

  // Colour in noon light; `local`: a point of the face in the axes of the solid.
  [[nodiscard]] cv::Vec3f colour(int solid, int face, const Eigen::Vector3d& local,
                                 double footprint) const;

 private:
  // Position of its centre in the texture, and that of its details.
  struct Face {
    cv::Point2d texture_center;
    cv::Point2d detail_center;
    std::vector<cv::Rect2d> details;  // units from its centre, v upwards
  };

  int add(const Solid& solid, int same_as = -1);
  void make_box();
  void make_temple();
  void make_toy();
  cv::Point2d allocate_texture(double width);
  void assign_textures();
  void place_details(double share, Rng rng);

  Kind kind_ = Kind::kBox;
  std::vector<Solid> solids_;
  std::vector<int> same_as_;  // for each solid: the one that it looks like
  std::vector<std::array<Face, 4>> faces_;
  Texture texture_;
  cv::Point2d next_free_{0, 0};  // next free place in the texture
};

}  // namespace tarsier::synth
