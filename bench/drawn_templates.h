// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/face/recognition/recognizer.h"

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

// Random templates of people without face images. Their distribution is that of a background: how
// people differ, and how the images of one person differ.
namespace tarsier::cli {

inline constexpr int kDrawnImages = 5;  // per person

class DrawnTemplates {
 public:
  // `spread` scales the scatter of a person's images relative to that of the background.
  DrawnTemplates(const face::recognition::Background& background, double spread, std::uint64_t seed,
                 const std::stop_token& stop);

  // Image i of a person. Images from kDrawnImages on are in no gallery. There may be any number of
  // people.
  struct Image {
    std::int64_t person = 0;
    int image = 0;
  };
  [[nodiscard]] face::recognition::Rows coordinates(std::span<const Image> images) const;
  [[nodiscard]] face::recognition::Rows templates(std::span<const Image> images) const {
    return projection_(coordinates(images));
  }
  // A source of the first `count` images, with ids from 1.
  [[nodiscard]] face::recognition::TemplateSource source(std::int64_t count) const;
  [[nodiscard]] const face::recognition::Recognizer& recognizer() const { return recognizer_; }

 private:
  const face::recognition::Background* background_;
  double spread_;
  std::uint64_t seed_;
  face::recognition::Rows people_;  // standard deviation of people along each direction
  face::recognition::Rows within_;  // m x m: a root of the scatter within people
  face::recognition::Recognizer recognizer_;
  face::recognition::CoordinateProjection projection_;
};

}  // namespace tarsier::cli
