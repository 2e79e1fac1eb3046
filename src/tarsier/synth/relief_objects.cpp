// SPDX-License-Identifier: MIT
#include "tarsier/synth/relief_objects.h"

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

Solid half_turned(Solid solid) {
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
  give_looks();
  place_details(details, rng);
  texture_ = Texture(kTextureWidth, kind == Kind::kBox ? kCell : kObjectHeight, texels_per_unit,
                     texture_rng);
}

// Adds a solid that looks like the one with index `like`; returns its index.
int SymmetricObject::add(const Solid& solid, int like) {
  const auto number = static_cast<int>(solids_.size());
  solids_.push_back(solid);
  like_.push_back(like < 0 ? number : like);
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
  const auto add_two = [&](const Solid& solid) { add(half_turned(solid), add(solid)); };
  add_two(make_solid(Form::kBox, 0, 0.42, 0.3, 0.3, 0.2, 0.9));
  add_two(make_solid(Form::kColumn, 0, 1, 0.17, 0.17, 0.8, 2));
}

// The centre of a free place of the texture.
cv::Point2d SymmetricObject::room_for(double width) {
  if (free_.x + width > kTextureWidth) free_ = {0, free_.y + kShelf};
  const cv::Point2d middle(free_.x + width / 2, free_.y + kShelf / 2);
  free_.x += width + kGap;
  return middle;
}

void SymmetricObject::give_looks() {
  faces_.resize(solids_.size());
  for (std::size_t k = 0; k < solids_.size(); ++k) {
    const Solid& solid = solids_[k];
    for (int face = 0; face < faces_of(solid); ++face) {
      Face& here = faces_[k][static_cast<std::size_t>(face)];
      if (kind_ == Kind::kBox) {
        here.look = {kCell / 2, kCell / 2};
        here.own = {kCell * (1 + face + 0.5), kCell / 2};
        continue;
      }
      const double width = solid.size_of(face).width;
      here.own = room_for(width);
      if (like_[k] != static_cast<int>(k)) {
        here.look = faces_[static_cast<std::size_t>(like_[k])][static_cast<std::size_t>(face)].look;
      } else if (is_centred(solid) && face % 2 == 1) {
        here.look = faces_[k][static_cast<std::size_t>(face - 1)].look;  // after half a turn
      } else {
        here.look = room_for(width);
      }
    }
  }
}

// Adds rectangles to each face until they cover the share of it, or as many as fit.
void SymmetricObject::place_details(double share, Rng rng) {
  constexpr int kTries = 1000;
  for (std::size_t k = 0; k < solids_.size(); ++k) {
    for (int face = 0; face < faces_of(solids_[k]); ++face) {
      const cv::Size2d size = solids_[k].size_of(face);
      const double wanted = share * size.area();
      const double largest = std::min({0.6, size.width, size.height});
      const double smallest = std::min(0.3, largest / 2);
      std::vector<cv::Rect2d>& placed = faces_[k][static_cast<std::size_t>(face)].details;
      double covered = 0;
      for (int i = 0; i < kTries && covered < wanted; ++i) {
        const double left = std::min(largest, std::sqrt(wanted - covered));
        cv::Rect2d detail;
        detail.width = std::min(left, rng.uniform(smallest, largest));
        detail.height = std::min(left, rng.uniform(smallest, largest));
        detail.x = rng.uniform(-size.width / 2, size.width / 2 - detail.width);
        detail.y = rng.uniform(-size.height / 2, size.height / 2 - detail.height);
        if (std::any_of(placed.begin(), placed.end(),
                        [&](const cv::Rect2d& other) { return (other & detail).area() > 0; }))
          continue;
        placed.push_back(detail);
        covered += detail.area();
      }
    }
  }
}

cv::Vec3f SymmetricObject::colour(int solid, int face, const Eigen::Vector3d& own,
                                  double footprint) const {
  if (face >= kTopFace) return kTop;
  const auto number = static_cast<std::size_t>(solid);
  const Face& here = faces_[number][static_cast<std::size_t>(face)];
  cv::Point2d at = solids_[number].on_face(face, own);
  const bool is_detail = std::any_of(here.details.begin(), here.details.end(),
                                     [&](const cv::Rect2d& detail) { return detail.contains(at); });
  // Columns look the same from four sides.
  if (!is_detail && solids_[number].form == Form::kColumn)
    at.x = std::fmod(at.x + solids_[number].size_of(face).width,
                     solids_[number].size_of(face).width / 4);
  const cv::Point2d in_texture = at + (is_detail ? here.own : here.look);
  return texture_.at(in_texture.x, in_texture.y, footprint);
}

}  // namespace tarsier::synth
