// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/evidence.h"

#include "tarsier/plate/networks/quad.h"

#include <gtest/gtest.h>

namespace tarsier::plate {
namespace {

Alignment alignment_of(float height) {
  Alignment alignment;
  alignment.plate = quad_of({0, 0, 6 * height, 1.5F * height});
  alignment.text = quad_of({0, 0, 5 * height, height});
  alignment.score = 0.9F;
  return alignment;
}

Reading reading_of(double confidence, double plate, const cv::Rect2f& box) {
  Reading reading;
  reading.text = "4725BKZ";
  reading.confidence = confidence;
  reading.plate = plate;
  reading.corners = quad_of(box);
  return reading;
}

TEST(CalibrationCurve, SlopeChangesAtTwoAndMinusOne) {
  EXPECT_DOUBLE_EQ(CalibrationCurve{}(3.5), 3.5);  // no correction
  const CalibrationCurve curve{{0.5, 0.75, 0.25, -0.5}};
  EXPECT_DOUBLE_EQ(curve(1), 1.25);
  EXPECT_DOUBLE_EQ(curve(4), 0.5 + 3 + 0.5);
  EXPECT_DOUBLE_EQ(curve(-3), 0.5 - 2.25 - 1);
}

TEST(PlateClassifierFeatures, DescribeTheText) {
  const Detection detection{quad_of({0, 0, 60, 15}), 0.5F};
  const PlateClassifierFeatures grille = plate_classifier_features(
      detection, alignment_of(10), {"1111T11", {1, 1, 1, 1, 0.5, 1, 1}, ""});
  EXPECT_DOUBLE_EQ(grille[0], 1);
  EXPECT_NEAR(grille[1], std::log(9), 1e-4);
  EXPECT_NEAR(grille[2], 0, 1e-6);
  EXPECT_NEAR(grille[3], std::log(0.5) / 7, 1e-6);
  EXPECT_NEAR(grille[4], std::log(0.5), 1e-5);
  EXPECT_EQ(grille[5], 7);
  EXPECT_EQ(grille[6], 0);
  EXPECT_EQ(grille[7], 0);
  EXPECT_NEAR(grille[8], 2.0 / 7, 1e-9);
  const PlateClassifierFeatures sign =
      plate_classifier_features(detection, alignment_of(50), {"PARKING", {}, "xx"});
  EXPECT_EQ(sign[4], 0);  // large enough
  EXPECT_EQ(sign[6], 1);
  EXPECT_EQ(sign[7], 1);
  for (const double value : plate_classifier_features({}, {}, {}))
    EXPECT_TRUE(std::isfinite(value));
}

TEST(RelativeEvidence, IsSetByStrongerReadingsElsewhere) {
  const std::vector<Reading> readings{reading_of(0.9, 0.99, {0, 0, 100, 20}),
                                      reading_of(0.01, 0.9, {300, 0, 100, 20}),
                                      reading_of(0.5, 0.5, {5, 0, 95, 20})};
  std::vector<PlateClassifierFeatures> features(3, PlateClassifierFeatures{});
  set_relative_evidence(readings, features);
  EXPECT_EQ(features[0].back(), 0);
  EXPECT_NEAR(features[1].back(), std::log(0.9 / 0.01) + std::log(99) - std::log(9), 1e-6);
  // A reading that overlaps competes for the same plate. Only the second reading is elsewhere,
  // and less certain.
  EXPECT_NEAR(features[2].back(), 0, 1e-9);
  features.pop_back();
  EXPECT_THROW(set_relative_evidence(readings, features), std::invalid_argument);
}

TEST(PlateClassifier, SeparatesPlatesFromGrillesAndSigns) {
  const PlateClassifier classifier;
  const Detection detection{quad_of({0, 0, 60, 15}), 0.97F};
  const std::vector<double> high(7, 0.99);
  Alignment alignment = alignment_of(30);
  alignment.score = 0.999F;
  EXPECT_GT(
      classifier.log_odds(plate_classifier_features(detection, alignment, {"4725BKZ", high, "es"})),
      1);
  // No known layout, but clearly lettered.
  EXPECT_GT(
      classifier.log_odds(plate_classifier_features(detection, alignment, {"47X25BKZ", high, ""})),
      -0.5);
  const std::vector<double> low(7, 0.5);
  EXPECT_LT(
      classifier.log_odds(plate_classifier_features(detection, alignment, {"1111TT1", low, ""})),
      -0.5);
  EXPECT_LT(
      classifier.log_odds(plate_classifier_features(detection, alignment, {"PARKING", high, ""})),
      -0.5);
}

}  // namespace
}  // namespace tarsier::plate
