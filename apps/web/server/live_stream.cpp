// SPDX-License-Identifier: MIT
#include "live_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <utility>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kPing{2000};
constexpr milliseconds kWait{400};  // interval of checks of a stream without news
constexpr milliseconds kReadTimeout{
    300'000};  // a viewer that reads nothing for this time is disconnected
constexpr milliseconds kMaxImageAge{
    60};  // an older image is not sent before a newer one was requested
constexpr milliseconds kNewerImageWait{50};
constexpr int kUnsent = 16 << 10;  // bytes that may be unsent in the socket when more is written

// Waits until the client has read nearly everything, so that the next image is made late and is
// new. Returns false if it has not within `timeout`.
bool wait_until_writable(int socket, milliseconds timeout) {
  pollfd item{socket, POLLOUT, 0};
  return ::poll(&item, 1, static_cast<int>(timeout.count())) > 0;
}

bool is_gone(int socket) {
  pollfd item{socket, POLLRDHUP, 0};
  return ::poll(&item, 1, 0) > 0 && item.revents != 0;
}

void prepare(int socket) {
  const int unsent = kUnsent;
  (void)::setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
}

// Gives a viewer images that are new when they are sent: it requests one from the child only when
// the client has read the previous data.
class ImageFollower {
 public:
  explicit ImageFollower(std::shared_ptr<LiveSession> session) : session_(std::move(session)) {}

  // The next image; nullopt if the caller must wait.
  std::optional<LiveSession::Image> next() {
    LiveSession::Image image = session_->image();
    const Clock::time_point now = Clock::now();
    if (image.number <= last_) {
      session_->request_image();
      requested_at_.reset();
      return std::nullopt;
    }
    const bool is_recent = now - image.received <= kMaxImageAge;
    if (!is_recent && session_->is_running()) {
      // An old image that nobody took: the child may have a newer one immediately.
      if (!requested_at_) {
        requested_at_ = now;
        session_->request_image();
        return std::nullopt;
      }
      if (now - *requested_at_ < kNewerImageWait) return std::nullopt;
    }
    requested_at_.reset();
    last_ = image.number;
    return image;
  }
  // The maximum time until next() must be called again.
  [[nodiscard]] milliseconds max_wait() const { return requested_at_ ? kNewerImageWait : kWait; }
  [[nodiscard]] LiveSession& session() const { return *session_; }

 private:
  std::shared_ptr<LiveSession> session_;
  std::uint64_t last_ = 0;
  std::optional<Clock::time_point> requested_at_;
};

// Bytes that are sent in pieces.
class Outgoing {
 public:
  [[nodiscard]] bool is_empty() const { return sent_ == text_.size(); }
  std::string& cleared_text() {
    text_.clear();
    sent_ = 0;
    return text_;
  }
  [[nodiscard]] std::size_t size() const { return text_.size(); }
  std::ptrdiff_t take(std::span<char> buffer) {
    const std::size_t count = std::min(buffer.size(), text_.size() - sent_);
    std::memcpy(buffer.data(), text_.data() + sent_, count);
    sent_ += count;
    return static_cast<std::ptrdiff_t>(count);
  }

 private:
  std::string text_;
  std::size_t sent_ = 0;
};

// GET /api/live
class LiveStream final : public BodyStream {
 public:
  LiveStream(std::shared_ptr<StreamSlots::Slot> slot, std::shared_ptr<Waker> waker,
             std::vector<std::string> unknown,
             const std::vector<std::pair<std::shared_ptr<LiveSession>, int>>& sessions,
             const JobFeed* jobs, std::function<ClockTime()> now)
      : now_(std::move(now)),
        slot_(std::move(slot)),
        waker_(std::move(waker)),
        unknown_(std::move(unknown)),
        jobs_(jobs),
        jobs_seen_(jobs == nullptr ? 0 : jobs->newest()) {
    for (const auto& [session, width] : sessions) {
      watched_.emplace_back(session);
      session->add_viewer(waker_, width);
    }
  }
  ~LiveStream() override {
    for (Watched& watched : watched_) watched.images.session().remove_viewer(waker_);
  }

  std::ptrdiff_t read(std::span<char> buffer, int socket) override {
    if (!out_.is_empty()) return out_.take(buffer);
    if (!is_prepared_) {
      prepare(socket);
      is_prepared_ = true;
    }
    const Clock::time_point now = now_();
    if (now - begun_ > StreamSlots::kTurn && slot_->takes_turns()) return -1;
    if (!wait_until_writable(socket, kWait)) return now - last_write_ > kReadTimeout ? -1 : 0;
    last_write_ = now;
    measure();
    if (is_gone(socket)) return -1;
    if (compose()) return out_.take(buffer);
    milliseconds max_wait = kWait;
    for (const Watched& watched : watched_)
      max_wait = std::min(max_wait, watched.images.max_wait());
    waker_->wait(max_wait);
    return compose() ? out_.take(buffer) : 0;
  }

 private:
  struct Watched {
    explicit Watched(std::shared_ptr<LiveSession> session) : images(std::move(session)) {}
    ImageFollower images;
    std::uint64_t hello = 0;
    std::uint64_t state = 0;
    std::uint64_t ended = 0;
  };

  void add_message(std::string& out, LiveRecord kind, const std::string& id,
                   const LiveSession::VersionedJson& message, std::uint64_t& seen) {
    if (message.number <= seen || message.json == nullptr) return;
    seen = message.number;
    append_record(out, kind, id, *message.json);
  }

  // The viewer has read the data: the time it took determines the quality of the next images.
  void measure() {
    if (image_quality_ == 0) return;
    const std::chrono::duration<double> spent = now_() - composed_;
    quality_control_.add_transfer(out_.size(), spent.count(), std::exchange(image_quality_, 0));
    for (Watched& watched : watched_)
      watched.images.session().set_quality(waker_, quality_control_.quality());
  }

  // Composes all news and one image. Returns false if there are none.
  bool compose() {
    std::string& out = out_.cleared_text();
    const Clock::time_point now = now_();
    for (const std::string& id : unknown_)
      append_record(out, LiveRecord::kEnded, id, R"({"exit":null,"error":"no such session"})");
    unknown_.clear();
    for (Watched& watched : watched_) {
      LiveSession& session = watched.images.session();
      add_message(out, LiveRecord::kHello, session.id(), session.hello(), watched.hello);
      add_message(out, LiveRecord::kState, session.id(), session.state(), watched.state);
    }
    if (jobs_ != nullptr) {
      for (const auto& [id, json] : jobs_->since(jobs_seen_))
        append_record(out, LiveRecord::kJob, id, json);
    }
    // Sessions take turns, so that a fast one does not block the others.
    for (std::size_t i = 0; i < watched_.size(); ++i) {
      Watched& watched = watched_[(turn_ + i) % watched_.size()];
      const auto image = watched.images.next();
      if (!image) continue;
      std::string payload = image_head(image->frame, image->age_now());
      payload += *image->jpeg;
      append_record(out, LiveRecord::kImage, watched.images.session().id(), payload);
      image_quality_ = watched.images.session().quality();
      composed_ = now;
      turn_ = (turn_ + i + 1) % watched_.size();
      break;
    }
    for (Watched& watched : watched_) {
      LiveSession& session = watched.images.session();
      add_message(out, LiveRecord::kEnded, session.id(), session.ended(), watched.ended);
    }
    if (out.empty() && now - pinged_ >= kPing) append_record(out, LiveRecord::kPing, "", "");
    if (!out.empty()) pinged_ = now;
    return !out.empty();
  }

  const std::function<ClockTime()> now_;
  const std::shared_ptr<StreamSlots::Slot> slot_;
  const std::shared_ptr<Waker> waker_;
  std::vector<std::string> unknown_;
  const JobFeed* jobs_;
  std::vector<Watched> watched_;
  std::uint64_t jobs_seen_;
  std::size_t turn_ = 0;
  Outgoing out_;
  bool is_prepared_ = false;
  JpegQualityControl quality_control_;
  int image_quality_ = 0;       // of the image in out_; 0: there is none, or it was measured
  Clock::time_point composed_;  // when out_ was composed
  const Clock::time_point begun_ = now_();
  Clock::time_point last_write_ = begun_;
  // Time of the last sent data. Initially long ago, so that the first ping is immediate.
  Clock::time_point pinged_;
};

// GET /api/sessions/ID/stream.mjpg
class MjpegStream final : public BodyStream {
 public:
  MjpegStream(std::shared_ptr<StreamSlots::Slot> slot, std::shared_ptr<LiveSession> session)
      : slot_(std::move(slot)), images_(std::move(session)) {
    images_.session().add_viewer(waker_);
    out_.cleared_text() = "--tarsier-frame\r\n";
  }
  ~MjpegStream() override { images_.session().remove_viewer(waker_); }
  [[nodiscard]] bool is_plain() const override { return true; }

  std::ptrdiff_t read(std::span<char> buffer, int socket) override {
    if (!out_.is_empty()) return out_.take(buffer);
    if (!is_prepared_) {
      prepare(socket);
      is_prepared_ = true;
    }
    const Clock::time_point now = Clock::now();
    if (!wait_until_writable(socket, kWait)) return now - last_write_ > kReadTimeout ? -1 : 0;
    last_write_ = now;
    if (is_gone(socket)) return -1;
    auto image = images_.next();
    if (!image) {
      if (!images_.session().is_running()) return -1;
      waker_->wait(images_.max_wait());
      image = images_.next();
    }
    if (!image) return 0;
    // The boundary follows its part at once: browsers show an image only after it.
    out_.cleared_text() = fmt::format(
        "Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n{}\r\n--tarsier-frame\r\n",
        image->jpeg->size(), *image->jpeg);
    return out_.take(buffer);
  }

 private:
  const std::shared_ptr<StreamSlots::Slot> slot_;
  const std::shared_ptr<Waker> waker_ = std::make_shared<Waker>();
  ImageFollower images_;
  Outgoing out_;
  bool is_prepared_ = false;
  Clock::time_point last_write_ = Clock::now();
};

}  // namespace

