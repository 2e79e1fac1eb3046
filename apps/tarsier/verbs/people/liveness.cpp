// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "ui/face/liveness_session.h"
#include "verbs/people/people.h"
#include "verbs/pose/engine.h"
#include <cstdint>
#include <nlohmann/json.hpp>
#include <random>

namespace tarsier::cli {
namespace {

struct LivenessFlags {
  RunFlags run;
  face::head::LivenessOptions options;
  bool fixed_order = false;
};

ExitStatus run_liveness(LivenessFlags& flags, Context& context) {
  default_to_headless(flags.run);
  using face::head::LivenessState;
  face::PoseTrackerOptions options;
  options.landmarks.tracker.smoothing = false;  // smoothing would hide a blink
  options.smoothing = face::PoseSmoothing::kNone;
  std::uint64_t seed = context.seed;
  if (!flags.fixed_order) {  // a predictable order proves nothing
    std::random_device chance;
    seed = (static_cast<std::uint64_t>(chance()) << 32) | chance();
  }
  LivenessSession session(face::PoseTracker(load_pose_models(options), options), seed,
                          flags.options);
  LivenessState reported = LivenessState::kLook;
  int reported_done = -1;
  RunHooks hooks;
  hooks.title = "liveness";
  hooks.before_frame = [](const Frame& frame) {
    if (frame.still)
      throw UsageError(
          "a challenge needs a video or a camera; for consecutive images add --sequence");
  };
  hooks.after_frame = [&](const Frame& frame) {
    const face::head::LivenessStatus& now = session.challenge();
    if (now.state == reported && now.done == reported_done) return;
    reported = now.state;
    reported_done = now.done;
    if (now.state == LivenessState::kLook) return;
    if (context.json) {
      nlohmann::ordered_json line = {{"event", "liveness"}, {"time", rounded(frame.time, 3)}};
      line.update(session.challenge_json());
      print_json(line);
    } else if (!context.quiet) {
      print_text(fmt::format("{:7.2f} s  {}{}\n", frame.time, name_of(now.state),
                             now.task             ? fmt::format(": {}", name_of(*now.task))
                             : now.reason.empty() ? std::string()
                                                  : ": " + now.reason));
    }
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line["liveness"] = session.challenge_json();
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  return status == ExitStatus::kDone && session.challenge().state != LivenessState::kPassed
             ? ExitStatus::kNothingFound
             : status;
}

void add_flags(Command& verb, LivenessFlags& flags) {
  add_run_flags(verb, flags.run, false);
  bind_field(verb, flags.options, flags.options.tasks);
  bind_field(verb, flags.options, flags.options.task_s);
  verb.add_flag(
      "--fixed-order", flags.fixed_order,
      "take the order of tasks from --seed, for videos made with that seed [random order]");
}

}  // namespace

void add_people_liveness(Command& area, Context& context) {
  add_verb<LivenessFlags>(
      area, "liveness", "check liveness by blink and turn tasks; exit status 0: passed, 1: failed",
      context, add_flags, run_liveness);
}

}  // namespace tarsier::cli
