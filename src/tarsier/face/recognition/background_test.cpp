// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/background.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::face::recognition {
namespace {

Background general_background() { return synthetic_background(60, 1000, 50); }

struct MeasuredRates {
  double true_accept_rate = 0;
  double false_accept_rate = 0;
};

// Shares above the threshold for a false accept rate of 1 %: other images of the enrolled people,
// and of 30 unknown people.
MeasuredRates measured_rates(const Recognizer& model, int enrolled) {
  const SyntheticFaces known = synthetic_faces(enrolled, 6, 0.3, 77);
  const SyntheticFaces unknown = synthetic_faces(30, 4, 0.3, 78, 200);
  const double threshold = model.calibration->threshold(0.01, enrolled);
  const auto share = [&](const SyntheticFaces& of) {
    double above = 0;
    for (const cv::Mat& face : of.faces)
      above += identify(model, face).front().score >= threshold ? 1 : 0;
    return above / static_cast<double>(of.faces.size());
  };
  return {share(known), share(unknown)};
}

TEST(BackgroundTest, SmallGalleriesRejectImpostors) {
  const Background general = general_background();
  NoProgress progress;
  for (const int enrolled : {1, 2, 5}) {
    const SyntheticFaces gallery = synthetic_faces(enrolled, 3, 0.3, 5);
    const Recognizer model = train(gallery.faces, gallery.labels, {}, progress, {}, &general);
    ASSERT_TRUE(model.calibration) << enrolled;
    const MeasuredRates measured = measured_rates(model, enrolled);
    EXPECT_GT(measured.true_accept_rate, 0.9) << enrolled;
    EXPECT_LE(measured.false_accept_rate, 0.03) << enrolled;
  }
}

TEST(BackgroundTest, OneImageSuffices) {
  const Background general = general_background();
  NoProgress progress;
  const SyntheticFaces gallery = synthetic_faces(1, 1, 0.3, 5);
  const Recognizer model = train(gallery.faces, gallery.labels, {}, progress, {}, &general);
  const MeasuredRates measured = measured_rates(model, 1);
  EXPECT_GT(measured.true_accept_rate, 0.8);
  EXPECT_LE(measured.false_accept_rate, 0.03);
}

TEST(BackgroundTest, IsDeterministic) {
  const Background a = general_background();
  const Background b = general_background();
  EXPECT_EQ(a.basis, b.basis);
  EXPECT_EQ(a.within, b.within);
}

TEST(BackgroundTest, RelitFaceKeepsItsSize) {
  const cv::Mat face = synthetic_faces(1, 1, 0, 1).faces[0];
  const cv::Mat lit = relit_face(face, 1, 4);
  EXPECT_EQ(lit.size(), face.size());
  EXPECT_GT(cv::norm(lit, face, cv::NORM_L1) / static_cast<double>(face.total()), 5);
  EXPECT_EQ(cv::norm(lit, relit_face(face, 1, 4), cv::NORM_INF), 0);
}

TEST(BackgroundTest, RoundTripAndInvalidFiles) {
  const TemporaryFolder folder;
  const std::string path = folder / "b.json";
  const Background written = general_background();
  write_background(path, written, nlohmann::json::object());
  const Background read = read_background(path);
  EXPECT_EQ(read.basis, written.basis);
  EXPECT_EQ(read.mean, written.mean);
  EXPECT_LT((read.within - written.within).cwiseAbs().maxCoeff(), 1e-6);
  const std::string text = read_file(path, 100'000'000);
  write_file_atomically(folder / "cut.json", std::string_view(text).substr(0, text.size() / 2));
  EXPECT_THROW((void)read_background(folder / "cut.json"), ModelError);
  std::string other = text;
  other.replace(other.find("\"outside\":"), 10, "\"outside\":-");
  write_file_atomically(folder / "other.json", std::string_view(other));
  EXPECT_THROW((void)read_background(folder / "other.json"), ModelError);
  EXPECT_THROW((void)read_background(folder / "none.json"), ModelError);
}

TEST(BackgroundTest, RejectsInconsistentParts) {
  Background general = general_background();
  general.variance.resize(3);
  const SyntheticFaces gallery = synthetic_faces(2, 2, 0.3, 5);
  NoProgress progress;
  EXPECT_THROW((void)train(gallery.faces, gallery.labels, {}, progress, {}, &general),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::recognition
