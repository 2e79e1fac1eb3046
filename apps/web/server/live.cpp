// SPDX-License-Identifier: MIT
#include "live.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/image_probe.h"

#include <fmt/format.h>

#include "secrets.h"
#include <algorithm>
#include <cstring>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <set>
#include <sys/socket.h>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kPing{2000};
constexpr milliseconds kWait{400};      // of a stream without news, before it looks around
constexpr milliseconds kDeaf{300'000};  // a viewer that takes nothing for so long is let go
constexpr milliseconds kFresh{60};      // an older picture is not sent before a newer was asked for
constexpr milliseconds kFreshWait{50};
constexpr std::size_t kMaxWatched = 16;  // sessions in one stream
constexpr std::size_t kMaxEvents = 64;   // in one POST
constexpr milliseconds kHandled{1000};   // for a session to handle them
constexpr int kUnsent = 16 << 10;        // bytes that may wait in the socket when more is written

// What is drawn by the program itself, for those without a camera.
struct Drawn {
  const char* id;
  const char* name;
};
constexpr Drawn kDrawn[] = {
    {"synth:portrait?live=1", "Drawn portrait"},
    {"synth:scene?live=1", "Drawn scene"},
    {"synth:drive?live=1", "Drawn street with cars"},
    {"synth:car?live=1", "Drawn car with a number plate"},
    {"synth:markers?live=1", "Drawn markers"},
    {"synth:planar?live=1", "Drawn posters"},
    {"synth:board?live=1", "Drawn calibration board"},
    {"synth:clock?live=1", "Drawn clock"},
};

// Waits until the client has nearly all that was written: a picture that is made later is newer.
// False where it has not within `patience`.
bool wait_until_taken(int socket, milliseconds patience) {
  pollfd item{socket, POLLOUT, 0};
  return ::poll(&item, 1, static_cast<int>(patience.count())) > 0;
}

bool is_gone(int socket) {
  pollfd item{socket, POLLRDHUP, 0};
  return ::poll(&item, 1, 0) > 0 && item.revents != 0;
}

void prepare(int socket) {
  const int unsent = kUnsent;
  (void)::setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof unsent);
}

}  // namespace

// --- cameras of viewers ---

std::string ViewerCameras::add() {
  forget_silent();
  const std::lock_guard lock(mutex_);
  if (cameras_.size() >= kMost)
    throw HttpError(409, fmt::format("{} cameras of browsers are the limit; end one first", kMost));
  std::string id = new_secret().substr(0, 12);
  cameras_[id].heard = Clock::now();
  return id;
}

void ViewerCameras::put(const std::string& id, std::string jpeg) {
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(jpeg.data()),
                                            jpeg.size());
  const auto header = probe_image(bytes);
  if (!header || jpeg.compare(0, 2, "\xff\xd8") != 0) throw HttpError(415, "the frame is no JPEG");
  if (static_cast<std::int64_t>(header->width) * header->height > 100'000'000)
    throw HttpError(415, "the frame has more than 100 million pixels");
  auto frame = std::make_shared<const std::string>(std::move(jpeg));
  std::vector<std::shared_ptr<LiveSession>> sessions;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end())
      throw HttpError(404, "this camera is over: make another (POST /api/viewer-cameras)");
    Camera& camera = found->second;
    camera.heard = Clock::now();
    camera.newest = frame;
    std::erase_if(camera.sessions, [](const auto& session) { return session.expired(); });
    for (const auto& session : camera.sessions) {
      if (auto alive = session.lock()) sessions.push_back(std::move(alive));
    }
  }
  for (const auto& session : sessions) session->offer_frame(frame);
}

void ViewerCameras::end(Camera& camera) {
  for (const auto& session : camera.sessions) {
    if (const auto alive = session.lock()) alive->end_camera();
  }
}

void ViewerCameras::remove(const std::string& id) {
  Camera camera;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end()) throw HttpError(404, "there is no such camera");
    camera = std::move(found->second);
    cameras_.erase(found);
  }
  end(camera);
}

bool ViewerCameras::has(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  return cameras_.contains(id);
}

std::vector<std::string> ViewerCameras::ids() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> result;
  for (const auto& [id, camera] : cameras_) result.push_back(id);
  return result;
}

void ViewerCameras::attach(const std::string& id, const std::shared_ptr<LiveSession>& session) {
  std::shared_ptr<const std::string> newest;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end()) {
      session->end_camera();
      return;
    }
    found->second.sessions.push_back(session);
    newest = found->second.newest;
  }
  if (newest != nullptr) session->offer_frame(std::move(newest));
}

