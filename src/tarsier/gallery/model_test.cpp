// SPDX-License-Identifier: MIT
#include "tarsier/gallery/model.h"

#include "tarsier/io/testing_folder.h"
#include "tarsier/recognition/background.h"
#include "tarsier/recognition/testing_faces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier::people {
namespace {

using recognition::synthetic_faces;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

recognition::Background background() {
  const auto many = synthetic_faces(40, 1, 0.3, 3, 1000, {128, 160});
  recognition::BackgroundOptions options;
  options.components = 30;
  NoProgress progress;
  return recognition::learn_background(many.faces, options, progress, {});
}

class GalleryModelTest : public FolderTest {
 protected:
  void enroll(Gallery& gallery, int people, int pictures, int first = 0) {
    const auto faces = synthetic_faces(people, pictures, 0.3, 5, first, {128, 160});
    for (std::size_t i = 0; i < faces.faces.size(); ++i) {
      StoredFace face;
      face.crop = faces.faces[i];
      face.measures = "{}";
      gallery.enroll(faces.labels[i], "", face);
    }
  }
  Recognition named(const recognition::Recognizer& model, int person, int seed = 99) {
    const cv::Mat face =
        synthetic_faces(1, 1, 0.3, static_cast<std::uint64_t>(seed), person, {128, 160}).faces[0];
    return recognize(
        model, recognition::template_of(model, recognizer_input(model.options.algorithm, face)),
        0.01);
  }
  NoProgress progress_;
};

TEST_F(GalleryModelTest, AnEmptyGalleryHasNoModel) {
  Gallery gallery(path("p.db"));
  EXPECT_FALSE(gallery_model(gallery, nullptr, true, progress_, {}));
}

TEST_F(GalleryModelTest, NamesThoseEnrolledAndNobodyElse) {
  Gallery gallery(path("p.db"));
  const auto general = background();
  for (const int people : {1, 3}) {
    enroll(gallery, people, 3);
    const auto model = gallery_model(gallery, &general, true, progress_, {});
    ASSERT_TRUE(model);
    for (int p = 0; p < people; ++p) {
      const Recognition seen = named(*model, p);
      EXPECT_TRUE(seen.known) << people;
      EXPECT_EQ(seen.label, "p" + std::to_string(p));
      EXPECT_GT(seen.confidence, 0.5);
    }
    const Recognition stranger = named(*model, 500);
    EXPECT_FALSE(stranger.known);
    EXPECT_FALSE(stranger.label.empty());
    EXPECT_LT(stranger.confidence, 0.5);
  }
}

TEST_F(GalleryModelTest, TheStoredModelIsTheSame) {
  Gallery gallery(path("p.db"));
  const auto general = background();
  enroll(gallery, 3, 2);
  const auto trained = gallery_model(gallery, &general, true, progress_, {});
  ASSERT_TRUE(gallery.model());
  const auto read = gallery_model(gallery, nullptr, false, progress_, {});  // needs no background
  EXPECT_EQ(read->templates, trained->templates);
  EXPECT_EQ(read->labels, trained->labels);
  EXPECT_DOUBLE_EQ(named(*read, 1).score, named(*trained, 1).score);
}

TEST_F(GalleryModelTest, WhenSomebodyIsForgottenTheOthersAreStillKnown) {
  Gallery gallery(path("p.db"));
  const auto general = background();
  enroll(gallery, 3, 3);
  (void)gallery_model(gallery, &general, true, progress_, {});
  ASSERT_TRUE(gallery.forget("p1", {})->proven());
  const auto model = gallery_model(gallery, &general, true, progress_, {});
  EXPECT_THAT(model->labels, ElementsAre("p0", "p2"));
  EXPECT_TRUE(named(*model, 2).known);
  EXPECT_FALSE(named(*model, 1).known);
}

TEST_F(GalleryModelTest, ClassicalRecognisersWorkToo) {
  Gallery gallery(path("p.db"));
  enroll(gallery, 1, 3);
  gallery.set_algorithm("fisher");
  EXPECT_THROW((void)gallery_model(gallery, nullptr, true, progress_, {}), std::invalid_argument);
  enroll(gallery, 3, 4, 1);
  for (const char* algorithm : {"fisher", "eigen", "lbph"}) {
    gallery.set_algorithm(algorithm);
    const auto model = gallery_model(gallery, nullptr, true, progress_, {});
    ASSERT_TRUE(model) << algorithm;
    EXPECT_EQ(model->templates.rows(), 15) << algorithm;
    EXPECT_EQ(model->labels.size(), 4U);
  }
}

TEST_F(GalleryModelTest, OnePersonUnderTwoNamesIsNoticed) {
  Gallery gallery(path("p.db"));
  const auto general = background();
  enroll(gallery, 2, 4);
  const auto model = gallery_model(gallery, &general, true, progress_, {});
  const auto again = synthetic_faces(1, 3, 0.2, 123, 1, {128, 160}).faces;
  EXPECT_THAT(other_names(*model, again, "Somebody"), ElementsAre("p1"));
  EXPECT_THAT(other_names(*model, again, "p1"), IsEmpty());
  EXPECT_THAT(other_names(*model, synthetic_faces(1, 3, 0.2, 123, 700, {128, 160}).faces, "x"),
              IsEmpty());
}

}  // namespace
}  // namespace tarsier::people
