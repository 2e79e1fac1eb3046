// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/pair_scores.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace tarsier::face::recognition {
namespace {

// Faces of people who are held out from the background. Faces of one person are more similar, and
// strangers reach the threshold no more often than stated.
TEST(PairScores, FalseAcceptRateHoldsForHeldOutPeople) {
  const Background general = synthetic_background();
  const PairScores pairs = pair_scores(general);
  Rng rng(7);
  constexpr int kPeople = 20;
  constexpr int kImages = 4;
  const Eigen::Index m = general.basis.rows();
  Rows coordinates(kPeople * kImages, m + 1);
  std::vector<int> who;
  for (int p = 0; p < kPeople; ++p) {
    Rng person = rng.fork(static_cast<std::uint64_t>(p));
    for (int k = 0; k < kImages; ++k) {
      Rng same = rng.fork(static_cast<std::uint64_t>(p));
      const auto i = static_cast<Eigen::Index>(who.size());
      for (Eigen::Index c = 0; c < m; ++c) {
        const double deviation = std::sqrt(general.variance(c));
        coordinates(i, c) = static_cast<float>(deviation * (same.normal() + 0.3 * person.normal()));
      }
      coordinates(i, m) = static_cast<float>(general.residual_variance);
      who.push_back(p);
    }
  }
  const Rows templates = templates_of_coordinates(pairs.model, general, coordinates);
  const double threshold = pairs.model.calibration->threshold(0.01, 1);
  int impostor_pairs = 0;
  int false_accepts = 0;
  int genuine_pairs = 0;
  int true_accepts = 0;
  for (Eigen::Index i = 0; i < templates.rows(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      const bool accepted = templates.row(i).dot(templates.row(j)) >= threshold;
      const bool genuine = who[static_cast<std::size_t>(i)] == who[static_cast<std::size_t>(j)];
      (genuine ? genuine_pairs : impostor_pairs) += 1;
      (genuine ? true_accepts : false_accepts) += accepted ? 1 : 0;
    }
  }
  EXPECT_LE(false_accepts, 0.02 * impostor_pairs);
  EXPECT_GE(true_accepts, 0.8 * genuine_pairs);
}

TEST(PairScores, IsDeterministicAndRequiresABasis) {
  const Background general = synthetic_background();
  EXPECT_EQ(recognizer_text(pair_scores(general).model),
            recognizer_text(pair_scores(general).model));
  Background mean = general;
  mean.basis.resize(0, 0);
  EXPECT_THROW((void)pair_scores(mean), std::invalid_argument);
}

// A ruled-out face excludes that person if it is the nearest.
TEST(Negatives, ExcludeAPerson) {
  const SyntheticFaces set = synthetic_faces(3, 3, 0.2, 7);
  NoProgress quiet;
  const std::vector<cv::Mat> faces{set.faces[0], set.faces[1], set.faces[3], set.faces[4]};
  const std::vector<std::string> labels{"a", "a", "b", "b"};
  Recognizer model = train(faces, labels, {}, quiet, {});
  const std::vector<float> wrong = template_of(model, set.faces[2]);
  const std::vector<float> other = template_of(model, set.faces[5]);
  ASSERT_EQ(best_person(model, wrong)->person, 0);
  ASSERT_EQ(best_person(model, other)->person, 1);
  model.negatives =
      Eigen::Map<const Rows>(wrong.data(), 1, static_cast<Eigen::Index>(wrong.size()));
  model.negative_people = {0};
  model.check();
  EXPECT_EQ(best_person(model, wrong)->person, 1);
  EXPECT_EQ(identify_template(model, wrong).size(), 1U);
  // Other faces are identified as before, also other faces of the excluded person.
  EXPECT_EQ(best_person(model, other)->person, 1);
  EXPECT_EQ(best_person(model, template_of(model, set.faces[0]))->person, 0);
  ASSERT_TRUE(remove_person(model, "a"));
  EXPECT_EQ(model.negatives.rows(), 0);
  model.check();
}

}  // namespace
}  // namespace tarsier::face::recognition
