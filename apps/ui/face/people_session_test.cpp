// SPDX-License-Identifier: MIT
#include "ui/face/people_session.h"

#include "tarsier/core/testing_long.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/scripted_host.h"
#include "ui/testing_plain.h"
#include "ui/testing_stages.h"
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

namespace tarsier {
namespace {

using ::testing::HasSubstr;

constexpr const char* kImage = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

// The models that ship, of the source tree.
std::string models_folder() { return TARSIER_SOURCE_MODELS; }

std::shared_ptr<const face::landmarks::LandmarkModel> landmark_model() {
  static const auto model = [] {
    const std::string path = models_folder() + "/landmarks68.json";
    return std::filesystem::exists(path) ? std::make_shared<const face::landmarks::LandmarkModel>(
                                               face::landmarks::read_landmark_model(path))
                                         : nullptr;
  }();
  return model;
}

// With the models that ship.
face::people::FaceReader shipped_reader() {
  static const auto networks = std::make_shared<const face::FaceNetworks>(
      face::read_face_networks(models_folder() + "/face-detector.json"));
  return {{}, landmark_model(), networks};
}

Event click(const cv::Rect& box) {
  Event event;
  event.kind = Event::Kind::kMouse;
  event.mouse = Event::Mouse::kLeftDown;
  event.x = box.x + box.width / 2.0;
  event.y = box.y + box.height / 2.0;
  return event;
}

Frame frame(const cv::Mat& image, int index) {
  Frame out;
  out.image = image;
  out.index = index;
  out.time = index / 25.0;
  out.name = "camera";
  return out;
}

class PeopleSessionTest : public FolderTest {
 protected:
  // Cascades find no face in plain images: enough for everything but faces.
  static face::people::FaceReader reader() {
    face::people::FaceReaderOptions options;
    options.eyes = face::people::EyeMethod::kSplits;
    options.finder.thorough = false;
    return {options, nullptr};
  }
  // Of a gallery that a test looks into; nothing is learned yet.
  face::IdentifierState opened(face::people::Gallery& gallery,
                               const face::recognition::Background* background = nullptr,
                               face::people::FaceReader with = reader()) {
    follower_.emplace(gallery, background, std::nullopt);
    return {std::move(with), *follower_};
  }
  static face::people::StoredFace face(int seed) {
    face::people::StoredFace out;
    out.crop.create(160, 128, CV_8UC1);
    cv::RNG rng(static_cast<std::uint64_t>(seed) + 3);
    rng.fill(out.crop, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(out.crop, out.crop, {}, 3);
    out.measures = "{}";
    return out;
  }
  const cv::Mat empty_ = cv::Mat(360, 480, CV_8UC3, cv::Scalar(120, 130, 140));
  const SourceStatus live_{SourceState::kLive, "", 0, 0, 0, 0};
  std::optional<face::people::GalleryFollower> follower_;
};

TEST_F(PeopleSessionTest, StartsInDetectMode) {
  face::people::Gallery gallery(path("p.db"));
  PeopleSession session(opened(gallery), {});
  EXPECT_EQ(session.mode(), PeopleMode::kStart);
  const View view = session.on_frame(frame(empty_, 0), live_);
  EXPECT_EQ(view.state["mode"], "detect");
  EXPECT_EQ(view.image.type(), CV_8UC3);
  EXPECT_GT(view.image.cols, view.image.rows);
  EXPECT_TRUE(session.on_event(key_event(key::kEscape)).finished);
}

TEST_F(PeopleSessionTest, RecognizesFromTheFirstFrameWithAModel) {
  face::people::Gallery gallery(path("p.db"));
  for (int i = 0; i < 3; ++i) {
    gallery.enroll("Ann", "", face(i));
    gallery.enroll("Ben", "", face(10 + i));
  }
  gallery.set_algorithm("lbph");
  NoProgress quiet;
  face::people::GalleryFollower follower(
      gallery, nullptr,
      face::train_gallery(gallery, nullptr, face::people::TrainingPolicy::kIfNeeded, quiet, {}));
  PeopleSession session(face::IdentifierState(reader(), follower), {});
  EXPECT_EQ(session.on_frame(frame(empty_, 0), live_).state["mode"], "recognize");
  EXPECT_THROW(PeopleSession(face::IdentifierState(reader(), nullptr), {}), std::invalid_argument);
}

TEST_F(PeopleSessionTest, AddsAtMostOnePersonWithoutFaces) {
  face::people::Gallery gallery(path("p.db"));
  PeopleSessionOptions options;
  options.names = {"Ann"};
  PeopleSession session(opened(gallery), options);
  (void)session.on_frame(frame(empty_, 0), live_);
  View view = session.on_event(click(session.button_box("add")));
  EXPECT_EQ(view.state["mode"], "collect");
  EXPECT_EQ(view.state["collecting"], "Ann");
  view = session.on_event(key_event('a'));
  EXPECT_EQ(view.state["people"].size(), 1U);
  EXPECT_EQ(gallery.people().size(), 0U);  // nobody is enrolled without a face
  // A click elsewhere ends it; nothing to train on is said.
  view = session.on_event(click({200, 300, 2, 2}));
  EXPECT_EQ(view.state["mode"], "detect");
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("no face"));
}

TEST_F(PeopleSessionTest, DeleteAllAsksForConfirmation) {
  face::people::Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", face(1));
  gallery.enroll("Ben", "", face(2));
  PeopleSession session(opened(gallery), {});
  (void)session.on_frame(frame(empty_, 0), live_);
  View view = session.on_event(click(session.button_box("delete")));
  EXPECT_TRUE(view.state["asking"]);
  view = session.on_event(click(session.button_box("cancel")));
  EXPECT_FALSE(view.state["asking"]);
  EXPECT_EQ(gallery.people().size(), 2U);
  // A stray "y" is no answer to a question that nobody asked.
  (void)session.on_event(key_event('y'));
  EXPECT_EQ(gallery.people().size(), 2U);
  (void)session.on_event(key_event('d'));
  view = session.on_event(click(session.button_box("confirm")));
  EXPECT_EQ(gallery.people().size(), 0U);
  EXPECT_EQ(view.state["people"].size(), 0U);
  EXPECT_EQ(view.state["forgotten"], nlohmann::json({"Ann", "Ben"}));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("no copy is left"));
}

TEST_F(PeopleSessionTest, ReportsThatFisherfacesNeedsTwoPeople) {
  face::people::Gallery gallery(path("p.db"));
  for (int i = 0; i < 3; ++i) gallery.enroll("Ann", "", face(i));
  gallery.set_algorithm("fisher");
  PeopleSession session(opened(gallery), {});
  View view;
  for (int i = 0; i < 3; ++i) view = session.on_frame(frame(empty_, i), live_);
  EXPECT_EQ(view.state["mode"], "detect");
  EXPECT_THAT(view.status, HasSubstr("two people"));
  for (int i = 0; i < 3; ++i) gallery.enroll("Ben", "", face(10 + i));
  (void)session.on_event(click(session.strip_box(0)));
  EXPECT_EQ(session.mode(), PeopleMode::kCollect);
  (void)session.on_event(key_event('t'));
  view = session.on_frame(frame(empty_, 4), live_);
  EXPECT_EQ(view.state["mode"], "recognize");
}

TEST_F(PeopleSessionTest, CollectsAndShowsAFaceOnce) {
  if (landmark_model() == nullptr || !std::filesystem::exists(kImage))
    GTEST_SKIP() << "needs models/landmarks68.json and the package opencv-doc";
  const cv::Mat image = read_image(kImage);
  face::people::Gallery gallery(path("p.db"));
  PeopleSessionOptions options;
  options.names = {"Leo"};
  options.collect.gate.min_eye_distance = 8;
  options.collect.gate.min_sharpness = 0.02;
  PeopleSession session(opened(gallery, nullptr, shipped_reader()), options);
  (void)session.on_frame(frame(image, 0), live_);
  (void)session.on_event(key_event('a'));
  View view = session.on_frame(frame(image, 1), live_);
  ASSERT_EQ(session.faces().size(), 1U);
  EXPECT_TRUE(view.state["flash"]);
  EXPECT_EQ(gallery.face_count(), 1);
  EXPECT_EQ(view.image.at<cv::Vec3b>(300, 200), cv::Vec3b(255, 255, 255));
  EXPECT_THAT(view.state["prompt"].get<std::string>(), HasSubstr("left"));
  // The same face again is refused; time passing alone does not change that.
  for (int i = 2; i < 30; ++i) view = session.on_frame(frame(image, i), live_);
  EXPECT_EQ(gallery.face_count(), 1);
  EXPECT_FALSE(view.state["flash"]);
  const cv::Rect strip = session.strip_box(0);
  EXPECT_GT(view.image.at<cv::Vec3b>(strip.y - 2, strip.x + 5)[2], 200);  // red: being collected
}

TEST_F(PeopleSessionTest, PassesStagesToAWatchingSink) {
  if (landmark_model() == nullptr || !std::filesystem::exists(kImage))
    GTEST_SKIP() << "needs models/landmarks68.json and the package opencv-doc";
  const cv::Mat image = read_image(kImage);
  face::people::Gallery gallery(path("p.db"));
  test_support::WatchedStages stages;
  PeopleSession session(opened(gallery, nullptr, shipped_reader()), {}, &stages);
  const cv::Mat plain = session.on_frame(frame(image, 0), live_).image.clone();
  EXPECT_TRUE(stages.names.empty());
  stages.watched = true;
  const View view = session.on_frame(frame(image, 1), live_);
  EXPECT_THAT(stages.names, ::testing::ElementsAre("found", "aligned", "illumination normalised",
                                                   "cut", "equalised", "smoothed", "masked"));
  EXPECT_TRUE(stages.are_images);
  EXPECT_EQ(view.image.size(), plain.size());
}

// "Not this person" holds from the next frame on, and is taken back by a key.
TEST_F(PeopleSessionTest, KeysCorrectANameAndUndoIt) {
  if (landmark_model() == nullptr || !std::filesystem::exists(kImage))
    GTEST_SKIP() << "needs models/landmarks68.json and the package opencv-doc";
  const cv::Mat image = read_image(kImage);
  face::people::Gallery gallery(path("p.db"));
  PeopleSessionOptions options;
  options.names = {"Leo <b>"};
  options.actor = "tester";
  options.collect.check_quality = false;
  PeopleSession session(opened(gallery, nullptr, shipped_reader()), options);
  View view = session.on_event(key_event('x'));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("no face is identified"));
  view = session.on_event(key_event('u'));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("no correction"));
  (void)session.on_frame(frame(image, 0), live_);
  (void)session.on_event(key_event('a'));
  (void)session.on_frame(frame(image, 1), live_);
  (void)session.on_event(key_event('t'));
  int at = 2;
  const auto label = [&] {
    view = session.on_frame(frame(image, at++), live_);
    const auto& seen = view.state["recognized"].at(0)["label"];
    return seen.is_null() ? std::string() : seen.get<std::string>();
  };
  for (int i = 0; i < 60 && label() != "Leo <b>"; ++i) {
  }
  ASSERT_EQ(label(), "Leo <b>");
  view = session.on_event(key_event('x'));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("Not Leo <b>"));
  EXPECT_EQ(label(), "");
  ASSERT_EQ(gallery.corrections().size(), 1U);
  EXPECT_EQ(gallery.corrections()[0].actor, "tester");
  (void)session.on_event(key_event('u'));
  EXPECT_EQ(label(), "Leo <b>");
  // Undone by another program, or forgotten: said.
  (void)session.on_event(key_event('x'));
  (void)gallery.undo(0, {});
  view = session.on_event(key_event('u'));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("undone already"));
}

