// SPDX-License-Identifier: MIT
#include "tarsier/face/people/gallery_index.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/people/testing_gallery.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::face::people {
namespace {

using recognition::CellIndex;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr int kPeople = 400;
constexpr int kImages = 3;
constexpr std::size_t kFaces = std::size_t{kPeople} * kImages;

std::int64_t space() { return -recognition::fingerprint(gallery_background()); }

// Random coordinates of a person; all crops are equal.
std::vector<float> random_coordinates(int person, int image) {
  Rng of_person(static_cast<std::uint64_t>(person) + 1);
  Rng of_image(static_cast<std::uint64_t>(1000 * person + image) + 77);
  std::vector<float> numbers;
  for (Eigen::Index i = 0; i < gallery_background().basis.rows(); ++i) {
    const double spread = std::sqrt(std::max(1e-12, gallery_background().variance(i)));
    numbers.push_back(static_cast<float>(spread * (of_person.normal() + 0.3 * of_image.normal())));
  }
  numbers.push_back(1e-3F);
  return numbers;
}

NewFace face_of(int person, int image) {
  NewFace out{"p" + std::to_string(person), "", {}};
  out.face.crop = cv::Mat(160, 128, CV_8UC1, cv::Scalar(100));
  out.face.crop.at<unsigned char>(person % 160, image) = static_cast<unsigned char>(person);
  out.face.measures = "{}";
  out.face.features = random_coordinates(person, image);
  out.face.space = space();
  return out;
}

class GalleryIndexTest : public FolderTest {
 protected:
  GalleryIndexTest() : gallery_(copy_to(path("p.db"))) {}

