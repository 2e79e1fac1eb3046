// SPDX-License-Identifier: MIT
#include "tarsier/face/people/model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/people/testing_gallery.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/testing_deep.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stop_token>

namespace tarsier::face::people {
namespace {

using recognition::synthetic_faces;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

class GalleryModelTest : public FolderTest {
 protected:
  void enroll(Gallery& gallery, int people, int images, int first = 0,
              TemplateExtractor* extractor = nullptr) {
    const auto faces = synthetic_faces(people, images, 0.3, 5, first, {128, 160});
    for (std::size_t i = 0; i < faces.faces.size(); ++i) {
      StoredFace face;
      face.crop = faces.faces[i];
      face.measures = "{}";
      if (extractor != nullptr) extractor->fill(face);
      gallery.enroll(faces.labels[i], "", face);
    }
  }
  Recognition identified(const recognition::Recognizer& model, int person, int seed = 99) {
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

// The background of an untrained network.
recognition::Background deep_background(std::uint64_t seed) {
  const auto many = synthetic_faces(12, 1, 0.3, 3, 1000, {128, 160});
  recognition::BackgroundOptions options;
  options.components = 10;
  options.network = std::make_shared<const recognition::DeepNetwork>(
      recognition::build_deep_network(recognition::tiny_deep_weights(seed), "made up"));
  NoProgress progress;
  return recognition::learn_background(many.faces, options, progress, {});
}

TEST_F(GalleryModelTest, DeepTemplatesDoNotDependOnTheGallery) {
  Gallery gallery(path("p.db"));
  gallery.set_algorithm("deep");
  const auto general = deep_background(1);
  TemplateExtractor extractor(gallery, &general);
  enroll(gallery, 2, 1, 0, &extractor);
  const std::int64_t space = -recognition::fingerprint(general);
  EXPECT_THAT(gallery.without_template(space), IsEmpty());
  const std::vector<float> first = gallery.template_of(gallery.face_refs().front().id, space);
  const auto model =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  ASSERT_TRUE(model);
  EXPECT_EQ(model->recognizer.options.algorithm, recognition::Algorithm::kDeep);
  EXPECT_EQ(identified(model->recognizer, 1, 5).label, "p1");
  enroll(gallery, 1, 2, 7, &extractor);
  ASSERT_TRUE(gallery.forget("p1", {}));
  EXPECT_EQ(gallery.template_of(gallery.face_refs().front().id, space), first);
}

TEST_F(GalleryModelTest, SmallDeepGalleryIsRetrainedAfterEnrolment) {
  Gallery gallery(path("p.db"));
  gallery.set_algorithm("deep");
  const auto general = deep_background(1);
  enroll(gallery, 1, 1);
  const auto one =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  const auto same =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  enroll(gallery, 3, 1, 7);
  const auto four =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  ASSERT_TRUE(one && same && four);
  EXPECT_EQ(same->id, one->id);
  EXPECT_NE(four->id, one->id);
  EXPECT_EQ(four->recognizer.calibration->impostor_people, 4);
}

TEST_F(GalleryModelTest, RecomputesTemplatesOfAnotherKind) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  const auto deep = deep_background(1);
  enroll(gallery, 3, 1);
  const auto classic =
      gallery_model(gallery, &general, true, progress_, {}, TrainingPolicy::kAlways);
  ASSERT_TRUE(classic);
  gallery.set_algorithm("deep");
  const auto made = gallery_model(gallery, &deep, true, progress_, {}, TrainingPolicy::kAlways);
  ASSERT_TRUE(made);
  EXPECT_EQ(made->options.algorithm, recognition::Algorithm::kDeep);
  EXPECT_NE(made->template_length(), classic->template_length());
  EXPECT_EQ(identified(*made, 2, 5).label, "p2");
  gallery.set_algorithm("default");
  const auto back = gallery_model(gallery, &general, true, progress_, {}, TrainingPolicy::kAlways);
  ASSERT_TRUE(back);
  EXPECT_LT((back->templates - classic->templates).cwiseAbs().maxCoeff(), 1e-6);
}

TEST_F(GalleryModelTest, RejectsDeepTemplatesWithoutTheirNetwork) {
  Gallery gallery(path("p.db"));
  enroll(gallery, 2, 1);
  gallery.set_algorithm("deep");
  const auto general = gallery_background();
  EXPECT_THROW((void)gallery_model(gallery, &general, true, progress_, {}), std::invalid_argument);
  EXPECT_THROW((void)gallery_model(gallery, nullptr, true, progress_, {}), std::invalid_argument);
  const auto one = deep_background(1);
  const auto other = deep_background(2);
  const auto first = gallery_model(gallery, &one, true, progress_, {});
  const auto second = gallery_model(gallery, &other, true, progress_, {});
  ASSERT_TRUE(first && second);
  EXPECT_NE(first->templates, second->templates);  // computed again, not mixed
}

TEST_F(GalleryModelTest, IdentifiesEnrolledPeopleOnly) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  for (const int people : {1, 3}) {
    enroll(gallery, people, 3);
    const auto model = gallery_model(gallery, &general, true, progress_, {});
    ASSERT_TRUE(model);
    for (int p = 0; p < people; ++p) {
      const Recognition seen = identified(*model, p);
      EXPECT_TRUE(seen.known) << people;
      EXPECT_EQ(seen.label, "p" + std::to_string(p));
      EXPECT_GT(seen.confidence, 0.5);
    }
    const Recognition unknown = identified(*model, 500);
    EXPECT_FALSE(unknown.known);
    EXPECT_FALSE(unknown.label.empty());
    EXPECT_LT(unknown.confidence, 0.5);
  }
}

TEST_F(GalleryModelTest, StoredModelEqualsTheTrainedModel) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 3, 2);
  const auto trained = gallery_model(gallery, &general, true, progress_, {});
  ASSERT_TRUE(gallery.model());
  const auto read = gallery_model(gallery, nullptr, false, progress_, {});  // needs no background
  EXPECT_EQ(read->templates, trained->templates);
  EXPECT_EQ(read->labels, trained->labels);
  EXPECT_DOUBLE_EQ(identified(*read, 1).score, identified(*trained, 1).score);
}

