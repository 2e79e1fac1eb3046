// SPDX-License-Identifier: MIT
#include "tarsier/face/people/gallery.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/people/export.h"
#include "tarsier/face/people/name.h"
#include "tarsier/face/people/testing_gallery.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <sys/wait.h>
#include <unistd.h>

namespace tarsier::face::people {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

StoredFace stored_face(int seed) {
  StoredFace out;
  out.crop.create(160, 128, CV_8UC1);
  cv::RNG rng(static_cast<std::uint64_t>(seed) + 17);
  rng.fill(out.crop, cv::RNG::UNIFORM, 0, 256);
  out.quality = 0.5;
  out.measures = "{}";
  out.source = "test.png";
  out.time = 1000 + seed;
  return out;
}

using GalleryTest = FolderTest;

TEST_F(GalleryTest, StoresPeopleWithAnyNames) {
  const std::vector<std::string> names = {"O'Brien \"Bob\"", "../../etc/passwd", "%s\\",
                                          "日本 名前", std::string(200, 'x')};
  {
    Gallery gallery(path("p.db"));
    for (std::size_t i = 0; i < names.size(); ++i)
      gallery.enroll(names[i], "agreed", stored_face(static_cast<int>(i)));
  }
  Gallery gallery(path("p.db"), DatabaseAccess::kRead);
  const std::vector<Person> people = gallery.people();
  ASSERT_EQ(people.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(people[i].name, names[i]);
    EXPECT_EQ(people[i].note, "agreed");
    EXPECT_EQ(people[i].faces, 1);
    const auto faces = gallery.faces(people[i].id);
    ASSERT_THAT(faces, SizeIs(1));
    EXPECT_EQ(cv::norm(faces[0].crop, stored_face(static_cast<int>(i)).crop, cv::NORM_INF), 0);
  }
  EXPECT_FALSE(gallery.find("nobody"));
  namespace fs = std::filesystem;
  EXPECT_EQ(fs::status(path("p.db")).permissions() & fs::perms::all,
            fs::perms::owner_read | fs::perms::owner_write);
}

TEST_F(GalleryTest, RejectsInvalidNames) {
  Gallery gallery(path("p.db"));
  for (const std::string& name : {std::string(), std::string(201, 'x'), std::string(10'000, 'x'),
                                  std::string("a\nb"), std::string("\xff\xfe"), std::string(" x"),
                                  std::string("a\xC0\xAF"), std::string("\xED\xA0\x80")}) {
    EXPECT_THROW(gallery.enroll(name, "", stored_face(1)), UsageError);
  }
  EXPECT_THAT(message_of([] { check_name(std::string(10'000, 'x')); }), HasSubstr("10000 bytes"));
  EXPECT_THAT(gallery.people(), IsEmpty());
}

TEST_F(GalleryTest, AddsFacesAndNotesToAnEnrolledPerson) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  const auto before = gallery.generation();
  gallery.enroll("Ann", "agreed on Monday", stored_face(2));
  gallery.enroll("Ann", "", stored_face(3));
  EXPECT_NE(gallery.generation(), before);
  ASSERT_THAT(gallery.people(), SizeIs(1));
  EXPECT_EQ(gallery.people()[0].faces, 3);
  EXPECT_EQ(gallery.people()[0].note, "agreed on Monday");
  EXPECT_EQ(cv::norm(gallery.latest_face(1)->crop, stored_face(3).crop, cv::NORM_INF), 0);
}

// The raw bytes are in the files before, and in no file afterwards.
TEST_F(GalleryTest, ForgettingLeavesNoPiece) {
  Gallery gallery(path("p.db"));
  Pieces pieces;
  for (int i = 0; i < 6; ++i) {
    const StoredFace stored = stored_face(i);
    gallery.enroll(i < 4 ? "Ann" : "Ben", "", stored);
    const std::vector<std::uint8_t> png = encode_image(".png", stored.crop, "x");
    if (i < 4) pieces.add(std::span<const std::uint8_t>(png).subspan(43));
  }
  std::vector<std::pair<std::int64_t, std::vector<float>>> templates;
  cv::RNG rng(3);
  for (const StoredFace& stored : gallery.faces()) {
    std::vector<float> values(256);
    for (float& value : values) value = rng.uniform(-1.0F, 1.0F);
    if (stored.person == 1) {
      pieces.add({reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * 4});
    }
    templates.emplace_back(stored.id, values);
  }
  std::vector<std::int64_t> learned;
  for (const auto& [id, values] : templates) learned.push_back(id);
  ASSERT_TRUE(gallery.store_model("subspace", gallery.generation(), 0, learned, templates));
  gallery.add_sighting(5, "camera", "Ann", true, 0.9);
  gallery.add_sighting(6, "camera", "Ben", true, 0.9);
  EXPECT_FALSE(search_below(pieces, folder_, {}).files_with_pieces.empty());

  const auto report = gallery.forget("Ann", {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven());
  EXPECT_EQ(report->person.faces, 4);
  EXPECT_EQ(report->sightings, 1);
  EXPECT_GT(report->total_pieces, 10'000);
  EXPECT_EQ(report->searched_pieces, report->total_pieces);
  EXPECT_TRUE(report->model_removed);
  EXPECT_GT(report->search.bytes, 10'000);
  const SearchReport again = search_below(pieces, folder_, {});
  EXPECT_THAT(again.files_with_pieces, IsEmpty());
  EXPECT_GE(again.files.size(), 1U);
  EXPECT_FALSE(gallery.model());
  EXPECT_THAT(gallery.sightings(), SizeIs(1));
  EXPECT_THAT(gallery.faces(), SizeIs(2));
  EXPECT_FALSE(gallery.forget("Ann", {}));
}

TEST_F(GalleryTest, ReportsCopiesInTheFolder) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  export_gallery(gallery, path("out"), [](std::int64_t) { return "t"; }, {});
  std::filesystem::copy_file(path("out/person-1/face-1.png"), path("copy.png"));
  const auto report = gallery.forget("Ann", {});
  EXPECT_FALSE(report->proven());
  EXPECT_THAT(report->search.files_with_pieces,
              testing::ElementsAre(path("copy.png"), path("out/person-1/face-1.png")));
}

// An export in a subfolder, as `people export -o all` makes it beside the gallery.
TEST_F(GalleryTest, ReportsCopiesInSubfolders) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  gallery.enroll("Ben", "", stored_face(2));
  export_gallery(gallery, path("all"), [](std::int64_t) { return "t"; }, {});
  const auto report = gallery.forget("Ann", {});
  EXPECT_FALSE(report->proven());
  EXPECT_THAT(report->search.files_with_pieces,
              testing::ElementsAre(path("all/person-1/face-1.png")));
  std::filesystem::remove(path("all/person-1/face-1.png"));
  EXPECT_TRUE(gallery.forget("Ben", {})->search.files_with_pieces.size() == 1);
}

// The folder of the file itself is searched, not that of a link to it.
TEST_F(GalleryTest, FollowsALinkToItsFile) {
  namespace fs = std::filesystem;
  fs::create_directory(path("real"));
  fs::create_directory(path("link"));
  fs::create_symlink("../real/p.db", path("link/people.db"));
  {
    Gallery gallery(path("link/people.db"));
    EXPECT_TRUE(fs::equivalent(gallery.path(), path("real/p.db")));
    gallery.enroll("Ann", "", stored_face(1));
    gallery.enroll("Ben", "", stored_face(2));
  }
  fs::copy_file(path("real/p.db"), path("real/backup.db"));
  Gallery gallery(path("link/people.db"));
  const auto report = gallery.forget("Ann", {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->gallery_searched);
  EXPECT_FALSE(report->proven());
  ASSERT_THAT(report->search.files_with_pieces, SizeIs(1));
  EXPECT_TRUE(fs::equivalent(report->search.files_with_pieces[0], path("real/backup.db")));
  fs::remove(path("real/backup.db"));
  EXPECT_TRUE(gallery.forget("Ben", {})->proven());
}

// A proof needs that the gallery's own file was searched.
TEST_F(GalleryTest, AMovedGalleryProvesNothing) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  const auto folder = std::filesystem::path(folder_).string() + "-moved.db";
  std::filesystem::rename(path("p.db"), folder);
  const auto report = gallery.forget("Ann", {});
  std::filesystem::remove(folder);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->gallery_searched);
  EXPECT_FALSE(report->proven());
}

// One image under two names. The other person's bytes stay, so nothing is reported as proven.
TEST_F(GalleryTest, SharedImagesMakeDeletionUnproven) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  gallery.enroll("Same", "", stored_face(1));
  const auto report = gallery.forget("Same", {});
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->proven());
  EXPECT_EQ(report->searched_pieces, 0);
  EXPECT_GT(report->shared_pieces, 1000);
  EXPECT_EQ(report->unproven_records, 1);
  EXPECT_THAT(report->shared_with, testing::ElementsAre("Ann"));
  EXPECT_THAT(report->search.files_with_pieces, IsEmpty());
  // If the person also has other images, the number of unproven faces is reported.
  gallery.enroll("Same", "", stored_face(1));
  gallery.enroll("Same", "", stored_face(2));
  const auto partly = gallery.forget("Same", {});
  EXPECT_FALSE(partly->proven());
  EXPECT_EQ(partly->unproven_records, 1);
  EXPECT_GT(partly->searched_pieces, 1000);
  EXPECT_TRUE(gallery.forget("Ann", {})->proven());
}

// A program that enrols, learns and forgets is killed at many moments. Everything that it reported
// as done is done, and the file is intact.
TEST_F(GalleryTest, KillLeavesAConsistentGallery) {
  std::int64_t enrolled = 0;
  for (int round = 0; round < 12; ++round) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(ends[0]);
      try {
        Gallery gallery(path("p.db"));
        for (int i = 0;; ++i) {
          const std::string name = "p" + std::to_string(round) + "." + std::to_string(i % 3);
          const std::int64_t id = gallery.enroll(name, "", stored_face(100 * round + i));
          if (write(ends[1], "e", 1) != 1) _exit(1);
          const std::pair<std::int64_t, std::vector<float>> numbers{id, {1.0F, 2.0F}};
          (void)gallery.store_model("body", gallery.generation(), 0, {{id}}, {{numbers}});
          if (i % 4 == 3) {
            if (!gallery.forget("p" + std::to_string(round) + ".0", {})) _exit(1);
            if (write(ends[1], "f", 1) != 1) _exit(1);
          }
        }
      } catch (...) {
        _exit(1);
      }
    }
    close(ends[1]);
    char done = 0;
    std::string seen;
    while (static_cast<int>(seen.size()) < 1 + round && read(ends[0], &done, 1) == 1) seen += done;
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "the child ended by itself";
    while (read(ends[0], &done, 1) == 1) seen += done;
    close(ends[0]);
    Gallery gallery(path("p.db"));
    {
      const DatabaseKind kind{"", 0x54504731, {"", "", "", ""}};
      Database database(path("p.db"), kind, DatabaseAccess::kRead);
      Statement check(database, "PRAGMA integrity_check");
      ASSERT_TRUE(check.step());
      EXPECT_EQ(check.text(0), "ok") << "round " << round;
      Statement lost(database,
                     "SELECT (SELECT count(*) FROM template WHERE face NOT IN (SELECT id FROM "
                     "face)) + (SELECT count(*) FROM learned_face WHERE face NOT IN (SELECT id "
                     "FROM face)) + (SELECT count(*) FROM face WHERE person NOT IN (SELECT id FROM "
                     "person))");
      ASSERT_TRUE(lost.step());
      EXPECT_EQ(lost.integer(0), 0) << "round " << round;
    }
    // Some reported faces of this round may be gone: those of the forgotten person.
    const std::int64_t reported = std::count(seen.begin(), seen.end(), 'e');
    std::int64_t there = 0;
    for (const Person& person : gallery.people())
      if (person.name.starts_with("p" + std::to_string(round) + ".")) there += person.faces;
    EXPECT_GE(there, reported / 2) << "round " << round;
    EXPECT_GE(gallery.face_count(), enrolled + there);
    enrolled = gallery.face_count();
  }
}

TEST_F(GalleryTest, ForgetsAllPeople) {
  Gallery gallery(path("p.db"));
  EXPECT_FALSE(gallery.forget_all({}));
  for (int i = 0; i < 6; ++i) gallery.enroll("p" + std::to_string(i / 2), "", stored_face(i));
  gallery.add_sighting(5, "camera", "p1", true, 0.9);
  const auto report = gallery.forget_all({});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven());
  EXPECT_EQ(report->people, 3);
  EXPECT_EQ(report->person.faces, 6);
  EXPECT_EQ(report->sightings, 1);
  EXPECT_THAT(gallery.people(), IsEmpty());
  EXPECT_EQ(gallery.face_count(), 0);
}

TEST_F(GalleryTest, EnrollingKeepsTheModel) {
  Gallery gallery(path("p.db"));
  const auto id = gallery.enroll("Ann", "", stored_face(1));
  const std::pair<std::int64_t, std::vector<float>> numbers{id, {1.0F, 2.0F}};
  const auto model = gallery.store_model("subspace", gallery.generation(), 0, {{id}}, {{numbers}});
  ASSERT_TRUE(model);
  EXPECT_EQ(gallery.model()->body, "subspace");
  EXPECT_EQ(gallery.model()->generation, gallery.generation());
  StoredFace second = stored_face(2);
  second.features = {3.0F, 4.0F};
  second.space = *model;
  const auto other = gallery.enroll("Ben", "", second);
  gallery.enroll("Ben", "", stored_face(3));
  EXPECT_EQ(gallery.model()->body, "subspace");
  EXPECT_NE(gallery.model()->generation, gallery.generation());
  EXPECT_THAT(gallery.faces()[0].features, testing::ElementsAre(1.0F, 2.0F));
  EXPECT_THAT(gallery.template_of(other, *model), testing::ElementsAre(3.0F, 4.0F));
  EXPECT_THAT(gallery.without_template(*model), testing::ElementsAre(3));
  // Forgetting a person whom nothing was learned from keeps the model.
  EXPECT_FALSE(gallery.forget("Ben", {})->model_removed);
  EXPECT_TRUE(gallery.model());
  EXPECT_TRUE(gallery.forget("Ann", {})->model_removed);
  EXPECT_FALSE(gallery.model());
}

// After a face was forgotten, nothing that was learned from it is stored.
TEST_F(GalleryTest, RejectsAModelOfRemovedFaces) {
  Gallery gallery(path("p.db"));
  const auto id = gallery.enroll("Ann", "", stored_face(1));
  gallery.enroll("Ben", "", stored_face(2));
  const auto generation = gallery.generation();
  ASSERT_TRUE(gallery.forget("Ann", {}));
  EXPECT_FALSE(gallery.store_model("late", generation, 0, {{id}}, {}));
  EXPECT_FALSE(gallery.model());
}

// The statements of an enrolment and of one person's faces read no other row. The test checks
// SQLite's query plan, since times depend on the machine.
TEST_F(GalleryTest, QueriesUseTheirIndices) {
  { const Gallery gallery(path("p.db")); }
  const DatabaseKind kind{"", 0x54504731, {"", "", "", ""}};
  Database database(path("p.db"), kind, DatabaseAccess::kRead);
  for (const char* query :
       {"SELECT id FROM face LEFT JOIN template ON template.face = face.id WHERE person = 1 "
        "ORDER BY id",
        "SELECT face FROM template WHERE space > 0", "SELECT name FROM person WHERE name = 'x'",
        "SELECT id FROM sighting WHERE time < 5 ORDER BY time LIMIT 500",
        "SELECT DISTINCT person FROM face WHERE id IN (1,2)",
        "SELECT person, face, numbers FROM face INDEXED BY face_by_person CROSS JOIN template ON "
        "template.face = face.id WHERE person IN (1,2) AND +space = -5",
        "SELECT face, numbers FROM template NOT INDEXED WHERE face > 3 AND face <= 9 AND space = "
        "-5 ORDER BY face LIMIT 7"}) {
    Statement plan(database, std::string("EXPLAIN QUERY PLAN ") + query);
    while (plan.step()) {
      EXPECT_THAT(plan.text(3), testing::Not(testing::StartsWith("SCAN"))) << query;
    }
  }
}

// A gallery with the first version of the layout.
TEST_F(GalleryTest, UpgradesAnOlderVersion) {
  std::int64_t face_id = 0;
  const StoredFace stored = stored_face(1);
  {
    const DatabaseKind first{"", 0x54504731, {R"sql(
CREATE TABLE person(id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL UNIQUE,
  note TEXT NOT NULL, time INTEGER NOT NULL) STRICT;
CREATE TABLE face(id INTEGER PRIMARY KEY AUTOINCREMENT,
  person INTEGER NOT NULL REFERENCES person(id) ON DELETE CASCADE, crop BLOB NOT NULL,
  template BLOB, quality REAL NOT NULL, measures TEXT NOT NULL, source TEXT NOT NULL,
  time INTEGER NOT NULL) STRICT;
CREATE INDEX face_by_person ON face(person);
CREATE TABLE model(id INTEGER PRIMARY KEY CHECK(id = 1), generation INTEGER NOT NULL,
  body BLOB NOT NULL) STRICT;
CREATE TABLE setting(name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE sighting(id INTEGER PRIMARY KEY AUTOINCREMENT, time INTEGER NOT NULL,
  source TEXT NOT NULL, person INTEGER NOT NULL REFERENCES person(id) ON DELETE CASCADE,
  known INTEGER NOT NULL, confidence REAL NOT NULL) STRICT;
CREATE INDEX sighting_by_time ON sighting(time);
CREATE INDEX sighting_by_person ON sighting(person);
INSERT INTO person(name, note, time) VALUES('Ann', 'agreed', 5);
INSERT INTO setting VALUES('generation', '7');
INSERT INTO sighting(id, time, source, person, known, confidence) VALUES(9, 5, 'cam', 1, 1, 0.5);
INSERT INTO model VALUES(1, 7, x'78');
)sql"}};
    Database old(path("p.db"), first, DatabaseAccess::kCreate);
    const std::vector<std::uint8_t> png = encode_image(".png", stored.crop, "x");
    const std::vector<float> numbers{1.0F, 2.0F};
    Statement insert(old,
                     "INSERT INTO face(person, crop, template, quality, measures, source, time) "
                     "VALUES(1, ?, ?, 0.5, '{}', 'a.png', 6)");
    insert.bind(1, std::span<const std::uint8_t>(png))
        .bind(2, std::span(reinterpret_cast<const std::uint8_t*>(numbers.data()), 8));
    (void)insert.step();
    face_id = old.last_row_id();
  }
  EXPECT_THAT(message_of([&] { Gallery(path("p.db"), DatabaseAccess::kRead); }),
              HasSubstr("older version"));
  Gallery gallery(path("p.db"));
  ASSERT_THAT(gallery.people(), SizeIs(1));
  const auto faces = gallery.faces();
  ASSERT_THAT(faces, SizeIs(1));
  EXPECT_EQ(faces[0].id, face_id);
  EXPECT_EQ(cv::norm(faces[0].crop, stored.crop, cv::NORM_INF), 0);
  EXPECT_THAT(faces[0].features, testing::ElementsAre(1.0F, 2.0F));
  ASSERT_TRUE(gallery.model());
  EXPECT_EQ(gallery.model()->body, "x");
  EXPECT_EQ(gallery.model()->generation, gallery.generation());
  EXPECT_EQ(faces[0].space, gallery.model()->id);
  ASSERT_THAT(gallery.sightings(), SizeIs(1));
  EXPECT_EQ(gallery.sightings()[0].name, "Ann");
  EXPECT_FALSE(gallery.sightings()[0].has_face);
  // Numbers continue, and a sighting may be of an unknown person.
  EXPECT_EQ(gallery.add_sighting(6, "cam", "", false, 0), 10);
  EXPECT_TRUE(gallery.forget("Ann", {})->model_removed);
  EXPECT_FALSE(gallery.model());
}

// Version 3 did not store the sighting of a negative.
TEST_F(GalleryTest, UpgradeFindsTheSightingsOfNegatives) {
  {
    Gallery gallery(path("p.db"));
    gallery.enroll("Ann", "", stored_face(1));
    for (int i = 2; i < 5; ++i) {
      const SightingFace face{stored_face(i).crop, 0.5, "{}"};
      (void)gallery.not_this_sighting(gallery.add_sighting(i, "camera", "Ann", true, 0.9, &face),
                                      {9, "me"});
    }
    (void)gallery.not_this_person("Ann", {stored_face(7).crop, 0.7, "{}"}, "door", {6, "me"});
  }
  {
    const DatabaseKind any{"", 0x54504731, {"", "", "", ""}};
    Database old(path("p.db"), any, DatabaseAccess::kWrite);
    old.run(
        "DROP INDEX negative_by_sighting; ALTER TABLE negative DROP COLUMN overruled; ALTER TABLE "
        "negative DROP COLUMN sighting; DELETE FROM sighting WHERE id = 1; DELETE FROM "
        "correction_row WHERE correction = 3; PRAGMA user_version = 3");
  }
  Gallery gallery(path("p.db"));
  // The first sighting was deleted before: its negative goes now.
  ASSERT_THAT(gallery.negatives(), SizeIs(3));
  EXPECT_EQ(gallery.forget_sightings_before(3), 0);
  // The second is found by the log, the third by its face.
  EXPECT_EQ(gallery.forget_sightings_before(4), 1);
  EXPECT_THAT(gallery.negatives(), SizeIs(2));
  EXPECT_EQ(gallery.forget_sightings_before(100), 1);
  ASSERT_THAT(gallery.negatives(), SizeIs(1));
  EXPECT_EQ(gallery.negatives()[0].source, "door");
}

TEST_F(GalleryTest, ForgetsSightingsBeforeATime) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  for (int i = 0; i < 10; ++i)
    gallery.add_sighting(i, "rtsp://me:secret@host/x", "Ann", i > 5, 0.5);
  gallery.add_sighting(4, "x", "nobody", false, 0.1);
  EXPECT_THAT(gallery.sightings(), SizeIs(10));
  EXPECT_THAT(gallery.sightings()[0].source, testing::Not(HasSubstr("secret")));
  EXPECT_EQ(gallery.forget_sightings_before(7), 7);
  EXPECT_THAT(gallery.sightings(), SizeIs(3));
  EXPECT_THAT(gallery.sightings(2), SizeIs(2));
  EXPECT_EQ(gallery.sighting_count(), 3);
  EXPECT_EQ(gallery.forget_sightings_before(100, 2), 2);
  EXPECT_EQ(gallery.sighting_count(), 1);
}

TEST_F(GalleryTest, ExportsEverything) {
  Gallery gallery(path("p.db"));
  gallery.enroll("../a\"b", "note", stored_face(1));
  gallery.enroll("../a\"b", "", stored_face(2));
  gallery.enroll("Ben", "", stored_face(3));
  const auto report =
      export_gallery(gallery, path("out"), [](std::int64_t t) { return std::to_string(t); }, {});
  EXPECT_EQ(report.people, 2);
  EXPECT_EQ(report.faces, 3);
  EXPECT_EQ(
      contents(path("out/faces.lst")),
      "person-1/face-1.png\t../a\"b\nperson-1/face-2.png\t../a\"b\nperson-2/face-3.png\tBen\n");
  const auto json = nlohmann::json::parse(contents(path("out/people.json")));
  EXPECT_EQ(json["people"][0]["name"], "../a\"b");
  EXPECT_EQ(json["people"][0]["note"], "note");
  EXPECT_EQ(json["people"][1]["faces"][0]["time"], "1003");
  EXPECT_EQ(
      cv::norm(read_gray_image(path("out/person-2/face-3.png")), stored_face(3).crop, cv::NORM_INF),
      0);
  EXPECT_THROW(export_gallery(gallery, path("out"), [](std::int64_t) { return ""; }, {}),
               OutputError);
}

TEST_F(GalleryTest, ExportsSightingsNegativesAndLog) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  const SightingFace stranger{stored_face(2).crop, 0.5, "{}"};
  (void)gallery.add_sighting(5, "camera", "Ann", false, 0.2, &stranger);
  (void)gallery.not_this_person("Ann", {stored_face(3).crop, 0.7, "{}"}, "door", {6, "me"});
  export_gallery(gallery, path("out"), [](std::int64_t t) { return std::to_string(t); }, {});
  const auto json = nlohmann::json::parse(contents(path("out/people.json")));
  // A stranger is filed under nobody, whomever the face resembles.
  EXPECT_EQ(json["people"][0]["sightings"].size(), 0U);
  ASSERT_EQ(json["unknown"].size(), 1U);
  ASSERT_EQ(json["negatives"].size(), 1U);
  EXPECT_EQ(json["negatives"][0]["not"], "Ann");
  EXPECT_EQ(json["negatives"][0]["source"], "door");
  EXPECT_EQ(
      cv::norm(read_gray_image(path("out/" + json["negatives"][0]["file"].get<std::string>())),
               stored_face(3).crop, cv::NORM_INF),
      0);
  ASSERT_EQ(json["log"].size(), 1U);
  EXPECT_EQ(json["log"][0]["what"], "not");
  EXPECT_EQ(json["log"][0]["from"], "Ann");
}

TEST_F(GalleryTest, ExportOmitsInvalidMeasures) {
  Gallery gallery(path("p.db"));
  StoredFace hostile = stored_face(1);
  hostile.measures = std::string(300'000, '[') + std::string(300'000, ']');
  gallery.enroll("Ann", "", hostile);
  export_gallery(gallery, path("out"), [](std::int64_t) { return "t"; }, {});
  const auto json = nlohmann::json::parse(contents(path("out/people.json")));
  EXPECT_TRUE(json["people"][0]["faces"][0]["measures"].is_null());
}

TEST_F(GalleryTest, InterruptedExportLeavesNothing) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", stored_face(1));
  std::stop_source source;
  source.request_stop();
  EXPECT_THROW(export_gallery(
                   gallery, path("out"), [](std::int64_t) { return ""; }, source.get_token()),
               Interrupted);
  EXPECT_FALSE(std::filesystem::exists(path("out")));
}

TEST_F(GalleryTest, RejectsInvalidFiles) {
  {
    Gallery gallery(path("p.db"));
    gallery.enroll("Ann", "", stored_face(1));
  }
  EXPECT_THROW(Gallery(path("none.db"), DatabaseAccess::kRead), InputError);
  std::ofstream(path("text.db")) << std::string(5000, 'x');
  EXPECT_THAT(message_of([&] { Gallery(path("text.db"), DatabaseAccess::kRead); }),
              HasSubstr("text.db: is not a database"));
  {
    const DatabaseKind other{"other", 7, {"CREATE TABLE a(b)"}};
    Database(path("other.db"), other, DatabaseAccess::kCreate);
    const DatabaseKind newer{"newer", 0x54504731, {"CREATE TABLE a(b)", "", "", "", ""}};
    Database(path("newer.db"), newer, DatabaseAccess::kCreate);
  }
  EXPECT_THAT(message_of([&] { Gallery(path("other.db")); }),
              HasSubstr("not a Tarsier people gallery"));
  EXPECT_THAT(message_of([&] { Gallery(path("newer.db")); }), HasSubstr("version 5"));
  {
    Gallery holder(path("p.db"));
    const DatabaseKind kind{"", 0x54504731, {"", "", "", ""}};
    Database locker(path("p.db"), kind, DatabaseAccess::kWrite, 0);
    const Transaction transaction(locker);
    Gallery waiting(path("p.db"), DatabaseAccess::kWrite, 50);
    EXPECT_THAT(message_of([&] { waiting.enroll("Ben", "", stored_face(2)); }),
                HasSubstr("locked"));
  }
  // Damage inside the file causes an error, never a crash.
  std::string bytes = contents(path("p.db"));
  for (std::size_t at = 4096; at < bytes.size(); at += 64) bytes[at] = static_cast<char>(at * 31);
  std::ofstream(path("damaged.db"), std::ios::binary) << bytes;
  EXPECT_THROW(
      {
        Gallery gallery(path("damaged.db"), DatabaseAccess::kRead);
        (void)gallery.people();
        (void)gallery.faces();
      },
      Error);
}

}  // namespace
}  // namespace tarsier::face::people