StreamSlots::Slot::~Slot() {
  const std::lock_guard lock(owner_.mutex_);
  --owner_.count_;
  const auto own = owner_.of_viewer_.find(viewer_);
  if (own != owner_.of_viewer_.end() && --own->second == 0) owner_.of_viewer_.erase(own);
}

bool StreamSlots::Slot::takes_turns() const {
  if (viewer_.empty()) return false;
  const std::lock_guard lock(owner_.mutex_);
  return owner_.of_viewer_.at(viewer_) > kMaxConcurrent;
}

std::shared_ptr<StreamSlots::Slot> StreamSlots::take(const std::string& viewer) {
  const std::lock_guard lock(mutex_);
  if (count_ >= max_streams_)
    throw HttpError(503, fmt::format("the limit of {} live streams is reached; close another page",
                                     max_streams_));
  auto slot = std::make_shared<Slot>(*this, viewer);
  ++count_;
  ++of_viewer_[viewer];
  return slot;
}

std::unique_ptr<BodyStream> make_live_stream(
    std::shared_ptr<StreamSlots::Slot> slot, std::shared_ptr<Waker> waker,
    std::vector<std::string> unknown,
    const std::vector<std::pair<std::shared_ptr<LiveSession>, int>>& sessions, const JobFeed* jobs,
    std::function<ClockTime()> now) {
  return std::make_unique<LiveStream>(std::move(slot), std::move(waker), std::move(unknown),
                                      sessions, jobs, std::move(now));
}

std::unique_ptr<BodyStream> make_mjpeg_stream(std::shared_ptr<StreamSlots::Slot> slot,
                                              std::shared_ptr<LiveSession> session) {
  return std::make_unique<MjpegStream>(std::move(slot), std::move(session));
}

}  // namespace tarsier::web
