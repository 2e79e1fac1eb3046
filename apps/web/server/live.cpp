// SPDX-License-Identifier: MIT
#include "live.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"
#include "tarsier/media/cameras.h"

#include <fmt/format.h>

#include "secrets.h"
#include "sign_in.h"
#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::size_t kMaxWatched = 16;  // sessions in one stream
constexpr std::size_t kMaxEvents = 64;   // in one POST
constexpr milliseconds kHandled{1000};   // time for a session to handle them

// Synthetic sources, for users without a camera.
struct Drawn {
  const char* id;
  const char* name;
};
constexpr Drawn kDrawn[] = {
    {"synth:portrait?live=1", "Synthetic portrait"},
    {"synth:scene?live=1", "Synthetic scene"},
    {"synth:drive?live=1", "Synthetic street with cars"},
    {"synth:car?live=1", "Synthetic car with a number plate"},
    {"synth:markers?live=1", "Synthetic markers"},
    {"synth:planar?live=1", "Synthetic posters"},
    {"synth:board?live=1", "Synthetic calibration board"},
    {"synth:clock?live=1", "Synthetic clock"},
};

// Parses "ID" or "ID:WIDTH", the width in px at which the viewer shows it; 0: full size.
std::pair<std::string, int> watched_word(std::string_view word) {
  const std::size_t colon = word.find(':');
  if (colon == std::string_view::npos) return {std::string(word), 0};
  const auto width = to_integer(word.substr(colon + 1), 16, 16384);
  if (!width) throw HttpError(400, "\"s\": expected ID or ID:WIDTH, with a width of 16..16384 px");
  return {std::string(word.substr(0, colon)), static_cast<int>(*width)};
}

}  // namespace

Live::Live(LiveOptions options, JobFeed& jobs, AuditLog& audit)
    : options_(std::move(options)), jobs_(jobs), audit_(audit) {
  jobs_.on_publish([this] {
    const std::lock_guard lock(mutex_);
    std::erase_if(job_viewers_, [](const auto& viewer) { return viewer.expired(); });
    for (const auto& viewer : job_viewers_) {
      if (const auto alive = viewer.lock()) alive->wake();
    }
  });
  watchdog_ = std::thread([this] { run_watchdog(); });
}

Live::~Live() { stop(); }