void ViewerCameras::forget_silent() {
  std::vector<Camera> silent;
  {
    const std::lock_guard lock(mutex_);
    for (auto camera = cameras_.begin(); camera != cameras_.end();) {
      if (Clock::now() - camera->second.heard < kSilence) {
        ++camera;
        continue;
      }
      silent.push_back(std::move(camera->second));
      camera = cameras_.erase(camera);
    }
  }
  for (Camera& camera : silent) end(camera);
}

// --- streams ---

// Counts a stream while it lives.
struct Live::StreamSlot {
  explicit StreamSlot(Live& owner) : live(owner) {}
  ~StreamSlot() {
    {
      const std::lock_guard lock(live.mutex_);
      --live.streams_;
    }
    live.changed_.notify_all();
  }
  StreamSlot(const StreamSlot&) = delete;
  StreamSlot& operator=(const StreamSlot&) = delete;
  Live& live;
};

// Gives a viewer pictures that are new when they leave: it asks the child only when the client has
// taken what went before.
class PictureFollower {
 public:
  explicit PictureFollower(std::shared_ptr<LiveSession> session) : session_(std::move(session)) {}

  // The next picture; nothing if it has to be waited for.
  std::optional<LiveSession::Picture> next() {
    LiveSession::Picture picture = session_->picture();
    const Clock::time_point now = Clock::now();
    if (picture.number <= last_) {
      session_->want_picture();
      asked_.reset();
      return std::nullopt;
    }
    const bool is_fresh = now - picture.received <= kFresh;
    if (!is_fresh && session_->is_running()) {
      // An old one that nobody took: the child may have a newer one at once.
      if (!asked_) {
        asked_ = now;
        session_->want_picture();
        return std::nullopt;
      }
      if (now - *asked_ < kFreshWait) return std::nullopt;
    }
    asked_.reset();
    last_ = picture.number;
    return picture;
  }
  // How long next() wants to be left alone at most.
  [[nodiscard]] milliseconds patience() const { return asked_ ? kFreshWait : kWait; }
  [[nodiscard]] LiveSession& session() const { return *session_; }

 private:
  std::shared_ptr<LiveSession> session_;
  std::uint64_t last_ = 0;
  std::optional<Clock::time_point> asked_;
};

// Bytes that are handed out in pieces.
class Outgoing {
 public:
  [[nodiscard]] bool is_empty() const { return sent_ == text_.size(); }
  std::string& fresh() {
    text_.clear();
    sent_ = 0;
    return text_;
  }
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
  LiveStream(Live& live, std::shared_ptr<Live::StreamSlot> slot, std::vector<std::string> unknown,
             const std::vector<std::shared_ptr<LiveSession>>& sessions, bool with_jobs)
      : live_(live), slot_(std::move(slot)), unknown_(std::move(unknown)), with_jobs_(with_jobs) {
    for (const auto& session : sessions) {
      watched_.emplace_back(session);
      session->add_viewer(waker_);
    }
    if (with_jobs_) {
      jobs_seen_ = live_.jobs_.newest();
      const std::lock_guard lock(live_.mutex_);
      live_.job_viewers_.push_back(waker_);
    }
  }
  ~LiveStream() override {
    for (Watched& watched : watched_) watched.pictures.session().remove_viewer(waker_);
  }

  std::ptrdiff_t read(std::span<char> buffer, int socket) override {
    if (!out_.is_empty()) return out_.take(buffer);
    if (!is_prepared_) {
      prepare(socket);
      is_prepared_ = true;
    }
    const Clock::time_point now = Clock::now();
    if (!wait_until_taken(socket, kWait)) return now - taken_ > kDeaf ? -1 : 0;
    taken_ = now;
    if (is_gone(socket)) return -1;
    if (compose()) return out_.take(buffer);
    milliseconds patience = kWait;
    for (const Watched& watched : watched_)
      patience = std::min(patience, watched.pictures.patience());
    waker_->wait(patience);
    return compose() ? out_.take(buffer) : 0;
  }

 private:
  struct Watched {
    explicit Watched(std::shared_ptr<LiveSession> session) : pictures(std::move(session)) {}
    PictureFollower pictures;
    std::uint64_t hello = 0;
    std::uint64_t state = 0;
    std::uint64_t ended = 0;
  };

