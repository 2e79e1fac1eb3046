// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/same_camera.h"

#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace tarsier::face::recognition {
namespace {

// The common part of all images of one camera: half of each.
void blend_with_one(std::vector<cv::Mat>& faces) {
  const cv::Mat common = synthetic_faces(1, 1, 0, 1, 900).faces.front();
  for (cv::Mat& face : faces) cv::addWeighted(face, 0.5, common, 0.5, 0, face);
}

TEST(SameCameraAdjustment, ShiftIsGreaterForOneCamera) {
  const Background general = synthetic_background();
  SyntheticFaces set = synthetic_faces(8, 4, 0.3, 7);
  NoProgress quiet;
  const SameCameraFit apart = fit_same_camera(set.faces, set.labels, 2, 2, general, quiet, {});
  EXPECT_EQ(apart.people, 8);
  EXPECT_EQ(apart.galleries, 16);
  EXPECT_EQ(apart.scores, 16 * 28);
  blend_with_one(set.faces);
  const SameCameraFit together = fit_same_camera(set.faces, set.labels, 2, 2, general, quiet, {});
  EXPECT_GT(together.adjustment.shift, apart.adjustment.shift + 0.03);
  EXPECT_GT(together.adjustment.spread, 0);
}

// The estimated mean is that of the strangers' scores, independent of the constants.
TEST(SameCameraAdjustment, ShiftIsTheDifferenceOfTheMeans) {
  const Background general = synthetic_background();
  const SyntheticFaces set = synthetic_faces(3, 2, 0.3, 7);
  NoProgress quiet;
  const SameCameraFit fit = fit_same_camera(set.faces, set.labels, 2, 1, general, quiet, {});
  double expected = 0;
  for (int p = 0; p < 3; ++p) {
    const std::vector<cv::Mat> own{set.faces[static_cast<std::size_t>(2 * p)],
                                   set.faces[static_cast<std::size_t>(2 * p + 1)]};
    const Recognizer model =
        train(own, std::vector<std::string>{"a", "a"}, {}, quiet, {}, &general);
    for (int i = 0; i < 6; ++i) {
      if (i / 2 == p) continue;
      const double score = identify(model, set.faces[static_cast<std::size_t>(i)]).front().score;
      expected += (score - model.calibration->location) / 12 + kSameCameraClassic.shift / 12;
    }
  }
  EXPECT_NEAR(fit.adjustment.shift, expected, 1e-9);
}

TEST(SameCameraAdjustment, RejectsInvalidInput) {
  const Background general = synthetic_background();
  const SyntheticFaces set = synthetic_faces(3, 2, 0.3, 7);
  NoProgress quiet;
  const auto fit = [&](int training, int draws, const Background& of) {
    (void)fit_same_camera(set.faces, set.labels, training, draws, of, quiet, {});
  };
  EXPECT_THROW(fit(3, 1, general), std::invalid_argument);
  EXPECT_THROW(fit(1, 0, general), std::invalid_argument);
  EXPECT_THROW(fit(1, 1, background_of(set.faces, {})), std::invalid_argument);
  const SyntheticFaces two = synthetic_faces(2, 2, 0.3, 7);
  EXPECT_THROW((void)fit_same_camera(two.faces, two.labels, 1, 1, general, quiet, {}),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::recognition
