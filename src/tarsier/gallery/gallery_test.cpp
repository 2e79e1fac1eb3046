// SPDX-License-Identifier: MIT
#include "tarsier/gallery/gallery.h"

#include "tarsier/core/errors.h"
#include "tarsier/gallery/export.h"
#include "tarsier/gallery/name.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stop_token>

namespace tarsier::people {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

StoredFace face(int seed) {
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

template <typename Call>
std::string message_of(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

using GalleryTest = FolderTest;

TEST_F(GalleryTest, KeepsPeopleWithAnyNames) {
  const std::vector<std::string> names = {"O'Brien \"Bob\"", "../../etc/passwd", "%s\\",
                                          "日本 名前", std::string(200, 'x')};
  {
    Gallery gallery(path("p.db"));
    for (std::size_t i = 0; i < names.size(); ++i)
      gallery.enroll(names[i], "agreed", face(static_cast<int>(i)));
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
    EXPECT_EQ(cv::norm(faces[0].crop, face(static_cast<int>(i)).crop, cv::NORM_INF), 0);
  }
  EXPECT_FALSE(gallery.find("nobody"));
  namespace fs = std::filesystem;
  EXPECT_EQ(fs::status(path("p.db")).permissions() & fs::perms::all,
            fs::perms::owner_read | fs::perms::owner_write);
}

TEST_F(GalleryTest, NamesThatCannotBeAreRefused) {
  Gallery gallery(path("p.db"));
  for (const std::string& name : {std::string(), std::string(201, 'x'), std::string(10'000, 'x'),
                                  std::string("a\nb"), std::string("\xff\xfe"), std::string(" x"),
                                  std::string("a\xC0\xAF"), std::string("\xED\xA0\x80")}) {
    EXPECT_THROW(gallery.enroll(name, "", face(1)), UsageError);
  }
  EXPECT_THAT(message_of([] { check_name(std::string(10'000, 'x')); }), HasSubstr("10000 bytes"));
  EXPECT_THAT(gallery.people(), IsEmpty());
}

TEST_F(GalleryTest, MoreFacesOfAKnownPersonAndItsNote) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", face(1));
  const auto before = gallery.generation();
  gallery.enroll("Ann", "agreed on Monday", face(2));
  gallery.enroll("Ann", "", face(3));
  EXPECT_NE(gallery.generation(), before);
  ASSERT_THAT(gallery.people(), SizeIs(1));
  EXPECT_EQ(gallery.people()[0].faces, 3);
  EXPECT_EQ(gallery.people()[0].note, "agreed on Monday");
  EXPECT_EQ(cv::norm(gallery.latest_face(1)->crop, face(3).crop, cv::NORM_INF), 0);
}

// The raw bytes are in the files before, and in none afterwards.
TEST_F(GalleryTest, ForgettingLeavesNoByte) {
  Gallery gallery(path("p.db"));
  Pieces pieces;
  for (int i = 0; i < 6; ++i) {
    const StoredFace stored = face(i);
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
  gallery.store_model("subspace", gallery.generation(), templates);
  gallery.add_sighting(5, "camera", "Ann", true, 0.9);
  gallery.add_sighting(6, "camera", "Ben", true, 0.9);
  EXPECT_FALSE(search_folder(pieces, folder_, {}).found.empty());

  const auto report = gallery.forget("Ann", {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven());
  EXPECT_EQ(report->person.faces, 4);
  EXPECT_EQ(report->sightings, 1);
  EXPECT_GT(report->search.pieces, 10'000U);
  EXPECT_GT(report->search.bytes, 10'000);
  const SearchReport again = search_folder(pieces, folder_, {});
  EXPECT_THAT(again.found, IsEmpty());
  EXPECT_GE(again.files.size(), 1U);
  EXPECT_FALSE(gallery.model());
  EXPECT_THAT(gallery.sightings(), SizeIs(1));
  EXPECT_THAT(gallery.faces(), SizeIs(2));
  EXPECT_FALSE(gallery.forget("Ann", {}));
}

TEST_F(GalleryTest, ACopyInTheFolderIsTold) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", face(1));
  export_gallery(gallery, path("out"), [](std::int64_t) { return "t"; }, {});
  std::filesystem::copy_file(path("out/person-1/face-1.png"), path("copy.png"));
  const auto report = gallery.forget("Ann", {});
  EXPECT_FALSE(report->proven());
  EXPECT_THAT(report->search.found, testing::ElementsAre(path("copy.png")));
}

TEST_F(GalleryTest, WhatWasLearnedLastsUntilTheNextChange) {
  Gallery gallery(path("p.db"));
  const auto id = gallery.enroll("Ann", "", face(1));
  gallery.store_model("subspace", gallery.generation(), {{id, {1.0F, 2.0F}}});
  EXPECT_EQ(gallery.model(), "subspace");
  EXPECT_THAT(gallery.faces()[0].features, testing::ElementsAre(1.0F, 2.0F));
  gallery.enroll("Ben", "", face(2));
  EXPECT_FALSE(gallery.model());
  EXPECT_THAT(gallery.faces()[0].features, IsEmpty());
  gallery.store_model("late", gallery.generation() - 1, {});
  EXPECT_FALSE(gallery.model());
}

TEST_F(GalleryTest, SightingsAreKeptForATime) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", face(1));
  for (int i = 0; i < 10; ++i)
    gallery.add_sighting(i, "rtsp://me:secret@host/x", "Ann", i > 5, 0.5);
  gallery.add_sighting(4, "x", "nobody", false, 0.1);
  EXPECT_THAT(gallery.sightings(), SizeIs(10));
  EXPECT_THAT(gallery.sightings()[0].source, testing::Not(HasSubstr("secret")));
  EXPECT_EQ(gallery.forget_sightings_before(7), 7);
  EXPECT_THAT(gallery.sightings(), SizeIs(3));
  EXPECT_THAT(gallery.sightings(2), SizeIs(2));
}

TEST_F(GalleryTest, ExportsEverything) {
  Gallery gallery(path("p.db"));
  gallery.enroll("../a\"b", "note", face(1));
  gallery.enroll("../a\"b", "", face(2));
  gallery.enroll("Ben", "", face(3));
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
  EXPECT_EQ(cv::norm(read_gray_image(path("out/person-2/face-3.png")), face(3).crop, cv::NORM_INF),
            0);
  EXPECT_THROW(export_gallery(gallery, path("out"), [](std::int64_t) { return ""; }, {}),
               OutputError);
}

TEST_F(GalleryTest, MeasuresThatNoProgramOfOursWroteAreLeftOut) {
  Gallery gallery(path("p.db"));
  StoredFace hostile = face(1);
  hostile.measures = std::string(300'000, '[') + std::string(300'000, ']');
  gallery.enroll("Ann", "", hostile);
  export_gallery(gallery, path("out"), [](std::int64_t) { return "t"; }, {});
  const auto json = nlohmann::json::parse(contents(path("out/people.json")));
  EXPECT_TRUE(json["people"][0]["faces"][0]["measures"].is_null());
}

TEST_F(GalleryTest, AnExportThatIsStoppedLeavesNothing) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", face(1));
  std::stop_source source;
  source.request_stop();
  EXPECT_THROW(export_gallery(
                   gallery, path("out"), [](std::int64_t) { return ""; }, source.get_token()),
               Interrupted);
  EXPECT_FALSE(std::filesystem::exists(path("out")));
}

TEST_F(GalleryTest, FilesThatAreNoneOrCannotBeUsedSaySo) {
  {
    Gallery gallery(path("p.db"));
    gallery.enroll("Ann", "", face(1));
  }
  EXPECT_THROW(Gallery(path("none.db"), DatabaseAccess::kRead), InputError);
  std::ofstream(path("text.db")) << std::string(5000, 'x');
  EXPECT_THAT(message_of([&] { Gallery(path("text.db"), DatabaseAccess::kRead); }),
              HasSubstr("text.db: is no database"));
  {
    const DatabaseKind other{"other", 7, {"CREATE TABLE a(b)"}};
    Database(path("other.db"), other, DatabaseAccess::kCreate);
    const DatabaseKind newer{"newer", 0x54504731, {"CREATE TABLE a(b)", "", ""}};
    Database(path("newer.db"), newer, DatabaseAccess::kCreate);
  }
  EXPECT_THAT(message_of([&] { Gallery(path("other.db")); }),
              HasSubstr("no Tarsier people gallery"));
  EXPECT_THAT(message_of([&] { Gallery(path("newer.db")); }), HasSubstr("version 3"));
  {
    Gallery holder(path("p.db"));
    const DatabaseKind kind{"", 0x54504731, {""}};
    Database locker(path("p.db"), kind, DatabaseAccess::kWrite, 0);
    const Transaction transaction(locker);
    Gallery waiting(path("p.db"), DatabaseAccess::kWrite, 50);
    EXPECT_THAT(message_of([&] { waiting.enroll("Ben", "", face(2)); }), HasSubstr("locked"));
  }
  // Damage in the middle: an error, never a crash.
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
}  // namespace tarsier::people