  // Enrolled and learned once for all tests.
  static std::string copy_to(const std::string& to) {
    static const TemporaryFolder folder;
    static const std::string original = [] {
      std::string file = folder / "p.db";
      Gallery gallery(file);
      std::vector<NewFace> faces;
      for (int person = 0; person < kPeople; ++person)
        for (int image = 0; image < kImages; ++image) faces.push_back(face_of(person, image));
      gallery.enroll(faces);
      NoProgress quiet;
      (void)load_gallery_model(gallery, &gallery_background(), true, TrainingPolicy::kIfNeeded,
                               quiet, {});
      return file;
    }();
    std::filesystem::copy_file(original, to);
    return to;
  }
  void learn() {
    (void)load_gallery_model(gallery_, &gallery_background(), true, TrainingPolicy::kIfNeeded,
                             progress_, {});
  }
  // As in a gallery so large that its model is learned from few faces.
  void learned_from_few() {
    const auto model = gallery_.model();
    std::vector<std::int64_t> few{gallery_.face_refs().front().id};
    (void)gallery_.store_model(model->body, gallery_.generation(), space(), few, {});
  }
  GalleryIndexReport build(const recognition::CellIndexOptions& options = {}) {
    return build_gallery_index(gallery_, gallery_background(), options, progress_, {});
  }
  GalleryFollower follower(SearchMode search_mode = SearchMode::kIndexed) {
    return GalleryFollower(
        gallery_, &gallery_background(),
        load_gallery_model(gallery_, &gallery_background(), true, TrainingPolicy::kIfNeeded,
                           progress_, {}, search_mode),
        search_mode);
  }
  std::vector<float> probe(const recognition::Recognizer& model, int person, int image = kImages) {
    const std::vector<float> numbers = random_coordinates(person, image);
    const recognition::Rows row = recognition::templates_of_coordinates(
        model, gallery_background(),
        Eigen::Map<const recognition::Rows>(numbers.data(), 1,
                                            static_cast<Eigen::Index>(numbers.size())));
    return {row.data(), row.data() + row.size()};
  }
  std::set<std::int64_t> ids_in_index() {
    std::set<std::int64_t> ids;
    CellIndex(index_path(gallery_))
        .each_cell(
            [&](std::span<const std::int64_t> cell) { ids.insert(cell.begin(), cell.end()); },
            progress_, {});
    return ids;
  }
  std::vector<std::int64_t> faces_of(const std::string& name) {
    std::vector<std::int64_t> out;
    for (const StoredFace& face : gallery_.faces(gallery_.find(name)->id, false))
      out.push_back(face.id);
    return out;
  }
  // A person whose faces the index was not learned from.
  std::string person_outside_training() {
    const CellIndex index(index_path(gallery_));
    const auto& learned = index.learned_from();
    for (int person = 7; person < kPeople; ++person) {
      const std::string name = "p" + std::to_string(person);
      const auto faces = faces_of(name);
      if (std::none_of(faces.begin(), faces.end(), [&](std::int64_t id) {
            return std::binary_search(learned.begin(), learned.end(), id);
          }))
        return name;
    }
    return {};
  }
  Gallery gallery_;
  NoProgress progress_;
};

TEST_F(GalleryIndexTest, GivesTheResultOfAnExhaustiveSearch) {
  EXPECT_FALSE(gallery_index_state(gallery_).exists);
  const auto report = build();
  EXPECT_EQ(report.faces, static_cast<std::int64_t>(kFaces));
  EXPECT_EQ(files(), 2U + 2U) << "the database with its two files, the index";
  EXPECT_TRUE(gallery_index_state(gallery_).current);
  EXPECT_EQ(gallery_index_state(gallery_).newer, 0);
  GalleryFollower exact = follower(SearchMode::kExhaustive);
  GalleryFollower indexed = follower();
  ASSERT_EQ(exact.index(), nullptr);
  ASSERT_NE(indexed.index(), nullptr);
  EXPECT_EQ(indexed.recognizer()->templates.rows(), 0);
  int known = 0;
  for (int person = 0; person < kPeople; ++person) {
    const auto features = probe(*exact.recognizer(), person);
    const Recognition a = exact.recognize(features, 0.01);
    const Recognition b = indexed.recognize(features, 0.01);
    EXPECT_EQ(a.label, "p" + std::to_string(person));
    ASSERT_EQ(a.label, b.label);
    EXPECT_EQ(a.score, b.score) << "to the last bit";
    EXPECT_EQ(a.threshold, b.threshold);
    EXPECT_EQ(a.confidence, b.confidence);
    known += a.known ? 1 : 0;
    EXPECT_EQ(a.known, b.known);
  }
  EXPECT_GT(known, kPeople / 2);
}

TEST_F(GalleryIndexTest, FindsFacesEnrolledAfterTheBuild) {
  build();
  GalleryFollower running = follower();
  gallery_.enroll(std::vector<NewFace>{face_of(5000, 0), face_of(5000, 1)});
  EXPECT_EQ(running.update(), GalleryFollower::Change::kFaces);
  EXPECT_EQ(running.index()->newer(), 2);
  EXPECT_EQ(gallery_index_state(gallery_).newer, 2);
  const auto features = probe(*running.recognizer(), 5000);
  const Recognition seen = running.recognize(features, 0.01);
  EXPECT_EQ(seen.label, "p5000");
  EXPECT_EQ(seen.score, follower(SearchMode::kExhaustive).recognize(features, 0.01).score);
  EXPECT_TRUE(running.is_enrolled("p5000"));
  EXPECT_EQ(follower().index()->newer(), 2);
  // A face that has no template yet.
  NewFace bare = face_of(6000, 0);
  bare.face.features.clear();
  bare.face.space = 0;
  bare.face.crop = recognition::synthetic_faces(1, 1, 0.3, 5, 3, {128, 160}).faces[0];
  gallery_.enroll(std::vector<NewFace>{bare});
  EXPECT_EQ(follower().index()->newer(), 3);
}

TEST_F(GalleryIndexTest, ForgettingRemovesThePersonFromTheIndex) {
  learned_from_few();
  build({.learn_from = 1});
  const std::string name = person_outside_training();
  ASSERT_FALSE(name.empty());
  const auto gone = faces_of(name);
  const int number = std::stoi(name.substr(1));
  GalleryFollower running = follower();
  const auto features = probe(*running.recognizer(), number);
  ASSERT_EQ(running.recognize(features, 0.01).label, name);
  // The bytes of the person's entries, as in an index of this person alone.
  const std::size_t before = contents(index_path(gallery_)).size();
  const auto report = gallery_.forget(name, {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->index, IndexOutcome::kRewritten);
  EXPECT_FALSE(report->model_removed);
  const auto ids = ids_in_index();
  EXPECT_THAT(ids, SizeIs(kFaces - kImages));
  for (const std::int64_t id : gone) EXPECT_FALSE(ids.contains(id));
  const std::string bytes = contents(index_path(gallery_));
  EXPECT_EQ(before - bytes.size(), kImages * (8 + 4 + 64));
  EXPECT_EQ(files(), 4U);
  EXPECT_TRUE(gallery_index_state(gallery_).current);
  EXPECT_EQ(running.update(), GalleryFollower::Change::kModel) << "the index is another";
  EXPECT_NE(running.index(), nullptr);
  EXPECT_NE(running.recognize(features, 0.01).label, name);
  EXPECT_FALSE(running.is_enrolled(name));
}

TEST_F(GalleryIndexTest, ForgettingATrainingPersonDeletesTheIndex) {
  learned_from_few();
  build({.learn_from = 1000});  // from all people
  const auto report = gallery_.forget("p7", {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->index, IndexOutcome::kDeleted);
  EXPECT_FALSE(std::filesystem::exists(index_path(gallery_)));
  EXPECT_EQ(gallery_.index_record(), "");
  GalleryFollower running = follower();
  EXPECT_EQ(running.index(), nullptr);
  EXPECT_EQ(running.recognize(probe(*running.recognizer(), 8), 0.01).label, "p8");
  // The same if the model is removed.
  build({.learn_from = 1});
  const CellIndex open(index_path(gallery_));
  EXPECT_TRUE(gallery_.forget("p0", {})->model_removed);
  EXPECT_FALSE(std::filesystem::exists(index_path(gallery_)));
  // The index's bytes are overwritten, so a program that still has the file open reads zeros.
  EXPECT_THROW(open.each_cell([](std::span<const std::int64_t>) {}, progress_, {}), InputError);
  learn();
  build();
  ASSERT_TRUE(gallery_.forget_all({}));
  EXPECT_FALSE(std::filesystem::exists(index_path(gallery_)));
}

TEST_F(GalleryIndexTest, FollowerContinuesWithoutTheIndex) {
  build();
  GalleryFollower running = follower();
  const auto features = probe(*running.recognizer(), 11);
  ASSERT_TRUE(gallery_.forget("p7", {}));  // the model was learned from all people
  learn();
  EXPECT_EQ(running.update(), GalleryFollower::Change::kModel);
  EXPECT_EQ(running.index(), nullptr);
  EXPECT_EQ(running.recognize(probe(*running.recognizer(), 11), 0.01).label, "p11");
  // And uses the next index as soon as it exists.
  build();
  EXPECT_EQ(running.update(), GalleryFollower::Change::kModel);
  EXPECT_NE(running.index(), nullptr);
  EXPECT_EQ(running.recognize(probe(*running.recognizer(), 11), 0.01).label, "p11");
}

TEST_F(GalleryIndexTest, CorrectionsTakeEffectAtOnce) {
  build();
  GalleryFollower running = follower();
  const auto features = probe(*running.recognizer(), 21);
  ASSERT_EQ(running.recognize(features, 0.01).label, "p21");
  (void)gallery_.merge_people("p21", "p22", {1, "me"});
  (void)running.update();
  EXPECT_EQ(running.recognize(features, 0.01).label, "p22");
  GalleryFollower exact = follower(SearchMode::kExhaustive);
  EXPECT_EQ(running.recognize(features, 0.01).score, exact.recognize(features, 0.01).score);
  EXPECT_EQ(running.recognize(features, 0.01).threshold, exact.recognize(features, 0.01).threshold);
}

// A face that was restored is newer than the index.
TEST_F(GalleryIndexTest, FindsARestoredFace) {
  build();
  for (const std::int64_t face : faces_of("p21")) (void)gallery_.not_this_face(face, {1, "me"});
  ASSERT_EQ(faces_of("p21").size(), 0U);
  for (int i = 0; i < kImages; ++i) (void)gallery_.undo(0, {1, "me"});
  const std::vector<std::int64_t> faces = faces_of("p21");
  ASSERT_THAT(faces, SizeIs(kImages));
  std::vector<std::pair<std::int64_t, std::vector<float>>> templates;
  for (const std::int64_t face : faces) {
    EXPECT_GT(face, static_cast<std::int64_t>(kFaces));
    templates.emplace_back(face, random_coordinates(21, 0));
  }
  gallery_.store_templates(space(), templates);
  EXPECT_EQ(gallery_index_state(gallery_).newer, kImages);
  GalleryFollower running = follower();
  ASSERT_NE(running.index(), nullptr);
  EXPECT_EQ(running.recognize(probe(*running.recognizer(), 21, 0), 0.01).label, "p21");
  // The model was learned from these faces, under their old ids.
  EXPECT_TRUE(gallery_.forget("p21", {})->model_removed);
}

TEST_F(GalleryIndexTest, IgnoresInvalidAndForeignFiles) {
  build();
  const std::string file = index_path(gallery_);
  const std::string whole = contents(file);
  const auto put = [&](const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
  };
  const auto unused = [&](const char* why) {
    EXPECT_THAT(gallery_index_state(gallery_).unused_reason, HasSubstr(why));
    GalleryFollower exact = follower();
    EXPECT_EQ(exact.index(), nullptr);
    EXPECT_EQ(exact.recognize(probe(*exact.recognizer(), 3), 0.01).label, "p3");
  };
  put(whole.substr(0, whole.size() / 2));
  unused("is cut off");
  put("");
  unused("is not an index");
  put("SQLite format 3" + whole);
  unused("is not an index");
  std::string flipped = whole;
  flipped[200] = static_cast<char>(flipped[200] ^ 1);
  put(flipped);
  unused("its SHA-256 is another");
  // A valid index that this gallery did not write.
  {
    Gallery other(copy_to(path("q.db")));
    other.enroll(std::vector<NewFace>{face_of(700, 0)});
    (void)build_gallery_index(other, gallery_background(), {}, progress_, {});
    put(contents(index_path(other)));
  }
  unused("is of another state of the gallery");
  // Damaged bytes in cells are noticed when a cell is read. Then all faces are compared.
  put(whole);
  GalleryFollower running = follower();
  ASSERT_NE(running.index(), nullptr);
  flipped = whole;
  for (std::size_t i = whole.size() - kFaces * 64; i < whole.size(); i += 50)
    flipped[i] = static_cast<char>(flipped[i] ^ 4);
  put(flipped);
  EXPECT_EQ(running.recognize(probe(*running.recognizer(), 3), 0.01).label, "p3");
  EXPECT_EQ(running.index(), nullptr);
  EXPECT_EQ(running.recognizer()->templates.rows(), static_cast<Eigen::Index>(kFaces));
  // Templates that were computed again.
  put(whole);
  (void)load_gallery_model(gallery_, &gallery_background(), true, TrainingPolicy::kAlways,
                           progress_, {});
  unused("is of templates that were made again");
}

TEST_F(GalleryIndexTest, ForgettingDuringTheBuildRestartsIt) {
  learned_from_few();
  Gallery other(path("p.db"));
  struct Forgets final : Progress {
    std::function<void()> once;
    void begin(std::string_view stage, std::int64_t, std::string_view) override {
      if (stage == "writing" && once) std::exchange(once, {})();
    }
    void advance(std::int64_t) override {}
    void end() override {}
  } progress;
  const auto gone = faces_of("p9");
  progress.once = [&] { ASSERT_TRUE(other.forget("p9", {})); };
  (void)build_gallery_index(gallery_, gallery_background(), {}, progress, {});
  const auto ids = ids_in_index();
  EXPECT_THAT(ids, SizeIs(kFaces - kImages));
  for (const std::int64_t id : gone) EXPECT_FALSE(ids.contains(id));
  EXPECT_TRUE(gallery_index_state(gallery_).current);
}

TEST_F(GalleryIndexTest, KillLeavesTheOldOrTheNewIndex) {
  build({.rounds = 1});
  const std::string old = CellIndex(index_path(gallery_)).sha256();
  int before = 0;
  int after = 0;
  for (int moment = 0; moment < 12; ++moment) {
    const pid_t child = ::fork();
    if (child == 0) {
      try {
        NoProgress progress;
        Gallery own(path("p.db"));
        for (int rounds = 2;; ++rounds)
          (void)build_gallery_index(own, gallery_background(), {.rounds = 1 + rounds % 5}, progress,
                                    {});
      } catch (...) {
      }
      ::_exit(1);
    }
    ::usleep(static_cast<useconds_t>(20'000 + 37'000 * moment));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    const GalleryIndexState state = gallery_index_state(gallery_);
    ASSERT_TRUE(state.current) << moment << ": " << state.unused_reason;
    EXPECT_EQ(state.faces, static_cast<std::int64_t>(kFaces));
    EXPECT_THAT(ids_in_index(), SizeIs(kFaces));
    (CellIndex(index_path(gallery_)).sha256() == old ? before : after) += 1;
  }
  EXPECT_GT(after, 0) << "no kill came after the first one was made";
  EXPECT_EQ(gallery_.face_count(), static_cast<std::int64_t>(kFaces));
  build();
  EXPECT_EQ(files(), 4U) << "what a kill left is gone";
}

TEST_F(GalleryIndexTest, CanBeInterrupted) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(
      (void)build_gallery_index(gallery_, gallery_background(), {}, progress_, stop.get_token()),
      Interrupted);
  EXPECT_FALSE(gallery_index_state(gallery_).exists);
  EXPECT_EQ(files(), 3U);
}

TEST_F(GalleryIndexTest, RejectsSmallGalleries) {
  Gallery small(path("s.db"));
  NewFace one{"a", "", {}};
  one.face.crop = recognition::synthetic_faces(1, 1, 0.3, 5, 3, {128, 160}).faces[0];
  one.face.measures = "{}";
  small.enroll(std::vector<NewFace>{one});
  EXPECT_THROW((void)build_gallery_index(small, gallery_background(), {}, progress_, {}),
               InputError);
}

}  // namespace
}  // namespace tarsier::face::people