  void add_news(std::string& out, LiveRecord kind, const std::string& id,
                const LiveSession::News& news, std::uint64_t& seen) {
    if (news.number <= seen || news.json == nullptr) return;
    seen = news.number;
    append_record(out, kind, id, *news.json);
  }

  // All that is new, and one picture. False where nothing is.
  bool compose() {
    std::string& out = out_.fresh();
    const Clock::time_point now = Clock::now();
    for (const std::string& id : unknown_)
      append_record(out, LiveRecord::kEnded, id,
                    R"({"exit":null,"error":"there is no such session"})");
    unknown_.clear();
    for (Watched& watched : watched_) {
      LiveSession& session = watched.pictures.session();
      add_news(out, LiveRecord::kHello, session.id(), session.hello(), watched.hello);
      add_news(out, LiveRecord::kState, session.id(), session.state(), watched.state);
    }
    if (with_jobs_) {
      for (const auto& [id, json] : live_.jobs_.since(jobs_seen_))
        append_record(out, LiveRecord::kJob, id, json);
    }
    // Sessions take turns, so that a fast one does not shut out the others.
    for (std::size_t i = 0; i < watched_.size(); ++i) {
      Watched& watched = watched_[(turn_ + i) % watched_.size()];
      const auto picture = watched.pictures.next();
      if (!picture) continue;
      std::string payload = picture_head(picture->frame, picture->age_now());
      payload += *picture->jpeg;
      append_record(out, LiveRecord::kPicture, watched.pictures.session().id(), payload);
      turn_ = (turn_ + i + 1) % watched_.size();
      break;
    }
    for (Watched& watched : watched_) {
      LiveSession& session = watched.pictures.session();
      add_news(out, LiveRecord::kEnded, session.id(), session.ended(), watched.ended);
    }
    if (out.empty() && now - pinged_ >= kPing) append_record(out, LiveRecord::kPing, "", "");
    if (!out.empty()) pinged_ = now;
    return !out.empty();
  }

  Live& live_;
  const std::shared_ptr<Live::StreamSlot> slot_;
  std::vector<std::string> unknown_;
  const bool with_jobs_;
  const std::shared_ptr<Waker> waker_ = std::make_shared<Waker>();
  std::vector<Watched> watched_;
  std::uint64_t jobs_seen_ = 0;
  std::size_t turn_ = 0;
  Outgoing out_;
  bool is_prepared_ = false;
  Clock::time_point taken_ = Clock::now();
  Clock::time_point pinged_;  // something was sent; long ago at first: the first ping is at once
};

// GET /api/sessions/ID/stream.mjpg
class MjpegStream final : public BodyStream {
 public:
  MjpegStream(std::shared_ptr<Live::StreamSlot> slot, std::shared_ptr<LiveSession> session)
      : slot_(std::move(slot)), pictures_(std::move(session)) {
    pictures_.session().add_viewer(waker_);
    out_.fresh() = "--tarsier-frame\r\n";
  }
  ~MjpegStream() override { pictures_.session().remove_viewer(waker_); }
  [[nodiscard]] bool is_plain() const override { return true; }

  std::ptrdiff_t read(std::span<char> buffer, int socket) override {
    if (!out_.is_empty()) return out_.take(buffer);
    if (!is_prepared_) {
      prepare(socket);
      is_prepared_ = true;
    }
    const Clock::time_point now = Clock::now();
    if (!wait_until_taken(socket, kWait)) return now - taken_ > kDeaf ? -1 : 0;
    taken_ = now;
    if (is_gone(socket)) return -1;
    auto picture = pictures_.next();
    if (!picture) {
      if (!pictures_.session().is_running()) return -1;
      waker_->wait(pictures_.patience());
      picture = pictures_.next();
    }
    if (!picture) return 0;
    // The boundary follows its part at once: browsers show a picture only when they have seen it.
    out_.fresh() = fmt::format(
        "Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n{}\r\n--tarsier-frame\r\n",
        picture->jpeg->size(), *picture->jpeg);
    return out_.take(buffer);
  }

 private:
  const std::shared_ptr<Live::StreamSlot> slot_;
  const std::shared_ptr<Waker> waker_ = std::make_shared<Waker>();
  PictureFollower pictures_;
  Outgoing out_;
  bool is_prepared_ = false;
  Clock::time_point taken_ = Clock::now();
};

// --- sessions ---

