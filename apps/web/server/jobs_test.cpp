// SPDX-License-Identifier: MIT
#include "jobs.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "about.h"
#include "audit_log.h"
#include "files.h"
#include "job_feed.h"
#include "metrics.h"
#include "openapi.h"
#include "router.h"
#include "runs.h"
#include <algorithm>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sys/stat.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

// A program that does what its first input says.
constexpr std::string_view kProgram = R"(#!/bin/sh
for word; do last=$word; done
case "$last" in
  *good*) echo '{"loss":1}'; echo '{"progress":"work","done":2,"total":4,"unit":"images","seconds":0.1}' >&2
          echo "note: $last" >&2; echo made > made.txt; exit 0 ;;
  *bad*) echo 'tarsier: error: it is bad' >&2; exit 3 ;;
  *crash*) kill -SEGV $$ ;;
  *wait*) echo '{"pid":'$$'}'; [ -p wait.pipe ] || mkfifo wait.pipe; read line < wait.pipe ;;
  *curve*) echo '{"progress":"reader","done":1,"total":2,"unit":"steps","seconds":0,"loss":0.5}' >&2 ;;
  *long*) printf '{"proven":true,"searched":["a"'; n=0
          while [ $n -lt 9999 ]; do printf ',"abcdefghijklmnopqrstuvwxyz-%d"' $n; n=$((n+1)); done; echo ']}' ;;
  *many*) n=0; while [ $n -lt 300 ]; do echo "{\"n\":$n}"; n=$((n+1)); done ;;
  *big*) while :; do echo '{"text":"0123456789012345678901234567890123456789012345678901234567890123456789"}'; done ;;
esac
)";

constexpr std::string_view kHelp =
    R"({"program":"tarsier","version":"1","verbs":[{"verb":"do it","path":["do","it"],
  "area":"do","help":"","usage":"","example":"","inputs":[{"names":["NAME"],"required":true,"repeatable":false,"type":"text"}],
  "flags":[]}]})";