// An unknown face shows the group of its sighting, or the one that it is like; a key names it.
TEST_F(PeopleSessionTest, GroupsUnknownFacesAndNamesThem) {
  if (landmark_model() == nullptr || !std::filesystem::exists(kImage))
    GTEST_SKIP() << "needs models/landmarks68.json and the package opencv-doc";
  const face::recognition::Background general =
      face::recognition::read_background(models_folder() + "/people-background.json");
  const cv::Mat image = read_image(kImage);
  face::people::Gallery gallery(path("p.db"));
  PeopleSessionOptions options;
  options.names = {"Leo"};
  PeopleSession session(opened(gallery, &general, shipped_reader()), options);
  View view = session.on_frame(frame(image, 0), live_);
  EXPECT_TRUE(view.state["recognized"].at(0)["group"].is_null());
  view = session.on_event(key_event('w'));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("no grouped unknown face"));
  // The host keeps who was seen.
  const face::people::Face& seen = session.faces().at(0).face;
  const face::people::SightingFace kept{seen.crop.clone(), seen.quality.score(), "{}"};
  session.on_sighting_stored(seen.id, gallery.add_sighting(1000, "camera", "", false, 0, &kept));
  view = session.on_frame(frame(image, 1), live_);
  EXPECT_EQ(view.state["unknown"]["waiting"], 1);
  EXPECT_THAT(view.image.cols, ::testing::Gt(image.cols));
  view = session.on_event(key_event('g'));
  EXPECT_EQ(view.state["panel"]["list"], "groups");
  for (int i = 2; i < 6; ++i) view = session.on_frame(frame(image, i), live_);
  EXPECT_EQ(view.state["unknown"]["waiting"], 0);
  EXPECT_EQ(view.state["unknown"]["groups"], 1);
  EXPECT_EQ(view.state["panel"]["rows"].size(), 1U);
  EXPECT_EQ(view.state["recognized"].at(0)["group"], 1);
  // Escape leaves the list, not the session. The next window knows of no sighting.
  view = session.on_event(key_event(key::kEscape));
  EXPECT_FALSE(view.finished);
  EXPECT_TRUE(view.state["panel"].is_null());
  PeopleSession other(opened(gallery, &general, shipped_reader()), options);
  EXPECT_EQ(other.on_frame(frame(image, 0), live_).state["recognized"].at(0)["group"], 1);
  // Named: enrolled, learned, known.
  view = other.on_event(key_event('w'));
  EXPECT_EQ(view.state["panel"]["typing"], "Leo");
  view = other.on_event(key_event(key::kEnter));
  EXPECT_THAT(view.state["message"].get<std::string>(), HasSubstr("Group 1 is Leo"));
  for (int i = 1; i < 60 && view.state["mode"] != "recognize"; ++i)
    view = other.on_frame(frame(image, i), live_);
  view = other.on_frame(frame(image, 60), live_);
  EXPECT_EQ(view.state["recognized"].at(0)["label"], "Leo");
  EXPECT_EQ(view.state["recognized"].at(0)["known"], true);
  EXPECT_TRUE(view.state["recognized"].at(0)["group"].is_null());
  EXPECT_EQ(view.state["people"].at(0)["name"], "Leo");
  // And taken back.
  view = other.on_event(key_event('u'));
  EXPECT_EQ(view.state["people"].size(), 0U);
  EXPECT_EQ(view.state["unknown"]["groups"], 1);
  view = other.on_frame(frame(image, 61), live_);
  EXPECT_EQ(view.state["mode"], "detect");
  EXPECT_EQ(view.state["recognized"].at(0)["group"], 1);
}

