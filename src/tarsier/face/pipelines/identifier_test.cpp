// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/identifier.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/pipelines/template_error.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::face {
namespace {

using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

// A gallery of three synthetic people.
class IdentifierTest : public FolderTest {
 protected:
  IdentifierTest() : set_(recognition::synthetic_faces(3, 3, 0.3, 5, 0, {128, 160})) {
    people::Gallery gallery(path("people.db"));
    for (std::size_t i = 0; i < set_.faces.size(); ++i)
      gallery.enroll(set_.labels[i], "", stored(set_.faces[i]));
  }
  static people::StoredFace stored(const cv::Mat& crop) {
    people::StoredFace face;
    face.crop = crop;
    face.measures = "{}";
    return face;
  }
  // Cropped faces do not need a reader that finds anything.
  static people::FaceReader no_reader() {
    people::FaceReaderOptions options;
    options.eyes = people::EyeMethod::kSplits;
    options.finder.thorough = false;
    return {options, nullptr};
  }
  recognition::SyntheticFaces set_;
};

TEST_F(IdentifierTest, IdentifiesCroppedFacesByTheCurrentGallery) {
  people::Gallery gallery(path("people.db"));
  NoProgress quiet;
  people::GalleryFollower follower(
      gallery, nullptr,
      train_gallery(gallery, nullptr, people::TrainingPolicy::kIfNeeded, quiet, {}));
  const Identifier identifier({}, true);
  IdentifierState state(no_reader(), follower);
  const IdentifierResult first = identifier.process(frame_of(set_.faces[0], 0, true), state);
  ASSERT_EQ(first.faces.size(), 1U);
  EXPECT_EQ(first.faces[0].identity.label, "p0");
  EXPECT_TRUE(first.faces[0].identity.known);
  EXPECT_EQ(state.gallery(), &gallery);
  people::Gallery other(path("people.db"));
  ASSERT_TRUE(other.forget("p0", {}));
  EXPECT_NE(identifier.process(frame_of(set_.faces[0], 0, true), state).faces[0].identity.label,
            "p0");
  ASSERT_TRUE(other.forget_all({}));
  EXPECT_TRUE(state.update());
  EXPECT_EQ(state.recognizer(), nullptr);
  EXPECT_EQ(identifier.process(frame_of(set_.faces[0], 0, true), state).faces[0].identity.label,
            "");
}

TEST_F(IdentifierTest, PoolsTemplatesOfTrackedFaces) {
  people::Gallery gallery(path("people.db"));
  NoProgress quiet;
  const auto model = train_gallery(gallery, nullptr, people::TrainingPolicy::kIfNeeded, quiet, {});
  ASSERT_TRUE(model);
  IdentificationOptions options;
  options.max_pooled = 2;
  PooledTemplates pool;
  std::vector<IdentifiedFace> faces(2);
  for (int k = 0; k < 3; ++k) {
    faces[0].face.id = 4;
    faces[0].face.crop = set_.faces[static_cast<std::size_t>(k)];
    faces[1].face.id = 0;  // of a still image: not pooled
    faces[1].face.crop = set_.faces[3];
    identify_faces(&model->recognizer, true, options, faces, pool);
    EXPECT_EQ(faces[0].identity.label, "p0");
    EXPECT_EQ(faces[1].identity.label, "p1");
  }
  ASSERT_EQ(pool.size(), 1U);
  EXPECT_EQ(pool.at(4).size(), 2U);
  // Pooled faces get a share of the false accept rate, so their threshold is stricter.
  EXPECT_NE(faces[0].identity.threshold, faces[1].identity.threshold);
  faces.erase(faces.begin());
  identify_faces(&model->recognizer, true, options, faces, pool);
  EXPECT_TRUE(pool.empty());  // the tracked face is gone
}

TEST_F(IdentifierTest, FindsAndIdentifiesInTwoSteps) {
  people::Gallery gallery(path("people.db"));
  people::GalleryFollower follower(gallery, nullptr, std::nullopt);
  const Identifier identifier({}, true);
  IdentifierState state(no_reader(), follower);
  const Frame frame = frame_of(set_.faces[0], 0, true);
  std::vector<IdentifiedFace> faces = identifier.find(frame, state);
  ASSERT_EQ(faces.size(), 1U);
  identifier.identify(faces, state);
  EXPECT_EQ(faces[0].identity.label, "") << "nothing is learned yet";
  NoProgress quiet;
  state.replace(train_gallery(gallery, nullptr, people::TrainingPolicy::kIfNeeded, quiet, {}));
  identifier.identify(faces, state);
  EXPECT_EQ(faces[0].identity.label, "p0");
  EXPECT_EQ(identifier.process(frame, state).faces[0].identity.score, faces[0].identity.score);
  state.replace(std::nullopt);
  EXPECT_EQ(state.recognizer(), nullptr);
  IdentifierState alone(no_reader(), nullptr);
  EXPECT_THROW(alone.replace(std::nullopt), std::invalid_argument);
}

TEST_F(IdentifierTest, EnrollerStoresFaceAndMeasures) {
  people::Gallery gallery(path("new.db"), DatabaseAccess::kCreate);
  Enroller enroller(gallery, nullptr);
  people::Face face;
  face.crop = set_.faces[0];
  face.quality.eye_distance = 61;
  enroller.enroll("Ann", "agreed", face, "door.png", 1234);
  const auto person = gallery.find("Ann");
  ASSERT_TRUE(person);
  EXPECT_EQ(person->faces, 1);
  EXPECT_EQ(person->note, "agreed");
  const auto stored = gallery.latest_face(person->id);
  ASSERT_TRUE(stored);
  EXPECT_EQ(stored->source, "door.png");
  EXPECT_EQ(stored->time, 1234);
  EXPECT_EQ(stored->quality, face.quality.score());
  EXPECT_NE(stored->measures.find("61"), std::string::npos) << stored->measures;
}

TEST_F(IdentifierTest, WritesJson) {
  IdentifiedFace face;
  face.face.box = {10.4, 20.6, 30, 40};
  IdentifierResult result{{face}, 1.234};
  EXPECT_EQ(
      to_json(result).dump(),
      R"({"faces":[{"box":[10,21,30,40],"label":null,"confidence":0.0,"known":false,"trusted":true}],"ms":1.23})");
  result.faces[0].face.id = 3;
  result.faces[0].identity = {"Ann", 0, 0, 0.98765, true, 0};
  EXPECT_EQ(
      to_json(result.faces[0]).dump(),
      R"({"box":[10,21,30,40],"label":"Ann","confidence":0.9877,"known":true,"trusted":true,"id":3})");
}

TEST_F(IdentifierTest, IdentifiesAnEnrolledFace) {
  if (!fs::exists(kMessi)) GTEST_SKIP() << "needs the package opencv-doc";
  const cv::Mat image = read_image(kMessi);
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  IdentifierOptions options;
  options.gallery = path("messi.db");
  {
    people::FaceReader reader = FaceReaderModel::load(models()).make_reader();
    const std::vector<people::Face> faces = reader.read(gray);
    ASSERT_EQ(faces.size(), 1U);
    people::Gallery(options.gallery).enroll("Messi", "", stored(faces[0].crop));
  }
  const Identifier identifier = Identifier::load(models(), options);
  IdentifierState state = identifier.open();
  ASSERT_NE(state.gallery(), nullptr);
  const IdentifierResult still = identifier.process(frame_of(image, 0, true), state);
  ASSERT_EQ(still.faces.size(), 1U);
  EXPECT_EQ(still.faces[0].identity.label, "Messi");
  EXPECT_TRUE(still.faces[0].identity.known);
  EXPECT_EQ(still.faces[0].face.id, 0);
  const IdentifierResult video = identifier.process(frame_of(image, 0, false), state);
  ASSERT_EQ(video.faces.size(), 1U);
  EXPECT_GT(video.faces[0].face.id, 0);
  EXPECT_EQ(video.faces[0].identity.label, "Messi");
}

TEST_F(IdentifierTest, RejectsMissingFiles) {
  IdentifierOptions options;
  options.gallery = path("nobody.db");
  const Identifier identifier = Identifier::load(models(), options);
  EXPECT_THROW(static_cast<void>(identifier.open()), InputError);
  options.background = path("faces.json");
  EXPECT_THROW(static_cast<void>(Identifier::load(models(), options)), ModelError);
  options.background = "none";
  EXPECT_FALSE(load_background(models(), options.background));
  options.recognizer = path("recognizer.json");
  EXPECT_THROW(static_cast<void>(Identifier::load(models(), options)), ModelError);
  EXPECT_THROW(static_cast<void>(Identifier({}, true).open()), std::invalid_argument);
}

TEST_F(IdentifierTest, CreatesAGalleryForEnrolment) {
  IdentifierOptions options;
  options.gallery = path("nobody.db");
  options.enroll = true;
  options.algorithm = recognition::Algorithm::kFisher;
  const IdentifierState state = Identifier::load(models(), options).open();
  ASSERT_NE(state.gallery(), nullptr);
  EXPECT_EQ(state.gallery()->algorithm(), "fisher");
  EXPECT_NE(state.background(), nullptr) << "for those who are added, though nobody is there yet";
  EXPECT_EQ(state.recognizer(), nullptr);
  // Fisherfaces need two people. So the first person can be added alone.
  state.gallery()->enroll("Ann", "", stored(set_.faces[0]));
  EXPECT_EQ(Identifier::load(models(), options).open().recognizer(), nullptr);
  options.enroll = false;
  options.algorithm.reset();
  EXPECT_THROW(static_cast<void>(Identifier::load(models(), options).open()), InputError);
}

// It began while nobody was enrolled, so without a background. A large gallery needs one.
TEST_F(IdentifierTest, FollowsAGalleryThatBecomesLarge) {
  IdentifierOptions options;
  options.gallery = path("growing.db");
  people::Gallery other(options.gallery);
  const Identifier identifier = Identifier::load(models(), options);
  IdentifierState state = identifier.open();
  EXPECT_EQ(state.background(), nullptr);
  const auto background = load_background(models(), "");
  ASSERT_TRUE(background);
  Rng rng(7);
  std::vector<people::NewFace> faces;
  for (int i = 0; i <= people::kMaxSmallGalleryFaces; ++i) {
    people::NewFace face{i % 2 == 0 ? "Ann" : "Ben", "", stored(set_.faces[0])};
    face.face.space = -recognition::fingerprint(*background);
    for (int k = 0; k < recognition::coordinate_count(*background); ++k)
      face.face.features.push_back(
          static_cast<float>((i % 2 == 0 && k < 9 ? 1 : 0) + 0.1 * rng.normal()));
    faces.push_back(std::move(face));
  }
  other.enroll(faces);
  NoProgress quiet;
  (void)train_gallery(other, &*background, people::TrainingPolicy::kIfNeeded, quiet, {});
  EXPECT_TRUE(state.update());
  ASSERT_NE(state.background(), nullptr);
  ASSERT_NE(state.recognizer(), nullptr);
  EXPECT_EQ(state.recognizer()->templates.rows(), people::kMaxSmallGalleryFaces + 1);
  EXPECT_TRUE(state.is_enrolled("Ben"));
}

// The library does not know the commands of the program; its message states the problem only.
TEST_F(IdentifierTest, RejectsTemplatesOfAnotherKind) {
  const TemporaryFolder empty;
  const ModelStore none(empty.path());
  const auto problem_of = [&](people::Gallery& gallery, TemplateKind kind,
                              const SharedNetwork& own) -> std::optional<TemplateProblem> {
    try {
      resolve_template_kind(gallery, kind, none, false, own);
    } catch (const TemplateError& error) {
      EXPECT_EQ(error.path(), gallery.path());
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      EXPECT_THAT(error.what(), Not(HasSubstr("--")));
      return error.problem();
    }
    return std::nullopt;
  };
  const auto network_named = [](const std::string& name, const std::string& sha256) {
    auto network = std::make_shared<recognition::DeepNetwork>();
    network->name = name;
    network->sha256 = sha256;
    return SharedNetwork(network);
  };
  const SharedNetwork own = network_named("face.onnx", "0123456789abcdef");
  people::Gallery gallery(path("people.db"), DatabaseAccess::kWrite);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kClassic, nullptr), std::nullopt);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kDeep, nullptr), TemplateProblem::kNotDeep);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kAuto, own), TemplateProblem::kOtherNetwork);
  use_deep_templates(gallery, own);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kAuto, own), std::nullopt);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kAuto, network_named("b.onnx", "fedc")),
            TemplateProblem::kOtherNetwork);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kDeep, nullptr), TemplateProblem::kNetworkNotGiven);
  EXPECT_EQ(problem_of(gallery, TemplateKind::kClassic, nullptr), TemplateProblem::kNotClassic);
  try {
    static_cast<void>(load_deep_background(none, "", own));
    FAIL() << "a network without a background";
  } catch (const TemplateError& error) {
    EXPECT_EQ(error.problem(), TemplateProblem::kNotCalibrated);
    EXPECT_EQ(error.kind(), ErrorKind::kModel);
    EXPECT_EQ(error.path(), "face.onnx");
  }
}

TEST_F(IdentifierTest, RejectsInvalidOptions) {
  IdentifierOptions options;
  options.cropped = true;  // but no recognizer
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.identification.false_accepts = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.algorithm = recognition::Algorithm::kLbph;  // but not to enroll
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.identification.max_pooled = 0;
  EXPECT_THROW(static_cast<void>(Identifier::load(models(), options)), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face
