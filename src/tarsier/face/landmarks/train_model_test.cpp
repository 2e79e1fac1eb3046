// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/train_model.h"

#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <atomic>

namespace tarsier::face::landmarks {
namespace {

class TrainModelTest : public FolderTest {
 protected:
  shape::LandmarkSet faces(int count) {
    shape::LandmarkSet set;
    set.mirror = {2, 1, 0, 5, 4, 3, 8, 7, 6};
    Rng rng(4);
    for (int i = 0; i < count; ++i) {
      const regression::TrainingFace face = regression::test_support::blob_face(rng);
      shape::LandmarkSample sample;
      sample.image = path("face" + std::to_string(i) + ".png");
      sample.points = face.points;
      write_image(sample.image, face.gray);
      set.samples.push_back(sample);
    }
    return set;
  }
  static TrainModelOptions quick() {
    TrainModelOptions options;
    options.mirror = true;
    options.to_the_right = 0;
    options.patches = false;
    options.quality = false;
    options.starts = 2;
    options.tree_options.levels = 1;
    options.tree_options.trees = 3;
    options.descent_options.stages = {{16, 0.4}};
    return options;
  }
  TrainedModel train(const shape::LandmarkSet& set, const TrainModelOptions& options) {
    NoProgress silent;
    return train_landmark_model(set, path("set.yaml"), options, silent, {});
  }
};

// Extra faces and starts train trees and descent. The shape model uses the faces only; its mean is
// where fits start.
TEST_F(TrainModelTest, ExtraFacesDoNotChangeTheShapeModel) {
  const shape::LandmarkSet set = faces(6);
  const TrainedModel plain = train(set, quick());
  EXPECT_EQ(plain.extra, 0);
  TrainModelOptions options = quick();
  options.extra = [](const regression::TrainingFace& face, std::uint64_t) {
    regression::TrainingFace copy = face;
    copy.points.row(1) *= 0.7;
    return std::vector<regression::TrainingFace>{copy, face};
  };
  std::atomic<int> asked = 0;
  options.shaped_starts = 3;
  options.start_shapes = [&](const regression::TrainingFace& face, int count, std::uint64_t) {
    asked += count;
    return std::vector<Eigen::Matrix2Xd>(static_cast<std::size_t>(count), face.points);
  };
  const TrainedModel with = train(set, options);
  EXPECT_EQ(with.faces, 6);
  EXPECT_EQ(with.extra, 12);
  EXPECT_EQ(asked, 3 * 6 * 3 * 2);  // starts, faces, the face and two copies, mirrored
  EXPECT_EQ(with.model.shape.mean, plain.model.shape.mean);
  EXPECT_NE(with.model.descent->stages[0].weights, plain.model.descent->stages[0].weights);
  EXPECT_NE(with.model.trees->levels[0].leaves, plain.model.trees->levels[0].leaves);
}

TEST_F(TrainModelTest, TheSameForAnyNumberOfThreads) {
  const shape::LandmarkSet set = faces(4);
  TrainModelOptions options = quick();
  options.extra = [](const regression::TrainingFace& face, std::uint64_t seed) {
    regression::TrainingFace copy = face;
    copy.points.array() += Rng(seed).uniform();
    return std::vector<regression::TrainingFace>{copy};
  };
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const TrainedModel one = train(set, options);
  cv::setNumThreads(3);
  const TrainedModel three = train(set, options);
  cv::setNumThreads(threads);
  EXPECT_EQ(one.model.descent->stages[0].weights, three.model.descent->stages[0].weights);
  EXPECT_EQ(one.model.trees->levels[0].leaves, three.model.trees->levels[0].leaves);
}

TEST_F(TrainModelTest, RejectsInvalidStartShapes) {
  TrainModelOptions options = quick();
  options.start_shapes = [](const regression::TrainingFace&, int, std::uint64_t) {
    return std::vector<Eigen::Matrix2Xd>{Eigen::Matrix2Xd::Zero(2, 3)};
  };
  EXPECT_THROW((void)train(faces(2), options), std::invalid_argument);
  options = quick();
  options.shaped_starts = 0;
  EXPECT_THROW((void)train(faces(2), options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::landmarks