TEST_F(GalleryModelTest, ForgettingKeepsTheOtherPeople) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 3, 3);
  (void)gallery_model(gallery, &general, true, progress_, {});
  ASSERT_TRUE(gallery.forget("p1", {})->proven());
  const auto model = gallery_model(gallery, &general, true, progress_, {});
  EXPECT_THAT(model->labels, ElementsAre("p0", "p2"));
  EXPECT_TRUE(identified(*model, 2).known);
  EXPECT_FALSE(identified(*model, 1).known);
}

// New faces get templates of the learned model; the model stays as it is.
TEST_F(GalleryModelTest, EnrollingExtendsTheExistingModel) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 3, 3);
  auto model =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  const std::int64_t id = gallery.model_id();
  GalleryFollower follower(gallery, &general, std::move(model));
  TemplateExtractor extractor(gallery, &general);
  enroll(gallery, 1, 3, 40, &extractor);
  EXPECT_EQ(gallery.model_id(), id);
  EXPECT_THAT(gallery.without_template(id), IsEmpty());
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kNone);
  EXPECT_EQ(follower.recognizer()->labels.size(), 4U);
  EXPECT_NO_THROW(follower.recognizer()->check());
  EXPECT_TRUE(identified(*follower.recognizer(), 40).known);
  EXPECT_EQ(identified(*follower.recognizer(), 40).label, "p40");
}

// The memory of a running program does not keep a forgotten person.
TEST_F(GalleryModelTest, FollowerDropsPeopleForgottenElsewhere) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 3, 3);
  GalleryFollower follower(
      gallery, &general,
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {}));
  ASSERT_TRUE(identified(*follower.recognizer(), 1).known);
  Gallery other(path("p.db"));
  ASSERT_TRUE(other.forget("p1", {}));
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  EXPECT_THAT(follower.recognizer()->labels, ElementsAre("p0", "p2"));
  EXPECT_FALSE(identified(*follower.recognizer(), 1).known);
  EXPECT_NE(identified(*follower.recognizer(), 1).label, "p1");
  EXPECT_TRUE(identified(*follower.recognizer(), 2).known);
  EXPECT_EQ(follower.recognizer()->templates.rows(), 6);
  // If another program learns, its model is used.
  (void)gallery_model(other, &general, true, progress_, {});
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kModel);
  EXPECT_EQ(follower.recognizer()->labels.size(), 2U);
  ASSERT_TRUE(other.forget_all({}));
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  EXPECT_EQ(follower.recognizer(), nullptr);
}