Live::Live(LiveOptions options, JobFeed& jobs, AuditLog& audit)
    : options_(std::move(options)), jobs_(jobs), audit_(audit) {
  jobs_.on_publish([this] {
    const std::lock_guard lock(mutex_);
    std::erase_if(job_viewers_, [](const auto& viewer) { return viewer.expired(); });
    for (const auto& viewer : job_viewers_) {
      if (const auto alive = viewer.lock()) alive->wake();
    }
  });
  keeper_ = std::thread([this] { keep(); });
}

Live::~Live() { stop(); }

void Live::keep() {
  std::unique_lock lock(mutex_);
  while (!is_stopping_) {
    changed_.wait_for(lock, std::chrono::seconds(5), [&] { return is_stopping_; });
    lock.unlock();
    cameras_.forget_silent();
    lock.lock();
  }
}

void Live::stop() {
  std::vector<std::shared_ptr<LiveSession>> sessions;
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
    sessions.swap(sessions_);
  }
  changed_.notify_all();
  if (keeper_.joinable()) keeper_.join();
  jobs_.on_publish({});
  // All at once: each has as long as one.
  for (const auto& session : sessions) session->close();
  sessions.clear();
}

std::shared_ptr<LiveSession> Live::find(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  for (const auto& session : sessions_) {
    if (session->id() == id) return session;
  }
  return nullptr;
}

std::shared_ptr<LiveSession> Live::session_of(const Request& request) const {
  auto session = find(request.param("id"));
  if (session == nullptr) throw HttpError(404, "there is no such session");
  return session;
}

std::shared_ptr<Live::StreamSlot> Live::new_slot() {
  const std::lock_guard lock(mutex_);
  if (is_stopping_) throw HttpError(503, "the server is ending");
  if (streams_ >= options_.max_streams)
    throw HttpError(503, fmt::format("{} live streams are the limit: close a page elsewhere",
                                     options_.max_streams));
  auto slot = std::make_shared<StreamSlot>(*this);
  ++streams_;
  return slot;
}

std::string Live::source_word(const std::string& reference) const {
  const std::size_t colon = std::min(reference.find(':'), reference.size());
  const std::string kind = reference.substr(0, colon);
  const std::string rest = colon < reference.size() ? reference.substr(colon + 1) : "";
  if (kind == "synth" && !rest.empty()) return reference;
  if (kind == "camera") {
    const auto number = to_integer(rest, 0, 255);
    if (!number || rest.front() == '+' || rest.front() == '-')
      throw UsageError(fmt::format("{}: expected camera:N, as /api/sources lists them", reference));
    return std::to_string(*number);
  }
  if (kind == "allowed") {
    for (const auto& [name, source] : options_.allowed) {
      if (name == rest) return source;
    }
    throw UsageError(
        fmt::format("{}: no source of that name; start the server with --allow-source {}=URL",
                    reference, rest));
  }
  if (kind == "viewer") {
    if (!cameras_.has(rest))
      throw UsageError(fmt::format("{}: this camera of a browser is over", reference));
    return reference;
  }
  throw UsageError(fmt::format(
      "{}: no source; use one of those that /api/sources lists (synth:, camera:, allowed:)",
      reference));
}

Response Live::list_sources() const {
  nlohmann::json sources = nlohmann::json::array();
  const auto add = [&](const std::string& id, const std::string& name, const char* kind,
                       bool live) {
    sources.push_back({{"id", id}, {"name", name}, {"kind", kind}, {"live", live}});
  };
  for (const CameraInfo& camera : list_cameras()) {
    constexpr std::string_view kFolder = "/dev/video";
    if (!camera.path.starts_with(kFolder)) continue;
    add("camera:" + camera.path.substr(kFolder.size()),
        camera.card.empty() ? camera.path : camera.card, "camera", true);
    if (!camera.trouble.empty()) sources.back()["trouble"] = camera.trouble;
  }
  for (const auto& [name, source] : options_.allowed) add("allowed:" + name, name, "allowed", true);
  for (const std::string& id : cameras_.ids())
    add("viewer:" + id, "Camera of a browser", "viewer", true);
  for (const Drawn& drawn : kDrawn) add(drawn.id, drawn.name, "synth", true);
  if (options_.more_sources) {
    for (auto& source : options_.more_sources()) sources.push_back(std::move(source));
  }
  return json_response({{"sources", sources}});
}

