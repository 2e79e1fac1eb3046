// SPDX-License-Identifier: MIT
#include "jobs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "forgotten_names.h"
#include "job.h"
#include "job_feed.h"
#include "router.h"
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <sys/stat.h>

namespace tarsier::web {
namespace {

constexpr NameTable<JobState, 6> kStates{"state",
                                         {{{JobState::kQueued, "queued"},
                                           {JobState::kRunning, "running"},
                                           {JobState::kDone, "done"},
                                           {JobState::kFailed, "failed"},
                                           {JobState::kCancelled, "cancelled"},
                                           {JobState::kInterrupted, "interrupted"}}}};

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::size_t kMaxShown = 64U << 10U;  // bytes of lines in one response
constexpr std::size_t kMaxStored = 1U << 20U;

// Sorted by time, also within a millisecond and after the clock was set back; not predictable.
std::string new_id() {
  using std::chrono::milliseconds;
  static std::mutex mutex;
  static std::mt19937_64 random{std::random_device{}()};
  static std::chrono::sys_time<milliseconds> last;
  const std::lock_guard lock(mutex);
  last = std::max(std::chrono::floor<milliseconds>(std::chrono::system_clock::now()),
                  last + milliseconds(1));
  return fmt::format("{:%Y%m%d-%H%M%S}-{:03}-{:06x}",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(last)),
                     last.time_since_epoch().count() % 1000, random() & 0xffffffU);
}

JobState state_of(const std::string& name) {
  return kStates.find(name).value_or(JobState::kFailed);
}

Json time_or_null(double seconds) { return seconds > 0 ? Json(seconds) : Json(nullptr); }

}  // namespace

std::string_view name_of(JobState state) { return kStates.name(state); }

Jobs::Jobs(const VerbHost& host, JobFeed& feed, JobOptions options)
    : host_(host), feed_(feed), options_(options) {
  load();
  scheduler_ = std::thread([this] { schedule(); });
}

Jobs::~Jobs() { stop(); }

void Jobs::stop() {
  std::vector<std::shared_ptr<Job>> running;
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
    for (const auto& [id, job] : jobs_) {
      if (job->state == JobState::kRunning && job->child) {
        job->child->interrupt(std::chrono::milliseconds(400));
        running.push_back(job);
      }
    }
  }
  changed_.notify_all();
  if (!scheduler_.joinable()) return;
  scheduler_.join();
  for (const auto& job : running) {
    if (job->child) (void)job->child->wait(std::chrono::seconds(5));
    job->child.reset();  // kills remaining processes
    if (job->state == JobState::kRunning) {
      job->state = JobState::kInterrupted;
      job->error = "the studio was stopped during the job";
      job->ended = now_seconds();
      save(*job);
    }
  }
}

// The stored form of a job.
Json Jobs::stored(const Job& job) {
  return {{"id", job.id},
          {"verb", job.request.verb},
          {"inputs", job.request.inputs},
          {"flags", job.request.flags},
          {"name", job.name},
          {"command", job.shell_text},
          {"state", name_of(job.state)},
          {"progress", job.progress},
          {"created", job.created},
          {"started", job.started},
          {"ended", job.ended},
          {"exit", job.exit ? Json(*job.exit) : Json(nullptr)},
          {"error", job.error}};
}

void Jobs::save(const Job& job) const {
  write_file_atomically(host_.workspace.jobs_folder() + '/' + job.id + "/job.json",
                        to_text(stored(job)) + '\n');
}

void Jobs::load() {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(host_.workspace.jobs_folder(), error)) {
    const std::string folder = entry.path().string();
    try {
      const Json json = Json::parse(read_file(folder + "/job.json", kMaxStored));
      auto job = std::make_shared<Job>();
      job->id = entry.path().filename().string();
      (void)host_.workspace.job_folder(job->id);
      job->request = verb_request(json);
      job->name = json.value("name", "");
      job->shell_text = json.value("command", "");
      job->state = state_of(json.value("state", ""));
      if (json.contains("progress")) job->progress = json["progress"];
      job->created = json.value("created", 0.0);
      job->started = json.value("started", 0.0);
      job->ended = json.value("ended", 0.0);
      if (json.contains("exit") && json["exit"].is_number_integer())
        job->exit = json["exit"].get<int>();
      job->error = json.value("error", "");
      job->lines = tail_of(folder + "/lines.jsonl", options_.lines);
      if (job->state == JobState::kRunning) {
        job->state = JobState::kInterrupted;
        job->error = "the studio ended during the job; start the job again";
        job->ended = now_seconds();
        save(*job);
      }
      jobs_[job->id] = std::move(job);
    } catch (const std::exception& failure) {  // not a job, or corrupt: it is left unchanged
      log_warning("{}: no job: {}", folder, failure.what());
    }
  }
}

