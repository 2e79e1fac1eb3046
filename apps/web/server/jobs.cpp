// SPDX-License-Identifier: MIT
#include "jobs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "audit_log.h"
#include "job_feed.h"
#include "router.h"
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <filesystem>
#include <random>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Json = nlohmann::json;

constexpr auto kPublishEvery = std::chrono::milliseconds(400);
constexpr auto kSpaceEvery = std::chrono::seconds(2);
constexpr auto kCurveEvery = std::chrono::milliseconds(500);
constexpr std::size_t kMaxShown = 64U << 10U;  // bytes of lines in one answer
constexpr std::size_t kMaxStored = 1U << 20U;

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

// Sorts by time, and nobody guesses the next.
std::string new_id() {
  static std::mutex mutex;
  static std::mt19937_64 random{std::random_device{}()};
  const auto now = std::chrono::system_clock::now();
  const auto ms =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()) % 1000;
  const std::lock_guard lock(mutex);
  return fmt::format("{:%Y%m%d-%H%M%S}-{:03}-{:06x}",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(now)), ms.count(),
                     random() & 0xffffffU);
}

JobState state_of(const std::string& name) {
  for (const JobState state : {JobState::kQueued, JobState::kRunning, JobState::kDone,
                               JobState::kFailed, JobState::kCancelled, JobState::kInterrupted}) {
    if (name_of(state) == name) return state;
  }
  return JobState::kFailed;
}

bool is_over(JobState state) { return state != JobState::kQueued && state != JobState::kRunning; }

Json time_or_null(double seconds) { return seconds > 0 ? Json(seconds) : Json(nullptr); }

// Appends to a file up to a limit.
class BoundedFile {
 public:
  ~BoundedFile() { close(); }
  void open(const std::string& path, std::uint64_t most, bool fresh) {
    close();
    fd_ = ::open(path.c_str(),
                 O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW | (fresh ? O_TRUNC : 0),
                 0600);
    struct stat status {};
    written_ =
        fd_ >= 0 && ::fstat(fd_, &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
    most_ = most;
  }
  void add(std::string_view line) {
    if (fd_ < 0 || written_ > most_) return;
    std::string text(line);
    text += '\n';
    if (written_ + text.size() > most_) text = "(more is left out)\n";
    written_ += text.size() + (text.front() == '(' ? most_ : 0);
    try {
      write_all(fd_, text, "job");
    } catch (const Error& error) {
      log_warning("a job's lines: {}", error.what());
      written_ = most_ + 1;
    }
  }
  void close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }

 private:
  int fd_ = -1;
  std::uint64_t written_ = 0;
  std::uint64_t most_ = 0;
};

// The last lines of a file.
std::deque<std::string> tail_of(const std::string& path, std::size_t lines) {
  std::deque<std::string> tail;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return tail;
  constexpr off_t kTail = 256 << 10;
  const off_t size = ::lseek(fd, 0, SEEK_END);
  const off_t from = std::max<off_t>(0, size - kTail);
  std::string text(static_cast<std::size_t>(size - from), '\0');
  const ssize_t count = ::pread(fd, text.data(), text.size(), from);
  ::close(fd);
  text.resize(static_cast<std::size_t>(std::max<ssize_t>(0, count)));
  std::size_t at = from > 0 ? std::min(text.find('\n'), text.size() - 1) + 1 : 0;
  while (at < text.size()) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string::npos) break;  // cut short by a kill
    tail.push_back(text.substr(at, end - at));
    if (tail.size() > lines) tail.pop_front();
    at = end + 1;
  }
  return tail;
}

// A line whose long lists (all files that were searched) are cut, with their lengths beside them:
// lines.jsonl has it whole.
std::string shortened(const std::string& line) {
  constexpr std::size_t kMost = 500;
  const Json whole = Json::parse(line, nullptr, false);
  if (!whole.is_object()) return {};
  Json object = whole;
  for (const auto& [name, value] : whole.items()) {
    if (!value.is_array() || value.size() <= kMost) continue;
    object[name] = Json(std::vector<Json>(value.begin(), value.begin() + kMost));
    object[name + "_count"] = value.size();
  }
  return to_text(object);
}

