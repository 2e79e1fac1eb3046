// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/planar/augment/augment.h"
#include "tarsier/render/builtin.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/planar_images.h"
#include "tarsier/synth/planar_source.h"

#include <fmt/format.h>

#include "demo.h"
#include "ui/planar/ar_session.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

const cv::Size kSize{640, 480};
constexpr double kFps = 25;
constexpr int kMarkerFrameCount = 150;  // one turn of the video
constexpr double kMarkerSide_m = 0.05;

synth::PlanarVideo desk_video() {
  synth::PlanarSourceOptions options;
  options.video.speed_px = 12;
  options.video.exposure = 0.1;
  return synth::planar_source_video(options, kSize, kFps, 5);
}

// A painted box with a ball on it, z up.
std::shared_ptr<const render::Mesh> make_box_and_ball() {
  render::Mesh mesh = render::make_cube(render::make_texture(synth::poster_image({256, 256}, 7)));
  render::Mesh ball = render::make_sphere(24, {0.2F, 0.35F, 0.9F});
  for (cv::Vec3f& p : ball.positions) p = 0.4F * p + cv::Vec3f(0, 0, 0.9F);
  append(mesh, ball);
  return std::make_shared<const render::Mesh>(
      planar::augment::upright_mesh(mesh, planar::augment::Up::kZ));
}

struct Tally {
  int shown = 0;
  int found = 0;
  int flips = 0;
  std::vector<double> corner_px;
  std::vector<double> milliseconds;
};

void count(const std::vector<planar::TrackedMarker>& found,
           const std::vector<synth::PrintTruth>& truth, Tally& tally) {
  for (const synth::PrintTruth& print : truth) {
    if (print.visible < 0.99) continue;
    ++tally.shown;
    const auto at = std::find_if(found.begin(), found.end(), [&](const planar::TrackedMarker& m) {
      return m.marker.id == print.id;
    });
    if (at == found.end() || !at->pose) continue;
    ++tally.found;
    double sum = 0;
    for (std::size_t k = 0; k < 4; ++k)
      sum += std::hypot(at->marker.corners[k].x() - print.corners[k].x,
                        at->marker.corners[k].y() - print.corners[k].y);
    tally.corner_px.push_back(sum / 4);
    const double turned = geometry::angle_of(at->pose->camera_from_marker.rotation *
                                             print.camera_from_print.rotation.transpose());
    if (turned > 15 * CV_PI / 180) ++tally.flips;
  }
}

void add_table(DemoPage& page, const Tally& tally) {
  const double shown = std::max(1, tally.shown);
  page.table(
      {"", ""},
      {{"visible markers", std::to_string(tally.shown)},
       {"detected, with a pose", fmt::format("{:.1f} %", 100 * tally.found / shown)},
       {"median corner error", fmt::format("{:.2f} px", upper_median(tally.corner_px))},
       {"poses with an error above 15 degrees", std::to_string(tally.flips)},
       {"median time per frame", fmt::format("{:.1f} ms", upper_median(tally.milliseconds))}},
      "Measured on the video above, whose ground truth is known.");
}

}  // namespace

void demo_markers(Context& context, DemoPage& page) {
  const synth::PlanarVideo video = desk_video();
  planar::MarkerTrackerOptions how;
  how.side = kMarkerSide_m;
  how.camera = video.camera();
  const auto tracker = planar::MarkerTracker::load(how);
  ArSessionOptions options;
  options.outlines = false;
  options.augment.object = planar::augment::Object::kMesh;
  options.augment.mesh = make_box_and_ball();
  context.progress->begin("markers", kMarkerFrameCount, "frames");
  page.begin_area(
      "Square markers",
      "A black square with a pattern determines the camera pose. Virtual objects on it keep their "
      "position, cast shadows on the sheet, and are hidden behind other objects.");
  ArSession session(tracker, options);
  SourceStatus live;
  live.state = SourceState::kLive;
  std::vector<cv::Mat> frames;
  Tally tally;
  std::vector<DemoImage> shown;
  DemoImage poster;
  cv::Mat plain;
  cv::Mat drawn;
  for (int i = 0; i < kMarkerFrameCount; ++i) {
    throw_if_stopped(context.stop);
    Frame frame;
    frame.index = i;
    frame.time = i / kFps;
    frame.name = "video";
    frame.image = video.image_at(frame.time);
    synth::add_noise(frame.image, 2, static_cast<std::uint64_t>(i));
    const View view = session.on_frame(frame, live);
    frames.push_back(view.output.clone());
    count(session.result().markers, video.truth_at(frame.time), tally);
    tally.milliseconds.push_back(session.result().ms);
    if (i == 60) {
      plain = frame.image.clone();
      drawn = view.output.clone();
    }
    context.progress->advance();
  }
  poster = page.image("markers-poster", drawn, "a rendered video of a desk");
  page.compare(page.image("markers-plain", plain, "camera image"),
               page.image("markers-drawn", drawn, "with a virtual box on each marker"));
  page.command("tarsier ar markers 0 --size 50mm --camera camera.yaml --mesh object.obj --window");
  if (write_demo_video(page.path_of("markers.mp4"), frames, kFps)) {
    DemoImage moving = poster;
    moving.file = "img/markers.mp4";
    page.video(moving, poster);
  }
  add_table(page, tally);
  // The other objects, on a single image.
  Frame still;
  still.still = true;
  still.name = "still";
  still.image = plain;
  for (const planar::augment::Object object :
       {planar::augment::Object::kNone, planar::augment::Object::kAxes,
        planar::augment::Object::kCube}) {
    options.augment.object = object;
    options.outlines = object == planar::augment::Object::kNone;
    ArSession other(tracker, options);
    const View view = other.on_frame(still, live);
    const std::string name(
        object == planar::augment::Object::kNone ? "ids" : planar::augment::name_of(object));
    shown.push_back(page.image("markers-" + name, view.output, "--draw " + name));
  }
  page.grid(shown);
  context.progress->end();
}

}  // namespace tarsier::cli