Json Jobs::json_of(const Job& job, bool whole) const {
  Json json = stored(job);
  json["started"] = time_or_null(job.started);
  json["ended"] = time_or_null(job.ended);
  if (job.error.empty()) json["error"] = nullptr;
  json["lines"] = Json::array();
  json["files"] = Json::array();
  if (!whole) return json;
  std::size_t bytes = 0;
  std::vector<Json> lines;
  for (auto line = job.lines.rbegin(); line != job.lines.rend() && bytes < kMaxShown; ++line) {
    bytes += line->size();
    Json value = Json::parse(*line, nullptr, false);
    if (value.is_object()) lines.push_back(std::move(value));
  }
  std::reverse(lines.begin(), lines.end());
  json["lines"] = std::move(lines);
  for (const FileInfo& file : host_.workspace.job_files(job.id))
    json["files"].push_back(to_json(file));
  return json;
}

std::shared_ptr<Jobs::Job> Jobs::find(const std::string& id) const {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) throw HttpError(404, "no such job");
  return found->second;
}

Json Jobs::start(const Json& object, const std::string& address) {
  auto job = std::make_shared<Job>();
  job->request = verb_request(object);
  job->id = new_id();
  job->name = optional_text(object, "name").value_or("");
  if (!is_one_line(job->name, 200))
    throw HttpError(400, "name: expected one line of at most 200 bytes");
  const std::string folder = host_.workspace.job_folder(job->id);
  const CommandLine command = host_.command(job->request, Use::kJob, folder + "/files");
  job->shell_text = command.shell_text;
  host_.workspace.check_space(0);

  const Lock lock(mutex_);
  if (jobs_.size() >= options_.max_jobs) {
    throw HttpError(429, fmt::format("there are already {} jobs; delete some", jobs_.size()));
  }
  const auto queued = std::count_if(jobs_.begin(), jobs_.end(), [](const auto& entry) {
    return entry.second->state == JobState::kQueued;
  });
  if (static_cast<std::size_t>(queued) >= options_.max_queued) {
    throw HttpError(
        429, fmt::format("{} jobs are already waiting; cancel some, or try again later", queued));
  }
  if (::mkdir(folder.c_str(), 0700) != 0 || ::mkdir((folder + "/files").c_str(), 0700) != 0) {
    throw HttpError(507, fmt::format("the job's folder cannot be made: {}", std::strerror(errno)));
  }
  job->created = now_seconds();
  save(*job);
  sync_folder(folder);
  host_.write_audit(command, job->request, address);
  jobs_[job->id] = job;
  Json answer = json_of(*job, true);
  changed_.notify_all();
  return answer;
}

Json Jobs::list() const {
  const Lock lock(mutex_);
  Json jobs = Json::array();
  for (auto entry = jobs_.rbegin(); entry != jobs_.rend(); ++entry) {
    jobs.push_back(json_of(*entry->second, false));
  }
  return {{"jobs", std::move(jobs)}};
}

Json Jobs::get(const std::string& id) const {
  const Lock lock(mutex_);
  return json_of(*find(id), true);
}

void Jobs::cancel(const std::string& id) {
  const Lock lock(mutex_);
  const auto job = find(id);
  if (is_over(job->state)) throw HttpError(409, "the job has ended");
  job->cancelled = true;
  if (job->state == JobState::kRunning) {
    if (job->child) job->child->interrupt(options_.kill_delay);
  } else {
    job->state = JobState::kCancelled;
    job->ended = now_seconds();
    save(*job);
  }
  job->is_new = true;
  changed_.notify_all();
}

