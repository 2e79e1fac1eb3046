// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_objects.h"

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

using Form = Solid::Form;

const cv::Vec3f kTop{170, 170, 170};
constexpr double kTextureWidth = 25.6;  // units
constexpr double kCell = 3.2;           // units of the box's texture per side
constexpr double kObjectHeight = 25.6;  // units of the texture of temple and toy
constexpr double kShelf = 2.56;         // units of its height per row of faces
constexpr double kGap = 0.1;            // between faces

Solid make_solid(Form form, double x, double y, double half_x, double half_y, double bottom,
                 double top) {
  Solid solid;
  solid.form = form;
  solid.x = x;
  solid.y = y;
  solid.half[0] = half_x;
  solid.half[1] = half_y;
  solid.bottom = bottom;
  solid.top = top;
  return solid;
}

Solid rotated_180(Solid solid) {
  solid.x = -solid.x;
  solid.y = -solid.y;
  solid.cosine = -1;
  return solid;
}

int faces_of(const Solid& solid) { return solid.form == Form::kColumn ? 1 : 4; }

bool is_centred(const Solid& solid) { return solid.x == 0 && solid.y == 0; }

}  // namespace

SymmetricObject::SymmetricObject(Kind kind, double details, double texels_per_unit, Rng rng,
                                 const Rng& texture_rng)
    : kind_(kind) {
  switch (kind) {
    case Kind::kBox:
      make_box();
      break;
    case Kind::kTemple:
      make_temple();
      break;
    case Kind::kToy:
      make_toy();
      break;
  }
  assign_textures();
  place_details(details, rng);
  texture_ = Texture(kTextureWidth, kind == Kind::kBox ? kCell : kObjectHeight, texels_per_unit,
                     texture_rng);
}

// Adds a solid that looks like the one with index `same_as`; returns its index.
int SymmetricObject::add(const Solid& solid, int same_as) {
  const auto number = static_cast<int>(solids_.size());
  solids_.push_back(solid);
  same_as_.push_back(same_as < 0 ? number : same_as);
  return number;
}

void SymmetricObject::make_box() { add(make_solid(Form::kBox, 0, 0, 1.5, 1.5, 0, 2.4)); }

// Two steps, columns around a hall, the entablature, and a roof.
void SymmetricObject::make_temple() {
  add(make_solid(Form::kBox, 0, 0, 2.3, 1.6, 0, 0.25));
  add(make_solid(Form::kBox, 0, 0, 2.1, 1.4, 0, 0.45));
  add(make_solid(Form::kBox, 0, 0, 1.3, 0.65, 0.45, 2));
  add(make_solid(Form::kBox, 0, 0, 2.05, 1.35, 2, 2.4));
  add(make_solid(Form::kGable, 0, 0, 2.1, 1.4, 2.4, 3.1));
  int first = -1;
  const auto add_column = [&](double x, double y) {
    const int number = add(make_solid(Form::kColumn, x, y, 0.17, 0.17, 0.45, 2), first);
    if (first < 0) first = number;
  };
  for (int k = 0; k < 6; ++k)
    for (const double y : {-1.1, 1.1}) add_column((k - 2.5) * 0.72, y);
  for (const double y : {-1.1 / 3, 1.1 / 3})
    for (const double x : {-1.8, 1.8}) add_column(x, y);
}

// A figure that faces +x, and also -x.
void SymmetricObject::make_toy() {
  add(make_solid(Form::kBox, 0, 0, 1, 1.2, 0, 0.2));
  add(make_solid(Form::kBox, 0, 0, 0.45, 0.8, 0.9, 2.1));
  add(make_solid(Form::kColumn, 0, 0, 0.2, 0.2, 2.1, 2.3));
  add(make_solid(Form::kBox, 0, 0, 0.4, 0.45, 2.3, 3));
  const auto add_two = [&](const Solid& solid) { add(rotated_180(solid), add(solid)); };
  add_two(make_solid(Form::kBox, 0, 0.42, 0.3, 0.3, 0.2, 0.9));
  add_two(make_solid(Form::kColumn, 0, 1, 0.17, 0.17, 0.8, 2));
}