// Merged in the list meanwhile: there are fewer people than before.
TEST_F(PeopleSessionTest, KeepsTheCollectedPersonWhenOthersAreMerged) {
  face::people::Gallery gallery(path("p.db"));
  for (const char* name : {"Ann", "Ben", "Cid", "Dan"}) gallery.enroll(name, "", face(name[0]));
  PeopleSession session(opened(gallery), {});
  (void)session.on_frame(frame(empty_, 0), live_);
  View view = session.on_event(click(session.strip_box(2)));
  EXPECT_EQ(view.state["collecting"], "Cid");
  for (const char key : {'p', 'm'}) (void)session.on_event(key_event(key));
  (void)session.on_event(key_event(key::kDown));
  view = session.on_event(key_event('j'));
  EXPECT_EQ(view.state["people"].size(), 3U);
  EXPECT_EQ(view.state["collecting"], "Cid");
  EXPECT_EQ(view.state["mode"], "collect");
}

// Who was to be added is enrolled by another program: they are shown once.
TEST_F(PeopleSessionTest, ShowsAPersonEnrolledByAnotherProgramOnce) {
  face::people::Gallery gallery(path("p.db"));
  for (const char* name : {"Ann", "Ben"}) gallery.enroll(name, "", face(name[0]));
  PeopleSessionOptions options;
  options.names = {"Dan"};
  PeopleSession session(opened(gallery), options);
  (void)session.on_frame(frame(empty_, 0), live_);
  EXPECT_EQ(session.on_event(key_event('a')).state["people"].size(), 3U);
  gallery.enroll("Dan", "", face(9));
  for (const char key : {'p', 'm'}) (void)session.on_event(key_event(key));
  (void)session.on_event(key_event(key::kDown));
  EXPECT_EQ(session.on_event(key_event('j')).state["people"].size(), 2U);
}

