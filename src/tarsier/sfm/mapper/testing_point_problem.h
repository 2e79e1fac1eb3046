// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"
#include "tarsier/synth/sfm_scene.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm::test_support {

// A point problem in the form of the mapper's input: features, and matches by the points' identity.
struct Problem {
  synth::PointProblem truth;
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<Pair> pairs;
  std::vector<std::vector<int>> point_of;  // of each feature
};

inline Problem problem_of(const synth::PointProblem& truth) {
  Problem problem;
  problem.truth = truth;
  problem.cameras = {truth.camera};
  problem.images.resize(truth.poses.size());
  problem.point_of.resize(truth.poses.size());
  for (std::size_t i = 0; i < truth.poses.size(); ++i)
    problem.images[i].name = "photo-" + std::to_string(i);
  for (const auto& seen : truth.observations) {
    const auto i = static_cast<std::size_t>(seen.image);
    problem.images[i].features.emplace_back(seen.pixel);
    problem.point_of[i].push_back(seen.point);
  }
  for (const Image& image : problem.images)
    problem.colors.emplace_back(image.features.size(), cv::Vec3b(10, 20, 30));
  for (std::size_t a = 0; a < problem.images.size(); ++a) {
    for (std::size_t b = a + 1; b < problem.images.size(); ++b) {
      std::map<int, int> in_b;
      for (std::size_t f = 0; f < problem.point_of[b].size(); ++f)
        in_b[problem.point_of[b][f]] = static_cast<int>(f);
      std::vector<Match> matches;
      for (std::size_t f = 0; f < problem.point_of[a].size(); ++f) {
        const auto other = in_b.find(problem.point_of[a][f]);
        if (other != in_b.end()) matches.push_back({static_cast<int>(f), other->second});
      }
      Pair pair;
      pair.first = static_cast<int>(a);
      pair.second = static_cast<int>(b);
      pair.matches = static_cast<int>(matches.size());
      pair.view = verify_pair(problem.images[a].features, problem.images[b].features, matches,
                              truth.camera, truth.camera, {});
      problem.pairs.push_back(std::move(pair));
    }
  }
  return problem;
}

inline MapperInput input_of(const Problem& problem, const std::vector<cv::Mat>& descriptors) {
  return {.cameras = problem.cameras,
          .images = problem.images,
          .colors = problem.colors,
          .descriptors = descriptors,
          .kind = FeatureKind::kSift,
          .pairs = problem.pairs};
}

// The same with descriptors that identify the points. Some matches are missing, so that extending
// the tracks can find them.
struct DescribedProblem {
  Problem problem;
  std::vector<cv::Mat> descriptors;
};

inline DescribedProblem described(const synth::PointProblem& truth) {
  DescribedProblem result{problem_of(truth), {}};
  Rng rng(77);
  std::map<int, std::vector<std::uint8_t>> descriptors;
  for (const std::vector<int>& points : result.problem.point_of) {
    cv::Mat rows(static_cast<int>(points.size()), 128, CV_8UC1);
    for (std::size_t f = 0; f < points.size(); ++f) {
      std::vector<std::uint8_t>& descriptor = descriptors[points[f]];
      while (descriptor.size() < 128)
        descriptor.push_back(static_cast<std::uint8_t>(rng.uniform() < 0.15 ? 120 : 5));
      std::copy(descriptor.begin(), descriptor.end(), rows.ptr(static_cast<int>(f)));
    }
    result.descriptors.push_back(rows);
  }
  for (Pair& pair : result.problem.pairs) {
    std::vector<Match> inliers = pair.view.inliers.copy();
    std::erase_if(inliers, [&](const Match&) { return rng.uniform() < 0.4; });
    pair.view.inliers = std::move(inliers);
  }
  return result;
}

}  // namespace tarsier::sfm::test_support