Response Live::start(const Request& request) {
  const nlohmann::json body = request.json();
  const VerbRequest wanted = verb_request(body);
  const std::string name = optional_text(body, "name").value_or("");
  if (!is_one_line(name, 200))
    throw HttpError(400, "\"name\" must be one line of 200 bytes at most");

  LiveSession::Options options;
  std::vector<std::string> cameras;
  References references = options_.references;
  references.source = [&](const std::string& reference) {
    if (reference.starts_with("viewer:")) cameras.push_back(reference.substr(7));
    return source_word(reference);
  };
  CommandLine line = command_line(*options_.verbs, wanted, Use::kLive, references);
  if (cameras.size() > 1)
    throw HttpError(400, "a session takes one camera of a browser, not several");

  std::shared_ptr<LiveSession> session;
  {
    const std::lock_guard lock(mutex_);
    if (is_stopping_) throw HttpError(503, "the server is ending");
    std::size_t running = 0;
    for (const auto& other : sessions_) running += other->is_running() ? 1 : 0;
    if (running >= options_.max_sessions)
      throw HttpError(
          409, fmt::format("{} sessions are the limit: end one first", options_.max_sessions));
    // Those that ended long ago make room.
    for (std::size_t ended = sessions_.size() - running; ended >= options_.max_ended; --ended)
      sessions_.erase(std::find_if(sessions_.begin(), sessions_.end(),
                                   [](const auto& other) { return !other->is_running(); }));
    options.id = new_secret().substr(0, 8);
    options.verb = wanted.verb;
    options.name = name.empty() ? wanted.verb : name;
    options.inputs = wanted.inputs;
    options.flags = wanted.flags;
    options.shown = std::move(line.shown);
    options.arguments = {options_.program};
    for (std::string& word : line.words) options.arguments.push_back(std::move(word));
    options.secrets = std::move(line.secrets);
    options.has_camera = !cameras.empty();
    session = std::make_shared<LiveSession>(std::move(options));
    sessions_.push_back(session);
  }
  if (!cameras.empty()) cameras_.attach(cameras[0], session);
  nlohmann::json details{
      {"session", session->id()}, {"verb", wanted.verb}, {"inputs", wanted.inputs}};
  audit_.write(line.audit.empty() ? "session start" : line.audit, request.address, details);
  return json_response(session->describe(), 201);
}

Response Live::take_events(const Request& request) {
  const auto session = session_of(request);
  const nlohmann::json events = request.json();
  if (!events.is_array() || events.size() > kMaxEvents)
    throw HttpError(400, fmt::format("the body must be a list of at most {} events", kMaxEvents));
  std::string lines;
  bool is_move = true;  // of the mouse alone: nothing waits for it
  for (const auto& event : events) {
    const auto text = event_line(event);
    if (!text)
      throw HttpError(
          400, "an event is none of key, mouse, action, slider: " + to_text(event).substr(0, 200));
    lines += *text;
    is_move = is_move && event.value("mouse", "") == "move";
  }
  if (!session->is_running()) throw HttpError(409, "this session has ended");
  if (lines.empty()) return no_content();
  const auto number = session->send(lines);
  if (!number)
    throw HttpError(409, "this session takes no events now: it is ending, or busy for long");
  // 204: the session has handled them, and a click of an annotation is in its journal.
  if (is_move || session->wait_until_handled(*number, kHandled)) return no_content();
  if (!session->is_running()) throw HttpError(409, "this session ended before it handled them");
  return json_response({{"handled", false}}, 202);
}

Response Live::send_snapshot(const Request& request) {
  const auto session = session_of(request);
  const auto waker = std::make_shared<Waker>();
  session->add_viewer(waker);
  const std::uint64_t before = session->picture().number;
  const Clock::time_point until = Clock::now() + milliseconds(before == 0 ? 5000 : 500);
  session->want_picture();
  while (session->picture().number == before && session->is_running() && Clock::now() < until) {
    waker->wait(milliseconds(50));
    const std::lock_guard lock(mutex_);
    if (is_stopping_) break;
  }
  session->remove_viewer(waker);
  const LiveSession::Picture picture = session->picture();
  if (picture.number == 0) {
    Response response = error_response(503, "there is no picture yet; try again in a moment");
    response.headers.emplace_back("Retry-After", "1");
    return response;
  }
  Response response;
  response.type = "image/jpeg";
  response.body = *picture.jpeg;
  response.headers.emplace_back("X-Tarsier-Frame", std::to_string(picture.frame));
  response.headers.emplace_back("X-Tarsier-Age", std::to_string(picture.age_now()));
  return response;
}