// What is learned is learned a piece in each frame: none waits for all of it.
TEST_F(PeopleSessionTest, SpreadsTrainingOverFrames) {
  const auto set = face::recognition::synthetic_faces(20, 2, 0.3, 5, 0, {128, 160});
  face::people::Gallery gallery(path("p.db"));
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    face::people::StoredFace stored;
    stored.crop = set.faces[i];
    stored.measures = "{}";
    gallery.enroll(set.labels[i], "", stored);
  }
  PeopleSession session(opened(gallery), {});
  View view;
  int frames = 0;
  for (; frames < 100 && session.mode() != PeopleMode::kRecognize; ++frames)
    view = session.on_frame(frame(empty_, frames), live_);
  EXPECT_EQ(view.state["mode"], "recognize");
  EXPECT_GE(frames, 3);
  // Another one comes: the others are named all the while.
  gallery.enroll("Ann", "", face(7));
  (void)session.on_event(key_event('a'));
  (void)session.on_event(key_event('t'));
  for (int i = 0; i < 60; ++i) {
    view = session.on_frame(frame(empty_, 200 + i), live_);
    EXPECT_EQ(view.state["mode"], "recognize");
  }
  EXPECT_EQ(gallery.model_generation(), gallery.generation());
  EXPECT_EQ(view.state["people"].size(), 22U);  // Ann, and the one without faces yet
}