// The centre of a free place of the texture.
cv::Point2d SymmetricObject::allocate_texture(double width) {
  if (next_free_.x + width > kTextureWidth) next_free_ = {0, next_free_.y + kShelf};
  const cv::Point2d center(next_free_.x + width / 2, next_free_.y + kShelf / 2);
  next_free_.x += width + kGap;
  return center;
}

void SymmetricObject::assign_textures() {
  faces_.resize(solids_.size());
  for (std::size_t k = 0; k < solids_.size(); ++k) {
    const Solid& solid = solids_[k];
    for (int face = 0; face < faces_of(solid); ++face) {
      Face& entry = faces_[k][static_cast<std::size_t>(face)];
      if (kind_ == Kind::kBox) {
        entry.texture_center = {kCell / 2, kCell / 2};
        entry.detail_center = {kCell * (1 + face + 0.5), kCell / 2};
        continue;
      }
      const double width = solid.size_of(face).width;
      entry.detail_center = allocate_texture(width);
      if (same_as_[k] != static_cast<int>(k)) {
        entry.texture_center =
            faces_[static_cast<std::size_t>(same_as_[k])][static_cast<std::size_t>(face)]
                .texture_center;
      } else if (is_centred(solid) && face % 2 == 1) {
        entry.texture_center =
            faces_[k][static_cast<std::size_t>(face - 1)].texture_center;  // after half a turn
      } else {
        entry.texture_center = allocate_texture(width);
      }
    }
  }
}

// Adds rectangles to each face until they cover the share of it, or as many as fit.
void SymmetricObject::place_details(double share, Rng rng) {
  constexpr int kMaxAttempts = 1000;
  for (std::size_t k = 0; k < solids_.size(); ++k) {
    for (int face = 0; face < faces_of(solids_[k]); ++face) {
      const cv::Size2d size = solids_[k].size_of(face);
      const double target_area = share * size.area();
      const double largest = std::min({0.6, size.width, size.height});
      const double smallest = std::min(0.3, largest / 2);
      std::vector<cv::Rect2d>& details = faces_[k][static_cast<std::size_t>(face)].details;
      double covered = 0;
      for (int i = 0; i < kMaxAttempts && covered < target_area; ++i) {
        const double left = std::min(largest, std::sqrt(target_area - covered));
        cv::Rect2d detail;
        detail.width = std::min(left, rng.uniform(smallest, largest));
        detail.height = std::min(left, rng.uniform(smallest, largest));
        detail.x = rng.uniform(-size.width / 2, size.width / 2 - detail.width);
        detail.y = rng.uniform(-size.height / 2, size.height / 2 - detail.height);
        if (std::any_of(details.begin(), details.end(),
                        [&](const cv::Rect2d& other) { return (other & detail).area() > 0; }))
          continue;
        details.push_back(detail);
        covered += detail.area();
      }
    }
  }
}

cv::Vec3f SymmetricObject::colour(int solid, int face, const Eigen::Vector3d& local,
                                  double footprint) const {
  if (face >= kTopFace) return kTop;
  const auto number = static_cast<std::size_t>(solid);
  const Face& entry = faces_[number][static_cast<std::size_t>(face)];
  cv::Point2d at = solids_[number].on_face(face, local);
  const bool is_detail = std::any_of(entry.details.begin(), entry.details.end(),
                                     [&](const cv::Rect2d& detail) { return detail.contains(at); });
  // Columns look the same from four sides.
  if (!is_detail && solids_[number].form == Form::kColumn)
    at.x = std::fmod(at.x + solids_[number].size_of(face).width,
                     solids_[number].size_of(face).width / 4);
  const cv::Point2d in_texture = at + (is_detail ? entry.detail_center : entry.texture_center);
  return texture_.at(in_texture.x, in_texture.y, footprint);
}

}  // namespace tarsier::synth
