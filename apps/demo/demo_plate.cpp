// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/plate/reader/video_reader.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>

#include "demo.h"
#include "ui/plate/plate_session.h"
#include "verbs/plate/engine.h"
#include <chrono>

namespace tarsier::cli {
namespace {

// Stores the stages of one image.
class StageRecorder final : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat& image) override {
    names.emplace_back(name);
    images.push_back(image.clone());
  }
  std::vector<std::string> names;
  std::vector<cv::Mat> images;
};

struct Scene {
  const char* source;
  const char* title;
};
constexpr Scene kScenes[] = {
    {"synth:car?seed=11&frames=1", "by day"},
    {"synth:car?seed=3&frames=1&light=night", "by night"},
    {"synth:car?seed=8&frames=1&light=infrared", "infrared"},
    {"synth:car?seed=5&frames=1&kind=us", "another country"},
};

plate::VideoReader of_frames(const plate::Reader& reader) {
  return {[reader](const Frame& frame, DebugSink* debug) { return reader.process(frame, debug); },
          {}};
}

void show_stills(Context& context, DemoPage& page, const plate::Reader& reader) {
  std::vector<DemoImage> images;
  for (const Scene& scene : kScenes) {
    throw_if_stopped(context.stop);
    const auto source = synth::open_synth_source(std::string_view(scene.source).substr(6));
    auto frame = source->next(std::chrono::milliseconds(1000), context.stop);
    if (!frame) continue;
    frame->still = true;
    StageRecorder stages;
    PlateSession session(of_frames(reader), {}, {}, images.empty() ? &stages : nullptr);
    const View view = session.on_frame(*frame, source->status());
    std::string texts;
    for (const plate::Reading& reading : session.readings()) {
      if (reading.confidence < 0.3) continue;
      texts += fmt::format("{}{} ({:.0f} %)", texts.empty() ? "" : ", ", reading.text,
                           100 * reading.confidence);
    }
    if (images.empty()) {
      page.heading("Stages of reading a plate",
                   "The plate is detected, aligned and rectified. Then its text line is recognised "
                   "as a whole, and decoded with the plate layouts of the countries.");
      page.command(
          fmt::format("tarsier plate read '{}' -o read.png --debug-dir stages", scene.source));
      std::vector<DemoImage> strip;
      for (std::size_t i = 0; i < stages.images.size() && i < 3; ++i)
        strip.push_back(
            page.image("plate-stage-" + stages.names[i], stages.images[i], stages.names[i]));
      page.strip(strip);
    }
    images.push_back(page.image(fmt::format("plate-{}", images.size()), view.output,
                                fmt::format("{}: {}", scene.title, texts)));
  }
  page.heading("Plates of rendered cars");
  page.grid(images);
}

void show_drive(Context& context, DemoPage& page, const plate::Reader& reader) {
  constexpr const char* kSynthVideo =
      "drive?seconds=20&cars=3&parked=1&far=0&fps=5&size=960x540&seed=6";
  page.heading("Plates in a video",
               "Plates are tracked from frame to frame. The readings of a track vote, and each "
               "vehicle gives one event.");
  page.command(fmt::format("tarsier plate read 'synth:{}' --window", kSynthVideo));
  std::vector<std::vector<std::string>> rows;
  PlateSession session(of_frames(reader), [&](const plate::PlateEvent& event) {
    if (event.state != plate::PlateState::kClosed) return;
    rows.push_back({event.text, fmt::format("{:.0f} %", 100 * event.confidence),
                    fmt::format("{:.1f}-{:.1f} s", event.first_time, event.last_time),
                    std::to_string(event.frames)});
  });
  const auto source = synth::open_synth_source(kSynthVideo);
  std::vector<DemoImage> images;
  while (auto frame = source->next(std::chrono::milliseconds(1000), context.stop)) {
    throw_if_stopped(context.stop);
    const View view = session.on_frame(*frame, source->status());
    if (frame->index % 25 == 22)
      images.push_back(page.image(fmt::format("plate-drive-{}", frame->index), view.output,
                                  fmt::format("{:.1f} s", frame->time)));
  }
  session.finish();
  page.grid(images);
  page.table({"vehicle", "confidence", "time", "frames"}, rows, "One row for each vehicle");
}

}  // namespace

void demo_plate(Context& context, DemoPage& page) {
  page.begin_area(
      "Number plates",
      "A small network detects the plates. They are rectified, read by a second network, and "
      "decoded with the plate layouts of 49 countries. The cars are rendered by the program.");
  try {
    const plate::Reader reader = load_reader({}, context);
    show_stills(context, page, reader);
    show_drive(context, page, reader);
  } catch (const InputError& error) {  // there are no typefaces to draw plates
    log_warning("{}", error.what());
    page.note(error.what());
  }
}

}  // namespace tarsier::cli