constexpr std::size_t kLongLine = 256U << 10U;
constexpr std::string_view kForgotten = "(forgotten)";
constexpr std::string_view kErrorMark = "tarsier: error: ";

}  // namespace

std::optional<Json> progress_of(std::string_view line) {
  if (!line.starts_with("{\"progress\":")) return std::nullopt;
  const Json json = Json::parse(line, nullptr, false);
  if (!json.is_object() || !json["progress"].is_string()) return std::nullopt;
  const auto number = [&](const char* name) {
    return json.contains(name) && json[name].is_number() ? json[name] : Json(nullptr);
  };
  const bool has_unit = json.contains("unit") && json["unit"].is_string();
  Json progress = {{"label", json["progress"]},
                   {"done", number("done")},
                   {"total", number("total")},
                   {"unit", has_unit ? json["unit"] : Json("")}};
  for (const auto& [name, value] : json.items()) {
    const bool is_ours = name == "done" || name == "total" || name == "seconds";
    if (!is_ours && value.is_number()) progress["values"][name] = value;
  }
  return progress;
}

// ---- VerbHost

CommandLine VerbHost::command(const VerbRequest& request, Use use,
                              const std::string& output_folder) const {
  return command_line(verbs, request, use,
                      {[this](const std::string& reference, bool must_exist) {
                         return workspace.resolve(reference, must_exist);
                       },
                       source, output_folder});
}

void VerbHost::tell_audit(const CommandLine& line, const VerbRequest& request,
                          const std::string& address) const {
  if (line.audit.empty()) return;
  Json details = {{"verb", request.verb}};
  const bool has_person = request.verb == "people enroll" || request.verb == "people forget";
  if (has_person && !request.inputs.empty()) {
    Sha256 sum;
    sum.add(request.inputs.front());
    details["person_sha256"] = sum.hex();
  }
  audit.write(line.audit, address, details);
}

ChildOptions VerbHost::child(const CommandLine& line, const std::string& folder) const {
  ChildOptions options;
  options.arguments.push_back(program);
  options.arguments.insert(options.arguments.end(), line.words.begin(), line.words.end());
  // No window on the desktop of the server's machine.
  options.environment = {{"DISPLAY", ""}, {"WAYLAND_DISPLAY", ""}};
  options.folder = folder;
  return options;
}

std::string VerbHost::public_line(std::string_view line, const CommandLine& command) const {
  std::string text(line);
  for (const auto& [secret, shown] : command.secrets) {
    if (secret.empty()) continue;
    for (std::size_t at = text.find(secret); at != std::string::npos; at = text.find(secret, at)) {
      text.replace(at, secret.size(), shown);
      at += shown.size();
    }
  }
  return workspace.with_references(std::move(text));
}

// ---- Jobs

std::string_view name_of(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return "queued";
    case JobState::kRunning:
      return "running";
    case JobState::kDone:
      return "done";
    case JobState::kFailed:
      return "failed";
    case JobState::kCancelled:
      return "cancelled";
    case JobState::kInterrupted:
      break;
  }
  return "interrupted";
}

struct Jobs::Job {
  std::string id;
  VerbRequest request;
  std::string name;
  std::string shown;  // the command
  JobState state = JobState::kQueued;
  Json progress;
  double created = 0, started = 0, ended = 0;
  std::optional<int> exit;
  std::string error;
  std::deque<std::string> lines;
  // While it runs:
  CommandLine command;
  std::unique_ptr<ChildProcess> child;
  std::optional<ChildEnd> end;
  bool cancelled = false;
  std::string stopped_because;  // by the server itself
  std::string last_error;
  BoundedFile output, log;
  bool is_new = true;  // something to publish
  Clock::time_point published{};
  Clock::time_point measured{};
  std::string measured_stage;
};

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
    ending_ = true;
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
    job->child.reset();  // kills what is left
    if (job->state == JobState::kRunning) {
      job->state = JobState::kInterrupted;
      job->error = "the studio was stopped while it ran";
      job->ended = now_seconds();
      save(*job);
    }
  }
}

