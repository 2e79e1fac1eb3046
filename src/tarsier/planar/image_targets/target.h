// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/features.h"

#include <opencv2/core.hpp>

#include <array>
#include <string>
#include <vector>

// A flat printed image that is to be found and followed.
namespace tarsier::planar::image_targets {

// A feature as some view of the image showed it.
struct TrainedFeature {
  cv::Point2f at;     // px of the image
  cv::Matx22f frame;  // px of the image for one of the feature's own (turned, scaled) grid
  int right = 0;      // trials in which a feature of a view was rightly matched to it
};

// See quality.h. Each 0..1.
struct Quality {
  double rating = 0;                 // of them all: from 0.6 on a good target
  double features = 0;               // 1: enough features that stand tilt, blur and noise
  double spread = 0;                 // 1: they are all over the image
  double distinct = 0;               // 1: none looks like another place of the image
  double repeatable = 0;             // share of trials in which the image was found
  std::vector<std::string> reasons;  // what is wrong, one line each; empty for a good image
};

struct Target {
  std::string name;
  double width = 0;   // of the print, metres; of the image's outer edge, not of pixel centres
  double height = 0;  // metres
  cv::Size given;     // px, of the image that was given for training
  cv::Mat gray;       // CV_8UC1, the image at the size that all px of the image here mean
  std::vector<TrainedFeature> features;
  std::vector<Description> descriptions;  // of each feature
  Quality quality;

  // Follow from `gray` (see complete()).
  Pyramid pyramid;                                // in half steps
  std::vector<std::vector<cv::Point2f>> anchors;  // for each level: corners to align, px of the
                                                  // image; the first n of them are spread
  std::vector<SketchBlock> sketches;              // of the descriptions, for the search

  [[nodiscard]] cv::Size size() const { return gray.size(); }
  // Corners of the image's outer edge, px: top left, then clockwise.
  [[nodiscard]] std::array<cv::Point2d, 4> corners() const;
  // The same homography for px of the image that was given; its element (2, 2) is 1.
  [[nodiscard]] cv::Matx33d from_given_image(const cv::Matx33d& homography) const;
  // Metres on the print (x right, y up, origin in the middle) of px of the image.
  [[nodiscard]] cv::Point2d on_plane(const cv::Point2d& image) const;
};

// Computes what follows from `gray` and `descriptions`.
void complete(Target& target);

}  // namespace tarsier::planar::image_targets
