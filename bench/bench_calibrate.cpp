// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/detect.h"
#include "tarsier/synth/boards.h"
#include "tarsier/synth/scene.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/size_flag.h"
#include "framework/stopwatch.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

namespace tarsier::cli {
namespace {

using planar::calibration::BoardSpec;
using planar::calibration::BoardView;
using Json = nlohmann::ordered_json;

constexpr int kViews = 15;

geometry::Camera camera_of_size(cv::Size size) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = 0.85 * size.width;
  camera.cx = 0.51 * size.width;
  camera.cy = 0.49 * size.height;
  camera.distortion = {-0.25, 0.08, 5e-4, -5e-4, 0};
  return camera;
}

// Squared distances from the exact points; symmetric boards in either order.
double squares_of(const BoardView& found, const BoardView& exact, bool may_be_turned) {
  double best = std::numeric_limits<double>::infinity();
  for (const bool turned : {false, true}) {
    if (turned && !may_be_turned) continue;
    double sum = 0;
    for (std::size_t i = 0; i < found.points.size(); ++i) {
      const auto last = static_cast<int>(exact.points.size()) - 1;
      const int k = turned ? last - found.points[i] : found.points[i];
      const cv::Point2f d = found.pixels[i] - exact.pixels[static_cast<std::size_t>(k)];
      sum += static_cast<double>(d.dot(d));
    }
    best = std::min(best, sum);
  }
  return best;
}

void print_row(Context& context, const Json& row) {
  if (context.json) {
    print_json(row);
    return;
  }
  std::string text;
  for (const auto& [key, value] : row.items()) {
    if (key == "bench") continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : "  ", key,
                        value.is_string() ? value.get<std::string>() : value.dump());
  }
  print_text(text + "\n");
}

// Rendered views of one board: detection rate, accuracy, speed, and the resulting camera.
void measure_board(Context& context, const char* board, cv::Size size) {
  const BoardSpec spec = planar::calibration::parse_board(board, 0.025);
  const geometry::Camera truth = camera_of_size(size);
  const synth::BoardRenderer renderer(truth, spec);
  std::vector<BoardView> views;
  std::vector<double> times;
  double squares = 0;
  double points = 0;
  int found = 0;
  std::uint64_t seed = context.seed;
  for (const geometry::Rigid3& pose : synth::board_poses(truth, spec, kViews, context.seed)) {
    throw_if_stopped(context.stop);
    synth::BoardAppearance appearance;
    appearance.seed = ++seed;
    appearance.clutter = 12;
    const cv::Mat image = renderer.render(pose, appearance);
    const Stopwatch watch;
    views.push_back(planar::calibration::find_board(image, spec));
    times.push_back(watch.ms());
    if (views.back().empty()) continue;
    ++found;
    squares += squares_of(views.back(), synth::exact_view(truth, pose, spec),
                          spec.kind != planar::calibration::BoardKind::kCharuco);
    points += static_cast<double>(views.back().points.size());
  }
  const Stopwatch watch;
  const auto calibration = calibrate(views, spec, size, {}, context.stop);
  const double fit_ms = watch.ms();
  print_row(context,
            {{"bench", "calibrate"},
             {"case", fmt::format("{} {}x{}", board, size.width, size.height)},
             {"found", fmt::format("{}/{}", found, kViews)},
             {"corner_rms_px", rounded(points > 0 ? std::sqrt(squares / points) : 0, 4)},
             {"find_ms", rounded(upper_median(times), 1)},
             {"fit_ms", rounded(fit_ms, 1)},
             {"rms_px", rounded(calibration.camera.rms, 4)},
             {"fx_error_percent", rounded(100 * std::abs(calibration.camera.fx / truth.fx - 1), 4)},
             {"center_error_px", rounded(std::hypot(calibration.camera.cx - truth.cx,
                                                    calibration.camera.cy - truth.cy),
                                         3)}});
}

// Images without a board: the duration of a search, immediate and in a session.
void measure_nothing(Context& context, const std::vector<cv::Mat>& images, const char* board) {
  const BoardSpec spec = planar::calibration::parse_board(board, 0.025);
  for (const bool live : {false, true}) {
    planar::calibration::FindOptions options;
    if (live) {
      options.search_px = 480;
      options.retry = false;
    }
    std::vector<double> times;
    for (const cv::Mat& image : images) {
      throw_if_stopped(context.stop);
      const Stopwatch watch;
      (void)planar::calibration::find_board(image, spec, options);
      times.push_back(watch.ms());
    }
    print_row(context,
              {{"bench", "calibrate"},
               {"case", fmt::format("{} {}", board,
                                    live ? "nothing there, as a session looks" : "nothing there")},
               {"images", images.size()},
               {"find_ms", rounded(upper_median(times), 1)},
               {"max_ms", rounded(*std::max_element(times.begin(), times.end()), 1)}});
  }
}

}  // namespace

ExitStatus bench_calibrate(Context& context, const BenchOptions& options) {
  std::vector<cv::Size> sizes;
  for (const std::string& size : options.sizes) sizes.push_back(parse_size(size, 320, 4096));
  if (sizes.empty()) sizes = {{640, 480}, {1280, 720}};
  const std::vector<const char*> boards{"chess:9x6", "charuco:7x5:5x5_100", "circles:4x11",
                                        "circles-grid:7x6"};
  for (const char* board : boards) {
    if (!is_chosen(options, board)) continue;
    for (const cv::Size& size : sizes) measure_board(context, board, size);
  }
  std::vector<cv::Mat> images;
  if (options.inputs.empty()) {
    for (std::uint64_t seed = 1; seed <= 8; ++seed)
      images.push_back(synth::render_scene({1280, 720}, 0, seed));
  } else {
    const auto source = open_sources(options.inputs);
    while (!source->ended() && images.size() < 200) {
      throw_if_stopped(context.stop);
      if (auto frame = source->next(std::chrono::milliseconds(200), context.stop))
        images.push_back(frame->image.clone());
    }
  }
  for (const char* board : boards)
    if (!images.empty()) measure_nothing(context, images, board);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
