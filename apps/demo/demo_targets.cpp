// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/image_targets/quality.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <fmt/format.h>

#include "demo.h"
#include "ui/planar/target_session.h"
#include "verbs/program/sample_images.h"
#include <filesystem>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

constexpr double kVideoSeconds = 6;

// The session's drawing on an image.
cv::Mat seen_in(TargetSession& session, const cv::Mat& image, bool still) {
  Frame frame;
  frame.image = image;
  frame.name = "demo";
  frame.still = still;
  const SourceStatus live{.state = SourceState::kLive, .detail = "", .age_s = 0};
  return session.on_frame(frame, live).output.clone();
}

void show_box(DemoPage& page) {
  namespace fs = std::filesystem;
  const std::string box = sample_image("box.png");
  const std::string scene = sample_image("box_in_scene.png");
  std::error_code error;
  if (!fs::exists(box, error) || !fs::exists(scene, error)) {
    page.note(
        "No images: the package opencv-doc is not installed. Install it and run the demo again.");
    return;
  }
  const planar::image_targets::Target trained =
      planar::image_targets::train_target(read_image(box), "biscuits");
  const cv::Mat image = read_image(scene);
  planar::TargetTrackerOptions options;
  geometry::Camera camera;  // unknown camera: a usual field of view
  camera.fx = camera.fy = 1.2 * image.cols;
  camera.cx = image.cols / 2.0 - 0.5;
  camera.cy = image.rows / 2.0 - 0.5;
  options.camera = camera;
  TargetSession session(planar::TargetTracker({trained}, options));
  page.grid({page.drawing("target-quality", planar::image_targets::draw_quality(trained),
                          "trackability of the image: stable features, and its rating"),
             page.image("target-box", seen_in(session, image, true),
                        "detected at a small size, rotated and partly hidden")});
  page.command(
      "tarsier ar target-train box.png -o box.target.json --width 20cm --draw quality.png");
  page.command(
      "tarsier ar target-track box_in_scene.png --target box.target.json --camera camera.yaml -o "
      "found.png");
}

}  // namespace

void demo_targets(Context& context, DemoPage& page) {
  const auto frames = static_cast<int>(kVideoSeconds * 25);
  context.progress->begin("targets", frames, "frames");
  page.begin_area("Image targets",
                  "Any flat image with enough detail can serve instead of a marker. It is trained "
                  "from one image, detected in other images, and tracked through a video.");
  show_box(page);
  synth::VideoOptions video_options;
  video_options.exposure = 0.35;
  video_options.seed = context.seed;
  const synth::PlanarPrint poster = synth::poster_print(0, context.seed);
  const synth::PlanarVideo video = synth::print_video({poster}, video_options);
  planar::TargetTrackerOptions options;
  options.camera = video.camera();
  TargetSession session(planar::TargetTracker(
      {planar::image_targets::train_target(poster.image, "poster")}, options));
  std::vector<DemoImage> strip;
  int seen = 0;
  for (int i = 0; i < frames; ++i) {
    throw_if_stopped(context.stop);
    const cv::Mat drawn = seen_in(session, video.image_at(i / 25.0), false);
    seen += session.result().tracked.empty() ? 0 : 1;
    if (i % (frames / 5) == frames / 10)
      strip.push_back(
          page.image(fmt::format("target-video-{}", strip.size() + 1), drawn,
                     fmt::format("{:.1f} s, {:.1f} ms", i / 25.0, session.result().ms)));
    context.progress->advance();
  }
  page.heading(
      "Tracking in a video",
      fmt::format("A rendered video: the camera moves by up to 25 pixels per frame, the light "
                  "changes, and a hand hides a part. The target is tracked in {} of {} frames.",
                  seen, frames));
  page.grid(strip);
  page.command("tarsier ar target-track 0 --window  # select an image with the mouse");
  context.progress->end();
}

}  // namespace tarsier::cli