TEST_F(PeopleSessionTest, ForgetsPeopleDeletedByAnotherProgram) {
  const auto set = face::recognition::synthetic_faces(3, 3, 0.3, 5, 0, {128, 160});
  face::people::Gallery gallery(path("p.db"));
  for (std::size_t i = 0; i < set.faces.size(); ++i) {
    face::people::StoredFace stored;
    stored.crop = set.faces[i];
    stored.measures = "{}";
    gallery.enroll(set.labels[i], "", stored);
  }
  NoProgress quiet;
  face::people::GalleryFollower follower(
      gallery, nullptr,
      face::people::load_gallery_model(gallery, nullptr, true,
                                       face::people::TrainingPolicy::kIfNeeded, quiet, {}));
  RecognizeSession session(face::Identifier({}, true), face::IdentifierState(reader(), follower));
  const auto see = [&](std::size_t face) {
    Frame shown = frame({}, 0);
    cv::cvtColor(set.faces[face], shown.image, cv::COLOR_GRAY2BGR);
    (void)session.on_frame(shown, live_);
    return session.faces().at(0).identity;
  };
  EXPECT_EQ(see(0).label, "p0");
  EXPECT_TRUE(see(0).known);
  face::people::Gallery other(path("p.db"));
  ASSERT_TRUE(other.forget("p0", {}));
  EXPECT_NE(see(0).label, "p0");
  EXPECT_EQ(see(4).label, "p1");
  // Also while the source stalls and its last frame is shown.
  ASSERT_TRUE(other.forget("p1", {}));
  (void)session.on_idle(live_);
  EXPECT_EQ(session.faces().at(0).identity.label, "");
  ASSERT_TRUE(other.forget_all({}));
  EXPECT_EQ(see(8).label, "");
}