Response Live::send_live(const Request& request) {
  std::vector<std::string> unknown;
  std::vector<std::shared_ptr<LiveSession>> sessions;
  const std::string wanted = request.query_value("s").value_or("");
  std::set<std::string> seen;
  for (std::string_view rest = wanted; !rest.empty();) {
    const std::size_t comma = rest.find(',');
    const std::string id(rest.substr(0, comma));
    rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
    if (id.empty() || !seen.insert(id).second) continue;
    if (seen.size() > kMaxWatched || id.size() > 64)
      throw HttpError(400, fmt::format("\"s\" takes at most {} sessions", kMaxWatched));
    if (auto session = find(id)) {
      sessions.push_back(std::move(session));
    } else {
      unknown.push_back(id);
    }
  }
  const bool with_jobs = request.query_value("jobs") == "1";
  Response response;
  response.type = "application/octet-stream";
  response.stream =
      std::make_unique<LiveStream>(*this, new_slot(), std::move(unknown), sessions, with_jobs);
  // Proxies that hold answers back would turn it into a slide show.
  response.headers.emplace_back("X-Accel-Buffering", "no");
  return response;
}

Response Live::send_mjpeg(const Request& request) {
  const auto session = session_of(request);
  Response response;
  response.type = "multipart/x-mixed-replace; boundary=tarsier-frame";
  response.stream = std::make_unique<MjpegStream>(new_slot(), session);
  response.headers.emplace_back("X-Accel-Buffering", "no");
  return response;
}

void Live::add_routes(Router& router) {
  router.add("GET", "/api/sources", [this](const Request&) { return list_sources(); });
  router.add("POST", "/api/viewer-cameras", [this](const Request& request) {
    const std::string id = cameras_.add();
    audit_.write("viewer camera", request.address, {{"id", id}});
    return json_response({{"id", "viewer:" + id}}, 201);
  });
  const auto camera_id = [](const Request& request) {
    const std::string& id = request.param("id");
    return id.starts_with("viewer:") ? id.substr(7) : id;
  };
  router.add("POST", "/api/viewer-cameras/{id}/frame",
             [this, camera_id](const Request& request) {
               cameras_.put(camera_id(request), request.body);
               return no_content();
             },
             Access::kSignedIn, {.max_body = ViewerCameras::kMaxFrame, .types = {"image/jpeg"}});
  router.add("DELETE", "/api/viewer-cameras/{id}", [this, camera_id](const Request& request) {
    cameras_.remove(camera_id(request));
    return no_content();
  });
  router.add("GET", "/api/sessions", [this](const Request&) {
    return json_response({{"sessions", sessions()}});
  });
  router.add("POST", "/api/sessions", [this](const Request& request) { return start(request); });
  router.add("GET", "/api/sessions/{id}", [this](const Request& request) {
    return json_response(session_of(request)->describe());
  });
  router.add("DELETE", "/api/sessions/{id}", [this](const Request& request) {
    const auto session = session_of(request);
    {
      const std::lock_guard lock(mutex_);
      std::erase(sessions_, session);
    }
    session->close();
    audit_.write("session end", request.address, {{"session", session->id()}});
    return no_content();
  });
  router.add("POST", "/api/sessions/{id}/events",
             [this](const Request& request) { return take_events(request); });
  router.add("GET", "/api/sessions/{id}/snapshot.jpg",
             [this](const Request& request) { return send_snapshot(request); });
  router.add("GET", "/api/sessions/{id}/stream.mjpg",
             [this](const Request& request) { return send_mjpeg(request); });
  router.add("GET", "/api/live", [this](const Request& request) { return send_live(request); });
}

nlohmann::json Live::sessions() const {
  std::vector<std::shared_ptr<LiveSession>> all;
  {
    const std::lock_guard lock(mutex_);
    all = sessions_;
  }
  nlohmann::json list = nlohmann::json::array();
  for (const auto& session : all) list.push_back(session->describe());
  return list;
}

Live::Counts Live::counts() const {
  const std::lock_guard lock(mutex_);
  Counts counts;
  counts.streams = streams_;
  for (const auto& session : sessions_) {
    if (!session->is_running()) continue;
    ++counts.running;
    const ChildProcess::Use use = session->use();
    counts.cpu_seconds += use.cpu_seconds;
    counts.resident_bytes += use.resident_bytes;
  }
  return counts;
}

}  // namespace tarsier::web
