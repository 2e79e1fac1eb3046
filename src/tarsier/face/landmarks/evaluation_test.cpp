// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <fstream>

namespace tarsier::face::landmarks {
namespace {

Eigen::Matrix2Xd square() {
  Eigen::Matrix2Xd points(2, 4);
  points << 0, 100, 100, 0, 0, 0, 100, 100;
  return points;
}
constexpr std::array<int, 2> kEyes{0, 1};

TEST(EvaluateFit, MeasuresErrorInEyeDistances) {
  const FitOutcome outcome =
      evaluate_fit(square().colwise() + Eigen::Vector2d(3, -4), square(), kEyes);
  EXPECT_NEAR(outcome.nme, 5, 1e-9);
  EXPECT_NEAR(outcome.dx, 3, 1e-9);
  EXPECT_NEAR(outcome.dy, -4, 1e-9);
  EXPECT_FALSE(outcome.wrong);
}

TEST(EvaluateFit, DistinguishesWrongFromMissedFace) {
  EXPECT_TRUE(evaluate_fit(square().colwise() + Eigen::Vector2d(101, 0), square(), kEyes).wrong);
  EXPECT_TRUE(evaluate_fit(std::nullopt, square(), kEyes).missed);
}

TEST(EvaluateFit, NeedsEyesApart) {
  Eigen::Matrix2Xd truth = square();
  EXPECT_TRUE(has_eye_distance(truth, kEyes));
  truth.col(1) = truth.col(0);
  EXPECT_FALSE(has_eye_distance(truth, kEyes));
  EXPECT_THROW((void)evaluate_fit(square(), truth, kEyes), std::invalid_argument);
}

TEST(EvaluateFit, RefusesOtherNumbersOfPoints) {
  EXPECT_THROW((void)evaluate_fit(Eigen::Matrix2Xd(square().leftCols(3)), square(), kEyes),
               std::invalid_argument);
  EXPECT_THROW((void)evaluate_fit(square(), square(), {0, 7}), std::invalid_argument);
}

TEST(Score, MissedAndWrongCountAsFailuresButNotInTheMean) {
  std::vector<FitOutcome> outcomes(4);
  outcomes[0].nme = 2;
  outcomes[1].nme = 10;
  outcomes[2].missed = true;
  outcomes[3].wrong = true;
  const LandmarkScore score = score_of(outcomes);
  EXPECT_EQ(score.faces, 4);
  EXPECT_NEAR(score.mean, 6, 1e-9);
  EXPECT_NEAR(score.median, 6, 1e-9);
  EXPECT_NEAR(score.failures, 0.75, 1e-9);
  // From 2 % to 8 % of error the curve is at one face of four.
  EXPECT_NEAR(score.auc, 0.25 * 6 / 8, 1e-3);
}

class FaceLinesTest : public FolderTest {};

TEST_F(FaceLinesTest, UsesTheWidestFace) {
  const std::string file = path("r.jsonl");
  std::ofstream(file) << R"({"image":"a.png","faces":[{"box":[0,0,10,10],"points":[[1,1],[2,2]]},)"
                      << R"({"box":[0,0,30,30],"points":[[5,6],[7,8]]}]})"
                      << "\n"
                      << R"({"image":"b.png","faces":[]})"
                      << "\n";
  const FaceLines lines = read_face_lines(file);
  const auto a = lines.find("a.png", 2);
  ASSERT_TRUE(a);
  EXPECT_EQ((*a)(1, 0), 6);
  EXPECT_FALSE(lines.find("b.png", 2));
  EXPECT_FALSE(lines.find("c.png", 2));
  EXPECT_THROW((void)lines.find("a.png", 3), InputError);
}

TEST_F(FaceLinesTest, ErrorsNameTheLine) {
  const std::string file = path("r.jsonl");
  for (const char* text : {"{\"image\":1}\n", "[1]\n", "{\"image\":\"a\",\"points\":[[1]]}\n",
                           "{\"image\":\"a\",\"points\":\"x\"}\n", "{\n"}) {
    std::ofstream(file) << "{\"image\":\"ok\",\"points\":[[1,2]]}\n" << text;
    try {
      (void)read_face_lines(file);
      ADD_FAILURE() << text;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(":2"), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace tarsier::face::landmarks