void Jobs::remove(const std::string& id) {
  const Lock lock(mutex_);
  const auto job = find(id);
  if (!is_over(job->state)) throw HttpError(409, "the job has not ended; cancel it first");
  const std::string folder = host_.workspace.job_folder(id);
  ::unlink((folder + "/job.json").c_str());  // first: after a kill the rest is not taken for a job
  host_.workspace.forget_thumbnails(folder);
  std::error_code error;
  fs::remove_all(folder, error);
  if (error) throw HttpError(500, fmt::format("the job cannot be deleted: {}", error.message()));
  jobs_.erase(id);
  feed_.publish(id, to_text(Json{{"id", id}, {"state", "deleted"}}));
}

Json Jobs::restart(const std::string& id, const std::string& address) {
  Json new_request;
  {
    const Lock lock(mutex_);
    const auto job = find(id);
    if (!is_over(job->state)) throw HttpError(409, "the job has not ended");
    const Json words = Json::array({job->request.inputs, job->request.flags});
    if (to_text(words).find(kForgotten) != std::string::npos)
      throw HttpError(409, "a person of this job was forgotten; start a new job");
    if (job->state != JobState::kDone) {
      const CommandLine command =
          host_.command(job->request, Use::kJob, host_.workspace.job_folder(id) + "/files");
      job->shell_text = command.shell_text;
      job->state = JobState::kQueued;
      job->progress = nullptr;
      job->started = job->ended = 0;
      job->exit.reset();
      job->error.clear();
      job->lines.clear();
      job->cancelled = false;
      job->is_new = true;
      save(*job);
      host_.write_audit(command, job->request, address);
      changed_.notify_all();
      return json_of(*job, true);
    }
    new_request = {{"verb", job->request.verb},
                   {"inputs", job->request.inputs},
                   {"flags", job->request.flags},
                   {"name", job->name}};
  }
  return start(new_request, address);
}

std::map<std::string, int> Jobs::count_by_state() const {
  const Lock lock(mutex_);
  std::map<std::string, int> counts;
  for (const JobState state : {JobState::kQueued, JobState::kRunning, JobState::kDone,
                               JobState::kFailed, JobState::kCancelled, JobState::kInterrupted}) {
    counts[std::string(name_of(state))] = 0;
  }
  for (const auto& [id, job] : jobs_) ++counts[std::string(name_of(job->state))];
  return counts;
}

void Jobs::forget_name(const std::string& name) {
  const Lock lock(mutex_);
  forget_name_now(name);
  changed_.notify_all();
}

void Jobs::forget_name_now(const std::string& name) {
  for (const auto& [id, job] : jobs_) {
    if (!job->request.verb.starts_with("people ")) continue;
    if (is_over(job->state)) {
      remove_name_from(*job, name);
    } else {
      job->forgotten_names.push_back(name);
    }
  }
}

void Jobs::remove_name_from(Job& job, const std::string& name) {
  try {
    const Json before = stored(job);
    Json request = Json::array({job.request.inputs, job.request.flags});
    remove_name(request, name);
    if (request != Json::array({job.request.inputs, job.request.flags})) {
      job.request.inputs = request[0].get<std::vector<std::string>>();
      job.request.flags = request[1];
      job.shell_text = "tarsier " + job.request.verb;
    }
    job.name = without_name(job.name, name);
    job.error = without_name(job.error, name);
    remove_name(job.progress, name);
    for (std::string& line : job.lines) line = line_without_name(line, name);
    job.is_new = true;
    if (stored(job) != before) save(job);
    const std::string folder = host_.workspace.job_folder(job.id);
    for (const char* file : {"/lines.jsonl", "/log.txt"})
      remove_name_from_file(folder + file, name);
    for (const FileInfo& file : host_.workspace.job_files(job.id)) {
      if (file.type == FileType::kOther)
        remove_name_from_file(folder + "/files/" + file.name, name);
    }
  } catch (const std::exception& error) {  // a full disk: the other jobs lose the name
    log_warning("job {}: a forgotten name may be left: {}", job.id, error.what());
  }
}

}  // namespace tarsier::web
