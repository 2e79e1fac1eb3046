// SPDX-License-Identifier: MIT
#include "verbs/sfm/online.h"

#include "tarsier/core/log.h"
#include "tarsier/sfm/pipelines/online_reconstructor.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/input_schemes.h"
#include "framework/run_session.h"
#include "framework/security_flags.h"
#include "ui/sfm/sfm_session.h"
#include <chrono>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using Clock = std::chrono::steady_clock;

}  // namespace

void add_online_flags(Command& verb, OnlineFlags& flags) {
  Flag& online = verb.add_flag("--online", flags.online,
                               "reconstruct while the frames of a video, camera or folder arrive, "
                               "and show the model")
                     .group("Online");
  const auto needing = [&](Flag& flag) { flag.group("Online").needs(online); };
  needing(verb.add_flag("--window", flags.window, "show the result in a window (h: keys)"));
  needing(verb.add_flag("--fullscreen", flags.fullscreen, "show the window in full screen"));
  needing(verb.add_option("--online-view", flags.view,
                          "output of the view: .mp4, folder, http://127.0.0.1:8080/"));
  needing(verb.add_option("--online-every", flags.every,
                          "number of key frames between updates of the model")
              .check(range(1, 1000))
              .show_default());
  needing(
      verb.add_option("--actions", flags.actions, "-: read actions by name from stdin, one a line")
          .check(one_of({"-"})));
  needing(verb.add_option("--frames", flags.frames, "stop after this many frames; 0: all")
              .check(at_least(0))
              .show_default());
  needing(bind_field(verb, flags.source, flags.source.width));
  needing(bind_field(verb, flags.source, flags.source.height, {},
                     "px, requested camera image height; 0: the camera's choice"));
  needing(
      bind_field(verb, flags.source, flags.source.fps, {},
                 "requested frame rate of a camera; frame rate of a folder; 0: the source's own"));
  for (Flag* flag : add_security_flags(verb, flags.source.security)) needing(*flag);
}

SourceKind kind_of_online_source(const std::string& text) {
  return classify_source(text, input_schemes());
}

OnlineRun run_online(const std::vector<std::string>& sources, const std::vector<sfm::Input>& images,
                     const sfm::Reconstructor& reconstructor, const OnlineFlags& flags,
                     Context& context) {
  RunFlags run;
  run.inputs = sources;
  run.output = flags.view.empty() ? "none" : flags.view;
  run.window = flags.window;
  run.fullscreen = flags.fullscreen;
  run.actions = flags.actions;
  run.frames = flags.frames;
  run.source = flags.source;
  run.source.sequence = true;  // consecutive images
  if (classify_sink(run.output) == SinkKind::kImage)
    throw UsageError(
        fmt::format("--online-view {}: expected a video, a folder or an address", flags.view));

  sfm::OnlineReconstructorOptions options;
  options.mapper.pipeline = reconstructor.pipeline();
  options.keyframes = reconstructor.options().keyframes;
  options.grow_every = flags.every;
  options.frames_folder = reconstructor.frames_folder();
  options.every_frame = !images.empty();
  options.images = images;
  sfm::OnlineReconstructor online(options);
  DebugFolder debug(context.debug_dir);
  SfmSession session(online, context.stop, debug.sink());

  Clock::time_point start;
  double elapsed_ms = 0;
  RunHooks hooks;
  hooks.title = "online";
  hooks.debug = &debug;
  hooks.before_frame = [&](const Frame&) { start = Clock::now(); };
  hooks.after_frame = [&](const Frame&) {
    elapsed_ms = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  };
  hooks.describe = [&](const View& view, nlohmann::ordered_json& line) {
    for (const char* name : {"key_frames", "registered", "points", "followed"})
      line[name] = view.state.at(name);
    if (view.state.contains("no_model")) line["no_model"] = view.state.at("no_model");
    line["ms"] = rounded(elapsed_ms, 2);
  };
  OnlineRun result;
  try {
    result.status = run_session(session, run, context, hooks);
  } catch (const OutputError&) {
    throw;
  } catch (const Error&) {
    if (online.inputs().empty()) throw;
    result.error = std::current_exception();
  }
  context.progress->end();
  const View end = session.finish();
  result.inputs = online.inputs();
  log_info("online: {} key frames, {} in the model, {} points", result.inputs.size(),
           end.state.at("registered").get<int>(), online.model().points.size());
  return result;
}

}  // namespace tarsier::cli
