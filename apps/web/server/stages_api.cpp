// SPDX-License-Identifier: MIT
#include "stages_api.h"

#include "tarsier/core/words.h"

#include "live.h"
#include "live_session.h"
#include "router.h"
#include <chrono>
#include <memory>
#include <string>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kTimeout{2000};

class Watching {
 public:
  explicit Watching(LiveSession& session) : session_(session) {
    session_.add_viewer(waker_, LiveSession::kNoImages);
  }
  ~Watching() { session_.remove_viewer(waker_); }
  Watching(const Watching&) = delete;
  Watching& operator=(const Watching&) = delete;
  void wait() { waker_->wait(milliseconds(100)); }

 private:
  LiveSession& session_;
  std::shared_ptr<Waker> waker_ = std::make_shared<Waker>();
};

Response send_stages(const Request& request, const Live& live) {
  const auto session = live.find(request.param("id"));
  if (session == nullptr) throw HttpError(404, "no such session");
  const auto after =
      to_integer(request.query_value("after").value_or("0"), 0, std::int64_t{1} << 50);
  if (!after) throw HttpError(400, "after: expected the number of the last stages received");
  const auto seen = static_cast<std::uint64_t>(*after);
  if (!session->request_stages())
    throw HttpError(409, "this session has no stages: its verb makes none, or it has ended");
  Watching watching(*session);
  const Clock::time_point until = Clock::now() + kTimeout;
  LiveSession::Stages stages = session->stages();
  while (stages.number <= seen && session->is_running() && Clock::now() < until) {
    watching.wait();
    stages = session->stages();
  }
  if (stages.number <= seen) return no_content();
  Response response;
  response.type = "application/octet-stream";
  response.body = *stages.record;
  response.headers.emplace_back("X-Tarsier-Stages", std::to_string(stages.number));
  return response;
}

}  // namespace

void bind_stages(Router& router, const Live& live) {
  router.add("GET", "/api/sessions/{id}/stages",
             [&live](const Request& request) { return send_stages(request, live); });
}

}  // namespace tarsier::web