class JobsTest : public testing::Test {
 protected:
  JobsTest() {
    write_file_atomically(program_, kProgram);
    ::chmod(program_.c_str(), 0700);
    feed_.on_publish([this] { published_.notify_all(); });
    begin();
  }
  void begin() {
    workspace_ = std::make_unique<Workspace>(folder_.path() + "/ws", limits_);
    jobs_ = std::make_unique<Jobs>(host(), feed_, options_);
  }
  void end() {
    jobs_.reset();
    workspace_.reset();
  }
  VerbHost host() {
    return {*workspace_, verbs_, audit_, program_,
            [](const std::string&) -> std::string { throw UsageError("no sources"); }};
  }
  // "people verify" takes a NAME and a file; models info takes a word alone.
  std::string start(const std::string& word) {
    return jobs_->start({{"verb", "models info"}, {"inputs", {word}}}, "test")["id"];
  }
  Json wait_for(const std::string& id, const auto& is_so) {
    for (int n = 0; n < 2000; ++n) {
      Json job = jobs_->get(id);
      if (is_so(job)) return job;
      std::unique_lock lock(mutex_);
      published_.wait_for(lock, std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << jobs_->get(id).dump();
    return jobs_->get(id);
  }
  Json over(const std::string& id) {
    return wait_for(
        id, [](const Json& job) { return job["state"] != "queued" && job["state"] != "running"; });
  }
  Json running(const std::string& id) {
    return wait_for(
        id, [](const Json& job) { return job["state"] == "running" && !job["lines"].empty(); });
  }

  static WorkspaceLimits roomy() {
    WorkspaceLimits limits;
    limits.disk_reserve_bytes = 0;
    return limits;
  }
  TemporaryFolder folder_;
  std::string program_ = folder_.path() + "/program";
  WorkspaceLimits limits_ = roomy();
  VerbTable verbs_{
      R"({"verbs":[{"verb":"models info","path":["models","info"],"area":"models","help":"","inputs":)"
      R"([{"names":["NAME"],"required":true,"repeatable":false}],"flags":[]}]})"};
  AuditLog audit_{folder_.path() + "/audit.log"};
  std::mutex mutex_;
  std::condition_variable published_;
  JobFeed feed_;
  JobOptions options_;
  std::unique_ptr<Workspace> workspace_;
  std::unique_ptr<Jobs> jobs_;
};

TEST_F(JobsTest, RunsToTheEnd) {
  const std::string id = start("good");
  const Json job = over(id);
  EXPECT_EQ(job["state"], "done");
  EXPECT_EQ(job["exit"], 0);
  EXPECT_EQ(job["lines"], Json::parse(R"([{"loss":1}])"));
  EXPECT_EQ(job["progress"]["label"], "work");
  EXPECT_EQ(job["progress"]["total"], 4);
  ASSERT_EQ(job["files"].size(), 1U);
  EXPECT_EQ(job["files"][0]["name"], "made.txt");
  EXPECT_THAT(job["command"].get<std::string>(), HasSubstr("tarsier models info -- good"));
  EXPECT_TRUE(fs::exists(workspace_->job_folder(id) + "/log.txt"));
  std::uint64_t last = 0;
  EXPECT_THAT(feed_.since(last), Not(IsEmpty()));
}

TEST_F(JobsTest, ReportsErrors) {
  EXPECT_EQ(over(start("bad"))["error"], "it is bad");
  EXPECT_EQ(over(start("bad"))["state"], "failed");
  EXPECT_THAT(over(start("crash"))["error"].get<std::string>(), HasSubstr("signal 11"));
}

TEST_F(JobsTest, RunsInOrderOfSubmission) {
  std::vector<std::string> ids;
  for (int n = 0; n < 8; ++n) ids.push_back(start("wait"));
  EXPECT_TRUE(std::is_sorted(ids.begin(), ids.end()));
  (void)running(ids.front());
  for (const std::string& id : ids) jobs_->cancel(id);
  for (const std::string& id : ids) EXPECT_EQ(over(id)["state"], "cancelled");
}

TEST_F(JobsTest, RunsOneAtATimeAndCancels) {
  const std::string first = start("wait"), second = start("wait");
  (void)running(first);
  EXPECT_EQ(jobs_->get(second)["state"], "queued");
  EXPECT_THROW(jobs_->remove(first), HttpError);
  jobs_->cancel(second);
  EXPECT_EQ(jobs_->get(second)["state"], "cancelled");
  jobs_->cancel(first);
  EXPECT_EQ(over(first)["state"], "cancelled");
  EXPECT_THROW(jobs_->cancel(first), HttpError);
  jobs_->remove(first);
  EXPECT_THROW((void)jobs_->get(first), HttpError);
  EXPECT_FALSE(fs::exists(workspace_->job_folder(first)));
}

TEST_F(JobsTest, SurvivesARestart) {
  const std::string done = start("good");
  (void)over(done);
  const std::string cut = start("wait"), waiting = start("good");
  (void)running(cut);
  end();
  begin();
  EXPECT_EQ(jobs_->get(done)["state"], "done");
  EXPECT_EQ(jobs_->get(done)["lines"].size(), 1U);
  EXPECT_EQ(jobs_->get(cut)["state"], "interrupted");
  EXPECT_EQ(over(waiting)["state"], "done");
  // Again: in its own folder.
  EXPECT_EQ(jobs_->restart(cut, "test")["id"], cut);
  (void)running(cut);
  jobs_->cancel(cut);
  EXPECT_EQ(over(cut)["state"], "cancelled");
  EXPECT_NE(jobs_->restart(done, "test")["id"], done);
}

// A kill leaves "running" behind.
TEST_F(JobsTest, InterruptsJobsAfterAKill) {
  const std::string id = start("good");
  (void)over(id);
  end();
  const std::string path = folder_.path() + "/ws/jobs/" + id + "/job.json";
  write_file_atomically(
      path, Json{{"verb", "models info"}, {"inputs", {"good"}}, {"state", "running"}}.dump());
  fs::create_directories(folder_.path() + "/ws/jobs/broken");
  write_file_atomically(folder_.path() + "/ws/jobs/broken/job.json", "{\"verb\":");
  begin();
  EXPECT_EQ(jobs_->get(id)["state"], "interrupted");
  EXPECT_EQ(jobs_->list()["jobs"].size(), 1U);
}

TEST_F(JobsTest, KeepsTheLastLines) {
  const Json job = over(start("many"));
  ASSERT_EQ(job["lines"].size(), 100U);
  EXPECT_EQ(job["lines"].back()["n"], 299);
}

TEST_F(JobsTest, ShortensLongLists) {
  const Json job = over(start("long"));
  ASSERT_EQ(job["lines"].size(), 1U);
  EXPECT_EQ(job["lines"][0]["proven"], true);
  EXPECT_EQ(job["lines"][0]["searched"].size(), 500U);
  EXPECT_EQ(job["lines"][0]["searched_count"], 10'000);
  EXPECT_GT(fs::file_size(workspace_->job_folder(job["id"]) + "/lines.jsonl"), 300'000U);
}

TEST_F(JobsTest, StoresMeasures) {
  const Json job = over(start("curve"));
  ASSERT_EQ(job["lines"].size(), 1U);
  EXPECT_EQ(job["lines"][0]["loss"], 0.5);
}

TEST_F(JobsTest, RefusesForbiddenVerbs) {
  EXPECT_THROW(jobs_->start({{"verb", "no such"}}, ""), UsageError);
  EXPECT_THROW(jobs_->start({{"verb", "models info"}, {"inputs", {"/etc/passwd"}}}, ""),
               UsageError);
  EXPECT_THROW(jobs_->start({{"verb", "models info"}, {"inputs", {"good"}}, {"name", "a\nb"}}, ""),
               HttpError);
  EXPECT_EQ(jobs_->list()["jobs"].size(), 0U);
  EXPECT_TRUE(fs::is_empty(workspace_->jobs_folder()));
}

TEST_F(JobsTest, LimitsTheNumberOfJobs) {
  end();
  options_.max_queued = 1;
  begin();
  const std::string first = start("wait");
  (void)running(first);
  const std::string second = start("wait");
  EXPECT_THROW(start("wait"), HttpError);
  jobs_->cancel(second);
  jobs_->cancel(first);
  (void)over(first);
}

TEST_F(JobsTest, StopsWhenTheWorkspaceIsFull) {
  end();
  limits_.quota_bytes = 1;
  begin();
  EXPECT_THROW(start("good"), HttpError);
}

TEST_F(JobsTest, RemovesNamesOfForgottenPeople) {
  verbs_ = VerbTable(R"({"verbs":[{"verb":"people forget","path":["people","forget"],"inputs":)"
                     R"([{"names":["NAME"],"required":true,"repeatable":false}],"flags":[]}]})");
  const Json request = {
      {"verb", "people forget"}, {"inputs", {"Ann good"}}, {"name", "Forget Ann good"}};
  const std::string first = jobs_->start(request, "")["id"];
  (void)over(first);
  const Json bad = {{"verb", "people forget"}, {"inputs", {"Bob bad"}}};
  const std::string kept = jobs_->start(bad, "")["id"];
  EXPECT_THAT(over(kept).dump(), HasSubstr("Bob"));
  EXPECT_THAT(jobs_->get(first).dump(), Not(HasSubstr("Ann")));
  jobs_->forget_name("Bob bad");
  for (const auto& entry : fs::recursive_directory_iterator(workspace_->jobs_folder())) {
    if (!entry.is_regular_file() || entry.path().filename() == "made.txt") continue;
    const std::string text = read_file(entry.path().string(), 1 << 20);
    EXPECT_THAT(text, Not(HasSubstr("Ann"))) << entry.path();
    EXPECT_THAT(text, Not(HasSubstr("Bob"))) << entry.path();
  }
}

// The program of a test writes what its flag --note says.
TEST_F(JobsTest, RemovesNamesFromFlagsLinesAndTextResults) {
  write_file_atomically(program_, R"(#!/bin/sh
case "$*" in
  *stop*) [ -p wait.pipe ] || mkfifo wait.pipe; echo '{"label":"Annabel"}'; read line < wait.pipe ;;
esac
echo '{"faces":[{"name":"Annabel","of":"Annabella"},{"name":"Bob"}],"Annabel":1}'
echo "Annabel was seen" >&2
printf 'name,count\nAnnabel,1\nBob,2' > r.csv
printf 'Annabel\000' > r.bin
exit 1
)");
  ::chmod(program_.c_str(), 0700);
  verbs_ = VerbTable(
      R"({"verbs":[{"verb":"people list","path":["people","list"],"inputs":[],"flags":[)"
      R"({"names":["--note"],"type":"text","values":1,"repeatable":false,"choices":[],"range":null}]}]})");
  const auto begin_job = [&](const std::string& note) -> std::string {
    return jobs_->start(
        {{"verb", "people list"}, {"flags", {{"--note", note}}}, {"name", "Find Annabel"}},
        "")["id"];
  };
  const auto text_of = [&](const std::string& id, const std::string& file) {
    return read_file(workspace_->job_folder(id) + file, 1 << 20);
  };
  const std::string done = begin_job("Annabel agreed");
  (void)over(done);
  const std::string current = begin_job("Annabel, stop");
  (void)running(current);
  jobs_->forget_name("Annabel");
  const Json job = jobs_->get(done);
  EXPECT_EQ(job["flags"]["--note"], "(forgotten) agreed");
  EXPECT_EQ(job["name"], "Find (forgotten)");
  EXPECT_EQ(job["command"], "tarsier people list");
  EXPECT_EQ(job["lines"],
            Json::parse(R"json([{"faces":[{"name":"(forgotten)","of":"Annabella"},{"name":"Bob"}],
                                 "Annabel":1}])json"));
  EXPECT_EQ(Json::parse(text_of(done, "/lines.jsonl")), job["lines"][0]);
  EXPECT_EQ(text_of(done, "/log.txt"), "(forgotten) was seen\n");
  EXPECT_EQ(text_of(done, "/files/r.csv"), "name,count\n(forgotten),1\nBob,2");
  EXPECT_EQ(text_of(done, "/files/r.bin"), std::string("Annabel\0", 8));
  EXPECT_EQ(text_of(done, "/job.json").find("Annabel"), std::string::npos);
  EXPECT_THROW((void)jobs_->restart(done, ""), HttpError);
  // The job that was running loses the name at its end.
  std::ofstream(workspace_->job_folder(current) + "/files/wait.pipe") << "go\n";
  const Json last = wait_for(
      current, [](const Json& one) { return one["flags"]["--note"] == "(forgotten), stop"; });
  EXPECT_EQ(last["lines"][0]["label"], "(forgotten)");
  EXPECT_EQ(text_of(current, "/files/r.csv"), "name,count\n(forgotten),1\nBob,2");
}

TEST_F(JobsTest, RunsReturnResults) {
  Runs runs(host());
  const auto good = runs.run({{"verb", "models info"}, {"inputs", {"good"}}}, "");
  EXPECT_EQ(good.exit, 0);
  ASSERT_EQ(good.lines.size(), 1U);
  const auto bad = runs.run({{"verb", "models info"}, {"inputs", {"bad"}}}, "");
  EXPECT_EQ(bad.exit, 3);
  EXPECT_EQ(bad.error, "it is bad");
  EXPECT_EQ(runs.run({{"verb", "models info"}, {"inputs", {"crash"}}}, "").exit, 128 + 11);
  EXPECT_TRUE(fs::is_empty(workspace_->studio_folder() + "/runs"));
}

TEST_F(JobsTest, RunsAreLimited) {
  RunOptions options;
  options.limit = std::chrono::milliseconds(300);
  options.output_bytes = 10'000;
  options.wait = std::chrono::milliseconds(10);
  options.parallel = 1;
  Runs runs(host(), options);
  const auto status = [&](const char* word) {
    try {
      (void)runs.run({{"verb", "models info"}, {"inputs", {word}}}, "");
    } catch (const HttpError& error) {
      return error.status();
    }
    return 0;
  };
  EXPECT_EQ(status("wait"), 504);
  EXPECT_EQ(status("big"), 413);
  EXPECT_EQ(status("good"), 0);
}

TEST_F(JobsTest, EachRouteIsDescribed) {
  Router router;
  Runs runs(host());
  bind_files(router, *workspace_, audit_, "");
  bind_jobs(router, *jobs_, *workspace_, audit_, "");
  bind_runs(router, runs, *workspace_);
  bind_about(router, verbs_, *workspace_, audit_, {});
  EXPECT_THAT(undescribed_routes(router), IsEmpty());
  const Json description = openapi_json(verbs_, router, "1");
  EXPECT_EQ(description["openapi"], "3.1.0");
  for (const auto& [path, methods] : description["paths"].items()) {
    for (const auto& [method, operation] : methods.items()) {
      EXPECT_TRUE(operation.contains("x-codeSamples")) << method << ' ' << path;
    }
  }
}

TEST(JobProgress, ReadsLines) {
  EXPECT_EQ(
      (*progress_of(
          R"({"progress":"a","done":1,"total":3,"unit":"x","seconds":2,"loss":0.5})"))["values"],
      Json::parse(R"({"loss":0.5})"));
  EXPECT_FALSE(progress_of(R"({"progress":"a","done":1})")->contains("values"));
  EXPECT_EQ(
      (*progress_of(R"({"progress":"a","done":1,"total":null,"unit":"x","seconds":0})"))["total"],
      nullptr);
  for (const char* line : {"", "a", "{\"progress\":", "{\"progress\":3}", "{\"done\":3}", "[1]"}) {
    EXPECT_FALSE(progress_of(line)) << line;
  }
}

TEST(Metrics, FormatAsText) {
  MetricsText metrics;
  metrics.family("a_b", "gauge", "Help.");
  metrics.value(1.5, {{"name", "a\"b\\c\nd"}});
  metrics.value(2);
  EXPECT_EQ(metrics.text(),
            "# HELP a_b Help.\n# TYPE a_b gauge\na_b{name=\"a\\\"b\\\\c\\nd\"} 1.5\na_b 2\n");
  MetricsText sessions;
  add_session_metrics(
      sessions,
      Json::parse(R"([{"id":"s1","verb":"cartoon run","frames":3,"age_ms":40,"running":true}])"));
  EXPECT_THAT(
      sessions.text(),
      HasSubstr("tarsier_session_frame_age_seconds{session=\"s1\",verb=\"cartoon run\"} 0.04"));
}

TEST(HttpStatus, FollowsTheExitStatus) {
  EXPECT_EQ(http_status_of(0), 200);
  EXPECT_EQ(http_status_of(1), 200);
  EXPECT_EQ(http_status_of(2), 400);
  EXPECT_EQ(http_status_of(3), 422);
  EXPECT_EQ(http_status_of(5), 500);
  EXPECT_EQ(http_status_of(6), 507);
  EXPECT_EQ(http_status_of(139), 500);
}

}  // namespace
}  // namespace tarsier::web