void Jobs::save(const Job& job) const {
  const Json json = {{"id", job.id},
                     {"verb", job.request.verb},
                     {"inputs", job.request.inputs},
                     {"flags", job.request.flags},
                     {"name", job.name},
                     {"command", job.shown},
                     {"state", name_of(job.state)},
                     {"progress", job.progress},
                     {"created", job.created},
                     {"started", job.started},
                     {"ended", job.ended},
                     {"exit", job.exit ? Json(*job.exit) : Json(nullptr)},
                     {"error", job.error}};
  write_file_atomically(host_.workspace.jobs_folder() + '/' + job.id + "/job.json",
                        to_text(json) + '\n');
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
      job->shown = json.value("command", "");
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
        job->error = "the studio ended while it ran; start it again";
        job->ended = now_seconds();
        save(*job);
      }
      jobs_[job->id] = std::move(job);
    } catch (const std::exception& trouble) {  // not ours, or broken: it is left alone
      log_warning("{}: no job: {}", folder, trouble.what());
    }
  }
}

Json Jobs::json_of(const Job& job, bool whole) const {
  Json json = {{"id", job.id},
               {"verb", job.request.verb},
               {"inputs", job.request.inputs},
               {"flags", job.request.flags},
               {"name", job.name},
               {"command", job.shown},
               {"state", name_of(job.state)},
               {"progress", job.progress},
               {"created", job.created},
               {"started", time_or_null(job.started)},
               {"ended", time_or_null(job.ended)},
               {"exit", job.exit ? Json(*job.exit) : Json(nullptr)},
               {"error", job.error.empty() ? Json(nullptr) : Json(job.error)},
               {"lines", Json::array()},
               {"files", Json::array()}};
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
  job->shown = command.shown;
  host_.workspace.check_space(0);

  const Lock lock(mutex_);
  if (jobs_.size() >= options_.kept) {
    throw HttpError(429, fmt::format("{} jobs are kept already; delete some", jobs_.size()));
  }
  const auto queued = std::count_if(jobs_.begin(), jobs_.end(), [](const auto& entry) {
    return entry.second->state == JobState::kQueued;
  });
  if (static_cast<std::size_t>(queued) >= options_.queued) {
    throw HttpError(429,
                    fmt::format("{} jobs wait already; cancel some, or come back later", queued));
  }
  if (::mkdir(folder.c_str(), 0700) != 0 || ::mkdir((folder + "/files").c_str(), 0700) != 0) {
    throw HttpError(507, fmt::format("the job's folder cannot be made: {}", std::strerror(errno)));
  }
  job->created = now_seconds();
  save(*job);
  sync_folder(folder);
  host_.tell_audit(command, job->request, address);
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
  if (is_over(job->state)) throw HttpError(409, "the job is over");
  job->cancelled = true;
  if (job->state == JobState::kRunning) {
    if (job->child) job->child->interrupt(options_.patience);
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
  if (!is_over(job->state)) throw HttpError(409, "the job is not over; cancel it first");
  const std::string folder = host_.workspace.job_folder(id);
  ::unlink((folder + "/job.json").c_str());  // first: what is left of a kill here is no job
  host_.workspace.forget_thumbnails(folder);
  std::error_code error;
  fs::remove_all(folder, error);
  if (error) throw HttpError(500, fmt::format("the job cannot be deleted: {}", error.message()));
  jobs_.erase(id);
  feed_.publish(id, to_text(Json{{"id", id}, {"state", "deleted"}}));
}

Json Jobs::again(const std::string& id, const std::string& address) {
  Json fresh;
  {
    const Lock lock(mutex_);
    const auto job = find(id);
    if (!is_over(job->state)) throw HttpError(409, "the job is not over");
    if (job->state != JobState::kDone) {
      const CommandLine command =
          host_.command(job->request, Use::kJob, host_.workspace.job_folder(id) + "/files");
      job->shown = command.shown;
      job->state = JobState::kQueued;
      job->progress = nullptr;
      job->started = job->ended = 0;
      job->exit.reset();
      job->error.clear();
      job->lines.clear();
      job->cancelled = false;
      job->is_new = true;
      save(*job);
      host_.tell_audit(command, job->request, address);
      changed_.notify_all();
      return json_of(*job, true);
    }
    fresh = {{"verb", job->request.verb},
             {"inputs", job->request.inputs},
             {"flags", job->request.flags},
             {"name", job->name}};
  }
  return start(fresh, address);
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

void Jobs::take_output(Job& job, std::string_view line) {
  const std::string text = host_.public_line(line, job.command);
  const Lock lock(mutex_);
  job.output.add(text);
  keep_line(job, text);
}

void Jobs::keep_line(Job& job, std::string line) const {
  if (line.size() > kLongLine) line = shortened(line);
  job.lines.push_back(std::move(line));
  if (job.lines.size() > options_.lines) job.lines.pop_front();
  job.is_new = true;
}

void Jobs::take_message(Job& job, std::string_view line) {
  if (auto progress = progress_of(line)) {
    const Lock lock(mutex_);
    job.progress = std::move(*progress);
    job.is_new = true;
    // What is measured makes a curve: these lines are kept, too; of each stage the first and the
    // last, and some between.
    const auto stage = job.progress["label"].get<std::string>();
    const bool is_due = stage != job.measured_stage ||
                        job.progress["done"] == job.progress["total"] ||
                        Clock::now() - job.measured >= kCurveEvery;
    if (job.progress.contains("values") && is_due) {
      job.measured = Clock::now();
      job.measured_stage = stage;
      job.output.add(line);
      keep_line(job, std::string(line));
    }
    return;
  }
  const std::string text = host_.public_line(line, job.command);
  const Lock lock(mutex_);
  job.log.add(text);
  if (text.starts_with(kErrorMark)) job.last_error = text.substr(kErrorMark.size());
}

void Jobs::begin(const std::shared_ptr<Job>& job, Lock& lock) {
  const std::string folder = host_.workspace.job_folder(job->id);
  job->state = JobState::kRunning;
  job->started = now_seconds();
  job->end.reset();
  job->last_error.clear();
  job->stopped_because.clear();
  job->is_new = true;
  const auto fail = [&](const std::string& why) {
    job->state = JobState::kFailed;
    job->error = why;
    job->ended = now_seconds();
    save(*job);
  };
  try {
    host_.workspace.check_space(0);
    job->command = host_.command(job->request, Use::kJob, folder + "/files");
    save(*job);
    job->output.open(folder + "/lines.jsonl", options_.line_bytes, true);
    job->log.open(folder + "/log.txt", options_.log_bytes, true);
    ChildOptions options = host_.child(job->command, folder + "/files");
    options.niceness = 10;  // live sessions go first
    options.max_line = 16U << 20U;
    Job* const raw = job.get();
    options.on_output = [this, raw](std::string_view line) { take_output(*raw, line); };
    options.on_message = [this, raw](std::string_view line) { take_message(*raw, line); };
    lock.unlock();
    std::unique_ptr<ChildProcess> child;
    std::string trouble;
    try {
      child = std::make_unique<ChildProcess>(std::move(options), [this, raw](const ChildEnd& end) {
        const Lock inner(mutex_);
        raw->end = end;
        changed_.notify_all();
      });
    } catch (const std::exception& error) {
      trouble = error.what();
    }
    lock.lock();
    if (!child) return fail(trouble);
    job->child = std::move(child);
    if (job->cancelled || ending_) job->child->interrupt(options_.patience);
  } catch (const std::exception& error) {  // a set that is gone meanwhile, a full disk
    if (!lock.owns_lock()) lock.lock();
    fail(error.what());
  }
}

void Jobs::finish(const std::shared_ptr<Job>& job, Lock& lock) {
  std::unique_ptr<ChildProcess> child = std::move(job->child);
  lock.unlock();
  child.reset();
  lock.lock();
  const ChildEnd end = *job->end;
  job->output.close();
  job->log.close();
  job->exit = end.exit;
  job->ended = now_seconds();
  const bool is_done = end.exit == static_cast<int>(ExitStatus::kDone) ||
                       end.exit == static_cast<int>(ExitStatus::kNothingFound);
  if (!job->stopped_because.empty()) {
    job->state = JobState::kFailed;
    job->error = job->stopped_because;
  } else if (ending_ && !job->cancelled && !is_done) {
    job->state = JobState::kInterrupted;
    job->error = "the studio was stopped while it ran; start it again";
  } else if (job->cancelled && !is_done) {
    job->state = JobState::kCancelled;
    job->error.clear();
  } else if (is_done) {
    job->state = JobState::kDone;
    job->error = job->exit == 0 ? "" : job->last_error;
  } else {
    job->state = JobState::kFailed;
    job->error = job->last_error.empty() ? "the program " + end.text() : job->last_error;
  }
  job->is_new = true;
  save(*job);
  if (is_done && job->request.verb == "people forget") {
    forget_name_now(std::string(job->request.inputs.front()));
  }
}

void Jobs::forget_name(const std::string& name) {
  const Lock lock(mutex_);
  forget_name_now(name);
}

void Jobs::forget_name_now(const std::string& name) {
  for (const auto& [id, job] : jobs_) {
    std::vector<std::string>& inputs = job->request.inputs;
    const bool is_theirs = job->request.verb.starts_with("people ") &&
                           std::find(inputs.begin(), inputs.end(), name) != inputs.end();
    if (!is_theirs || !is_over(job->state)) continue;
    std::replace(inputs.begin(), inputs.end(), name, std::string(kForgotten));
    if (job->name.find(name) != std::string::npos) job->name = kForgotten;
    job->shown = "tarsier " + job->request.verb;
    for (std::string& line : job->lines) {
      Json object = Json::parse(line, nullptr, false);
      if (object.is_object() && object.value("name", Json()) == Json(name))
        object["name"] = kForgotten;
      line = object.is_object() ? to_text(object) : "";
    }
    const std::string folder = host_.workspace.job_folder(id);
    std::string lines;
    for (const std::string& line : job->lines) lines += line + '\n';
    write_file_atomically(folder + "/lines.jsonl", lines);
    write_file_atomically(folder + "/log.txt", "");
    job->error.clear();
    job->is_new = true;
    save(*job);
  }
}

void Jobs::publish(Job& job) {
  job.is_new = false;
  job.published = Clock::now();
  feed_.publish(job.id, to_text(json_of(job, true)));
}

void Jobs::check_space() {
  std::string trouble;
  try {
    host_.workspace.check_space(0);
  } catch (const HttpError& error) {
    trouble = error.what();
  }
  if (trouble.empty()) return;
  for (const auto& [id, job] : jobs_) {
    if (job->state != JobState::kRunning || !job->child || !job->stopped_because.empty()) continue;
    job->stopped_because = trouble;
    job->child->interrupt(options_.patience);
  }
}

void Jobs::schedule() {
  Clock::time_point space{};
  Lock lock(mutex_);
  while (true) {
    try {
      int running = 0;
      std::shared_ptr<Job> next;
      for (const auto& [id, job] : std::map(jobs_)) {
        if (job->state == JobState::kRunning && job->end) finish(job, lock);
        if (job->state == JobState::kRunning) ++running;
        if (job->state == JobState::kQueued && !next) next = job;
      }
      const bool starts = next && running < options_.parallel && !ending_;
      if (starts) begin(next, lock);
      const auto now = Clock::now();
      for (const auto& [id, job] : jobs_) {
        if (job->is_new && (is_over(job->state) || now - job->published >= kPublishEvery))
          publish(*job);
      }
      if (running > 0 && now - space > kSpaceEvery) {
        space = now;
        check_space();
      }
      if (ending_ && running == 0) return;
      if (starts) continue;
    } catch (const std::exception& error) {  // a full disk: the state in memory goes on
      log_warning("jobs: {}", error.what());
      if (!lock.owns_lock()) lock.lock();
      if (ending_) return;
    }
    const bool busy = std::any_of(jobs_.begin(), jobs_.end(), [](const auto& entry) {
      return !is_over(entry.second->state) || entry.second->is_new;
    });
    if (busy) {
      changed_.wait_for(lock, kPublishEvery);
    } else {
      changed_.wait(lock);
    }
  }
}

}  // namespace tarsier::web
