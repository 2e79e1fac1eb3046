// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/recognizer.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/features.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <set>

namespace tarsier::face::recognition {
namespace {

Recognizer trained(const SyntheticFaces& set, Algorithm algorithm) {
  RecognizerOptions options;
  options.algorithm = algorithm;
  NoProgress quiet;
  return train(set.faces, set.labels, options, quiet, {});
}

double accuracy(const Recognizer& model, const SyntheticFaces& probes) {
  int right = 0;
  for (std::size_t i = 0; i < probes.faces.size(); ++i) {
    const auto people = identify(model, probes.faces[i]);
    if (model.labels[static_cast<std::size_t>(people.front().person)] == probes.labels[i]) ++right;
  }
  return static_cast<double>(right) / static_cast<double>(probes.faces.size());
}

std::string message_of(auto&& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was thrown";
}

class AnyAlgorithm : public testing::TestWithParam<Algorithm> {};
INSTANTIATE_TEST_SUITE_P(Each, AnyAlgorithm,
                         testing::Values(Algorithm::kDefault, Algorithm::kEigen, Algorithm::kFisher,
                                         Algorithm::kLbph),
                         [](const auto& each) { return std::string(name_of(each.param)); });

TEST_P(AnyAlgorithm, IdentifiesPeopleInEvenLight) {
  const auto model = trained(synthetic_faces(6, 4, 0, 1), GetParam());
  EXPECT_EQ(model.labels.size(), 6U);
  EXPECT_EQ(model.templates.rows(), 24);
  EXPECT_EQ(accuracy(model, synthetic_faces(6, 5, 0, 2)), 1.0);
}

TEST_P(AnyAlgorithm, TemplatesEqualThoseOfTheTrainingFaces) {
  const auto set = synthetic_faces(3, 3, 0.2, 1);
  const auto model = trained(set, GetParam());
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    const auto values = template_of(model, set.faces[i]);
    ASSERT_EQ(static_cast<int>(values.size()), model.template_length());
    double square = 0;
    double off = 0;
    for (std::size_t j = 0; j < values.size(); ++j) {
      const double stored =
          model.templates(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      square += stored * stored;
      off += (stored - values[j]) * (stored - values[j]);
    }
    EXPECT_LT(std::sqrt(off), 1e-3 * std::sqrt(square)) << i;
    EXPECT_EQ(identify_template(model, values).front().nearest, static_cast<int>(i));
  }
}

TEST_P(AnyAlgorithm, ScoresEqualCompare) {
  const auto set = synthetic_faces(3, 2, 0.2, 1);
  auto model = trained(set, GetParam());
  model.options.mean_weight = 0;
  const auto probe = template_of(model, synthetic_faces(1, 1, 0.2, 9).faces.front());
  for (const auto& entry : identify_template(model, probe)) {
    const Rows row = model.templates.row(entry.nearest);
    EXPECT_EQ(model.people[static_cast<std::size_t>(entry.nearest)], entry.person);
    EXPECT_NEAR(entry.score,
                compare(model, probe, {row.data(), static_cast<std::size_t>(row.size())}),
                1e-4 * std::max(1.0, std::abs(entry.score)));
  }
}

TEST_P(AnyAlgorithm, ModelDoesNotDependOnThreads) {
  const auto set = synthetic_faces(4, 3, 0.3, 1);
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const auto one = trained(set, GetParam());
  cv::setNumThreads(4);
  const auto four = trained(set, GetParam());
  cv::setNumThreads(before);
  EXPECT_EQ(one.templates, four.templates);
  EXPECT_EQ(one.components, four.components);
}

TEST_P(AnyAlgorithm, NearestIsTheFirstOfEqualTemplates) {
  auto set = synthetic_faces(3, 2, 0.2, 1);
  set.faces.push_back(set.faces[2]);  // p1's first image, under another name
  set.labels.emplace_back("again");
  set.faces.push_back(synthetic_faces(1, 1, 0.2, 5, 7).faces.front());
  set.labels.emplace_back("again");
  const auto model = trained(set, GetParam());
  EXPECT_EQ(identify(model, set.faces[2]).front().nearest, 2);
}

TEST_P(AnyAlgorithm, RejectsColourAndEmptyInput) {
  NoProgress quiet;
  RecognizerOptions options;
  options.algorithm = GetParam();
  const std::vector<std::string> labels{"a"};
  EXPECT_THROW((void)train({}, {}, options, quiet, {}), std::invalid_argument);
  const std::vector<cv::Mat> colour{cv::Mat::zeros(80, 64, CV_8UC3)};
  EXPECT_THROW((void)train(colour, labels, options, quiet, {}), std::invalid_argument);
}

TEST_P(AnyAlgorithm, CanBeInterrupted) {
  const auto set = synthetic_faces(2, 2, 0, 1);
  std::stop_source source;
  source.request_stop();
  NoProgress quiet;
  RecognizerOptions options;
  options.algorithm = GetParam();
  EXPECT_THROW((void)train(set.faces, set.labels, options, quiet, source.get_token()), Interrupted);
}

TEST(DefaultRecognizer, OutperformsEigenfacesInHardLight) {
  const auto training = synthetic_faces(10, 3, 0.8, 1);
  const auto probes = synthetic_faces(10, 5, 0.8, 2);
  const double own = accuracy(trained(training, Algorithm::kDefault), probes);
  EXPECT_GE(own, 0.9);
  EXPECT_LT(accuracy(trained(training, Algorithm::kEigen), probes), own - 0.15);
}

TEST(DefaultRecognizer, WorksWithOneImagePerPerson) {
  const auto model = trained(synthetic_faces(8, 1, 0.4, 1), Algorithm::kDefault);
  EXPECT_GE(accuracy(model, synthetic_faces(8, 4, 0.4, 2)), 0.95);
}

TEST(DefaultRecognizer, BackgroundCalibratesAGalleryOfOne) {
  NoProgress quiet;
  const auto background = background_of(synthetic_faces(30, 1, 0, 4, 50).faces, {});
  const auto set = synthetic_faces(1, 1, 0, 1);
  const auto model = train(set.faces, set.labels, {}, quiet, {}, &background);
  ASSERT_TRUE(model.calibration);
  const double threshold = model.calibration->threshold(0.01, 1);
  EXPECT_GT(identify(model, synthetic_faces(1, 1, 0, 2).faces.front()).front().score, threshold);
  for (const auto& face : synthetic_faces(5, 1, 0, 3, 20).faces)
    EXPECT_LT(identify(model, face).front().score, threshold);
  // Without a background the model states that it has no threshold.
  EXPECT_FALSE(trained(set, Algorithm::kDefault).calibration);
  Background wrong = background;
  wrong.mean.conservativeResize(7);
  EXPECT_THROW((void)train(set.faces, set.labels, {}, quiet, {}, &wrong), std::invalid_argument);
}

TEST(DefaultRecognizer, ThresholdRejectsImpostors) {
  const auto model = trained(synthetic_faces(10, 4, 0.4, 1), Algorithm::kDefault);
  ASSERT_TRUE(model.calibration);
  EXPECT_EQ(model.calibration->impostor_people, 10);
  const double threshold = model.calibration->threshold(0.01, 10);
  const auto impostors = synthetic_faces(40, 3, 0.4, 2, 100);
  int accepted = 0;
  for (const auto& face : impostors.faces)
    if (identify(model, face).front().score >= threshold) ++accepted;
  EXPECT_LE(accepted, 4);  // 1 % of 120, with a margin for chance
  int known = 0;
  const auto probes = synthetic_faces(10, 4, 0.4, 3);
  for (const auto& face : probes.faces)
    if (identify(model, face).front().score >= threshold) ++known;
  EXPECT_GE(known, 38);  // of 40
}

TEST(DefaultRecognizer, PoolingRaisesTheScore) {
  const auto model = trained(synthetic_faces(5, 2, 0.5, 1), Algorithm::kDefault);
  const auto probes = synthetic_faces(1, 4, 0.5, 2);
  std::vector<std::vector<float>> templates;
  double single = 0;
  for (const auto& face : probes.faces) {
    templates.push_back(template_of(model, face));
    single += identify_template(model, templates.back()).front().score / 4;
  }
  const auto together = identify_template(model, pooled(model, templates)).front();
  EXPECT_EQ(together.person, 0);
  EXPECT_GT(together.score, single);
}

TEST(TemplateWeights, AreZeroForOutliers) {
  // The third row of person 0 belongs to another person; person 1 has only two rows; -1 belongs to
  // nobody.
  Rows rows(9, 3);
  rows << 1, 0.1F, 0,  //
      1, -0.1F, 0.1F,  //
      0, 0.1F, 1,      //
      0.9F, 0, -0.1F,  //
      0, 1, 0,         //
      0, 0, 1,         //
      0, 0, 0,         //
      1, 1, 1,         //
      0.8F, 0.1F, 0;
  const std::vector<int> people{0, 0, 0, 0, 1, 1, 0, -1, 0};
  EXPECT_EQ(template_weights(rows, people, 2), (std::vector<double>{1, 1, 0, 1, 1, 1, 1, 0, 1}));
  EXPECT_TRUE(template_weights(Rows(0, 3), {}, 0).empty());
}

TEST(TemplateWeights, RejectAWronglyEnrolledFace) {
  const SyntheticFaces set = synthetic_faces(6, 6, 0, 1);
  Recognizer model = trained(set, Algorithm::kDefault);
  const cv::Mat& wrong_face = set.faces.back();
  add_face(model, wrong_face, set.labels.front());  // under another's name
  EXPECT_EQ(model.weights.back(), 0);
  EXPECT_EQ(std::count(model.weights.begin(), model.weights.end(), 0.0), 1);
  EXPECT_EQ(accuracy(model, synthetic_faces(6, 5, 0, 2)), 1.0);
  const auto people = identify(model, wrong_face);
  EXPECT_EQ(model.labels[static_cast<std::size_t>(people.front().person)], set.labels.back());
  EXPECT_LT(people[1].score, 0.5 * people[0].score);
}

TEST(DefaultRecognizer, FlatFaceIsBelowTheThreshold) {
  const auto model = trained(synthetic_faces(3, 2, 0, 1), Algorithm::kDefault);
  const auto people = identify(model, cv::Mat(80, 64, CV_8UC1, cv::Scalar(90)));
  ASSERT_EQ(people.size(), 3U);
  EXPECT_TRUE(std::isfinite(people.front().score));
  EXPECT_LT(people.front().score, model.calibration->threshold(0.1, 3));
}

TEST(DefaultRecognizer, RejectsFlatTrainingFaces) {
  NoProgress quiet;
  const std::vector<cv::Mat> faces(2, cv::Mat(80, 64, CV_8UC1, cv::Scalar(90)));
  const std::vector<std::string> labels{"a", "b"};
  EXPECT_THAT(message_of([&] { (void)train(faces, labels, {}, quiet, {}); }),
              testing::HasSubstr("flat"));
}

TEST(FisherRecognizer, RequiresTwoPeople) {
  const auto set = synthetic_faces(1, 4, 0, 1);
  EXPECT_THAT(message_of([&] { (void)trained(set, Algorithm::kFisher); }),
              testing::StrEq("Fisherfaces needs faces of at least two people, there is one"));
  EXPECT_THAT(message_of([&] { (void)trained(synthetic_faces(3, 1, 0, 1), Algorithm::kFisher); }),
              testing::HasSubstr("more than one image"));
}

TEST(Eigen, ReconstructsItsTrainingFaces) {
  const auto set = synthetic_faces(3, 3, 0.2, 1);
  const auto model = trained(set, Algorithm::kEigen);
  EXPECT_EQ(model.components.rows(), 8);  // of nine images
  cv::Mat difference;
  cv::absdiff(reconstruction(model, set.faces[4]), set.faces[4], difference);
  double most = 0;
  cv::minMaxLoc(difference, nullptr, &most);
  EXPECT_LE(most, 1);
  EXPECT_GT(reconstruction_error(model, synthetic_faces(1, 1, 0, 3, 9).faces.front()),
            10 * reconstruction_error(model, set.faces[4]));
  EXPECT_EQ(mean_face(model).size(), cv::Size(64, 80));
  EXPECT_EQ(component_image(model, 0).size(), cv::Size(64, 80));
  EXPECT_THROW((void)component_image(model, 8), std::invalid_argument);
  EXPECT_THROW((void)mean_face(trained(set, Algorithm::kLbph)), std::invalid_argument);
}

TEST(Gallery, AddsAndRemovesPeople) {
  const auto set = synthetic_faces(4, 3, 0.2, 1);
  auto model = trained(set, Algorithm::kDefault);
  const auto added = synthetic_faces(1, 3, 0.2, 2, 30);
  EXPECT_EQ(add_face(model, added.faces[0], "new"), 12);
  EXPECT_EQ(add_face(model, added.faces[1], "new"), 13);
  EXPECT_EQ(model.labels.back(), "new");
  EXPECT_EQ(identify(model, added.faces[2]).front().person, 4);
  EXPECT_TRUE(remove_person(model, "p1"));
  EXPECT_FALSE(remove_person(model, "p1"));
  EXPECT_NO_THROW(model.check());
  EXPECT_THAT(model.labels, testing::ElementsAre("p0", "p2", "p3", "new"));
  EXPECT_EQ(identify(model, added.faces[2]).front().person, 3);
  EXPECT_EQ(model.templates.rows(), 11);
  for (const auto* label : {"p0", "p2", "p3", "new"}) EXPECT_TRUE(remove_person(model, label));
  EXPECT_TRUE(identify(model, added.faces[2]).empty());
}

}  // namespace
}  // namespace tarsier::face::recognition
