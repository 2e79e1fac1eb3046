// SPDX-License-Identifier: MIT
#include "live_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include "router.h"
#include "verb_policy.h"
#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kLogLines = 200;
constexpr std::size_t kLogLine = 4096;
constexpr std::size_t kMaxOutbox = 256 << 10;
constexpr milliseconds kRateWindow{2000};
constexpr milliseconds kKillDelay{300};  // between the request to end and the kill

// An integer member of a child's record; -1 if there is none.
std::int64_t whole_number(const nlohmann::json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number_integer() ? found->get<std::int64_t>() : -1;
}

void close_fd(int& fd) {
  if (fd >= 0) ::close(std::exchange(fd, -1));
}

}  // namespace

void Waker::wake() {
  {
    const std::lock_guard lock(mutex_);
    is_due_ = true;
  }
  changed_.notify_one();
}

void Waker::wait(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, timeout, [&] { return is_due_; });
  is_due_ = false;
}

std::uint32_t LiveSession::Image::age_now() const {
  const auto since = std::chrono::duration_cast<milliseconds>(Clock::now() - received).count();
  return age_ms + static_cast<std::uint32_t>(std::clamp<std::int64_t>(since, 0, 1'000'000'000));
}

LiveSession::LiveSession(Options options) : options_(std::move(options)) {
  if (!options_.folder.empty() && ::mkdir(options_.folder.c_str(), 0700) != 0) {
    throw HttpError(507, fmt::format("the session's folder cannot be made: {}", errno_text(errno)));
  }
  const PipeEnds events = make_pipe();
  PipeEnds records{};
  PipeEnds camera{};
  const auto close_all = [&] {
    for (int* fd : {&records.read_end, &records.write_end, &camera.read_end, &camera.write_end})
      close_fd(*fd);
    ::close(events.read_end);
    ::close(events.write_end);
  };
  try {
    records = make_pipe();
    if (options_.has_camera) camera = make_pipe();
    ChildOptions child;
    child.arguments = options_.arguments;
    child.folder = options_.folder;
    child.environment = options_.environment;
    child.environment.emplace_back("TARSIER_WINDOW", "pipe:3:4");
    child.pipes = {{3, events.read_end}, {4, records.write_end}};
    if (options_.has_camera) {
      child.environment.emplace_back("TARSIER_VIEWER", "5");
      child.pipes.push_back({5, camera.read_end});
    }
    child.on_output = [this](std::string_view line) { append_line(output_, line); };
    child.on_message = [this](std::string_view line) { append_line(log_, line); };
    ::fcntl(records.read_end, F_SETPIPE_SZ, 1 << 20);  // a smaller one works, too
    ::fcntl(records.read_end, F_SETFL, O_NONBLOCK);
    ::fcntl(events.write_end, F_SETFL, O_NONBLOCK);
    if (options_.has_camera) ::fcntl(camera.write_end, F_SETFL, O_NONBLOCK);
    wake_fd_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    child_ = std::make_unique<ChildProcess>(std::move(child),
                                            [this](const ChildEnd& end) { handle_end(end); });
  } catch (...) {
    close_all();
    close_fd(wake_fd_);
    remove_folder();
    throw;
  }
  ::close(events.read_end);
  ::close(records.write_end);
  close_fd(camera.read_end);
  events_fd_ = events.write_end;
  records_fd_ = records.read_end;
  camera_fd_ = camera.write_end;
  thread_ = std::thread([this] { work(); });
}

LiveSession::~LiveSession() {
  close();
  (void)child_->wait(kKillDelay + milliseconds(100));
  {
    const std::lock_guard lock(mutex_);
    is_destroyed_ = true;
  }
  wake_worker();
  thread_.join();  // before the child is destroyed, which the thread may be about to interrupt
  child_.reset();  // kills
  remove_folder();
  close_fd(records_fd_);
  close_fd(events_fd_);
  close_fd(camera_fd_);
  close_fd(wake_fd_);
}

void LiveSession::remove_folder() const {
  std::error_code error;
  if (!options_.folder.empty()) std::filesystem::remove_all(options_.folder, error);
}

void LiveSession::wake_worker() const {
  const std::uint64_t one = 1;
  (void)!::write(wake_fd_, &one, sizeof one);
}

void LiveSession::close() {
  {
    const std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  handled_.notify_all();
  child_->interrupt(kKillDelay);
  wake_worker();
}

bool LiveSession::is_running() const {
  const std::lock_guard lock(mutex_);
  return !end_;
}

// --- the pipes ---

void LiveSession::work() {
  WindowRecords records;
  std::vector<char> buffer(256 << 10);
  while (true) {
    bool wants_events = false;
    bool wants_camera = false;
    {
      const std::lock_guard lock(mutex_);
      if (is_destroyed_) return;
      wants_events = !outbox_.empty() && events_fd_ >= 0;
      if (is_closing_ && outbox_.empty()) close_fd(events_fd_);
      if (camera_now_.empty() && camera_next_ != nullptr && camera_fd_ >= 0) {
        const auto size = static_cast<std::uint32_t>(camera_next_->size());
        for (int shift = 24; shift >= 0; shift -= 8)
          camera_now_ += static_cast<char>(size >> static_cast<unsigned>(shift));
        camera_now_ += *camera_next_;
        camera_next_.reset();
        camera_written_ = 0;
      }
      if (has_camera_ended_ && camera_now_.empty()) close_fd(camera_fd_);
      wants_camera = !camera_now_.empty() && camera_fd_ >= 0;
    }
    std::array<pollfd, 4> items{
        pollfd{records_fd_, POLLIN, 0}, pollfd{wants_events ? events_fd_ : -1, POLLOUT, 0},
        pollfd{wants_camera ? camera_fd_ : -1, POLLOUT, 0}, pollfd{wake_fd_, POLLIN, 0}};
    if (::poll(items.data(), items.size(), -1) < 0 && errno != EINTR) return;
    if (items[3].revents != 0) {
      std::uint64_t count = 0;
      (void)!::read(wake_fd_, &count, sizeof count);
    }
    if (items[1].revents != 0) write_events();
    if (items[2].revents != 0) write_camera();
    if (items[0].revents == 0) continue;
    const ssize_t count = ::read(records_fd_, buffer.data(), buffer.size());
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count <= 0) {
      close_fd(records_fd_);
      continue;
    }
    records.feed({buffer.data(), static_cast<std::size_t>(count)});
    while (auto record = records.take()) take_record(record->kind, std::move(record->payload));
    if (records.is_broken()) {
      log_warning("session {}: its window sent an invalid record", options_.id);
      close_fd(records_fd_);
      child_->interrupt(kKillDelay);
    }
  }
}

void LiveSession::write_events() {
  const std::lock_guard lock(mutex_);
  while (!outbox_.empty() && events_fd_ >= 0) {
    const ssize_t count = ::write(events_fd_, outbox_.data(), outbox_.size());
    if (count > 0) {
      outbox_.erase(0, static_cast<std::size_t>(count));
    } else if (errno == EAGAIN) {
      return;
    } else if (errno != EINTR) {
      outbox_.clear();
      close_fd(events_fd_);  // EPIPE: its window is closed
    }
  }
}

void LiveSession::write_camera() {
  while (camera_written_ < camera_now_.size()) {
    const ssize_t count = ::write(camera_fd_, camera_now_.data() + camera_written_,
                                  camera_now_.size() - camera_written_);
    if (count > 0) {
      camera_written_ += static_cast<std::size_t>(count);
    } else if (errno == EAGAIN) {
      return;
    } else if (errno != EINTR) {
      close_fd(camera_fd_);
      break;
    }
  }
  camera_now_.clear();
  camera_written_ = 0;
}

void LiveSession::take_record(char kind, std::string payload) {
  if (kind == 'J') {
    if (payload.size() < 8) return;
    Image image;
    image.frame = read_u32(payload.data());
    image.age_ms = read_u32(payload.data() + 4);
    image.received = Clock::now();
    payload.erase(0, 8);
    image.jpeg = std::make_shared<const std::string>(std::move(payload));
    const std::lock_guard lock(mutex_);
    image.number = image_.number + 1;
    image_ = std::move(image);
    is_image_requested_ = false;
    wake_viewers();
    return;
  }
  if (kind == 'D') {
    auto record = std::make_shared<const std::string>(std::move(payload));
    const std::lock_guard lock(mutex_);
    stages_ = {stages_.number + 1, std::move(record)};
    are_stages_requested_ = false;
    wake_viewers();
    return;
  }
  if (kind != 'H' && kind != 'S') return;  // of a later version
  nlohmann::json value = nlohmann::json::parse(payload, nullptr, false);
  if (!value.is_object()) {
    log_warning("session {}: its window sent invalid JSON", options_.id);
    return;
  }
  if (kind == 'S') take_forgotten(value);
  auto text =
      std::make_shared<const std::string>(without_secrets(to_text(value), options_.secrets));
  const std::lock_guard lock(mutex_);
  VersionedJson& message = kind == 'H' ? hello_ : state_;
  ++message.number;
  message.json = std::move(text);
  if (kind == 'H') {
    hello_json_ = std::move(value);
  } else {
    const auto frame = value.find("frame");
    if (frame != value.end() && frame->is_object()) {
      const std::int64_t index = whole_number(*frame, "index");
      if (index != last_index_) {
        last_index_ = index;
        ++frames_;
        frame_times_.push_back(Clock::now());
        while (frame_times_.back() - frame_times_.front() > kRateWindow) frame_times_.pop_front();
      }
    }
    events_handled_ = std::max(events_handled_, whole_number(value, "events"));
    handled_.notify_all();
    state_json_ = std::move(value);
  }
  wake_viewers();
}

// Takes the names of deleted people out of a state: viewers do not get them.
void LiveSession::take_forgotten(nlohmann::json& value) {
  const auto state = value.find("state");
  if (state == value.end() || !state->is_object()) return;
  const nlohmann::json names = state->value("forgotten", nlohmann::json::array());
  state->erase("forgotten");
  if (!names.is_array()) return;
  for (; forgotten_count_ < names.size(); ++forgotten_count_) {
    const nlohmann::json& name = names[forgotten_count_];
    if (name.is_string() && options_.on_forgotten) options_.on_forgotten(name);
  }
}

// --- what is known ---

void LiveSession::append_line(std::deque<std::string>& lines, std::string_view line) {
  std::string text = without_secrets(std::string(line.substr(0, kLogLine)), options_.secrets);
  const std::lock_guard lock(mutex_);
  lines.push_back(std::move(text));
  if (lines.size() > kLogLines) lines.pop_front();
}

void LiveSession::handle_end(const ChildEnd& end) {
  {
    const std::lock_guard lock(mutex_);
    end_ = end;
    constexpr std::string_view kMark = "error: ";
    // We stopped it: what it then reports is not an error.
    if (!is_closing_ && end.exit != 0) {
      for (auto line = log_.rbegin(); line != log_.rend() && error_.empty(); ++line) {
        const std::size_t at = line->find(kMark);
        if (at != std::string::npos) error_ = line->substr(at + kMark.size());
      }
      if (end.signal != 0 || error_.empty())
        error_ = error_.empty() ? "the session " + end.text()
                                : fmt::format("the session {}; {}", end.text(), error_);
    }
    nlohmann::json value{{"exit", end.exit}, {"error", nullptr}};
    if (!error_.empty()) value["error"] = error_;
    ended_ = {1, std::make_shared<const std::string>(to_text(value))};
    handled_.notify_all();
    wake_viewers();
  }
  if (options_.on_end) options_.on_end();
}

void LiveSession::wake_viewers() {
  for (const Viewer& viewer : viewers_) viewer.waker->wake();
}

void LiveSession::apply_viewer_settings() {
  int widest = kNoImages;
  int quality = 0;
  for (const Viewer& viewer : viewers_) {
    if (viewer.max_width == kNoImages) continue;
    const bool is_whole = viewer.max_width == 0 || widest == 0;
    widest = is_whole ? 0 : std::max(widest, viewer.max_width);
    quality = std::max(quality, viewer.quality);
  }
  // Nobody watches: keep the settings, so that a reloaded page changes nothing.
  if (widest == kNoImages || end_) return;
  if (widest == max_width_ && quality == quality_) return;
  if (widest != max_width_) outbox_ += fmt::format("{{\"max_width\":{}}}\n", widest);
  if (quality != quality_) outbox_ += fmt::format("{{\"quality\":{}}}\n", quality);
  max_width_ = widest;
  quality_ = quality;
  // An image that was requested earlier may be in transit.
  first_fitting_image_ = image_.number + (is_image_requested_ ? 2 : 1);
}

nlohmann::json LiveSession::describe() const {
  const std::lock_guard lock(mutex_);
  const auto member = [](const nlohmann::json& object, const char* name) {
    const auto found = object.find(name);
    return found == object.end() ? nlohmann::json() : *found;
  };
  nlohmann::json value{{"id", options_.id},
                       {"verb", options_.verb},
                       {"name", options_.name},
                       {"inputs", options_.inputs},
                       {"flags", options_.flags},
                       {"command", options_.shell_text},
                       {"running", !end_},
                       {"exit", nullptr},
                       {"error", nullptr},
                       {"title", member(hello_json_, "title")},
                       {"actions", member(hello_json_, "actions")},
                       {"sliders", member(hello_json_, "sliders")},
                       {"stages", member(hello_json_, "stages") == true},
                       {"status", member(state_json_, "status")},
                       {"state", member(state_json_, "state")},
                       {"width", member(state_json_, "width")},
                       {"height", member(state_json_, "height")},
                       {"frames", frames_},
                       {"viewers", viewers_.size()},
                       {"log", log_},
                       {"output", output_}};
  for (const char* name : {"actions", "sliders"}) {
    if (!value[name].is_array()) value[name] = nlohmann::json::array();
  }
  if (end_) value["exit"] = end_->exit;
  if (!error_.empty()) value["error"] = error_;
  const Clock::time_point now = Clock::now();
  double rate = 0;
  if (frame_times_.size() > 1 && now - frame_times_.back() < kRateWindow) {
    const double span =
        std::chrono::duration<double>(frame_times_.back() - frame_times_.front()).count();
    if (span > 0) rate = static_cast<double>(frame_times_.size() - 1) / span;
  }
  value["fps"] = std::round(rate * 10) / 10;
  value["age_ms"] = nullptr;
  const auto frame = state_json_.find("frame");
  if (image_.number > 0)
    value["age_ms"] = image_.age_now();
  else if (frame != state_json_.end() && frame->is_object())
    value["age_ms"] = member(*frame, "age_ms");
  if (!options_.secrets.empty()) {
    // States contain names of sources, too.
    nlohmann::json cleaned =
        nlohmann::json::parse(without_secrets(to_text(value), options_.secrets), nullptr, false);
    if (!cleaned.is_discarded()) return cleaned;
  }
  return value;
}

std::optional<std::int64_t> LiveSession::send(std::string_view lines) {
  std::int64_t events = 0;
  {
    const std::lock_guard lock(mutex_);
    if (end_ || is_closing_ || outbox_.size() + lines.size() > kMaxOutbox) return std::nullopt;
    outbox_ += lines;
    events_sent_ += std::count(lines.begin(), lines.end(), '\n');
    events = events_sent_;
  }
  wake_worker();
  return events;
}

bool LiveSession::wait_until_handled(std::int64_t events, milliseconds timeout) {
  std::unique_lock lock(mutex_);
  (void)handled_.wait_for(lock, timeout,
                          [&] { return events_handled_ >= events || end_ || is_closing_; });
  return events_handled_ >= events || (end_ && end_->exit == 0);
}

LiveSession::Image LiveSession::image() const {
  const std::lock_guard lock(mutex_);
  return image_;
}

void LiveSession::request_image() {
  {
    const std::lock_guard lock(mutex_);
    if (is_image_requested_ || end_) return;
    is_image_requested_ = true;
    outbox_ += "{\"want\":1}\n";
  }
  wake_worker();
}

LiveSession::VersionedJson LiveSession::hello() const {
  const std::lock_guard lock(mutex_);
  return hello_;
}

LiveSession::VersionedJson LiveSession::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}

LiveSession::VersionedJson LiveSession::ended() const {
  const std::lock_guard lock(mutex_);
  return ended_;
}

std::uint64_t LiveSession::first_fitting_image() const {
  const std::lock_guard lock(mutex_);
  return first_fitting_image_;
}

LiveSession::Stages LiveSession::stages() const {
  const std::lock_guard lock(mutex_);
  return stages_;
}

bool LiveSession::request_stages() {
  {
    const std::lock_guard lock(mutex_);
    const auto gives = hello_json_.find("stages");
    if (end_ || gives == hello_json_.end() || *gives != true) return false;
    if (are_stages_requested_) return true;
    are_stages_requested_ = true;
    outbox_ += "{\"stages\":1}\n";
  }
  wake_worker();
  return true;
}

void LiveSession::add_viewer(const std::shared_ptr<Waker>& viewer, int max_width) {
  {
    const std::lock_guard lock(mutex_);
    viewers_.push_back({viewer, max_width});
    apply_viewer_settings();
  }
  wake_worker();
}

void LiveSession::remove_viewer(const std::shared_ptr<Waker>& viewer) {
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(viewers_, [&](const Viewer& one) { return one.waker == viewer; });
    apply_viewer_settings();
  }
  wake_worker();
}

void LiveSession::set_quality(const std::shared_ptr<Waker>& viewer, int quality) {
  {
    const std::lock_guard lock(mutex_);
    for (Viewer& one : viewers_)
      if (one.waker == viewer) one.quality = quality;
    apply_viewer_settings();
  }
  wake_worker();
}

int LiveSession::quality() const {
  const std::lock_guard lock(mutex_);
  return quality_;
}

void LiveSession::offer_frame(std::shared_ptr<const std::string> jpeg) {
  {
    const std::lock_guard lock(mutex_);
    camera_next_ = std::move(jpeg);
  }
  wake_worker();
}

void LiveSession::end_camera() {
  {
    const std::lock_guard lock(mutex_);
    has_camera_ended_ = true;
  }
  wake_worker();
}

}  // namespace tarsier::web
