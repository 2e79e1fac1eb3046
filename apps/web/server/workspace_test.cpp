// SPDX-License-Identifier: MIT
#include "workspace.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "router.h"
#include <filesystem>
#include <unistd.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class WorkspaceTest : public testing::Test {
 protected:
  static WorkspaceLimits small() {
    WorkspaceLimits limits;
    limits.file_bytes = 100'000;
    limits.pixels = 10'000;
    limits.disk_reserve_bytes = 0;
    return limits;
  }
  std::string spool(std::string_view bytes) {
    const std::string path = workspace_->uploads_folder() + "/part-" + std::to_string(++count_);
    write_file_atomically(path, bytes);
    return path;
  }
  static std::string image(int width = 40, int height = 30) {
    const auto bytes =
        encode_image(".png", cv::Mat(height, width, CV_8UC3, cv::Scalar(10, 200, 30)), "test");
    return {bytes.begin(), bytes.end()};
  }
  int status_of(const auto& work) {
    try {
      work();
    } catch (const HttpError& error) {
      message_ = error.what();
      return error.status();
    }
    return 0;
  }

  TemporaryFolder folder_;
  std::unique_ptr<Workspace> workspace_ =
      std::make_unique<Workspace>(folder_.path() + "/ws", small());
  std::string message_;
  int count_ = 0;
};

TEST_F(WorkspaceTest, AllowsOneServer) {
  EXPECT_THROW(Workspace(folder_.path() + "/ws"), OutputError);
  workspace_.reset();
  EXPECT_NO_THROW(Workspace(folder_.path() + "/ws"));
}

TEST_F(WorkspaceTest, IsPrivate) {
  for (const char* part : {"/ws/.studio", "/ws/sets", "/ws/jobs"}) {
    EXPECT_EQ(fs::status(folder_.path() + part).permissions(), fs::perms::owner_all) << part;
  }
}

TEST_F(WorkspaceTest, StoresAndListsFiles) {
  workspace_->make_set("Grüße");
  const FileInfo stored = workspace_->store("Grüße", "a b.png", spool(image()), true);
  EXPECT_EQ(stored.width, 40);
  EXPECT_EQ(stored.height, 30);
  EXPECT_EQ(stored.type, FileType::kImage);
  workspace_->store("Grüße", "list.txt", spool("a b.png\n"), true);
  const auto files = workspace_->files("Grüße");
  ASSERT_EQ(files.size(), 2U);
  EXPECT_EQ(files[0].name, "a b.png");
  EXPECT_EQ(files[0].width, 40);
  EXPECT_EQ(files[1].type, FileType::kOther);
  EXPECT_TRUE(fs::is_empty(workspace_->uploads_folder()));
  EXPECT_EQ(workspace_->sets().front().files, 2U);
  workspace_->remove_file("Grüße", "list.txt");
  EXPECT_EQ(workspace_->files("Grüße").size(), 1U);
  workspace_->remove_set("Grüße");
  EXPECT_TRUE(workspace_->sets().empty());
}

TEST_F(WorkspaceTest, FormsReplaceNoFiles) {
  workspace_->make_set("a");
  EXPECT_EQ(workspace_->store("a", "image.jpg", spool(image()), false).name, "image.jpg");
  EXPECT_EQ(workspace_->store("a", "image.jpg", spool(image(50)), false).name, "image (2).jpg");
  EXPECT_EQ(workspace_->store("a", "image.jpg", spool(image(60)), false).name, "image (3).jpg");
  EXPECT_EQ(workspace_->file_info("a", "image.jpg").width, 40);
  workspace_->store("a", "image.jpg", spool(image(70)), true);
  EXPECT_EQ(workspace_->file_info("a", "image.jpg").width, 70);
}

TEST_F(WorkspaceTest, RefusesHostileNames) {
  workspace_->make_set("a");
  for (const std::string name :
       {"", ".", "..", ".studio", "a/b", "../a", "/etc", "a\\b", "a\n", "x*", "[a]"}) {
    EXPECT_EQ(status_of([&] { workspace_->make_set(name); }), 400) << name;
    EXPECT_EQ(status_of([&] { (void)workspace_->files(name); }), 400) << name;
    EXPECT_EQ(status_of([&] { (void)workspace_->store("a", name, spool(image()), true); }), 400)
        << name;
    EXPECT_EQ(status_of([&] { (void)workspace_->file_path("a", name); }), 400) << name;
    EXPECT_EQ(status_of([&] { (void)workspace_->state_path(name); }), 400) << name;
    EXPECT_NE(status_of([&] { (void)workspace_->job_folder(name); }), 0) << name;
    EXPECT_NE(status_of([&] { (void)workspace_->job_file("j1", name); }), 0) << name;
  }
  EXPECT_EQ(status_of([&] { workspace_->make_set("a"); }), 409);
  EXPECT_EQ(status_of([&] { (void)workspace_->files("b"); }), 404);
  EXPECT_EQ(status_of([&] { (void)workspace_->state_path("sets"); }), 404);
}

