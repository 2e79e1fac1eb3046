// SPDX-License-Identifier: MIT
#include "tarsier/face/head/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/head/testing_head.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace tarsier::face::head {
namespace {

using testing::HasSubstr;

PosePair pair_of(const HeadAngles& found, const HeadAngles& truth) {
  PosePair pair;
  pair.rotation = rotation_of_angles(found);
  pair.truth = rotation_of_angles(truth);
  return pair;
}

TEST(HeadComparisonTest, MeasuresErrorAfterSimilarityAlignment) {
  const TemporaryFolder folder;
  const HeadModel head = testing_head(1);
  const auto write = [&](const std::string& name, const Eigen::Matrix3Xd& points) {
    std::ofstream file(folder / name);
    file.precision(12);
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      file << points(0, i) << ' ' << points(1, i) << ' ' << points(2, i) << '\n';
    return folder / name;
  };
  // The same head in cm, moved and rotated.
  Eigen::Matrix3Xd points = 0.1 * (rotation_of_angles({30, -10, 5}) * head.mean);
  points.colwise() += Eigen::Vector3d(7, 8, 9);
  EXPECT_NEAR(compare_head(head, write("same.txt", points)).all_mm, 0, 1e-6);
  // One point of 25 has an error of 2 mm. Nearly all of it remains after alignment, in the head's
  // mm.
  points.col(22) += 0.1 * Eigen::Vector3d(0, 0, 2);
  const HeadComparison off = compare_head(head, write("off.txt", points));
  EXPECT_GT(off.all_mm, 0.9 * 2 / 25);
  EXPECT_LT(off.all_mm, 3.0 * 2 / 25);
  EXPECT_EQ(off.inner_mm, 0) << "another markup";
  EXPECT_THROW((void)compare_head(head, write("few.txt", points.leftCols(24))), InputError);
}

TEST(PoseEvaluation, ComputesAngleAndTranslationErrors) {
  std::vector<PosePair> pairs = {pair_of({4, 0, 0}, {0, 0, 0}), pair_of({0, -20, 0}, {0, 0, 0}),
                                 pair_of({0, 0, 179}, {0, 0, -179})};
  pairs[0].translation = Eigen::Vector3d(0, 3, 500);
  pairs[0].true_translation = Eigen::Vector3d(0, 0, 500);
  const PoseScore score = score_poses(pairs, 4);
  EXPECT_EQ(score.truths, 4);
  EXPECT_EQ(score.with_pose, 3);
  EXPECT_NEAR(score.yaw_mae_deg, 4.0 / 3, 1e-9);
  EXPECT_NEAR(score.pitch_mae_deg, 20.0 / 3, 1e-9);
  EXPECT_NEAR(score.roll_mae_deg, 2.0 / 3, 1e-9);  // across 180 degrees
  EXPECT_NEAR(score.mean_deg, 26.0 / 3, 1e-6);
  EXPECT_NEAR(score.median_deg, 4, 1e-6);
  EXPECT_NEAR(score.p95_deg, 4 + 0.9 * 16, 1e-6);  // between the ranks, as numpy has it
  EXPECT_NEAR(score.over_10_deg, 1.0 / 3, 1e-12);
  EXPECT_NEAR(score.translation_mean_mm, 3, 1e-12);
  EXPECT_NEAR(score.translation_percent, 0.6, 1e-12);
}

TEST(PoseEvaluation, CountsErrorsWithinOneAndTwoSigmas) {
  std::vector<PosePair> pairs = {pair_of({4, 0, 0}, {0, 0, 0}), pair_of({-6, 3, 0}, {0, 0, 0}),
                                 pair_of({1, 0, 179}, {0, 0, -179}),
                                 pair_of({50, 50, 50}, {0, 0, 0})};
  for (int k = 0; k < 3; ++k) pairs[static_cast<std::size_t>(k)].sigma_deg = {3.1, 2, 2.5};
  pairs[2].sigma_floor_deg = {2.9, 2, 0};  // sqrt(3.1^2 - 2.9^2) = 1.1
  const AngleCoverage coverage = score_poses(pairs, 4).coverage;
  EXPECT_EQ(coverage.yaw.count, 3);  // one has none
  EXPECT_EQ(coverage.yaw.within, 1);
  EXPECT_EQ(coverage.yaw.within2, 3);
  EXPECT_EQ(coverage.pitch.within, 2);
  EXPECT_EQ(coverage.pitch.within2, 3);
  EXPECT_EQ(coverage.roll.within, 3);  // 2 degrees across 180
  const AngleCoverage of_image = score_poses(pairs, 4).image_coverage;
  EXPECT_EQ(of_image.yaw.count, 1);
  EXPECT_EQ(of_image.yaw.within, 1);
  EXPECT_EQ(of_image.pitch.within, 1);
  pairs[2].sigma_floor_deg = {3.0, 3, 0};
  EXPECT_EQ(score_poses(pairs, 4).image_coverage.yaw.within, 0);
  EXPECT_EQ(score_poses(pairs, 4).image_coverage.yaw.within2, 1);
}

TEST(PoseEvaluation, NoPosesGiveZeroErrors) {
  const PoseScore score = score_poses({}, 7);
  EXPECT_EQ(score.with_pose, 0);
  EXPECT_EQ(score.mean_deg, 0);
}

class PoseLines : public FolderTest {
 protected:
  std::vector<PoseLine> read(const std::string& text) const {
    std::ofstream(path("l.jsonl")) << text;
    return read_pose_lines(path("l.jsonl"));
  }
};

TEST_F(PoseLines, ReadsAllRotationFormats) {
  const Eigen::Matrix3d r = rotation_of_angles({10, 20, 30});
  std::string nine;
  for (const double v : geometry::row_major(r))
    nine += (nine.empty() ? "" : ",") + std::to_string(v);
  const auto lines = read("{\"image\":\"a\",\"rotation\":[" + nine +
                          "]}\n\n"
                          "{\"image\":\"b\",\"R\":[" +
                          nine +
                          "],\"t\":[1,2,3]}\n"
                          "{\"image\":\"c\",\"euler\":[-20,10,30]}\n"
                          "{\"image\":\"d\",\"faces\":[{\"yaw\":10,\"pitch\":20,\"roll\":30}]}\n"
                          "{\"image\":\"e\",\"faces\":[]}\n");
  ASSERT_EQ(lines.size(), 5U);
  for (int i = 0; i < 4; ++i) {
    const auto& rotation = lines[static_cast<std::size_t>(i)].rotation;
    ASSERT_TRUE(rotation) << i;
    EXPECT_LT((*rotation - r).norm(), 1e-5) << i;
  }
  EXPECT_EQ(lines[1].translation.value(), Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(lines[0].sigma_deg);
  const auto with_sigmas =
      read(R"({"image":"a","faces":[{"yaw":1,"pitch":2,"yaw_sigma_deg":3,"pitch_sigma_deg":4,)"
           R"("roll_sigma_deg":5,"sigma_floor_deg":[2,1,0]}]})");
  EXPECT_EQ(with_sigmas.at(0).sigma_deg.value(), Eigen::Vector3d(3, 4, 5));
  EXPECT_EQ(with_sigmas.at(0).sigma_floor_deg.value(), Eigen::Vector3d(2, 1, 0));
  EXPECT_EQ(match_poses(with_sigmas, with_sigmas).at(0).sigma_deg, with_sigmas.at(0).sigma_deg);
  EXPECT_FALSE(lines[4].rotation);
  EXPECT_EQ(match_poses(lines, lines).size(), 4U);
}

TEST_F(PoseLines, RefusesBrokenLines) {
  const auto refusal = [&](const std::string& text) -> std::string {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      return error.what();
    }
    ADD_FAILURE() << "was read: " << text;
    return {};
  };
  EXPECT_THAT(refusal("{}"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("{\"image\":\"a\"}\n{\"image\":"), HasSubstr("line 2"));
  EXPECT_THAT(refusal("{\"image\":\"a\",\"R\":[1,2,3]}"), HasSubstr("9 numbers"));
  EXPECT_THAT(refusal("{\"image\":\"a\",\"R\":[1,0,0,0,1,0,0,0,2]}"), HasSubstr("not a rotation"));
  EXPECT_THAT(refusal("{\"image\":\"a\",\"R\":[1,0,0,0,1,0,0,0,-1]}"), HasSubstr("not a rotation"));
  EXPECT_THAT(refusal("{\"image\":\"a\",\"faces\":3}"), HasSubstr("expected a list"));
  EXPECT_THAT(refusal(R"({"image":"a","yaw":1,"pitch":1,"yaw_sigma_deg":-1})"),
              HasSubstr("\"yaw_sigma_deg\" is below 0"));
  EXPECT_THAT(refusal(""), HasSubstr("no lines"));
  EXPECT_THAT(refusal(std::string(100'000, '[')), HasSubstr("l.jsonl"));
}

TEST(Pointing, ParsesAnglesFromFileNames) {
  const auto name = parse_pointing_name("a/Person01/person01246-30+15.jpg");
  ASSERT_TRUE(name);
  EXPECT_EQ(name->person, 1);
  EXPECT_EQ(name->tilt_deg, -30);
  EXPECT_EQ(name->pan_deg, 15);
  EXPECT_TRUE(parse_pointing_name("Front/personne01146+0+0.jpg"));
  EXPECT_FALSE(parse_pointing_name("person01.jpg"));
  EXPECT_FALSE(parse_pointing_name("person01246-30+15b.jpg"));
}

TEST(Pointing, SubtractsOffsetsAndChecksMonotonicity) {
  std::vector<PointingOutcome> outcomes;
  for (const double pan : {-45.0, -15.0, 0.0, 15.0, 45.0, 90.0}) {
    // All yaws have an offset of 5 degrees to the left, and rotations are estimated too small.
    outcomes.push_back({"",
                        {1, 0, pan},
                        true,
                        rotation_of_angles({0.8 * pan + 5, -3, 0}),
                        Eigen::Vector3d(8, 2, 1)});
  }
  outcomes.push_back({"", {1, 0, 30}, true, std::nullopt, std::nullopt});
  outcomes.push_back({"", {1, 0, 30}, false, std::nullopt, std::nullopt});
  const PointingScore score = score_pointing(outcomes);
  EXPECT_EQ(score.images, 7);  // 90 degrees is out of range
  EXPECT_EQ(score.detected, 6);
  EXPECT_EQ(score.with_pose, 5);
  EXPECT_EQ(score.detected_with_pose, 5);
  EXPECT_NEAR(score.yaw_offset_deg, 5, 1e-9);
  EXPECT_NEAR(score.yaw_mae_deg, (9 + 3 + 0 + 3 + 9) / 5.0, 1e-9);
  EXPECT_NEAR(score.yaw_mae_raw_deg, (14 + 8 + 5 + 2 + 4) / 5.0, 1e-9);
  EXPECT_NEAR(score.pitch_mae_deg, 0, 1e-9);
  EXPECT_NEAR(score.pitch_offset_deg, -3, 1e-9);
  EXPECT_TRUE(score.yaw_rises);
  // Errors of yaw 14, 8, 5, 2 and 4 with a deviation of 8; errors of pitch 3 with a deviation of 2.
  EXPECT_EQ(score.coverage.yaw.count, 5);
  EXPECT_EQ(score.coverage.yaw.within, 4);
  EXPECT_EQ(score.coverage.yaw.within2, 5);
  EXPECT_EQ(score.coverage.pitch.within, 0);
  EXPECT_EQ(score.coverage.pitch.within2, 5);
  EXPECT_EQ(score.coverage.roll.count, 0);
  outcomes[0].rotation = rotation_of_angles({50, -3, 0});
  EXPECT_FALSE(score_pointing(outcomes).yaw_rises);
}

TEST(Pointing, GazeOfPanThenTiltMatchesTheName) {
  std::vector<PointingOutcome> outcomes;
  for (const double pan : {-45.0, 0.0, 45.0}) {
    for (const double tilt : {-30.0, 0.0, 30.0}) {
      // The tilt is about the panned head's own axis.
      const Eigen::Matrix3d r = rotation_of_angles({pan, 0, 0}) * rotation_of_angles({0, tilt, 0});
      outcomes.push_back({"", {1, tilt, pan}, true, r, Eigen::Vector3d::Constant(1e-6)});
      const Gaze gaze = gaze_of_rotation(r);
      EXPECT_NEAR(gaze.azimuth_deg, pan, 1e-9);
      EXPECT_NEAR(gaze.elevation_deg, tilt, 1e-9);
      EXPECT_LT((forward_of_gaze(gaze) - r * Eigen::Vector3d(0, 0, -1)).norm(), 1e-12);
    }
  }
  const PointingScore score = score_pointing(outcomes);
  EXPECT_NEAR(score.elevation_mae_deg, 0, 1e-9);
  EXPECT_NEAR(score.azimuth_mae_deg, 0, 1e-9);
  // The head's pitch is asin(cos pan sin tilt) = 20.7 degrees. At four of nine positions this is
  // 9.3 degrees less than the tilt.
  EXPECT_NEAR(score.pitch_mae_deg, 9.295 * 4 / 9, 0.01);
  // The direction itself has no error.
  EXPECT_EQ(score.coverage.yaw.within, 9);
  EXPECT_EQ(score.coverage.pitch.within, 9);
}

TEST_F(PoseLines, ReadsBoxOfPointingImage) {
  std::ofstream(path("person01246-30+15.txt")) << "person\n\nFace\n192\n237\n126\n94\n";
  const auto box = pointing_box(path("person01246-30+15.jpg"));
  ASSERT_TRUE(box);
  EXPECT_EQ(*box, cv::Rect2d(129, 190, 126, 94));
  EXPECT_FALSE(pointing_box(path("other.jpg")));
  std::ofstream(path("bad.txt")) << "Face 1 2\n";
  EXPECT_THROW((void)pointing_box(path("bad.jpg")), InputError);
}

}  // namespace
}  // namespace tarsier::face::head
