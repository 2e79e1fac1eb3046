// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/features.h"

#include <opencv2/core.hpp>

#include <array>
#include <string>
#include <vector>

// A flat printed image to be detected and tracked.
namespace tarsier::planar::image_targets {

// A feature of one training view of the image.
struct TrainedFeature {
  cv::Point2f at;           // px of the image
  cv::Matx22f frame;        // from the feature's own (rotated, scaled) grid to px of the image
  int correct_matches = 0;  // number of trials in which it was matched correctly
};

// See quality.h. All values 0..1.
struct Quality {
  double rating = 0;                 // overall rating; 0.6 or more is a good target
  double features = 0;               // 1: enough features that are robust to tilt, blur and noise
  double spread = 0;                 // 1: the features cover the whole image
  double distinct = 0;               // 1: no feature resembles another place of the image
  double repeatability = 0;          // share of trials in which the image was detected
  std::vector<std::string> reasons;  // one problem per line; empty for a good image
};

struct Target {
  std::string name;
  double width = 0;        // metres, of the image's outer edge on the print, not of pixel centres
  double height = 0;       // metres
  cv::Size original_size;  // px, of the original image given for training
  cv::Mat gray;            // CV_8UC1; "px of the image" means pixels of this one
  std::vector<TrainedFeature> features;
  std::vector<Descriptor> descriptors;  // of each feature
  Quality quality;

  // Derived from `gray` and `descriptors` (see compute_derived_members()).
  Pyramid pyramid;  // with half steps
  // For each level: corners for alignment, px of the image. The first n of them are spread evenly.
  std::vector<std::vector<cv::Point2f>> anchors;
  std::vector<SketchBlock> sketches;  // of the descriptors, for the search

  [[nodiscard]] cv::Size size() const { return gray.size(); }
  // Corners of the image's outer edge, px: top left first, clockwise.
  [[nodiscard]] std::array<cv::Point2d, 4> corners() const;
  // The same homography for px of the original image; its element (2, 2) is 1.
  [[nodiscard]] cv::Matx33d from_original_image(const cv::Matx33d& homography) const;
  // Converts px of the image to metres on the print (x right, y up, origin at the centre).
  [[nodiscard]] cv::Point2d on_plane(const cv::Point2d& image) const;
};

// Computes the members derived from `gray` and `descriptors`.
void compute_derived_members(Target& target);

}  // namespace tarsier::planar::image_targets