void Live::run_watchdog() {
  std::unique_lock lock(mutex_);
  while (!is_stopping_) {
    changed_.wait_for(lock, std::chrono::seconds(5), [&] { return is_stopping_; });
    lock.unlock();
    cameras_.remove_inactive();
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
  if (watchdog_.joinable()) watchdog_.join();
  jobs_.on_publish({});
  // All at once: together they take as long as one.
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
  if (session == nullptr) throw HttpError(404, "no such session");
  return session;
}

std::shared_ptr<StreamSlots::Slot> Live::new_slot(const Request& request) {
  {
    const std::lock_guard lock(mutex_);
    if (is_stopping_) throw HttpError(503, "the server is stopping");
  }
  const auto cookie = cookie_value(request.header("cookie"), kCookieName);
  return streams_.take(cookie && !request.by_api_token ? hash_of(*cookie) : "");
}

std::string Live::resolve_source(const std::string& reference) const {
  const std::size_t colon = std::min(reference.find(':'), reference.size());
  const std::string kind = reference.substr(0, colon);
  const std::string rest = colon < reference.size() ? reference.substr(colon + 1) : "";
  if (kind == "synth" && !rest.empty()) return reference;
  if (kind == "camera") {
    const auto number = to_integer(rest, 0, 255);
    if (!number || rest.front() == '+' || rest.front() == '-')
      throw UsageError(
          fmt::format("{}: expected camera:N; /api/sources lists the cameras", reference));
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
      throw UsageError(fmt::format("{}: this browser camera was closed", reference));
    return reference;
  }
  throw UsageError(fmt::format(
      "{}: not a source; /api/sources lists the sources (synth:, camera:, allowed:)", reference));
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
    if (!camera.error.empty()) sources.back()["trouble"] = camera.error;
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
  const VerbRequest verb_to_start = verb_request(body);
  const std::string name = optional_text(body, "name").value_or("");
  if (!is_one_line(name, 200))
    throw HttpError(400, "\"name\" must be one line of at most 200 bytes");

  LiveSession::Options options;
  std::vector<std::string> cameras;
  References references = options_.references;
  references.source = [&](const std::string& reference) {
    if (reference.starts_with("viewer:")) cameras.push_back(reference.substr(7));
    return resolve_source(reference);
  };
  CommandLine line = command_line(*options_.verbs, verb_to_start, Use::kLive, references);
  if (cameras.size() > 1) throw HttpError(400, "a session can use only one browser camera");

  std::shared_ptr<LiveSession> session;
  {
    const std::lock_guard lock(mutex_);
    if (is_stopping_) throw HttpError(503, "the server is stopping");
    std::size_t running = 0;
    for (const auto& other : sessions_) running += other->is_running() ? 1 : 0;
    if (running >= options_.max_sessions)
      throw HttpError(409, fmt::format("the limit of {} sessions is reached; end one first",
                                       options_.max_sessions));
    // Sessions that ended long ago are dropped.
    for (std::size_t ended = sessions_.size() - running; ended >= options_.max_ended; --ended)
      sessions_.erase(std::find_if(sessions_.begin(), sessions_.end(),
                                   [](const auto& other) { return !other->is_running(); }));
    options.id = new_secret().substr(0, 8);
    options.verb = verb_to_start.verb;
    options.name = name.empty() ? verb_to_start.verb : name;
    options.inputs = verb_to_start.inputs;
    options.flags = verb_to_start.flags;
    options.shell_text = std::move(line.shell_text);
    options.arguments = {options_.program};
    for (std::string& word : line.words) options.arguments.push_back(std::move(word));
    options.secrets = std::move(line.secrets);
    options.environment = options_.environment;
    options.folder = options_.sessions_folder + '/' + options.id;
    options.on_forgotten = options_.forgotten;
    options.has_camera = !cameras.empty();
    session = std::make_shared<LiveSession>(std::move(options));
    sessions_.push_back(session);
  }
  if (!cameras.empty()) cameras_.attach(cameras[0], session);
  nlohmann::json details{
      {"session", session->id()}, {"verb", verb_to_start.verb}, {"inputs", verb_to_start.inputs}};
  audit_.write(line.audit.empty() ? "session start" : line.audit, request.address, details);
  return json_response(session->describe(), 201);
}

Response Live::take_events(const Request& request) {
  const auto session = session_of(request);
  const nlohmann::json events = request.json();
  if (!events.is_array() || events.size() > kMaxEvents)
    throw HttpError(400, fmt::format("the body must be a list of at most {} events", kMaxEvents));
  std::string lines;
  bool is_move = true;  // only mouse moves: nobody waits for these
  for (const auto& event : events) {
    const auto text = event_line(event);
    if (!text)
      throw HttpError(400, "expected an event of key, mouse, action or slider: " +
                               to_text(event).substr(0, 200));
    if (*text == "{\"action\":\"save\"}\n") {
      throw HttpError(400,
                      "'save' would write a file on the server; snapshot.jpg returns the image");
    }
    lines += *text;
    is_move = is_move && event.value("mouse", "") == "move";
  }
  if (!session->is_running()) throw HttpError(409, "this session has ended");
  if (lines.empty()) return no_content();
  const auto number = session->send(lines);
  if (!number) throw HttpError(409, "this session accepts no events now: it is stopping or busy");
  // 204: the session has handled them, so a click of an annotation is in its journal.
  if (is_move || session->wait_until_handled(*number, kHandled)) return no_content();
  if (!session->is_running())
    throw HttpError(409, "this session ended before it handled the events");
  return json_response({{"handled", false}}, 202);
}

Response Live::send_snapshot(const Request& request) {
  const auto session = session_of(request);
  const auto waker = std::make_shared<Waker>();
  // A snapshot has full size, even if other viewers show a small image.
  session->add_viewer(waker);
  const std::uint64_t before = session->image().number;
  const std::uint64_t min_number = std::max(before + 1, session->first_fitting_image());
  // A paused session delivers no newer image.
  const bool is_full = before > 0 && session->first_fitting_image() <= before;
  const Clock::time_point until = Clock::now() + milliseconds(is_full ? 500 : 5000);
  while (session->image().number < min_number && session->is_running() && Clock::now() < until) {
    session->request_image();
    waker->wait(milliseconds(50));
    const std::lock_guard lock(mutex_);
    if (is_stopping_) break;
  }
  session->remove_viewer(waker);
  const LiveSession::Image image = session->image();
  if (image.number == 0) {
    Response response = error_response(503, "there is no image yet; try again in a moment");
    response.headers.emplace_back("Retry-After", "1");
    return response;
  }
  Response response;
  response.type = "image/jpeg";
  response.body = *image.jpeg;
  response.headers.emplace_back("X-Tarsier-Frame", std::to_string(image.frame));
  response.headers.emplace_back("X-Tarsier-Age", std::to_string(image.age_now()));
  return response;
}

Response Live::send_live(const Request& request) {
  std::vector<std::string> unknown;
  std::vector<std::pair<std::shared_ptr<LiveSession>, int>> sessions;
  const std::string session_list = request.query_value("s").value_or("");
  std::set<std::string> seen;
  for (std::string_view rest = session_list; !rest.empty();) {
    const std::size_t comma = rest.find(',');
    const auto [id, width] = watched_word(rest.substr(0, comma));
    rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
    if (id.empty() || !seen.insert(id).second) continue;
    if (seen.size() > kMaxWatched || id.size() > 64)
      throw HttpError(400, fmt::format("\"s\" may name at most {} sessions", kMaxWatched));
    if (auto session = find(id)) {
      sessions.emplace_back(std::move(session), width);
    } else {
      unknown.push_back(id);
    }
  }
  const bool with_jobs = request.query_value("jobs") == "1";
  auto slot = new_slot(request);
  auto waker = std::make_shared<Waker>();
  if (with_jobs) {
    const std::lock_guard lock(mutex_);
    job_viewers_.push_back(waker);
  }
  Response response;
  response.type = "application/octet-stream";
  response.stream = make_live_stream(std::move(slot), std::move(waker), std::move(unknown),
                                     sessions, with_jobs ? &jobs_ : nullptr);
  // Proxies that buffer responses would delay the images.
  response.headers.emplace_back("X-Accel-Buffering", "no");
  return response;
}

Response Live::send_mjpeg(const Request& request) {
  const auto session = session_of(request);
  Response response;
  response.type = "multipart/x-mixed-replace; boundary=tarsier-frame";
  response.stream = make_mjpeg_stream(new_slot(request), session);
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

}  // namespace tarsier::web