TEST_F(WorkspaceTest, FollowsNoLinks) {
  workspace_->make_set("a");
  write_file_atomically(folder_.path() + "/secret.txt", "secret");
  fs::create_symlink(folder_.path() + "/secret.txt", folder_.path() + "/ws/sets/a/link.txt");
  fs::create_directory_symlink(folder_.path(), folder_.path() + "/ws/sets/out");
  fs::create_symlink(folder_.path() + "/secret.txt", folder_.path() + "/ws/state.txt");
  fs::create_directories(folder_.path() + "/ws/jobs/j1/files");
  fs::create_directory_symlink(folder_.path(), folder_.path() + "/ws/jobs/j1/files/out");
  EXPECT_EQ(status_of([&] { (void)workspace_->file_path("a", "link.txt"); }), 404);
  EXPECT_EQ(status_of([&] { (void)workspace_->files("out"); }), 404);
  EXPECT_EQ(status_of([&] { (void)workspace_->state_path("state.txt"); }), 404);
  EXPECT_EQ(status_of([&] { (void)workspace_->job_file("j1", "out/secret.txt"); }), 404);
  for (const char* reference :
       {"set:a/link.txt", "set:out", "ws:state.txt", "job:j1/out/secret.txt", "job:j1/out"}) {
    EXPECT_THROW((void)workspace_->resolve(reference, true), UsageError) << reference;
    EXPECT_THROW((void)workspace_->resolve(reference, false), UsageError) << reference;
  }
  EXPECT_TRUE(workspace_->files("a").empty());
  EXPECT_TRUE(workspace_->job_files("j1").empty());
  workspace_->remove_set("a");
  EXPECT_TRUE(fs::exists(folder_.path() + "/secret.txt"));
}

TEST_F(WorkspaceTest, ResolvesReferences) {
  workspace_->make_set("a");
  workspace_->store("a", "1.png", spool(image()), true);
  fs::create_directories(folder_.path() + "/ws/jobs/j1/files/model");
  write_file_atomically(folder_.path() + "/ws/jobs/j1/files/model/points.ply", "ply");
  const std::string root = workspace_->folder();
  EXPECT_EQ(workspace_->resolve("set:a", true), root + "/sets/a");
  EXPECT_EQ(workspace_->resolve("set:a/1.png", true), root + "/sets/a/1.png");
  EXPECT_EQ(workspace_->resolve("job:j1/model", true), root + "/jobs/j1/files/model");
  EXPECT_EQ(workspace_->resolve("job:j1/model/points.ply", true),
            root + "/jobs/j1/files/model/points.ply");
  EXPECT_EQ(workspace_->resolve("ws:gallery", false), root + "/gallery");
  EXPECT_THROW((void)workspace_->resolve("ws:gallery", true), UsageError);
  for (const char* reference :
       {"", "set:", "set:b", "set:a/2.png", "set:a/", "set:a/../a", "job:j1", "job:j2/x",
        "job:../x", "job:j1/../job.json", "ws:", "ws:sets", "ws:jobs", "ws:.studio", "ws:../x",
        "model:../README", "model:nothing", "/etc/passwd", "file:x"}) {
    EXPECT_THROW((void)workspace_->resolve(reference, true), UsageError) << reference;
  }
  EXPECT_EQ(workspace_->with_references("{\"image\":\"" + root + "/sets/a/1.png\",\"o\":\"" + root +
                                        "/jobs/j1/files/model/points.ply\",\"g\":\"" + root +
                                        "/gallery\"}"),
            R"({"image":"set:a/1.png","o":"job:j1/model/points.ply","g":"ws:gallery"})");
  EXPECT_EQ(workspace_->job_files("j1").front().name, "model/points.ply");
}