// Clips one after the other, each with its own part of the frames.
class ClipSource final : public FrameSource {
 public:
  void add(const std::string& path, int first, int last) {
    const auto source = open_source(path);
    while (!source->ended()) {
      auto next = source->next(std::chrono::milliseconds(1000), {});
      if (!next || next->index < first || next->index >= last) continue;
      next->image = next->image.clone();
      next->time += offset_;
      frames_.push_back(std::move(*next));
    }
    offset_ += 100;
  }
  [[nodiscard]] std::int64_t size() const { return static_cast<std::int64_t>(frames_.size()); }
  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token&) override {
    if (ended()) return std::nullopt;
    return frames_[at_++];
  }
  [[nodiscard]] bool ended() const override { return at_ >= frames_.size(); }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    return {SourceState::kLive, "", 0, 0, 0, 0};
  }
  [[nodiscard]] double fps() const override { return 25; }
  [[nodiscard]] std::int64_t count() const override { return size(); }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  std::vector<Frame> frames_;
  std::size_t at_ = 0;
  double offset_ = 0;
  std::vector<std::string> skipped_;
};

TEST_F(PeopleSessionTest, RecognizesEnrolledPeopleAndRejectsUnknownOnes) {
  TARSIER_LONG_TEST();
  const char* data = std::getenv("TARSIER_DATA");
  const std::string grid = std::string(data != nullptr ? data : "") + "/face-videos/grid/";
  if (landmark_model() == nullptr || !std::filesystem::exists(grid))
    GTEST_SKIP() << "needs $TARSIER_DATA/face-videos and the models that ship";
  const face::recognition::Background general =
      face::recognition::read_background(models_folder() + "/people-background.json");
  face::people::Gallery gallery(path("p.db"));
  PeopleSessionOptions options;
  options.names = {"Ann", "Ben"};
  PeopleSession session(opened(gallery, &general, shipped_reader()), options);
  ClipSource clips;
  std::vector<std::int64_t> from;  // each clip's first frame
  const auto add = [&](const std::string& name, int first, int last) {
    from.push_back(clips.size());
    clips.add(grid + name, first, last);
  };
  add("brbk7n.mpg", 0, 38);
  add("bbaf2n.mpg", 0, 38);
  add("brbk7n.mpg", 38, 75);
  add("bbaf2n.mpg", 38, 75);
  add("lrwp9a.mpg", 0, 45);
  add("lbbc2a.mpg", 0, 45);
  ScriptedHost host(session, clips);
  host.schedule(from[0] + 1, click(session.button_box("add")));
  host.schedule(from[1], action_event("add"));
  host.schedule(from[2], action_event("train"));
  for (const std::int64_t frame : from) host.keep_images(frame + 30);
  const auto& steps = host.run();
  EXPECT_EQ(gallery.people().size(), 2U);
  EXPECT_GE(gallery.face_count(), 4);
  const auto share = [&](std::size_t clip, const std::string& label, bool known) {
    const std::int64_t end = clip + 1 < from.size() ? from[clip + 1] : clips.size();
    double right = 0;
    for (const ScriptStep& step : steps) {
      if (step.cause != "frame" || step.frame < from[clip] || step.frame >= end) continue;
      const auto& seen = step.state["recognized"];
      if (seen.size() == 1 && seen[0]["known"] == known &&
          (label.empty() || seen[0]["label"] == label)) {
        ++right;
      }
    }
    return right / static_cast<double>(end - from[clip]);
  };
  EXPECT_GE(share(2, "Ann", true), 0.9);
  EXPECT_GE(share(3, "Ben", true), 0.9);
  EXPECT_GE(share(4, "", false), 0.95);
  EXPECT_GE(share(5, "", false), 0.95);
  if (const char* folder = std::getenv("PEOPLE_IMAGES")) {  // to look at
    for (const ScriptStep& step : steps)
      if (!step.image.empty())
        write_image(std::string(folder) + "/" + std::to_string(step.frame) + ".png", step.image);
  }
}

TEST_F(PeopleSessionTest, WithoutStatusDrawsNoBar) {
  face::people::Gallery gallery(path("p.db"));
  PeopleSession session(opened(gallery), {});
  session.draw_status(false);
  const View view =
      session.on_frame(frame(cv::Mat(480, 640, CV_8UC3, cv::Scalar(120, 130, 140)), 0), live_);
  EXPECT_EQ(view.image.rows, 480);
  test_support::expect_plain_image(session, live_);
}

}  // namespace
}  // namespace tarsier
