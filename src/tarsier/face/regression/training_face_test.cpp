// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/training_face.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <limits>

namespace tarsier::face::regression {
namespace {

class TrainingFaceTest : public FolderTest {
 protected:
  // An image with blobs at the points of its sample.
  shape::LandmarkSample sample(const std::string& name, double unit, cv::Size size) {
    Rng rng(1);
    shape::LandmarkSample result;
    result.points = (test_support::blob_shape(0) * unit).colwise() +
                    Eigen::Vector2d(size.width * 0.4, size.height * 0.6);
    result.image = path(name);
    write_image(result.image, test_support::draw_blobs(result.points, unit, size, rng));
    return result;
  }
  static int brightness(const cv::Mat& gray, const Eigen::Vector2d& at) {
    return gray.at<std::uint8_t>(cvRound(at.y()), cvRound(at.x()));
  }
  std::vector<TrainingFace> load(const shape::LandmarkSet& set, const LoadOptions& options = {}) {
    NoProgress silent;
    return load_training_faces(set, path("set.yaml"), options, silent, {}, skipped_);
  }
  std::vector<std::string> skipped_;
};

TEST_F(TrainingFaceTest, PointsKeepTheirPixelsWhenCroppedAndReduced) {
  shape::LandmarkSet set;
  set.mirror = {2, 1, 0, 5, 4, 3, 8, 7, 6};
  set.samples = {sample("small.png", 25, {200, 220}), sample("large.png", 300, {1600, 1500})};
  LoadOptions options;
  options.mirror = true;
  const std::vector<TrainingFace> faces = load(set, options);
  ASSERT_EQ(faces.size(), 4U);
  EXPECT_LE(faces[2].points.row(0).maxCoeff() - faces[2].points.row(0).minCoeff(), 401);
  EXPECT_TRUE(faces[1].mirrored);
  for (const TrainingFace& face : faces) {
    for (Eigen::Index p = 0; p < 9; ++p) {
      const int dim = p % 3 == 1 ? 105 : 140;
      EXPECT_GT(brightness(face.gray, face.points.col(p)), dim) << p;
    }
  }
}

TEST_F(TrainingFaceTest, ReportsSkippedSamples) {
  shape::LandmarkSet set;
  set.samples = {sample("good.png", 25, {200, 220}), sample("broken.png", 25, {200, 220}),
                 sample("hidden.png", 25, {200, 220})};
  std::ofstream(path("broken.png")) << "no image";
  set.samples[2].points(0, 3) = std::numeric_limits<double>::quiet_NaN();
  set.samples[2].points(1, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(load(set).size(), 1U);
  ASSERT_EQ(skipped_.size(), 2U);
  EXPECT_NE(skipped_[0].find("broken.png"), std::string::npos);
  EXPECT_NE(skipped_[1].find("missing"), std::string::npos);
}

TEST_F(TrainingFaceTest, ThrowsWithoutUsableFaces) {
  shape::LandmarkSet set;
  EXPECT_THROW((void)load(set), InputError);
  set.samples = {sample("gone.png", 25, {200, 220})};
  std::filesystem::remove(path("gone.png"));
  EXPECT_THROW((void)load(set), InputError);
}

TEST_F(TrainingFaceTest, MirroringNeedsTheSymmetry) {
  shape::LandmarkSet set;
  set.samples = {sample("good.png", 25, {200, 220})};
  LoadOptions options;
  options.mirror = true;
  EXPECT_THROW((void)load(set, options), InputError);
}

// Copies follow the face that they were made from, and each copy precedes its mirror image. So
// training keeps them in one part.
TEST_F(TrainingFaceTest, ExtraFacesFollowTheirFace) {
  shape::LandmarkSet set;
  set.mirror = {2, 1, 0, 5, 4, 3, 8, 7, 6};
  set.samples = {sample("a.png", 25, {200, 220}), sample("b.png", 25, {200, 220})};
  LoadOptions options;
  options.mirror = true;
  const std::vector<TrainingFace> faces = load(set, options);
  ASSERT_EQ(faces.size(), 4U);
  const ExtraFaces lower = [](const TrainingFace& face, std::uint64_t) {
    TrainingFace copy = face;
    copy.points.row(1).array() += 3;
    return std::vector<TrainingFace>{copy};
  };
  NoProgress silent;
  const auto all = with_extra_faces(faces, lower, set.mirror, 1.5, 1, silent, {});
  ASSERT_EQ(all.size(), 8U);
  for (std::size_t f = 0; f < 8; ++f) {
    EXPECT_EQ(all[f].mirrored, f % 2 == 1) << f;
    EXPECT_EQ(all[f].turned, f % 4 >= 2) << f;
    EXPECT_EQ(all[f].name, all[f / 4 * 4].name) << f;
  }
  EXPECT_DOUBLE_EQ(all[6].points(1, 4), all[4].points(1, 4) + 3);
  // The mirror image of a copy is shifted like that of a face.
  EXPECT_DOUBLE_EQ(all[7].points(0, 0), all[6].gray.cols - 1 - all[6].points(0, 2) + 3);
  EXPECT_EQ(with_extra_faces(faces, lower, {}, 0, 1, silent, {}).size(), 6U);

  const ExtraFaces broken = [](const TrainingFace& face, std::uint64_t) {
    TrainingFace copy = face;
    copy.gray.release();
    return std::vector<TrainingFace>{copy};
  };
  EXPECT_THROW((void)with_extra_faces(faces, broken, set.mirror, 0, 1, silent, {}),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::regression