// With more faces than learning uses, the gallery keeps coordinates. Forgetting a person keeps
// those of the others.
TEST_F(GalleryModelTest, LargeGalleryStoresCoordinates) {
  TARSIER_LONG_TEST();
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  const std::int64_t space = -recognition::fingerprint(general);
  const int people = (kMaxSmallGalleryFaces + 1) / 3 + 1;
  enroll(gallery, people, 3);
  auto model =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  ASSERT_TRUE(model);
  EXPECT_EQ(model->space, space);
  EXPECT_EQ(model->recognizer.labels.size(), static_cast<std::size_t>(people));
  const Recognition seen = identified(model->recognizer, 7);
  EXPECT_EQ(seen.label, "p7");
  EXPECT_FALSE(identified(model->recognizer, 5000).known);
  const std::int64_t id = gallery.model_id();
  // Enrolling one more person learns nothing and computes one template.
  TemplateExtractor extractor(gallery, &general);
  enroll(gallery, 1, 3, 3000, &extractor);
  EXPECT_THAT(gallery.without_template(space), IsEmpty());
  GalleryFollower follower(gallery, &general, std::move(model));
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  EXPECT_EQ(identified(*follower.recognizer(), 3000).label, "p3000");
  const auto again =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  EXPECT_EQ(gallery.model_id(), id);
  EXPECT_EQ(again->recognizer.templates, follower.recognizer()->templates);
  // Forgetting a person removes what was learned from that person, and no coordinates of others.
  ASSERT_TRUE(gallery.forget("p7", {})->model_removed);
  EXPECT_EQ(gallery.model_id(), 0);
  EXPECT_THAT(gallery.without_template(space), IsEmpty());
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  EXPECT_NE(identified(*follower.recognizer(), 7).label, "p7");
  const auto relearned =
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {});
  EXPECT_EQ(relearned->recognizer.labels.size(), static_cast<std::size_t>(people));
  // On request, it is learned again.
  (void)load_gallery_model(gallery, &general, true, TrainingPolicy::kAlways, progress_, {});
  EXPECT_NE(gallery.model_id(), id);
}

TEST_F(GalleryModelTest, TrainingCanBeInterruptedBeforeEachStep) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 3, 3);
  std::stop_source stop;
  stop.request_stop();
  for (int after = 0;; ++after) {
    GalleryTraining training(gallery, &general, false, TrainingPolicy::kAlways);
    bool more = true;
    for (int i = 0; i < after && more; ++i) more = training.step(progress_, {});
    if (!more) {
      EXPECT_GE(after, 10);
      EXPECT_TRUE(training.take());
      break;
    }
    EXPECT_THROW((void)training.step(progress_, stop.get_token()), Interrupted) << after;
  }
}

TEST_F(GalleryModelTest, RejectsLargeClassicalGalleries) {
  Gallery gallery(path("p.db"));
  std::vector<NewFace> many;
  for (int i = 0; i <= kMaxClassical; ++i) {
    NewFace one{"p" + std::to_string(i % 3), "", {}};
    one.face.crop = cv::Mat(160, 128, CV_8UC1, cv::Scalar(i % 200));
    one.face.measures = "{}";
    many.push_back(one);
  }
  gallery.enroll(many);
  gallery.set_algorithm("eigen");
  EXPECT_THROW((void)gallery_model(gallery, nullptr, true, progress_, {}), std::invalid_argument);
}

TEST_F(GalleryModelTest, TrainsClassicalRecognisers) {
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

TEST_F(GalleryModelTest, FindsDuplicateNames) {
  Gallery gallery(path("p.db"));
  const auto general = gallery_background();
  enroll(gallery, 2, 4);
  GalleryFollower follower(
      gallery, &general,
      load_gallery_model(gallery, &general, true, TrainingPolicy::kIfNeeded, progress_, {}));
  const auto again = synthetic_faces(1, 3, 0.2, 123, 1, {128, 160}).faces;
  EXPECT_THAT(duplicate_names(follower, again, "Somebody"), ElementsAre("p1"));
  EXPECT_THAT(duplicate_names(follower, again, "p1"), IsEmpty());
  const auto stranger = synthetic_faces(1, 3, 0.2, 123, 700, {128, 160}).faces;
  EXPECT_THAT(duplicate_names(follower, stranger, "x"), IsEmpty());
}

}  // namespace
}  // namespace tarsier::face::people
