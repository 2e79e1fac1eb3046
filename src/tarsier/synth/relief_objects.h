// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/relief_solids.h"
#include "tarsier/synth/relief_texture.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <vector>

// The objects on white of relief.h, which look nearly the same after a turn. Internal to this module.
namespace tarsier::synth {

class SymmetricObject {
 public:
  enum class Kind {
    kBox,     // 3 x 3 x 2.4 units, four sides alike
    kTemple,  // 4.6 x 3.2 x 3.1 units, 16 columns alike; the same after half a turn
    kToy,     // 2.0 x 2.4 x 3.0 units, front and back alike
  };

  SymmetricObject() = default;
  // `details`: share of each face but tops and bottoms that no other face has, 0..0.5; `rng`: of the places of these;
  // `texture_rng`: of what it looks like.
  SymmetricObject(Kind kind, double details, double texels_per_unit, Rng rng,
                  const Rng& texture_rng);

  [[nodiscard]] const std::vector<Solid>& solids() const { return solids_; }

  // In the light of noon; `own`: a point of the face in the axes of the solid.
  [[nodiscard]] cv::Vec3f colour(int solid, int face, const Eigen::Vector3d& own,
                                 double footprint) const;

 private:
  // Where its middle lies in the texture, and where that of its details does.
  struct Face {
    cv::Point2d look;
    cv::Point2d own;
    std::vector<cv::Rect2d> details;  // units from its middle, v upwards
  };

  int add(const Solid& solid, int like = -1);
  void make_box();
  void make_temple();
  void make_toy();
  cv::Point2d room_for(double width);
  void give_looks();
  void place_details(double share, Rng rng);

  Kind kind_ = Kind::kBox;
  std::vector<Solid> solids_;
  std::vector<int> like_;  // of each solid: the one that it looks like
  std::vector<std::array<Face, 4>> faces_;
  Texture texture_;
  cv::Point2d free_{0, 0};  // of the texture
};

}  // namespace tarsier::synth