TEST_F(WorkspaceTest, ChecksUploads) {
  workspace_->make_set("a");
  const auto store = [&](const std::string& name, std::string_view bytes) {
    return status_of([&] { (void)workspace_->store("a", name, spool(bytes), true); });
  };
  EXPECT_EQ(store("empty.png", ""), 415);
  EXPECT_EQ(store("large.png", image(200, 100)), 415);  // more pixels than are taken
  EXPECT_THAT(message_, HasSubstr("200x100"));
  EXPECT_EQ(store("cut.png", image().substr(0, 60)), 415);
  EXPECT_EQ(store("page.html", "<script>alert(1)</script>"), 415);
  EXPECT_EQ(store("page.png", "<script>alert(1)</script>"), 415);
  EXPECT_EQ(store("drawing.svg", "<svg onload='alert(1)'/>"), 415);
  EXPECT_EQ(store("list.mp4", "#EXTM3U\nfile:///etc/passwd\n"), 415);
  EXPECT_EQ(store("program",
                  "\x7f"
                  "ELF"),
            415);
  EXPECT_EQ(store("big.txt", std::string(100'001, 'a')), 413);
  EXPECT_TRUE(workspace_->files("a").empty());
}

TEST_F(WorkspaceTest, RefusesListsThatNameFilesElsewhere) {
  FileType type{};
  const auto error_of = [&](std::string_view text) {
    return upload_error("x.json", text, 1000, type);
  };
  for (const char* text :
       {"/etc/passwd", "a.jpg\n/etc/passwd", R"({"image": "/home/x/1.jpg"})", "../x.jpg",
        "a/../../x", R"({"image": "\/etc\/passwd"})", "image,x\n/root/a.png,3", "~/a.jpg",
        "<image file='/x.jpg'/>", R"("\u002fetc")", "<i file='&#47;etc'/>", "key: /etc",
        "//etc/passwd", "/./etc/passwd", R"({"image": "/\u0065tc/passwd"})",
        "/no-such-folder/1.jpg", "[/etc]"}) {
    EXPECT_NE(error_of(text), "") << text;
  }
  for (const char* text :
       {"a.jpg\nb/c.jpg\n", R"({"image": "faces/1.jpg", "rate": "1/2"})",
        "<image file='a.jpg'/><br /></image>", "f 1/2/3 1//3", "# a / b", "v 0 0 0", "and /or",
        "about ~5 px", R"({"a":"/wD8AA=="})", "<!--\n//////\n  //\n-->", "1 /km."}) {
    EXPECT_EQ(error_of(text), "") << text;
  }
  EXPECT_EQ(error_of("{\"data\": \"/" + std::string(5000, 'A') + "\"}"), "")
      << "encoded bytes may begin with '/'";
}

TEST_F(WorkspaceTest, EnforcesItsQuota) {
  WorkspaceLimits limits = small();
  limits.quota_bytes = 1'000;
  workspace_.reset();
  Workspace full(folder_.path() + "/ws", limits);
  EXPECT_EQ(status_of([&] { full.check_space(0); }), 507);
  EXPECT_THAT(message_, HasSubstr("delete sets or jobs"));
}

TEST_F(WorkspaceTest, EnforcesTheDiskReserve) {
  WorkspaceLimits limits = small();
  limits.disk_reserve_bytes = 1ULL << 60U;
  workspace_.reset();
  Workspace full(folder_.path() + "/ws", limits);
  EXPECT_EQ(status_of([&] { full.check_space(0); }), 507);
  EXPECT_THAT(message_, HasSubstr("disk is nearly full"));
}

TEST_F(WorkspaceTest, RemovesUnfinishedUploads) {
  spool("half");
  workspace_.reset();
  Workspace fresh(folder_.path() + "/ws", small());
  EXPECT_TRUE(fs::is_empty(fresh.uploads_folder()));
}

TEST(MediaType, NeverShowsActiveContent) {
  EXPECT_EQ(media_type("a.JPG"), "image/jpeg");
  for (const char* name : {"a.html", "a.svg", "a.xml", "a.js", "a.json", "a", "a.pdf"}) {
    EXPECT_EQ(media_type(name), "application/octet-stream") << name;
  }
}

TEST_F(WorkspaceTest, MakesThumbnails) {
  write_image(folder_.path() + "/big.png", cv::Mat(300, 400, CV_8UC3, cv::Scalar(1, 2, 3)));
  ASSERT_EQ(make_thumbnail(folder_.path() + "/big.png", folder_.path() + "/small.jpg", 100), 0);
  const cv::Mat small = read_image(folder_.path() + "/small.jpg");
  EXPECT_EQ(small.cols, 100);
  EXPECT_EQ(small.rows, 75);
  EXPECT_NE(make_thumbnail(folder_.path() + "/none.png", folder_.path() + "/x.jpg", 100), 0);
}

}  // namespace
}  // namespace tarsier::web
