// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/background_space.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace tarsier::face::recognition {
namespace {

Background small_background(int people = 40) { return synthetic_background(people, 1000, 30); }

Rows coordinates_of_all(const Background& general, const std::vector<cv::Mat>& faces) {
  Rows rows(static_cast<Eigen::Index>(faces.size()), coordinate_count(general));
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const std::vector<float> one = coordinates_of(general, faces[i]);
    rows.row(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::RowVectorXf>(one.data(), static_cast<Eigen::Index>(one.size()));
  }
  return rows;
}

TEST(BackgroundSpace, CoordinatesKeepTheSquaredLength) {
  const Background general = small_background();
  const cv::Mat face = synthetic_faces(1, 1, 0.3, 1).faces[0];
  const std::vector<float> numbers = coordinates_of(general, face);
  ASSERT_EQ(static_cast<int>(numbers.size()), coordinate_count(general));
  double sum = numbers.back();
  for (std::size_t i = 0; i + 1 < numbers.size(); ++i)
    sum += static_cast<double>(numbers[i]) * numbers[i];
  const std::vector<float> x = describe(face, {});
  double whole = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double off = x[i] - general.mean(static_cast<Eigen::Index>(i));
    whole += off * off;
  }
  EXPECT_NEAR(sum, whole, 1e-4 * whole);
  EXPECT_GT(numbers.back(), 0);
}

// Templates from stored coordinates equal those from the face itself.
TEST(BackgroundSpace, CoordinatesGiveTheTemplatesOfTheFaces) {
  const Background general = small_background();
  const auto set = synthetic_faces(8, 3, 0.3, 1);
  const Rows rows = coordinates_of_all(general, set.faces);
  NoProgress quiet;
  const Recognizer model = train_coordinates(rows, set.labels, {}, quiet, {}, general);
  ASSERT_EQ(model.templates.rows(), 24);
  EXPECT_NO_THROW(model.check());
  const Rows again = templates_of_coordinates(model, general, rows);
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    const std::vector<float> direct = template_of(model, set.faces[i]);
    double off = 0;
    for (std::size_t k = 0; k < direct.size(); ++k)
      off = std::max<double>(off, std::abs(direct[k] - again(static_cast<Eigen::Index>(i),
                                                             static_cast<Eigen::Index>(k))));
    EXPECT_LT(off, 1e-3) << i;
  }
}

TEST(BackgroundSpace, IdentifiesPeopleAndRejectsImpostors) {
  const Background general = small_background();
  const auto set = synthetic_faces(12, 3, 0.3, 1);
  NoProgress quiet;
  const Recognizer model =
      train_coordinates(coordinates_of_all(general, set.faces), set.labels, {}, quiet, {}, general);
  ASSERT_TRUE(model.calibration);
  EXPECT_EQ(model.calibration->impostor_people, 12);
  const double threshold = model.calibration->threshold(0.01, 12);
  const auto probes = synthetic_faces(12, 2, 0.3, 2);
  int right = 0;
  for (std::size_t i = 0; i < probes.faces.size(); ++i) {
    const auto best = identify(model, probes.faces[i]).front();
    if (model.labels[static_cast<std::size_t>(best.person)] == probes.labels[i]) ++right;
  }
  EXPECT_GE(right, 23);  // of 24
  int accepted = 0;
  for (const cv::Mat& face : synthetic_faces(40, 1, 0.3, 2, 100).faces)
    if (identify(model, face).front().score >= threshold) ++accepted;
  EXPECT_LE(accepted, 2);
}

TEST(BackgroundSpace, FingerprintDependsOnBackgroundAndDescriptor) {
  const Background one = small_background();
  Background other = one;
  EXPECT_EQ(fingerprint(one), fingerprint(other));
  EXPECT_GT(fingerprint(one), 0);
  other.basis(3, 5) += 1e-4F;
  EXPECT_NE(fingerprint(one), fingerprint(other));
  DescriptorOptions descriptor;
  descriptor.symmetric = false;
  EXPECT_NE(fingerprint(one), fingerprint(one, descriptor));
}

TEST(BackgroundSpace, RejectsInvalidInput) {
  const Background mean_only = background_of(synthetic_faces(5, 1, 0, 1).faces, {});
  const cv::Mat face = synthetic_faces(1, 1, 0, 1).faces[0];
  EXPECT_THROW((void)coordinates_of(mean_only, face), std::invalid_argument);
  const Background general = small_background();
  NoProgress quiet;
  const std::vector<std::string> labels{"a"};
  EXPECT_THROW((void)train_coordinates(Rows(1, 7), labels, {}, quiet, {}, general),
               std::invalid_argument);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)train_coordinates(coordinates_of_all(general, {face}), labels, {}, quiet,
                                       stop.get_token(), general),
               Interrupted);
}

}  // namespace
}  // namespace tarsier::face::recognition
