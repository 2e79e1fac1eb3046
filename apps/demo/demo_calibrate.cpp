// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/geometry/undistort.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/calibration/draw_board.h"
#include "tarsier/planar/pipelines/calibrator.h"
#include "tarsier/planar/sheets/sheet.h"
#include "tarsier/synth/boards.h"

#include <fmt/format.h>

#include "demo.h"
#include "verbs/program/sample_images.h"
#include <filesystem>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using planar::calibration::Calibration;

constexpr int kSyntheticImages = 12;  // synthetic images, if there are no others

struct Shot {
  std::string name;
  cv::Mat image;
};

// The left images of OpenCV's stereo pair, or synthetic ones.
std::vector<Shot> shots(const planar::calibration::BoardSpec& spec) {
  std::vector<Shot> result;
  for (int k = 1; k <= 14; ++k) {
    const std::string path = sample_image(fmt::format("left{:02}.jpg", k));
    std::error_code error;
    if (fs::exists(path, error)) result.push_back({fmt::format("left{:02}", k), read_image(path)});
  }
  if (!result.empty()) return result;
  const synth::BoardVideo video({640, 480}, spec, 1);
  for (int k = 0; k < kSyntheticImages; ++k)
    result.push_back({fmt::format("drawn{:02}", k), video.image_at(0.8 + 1.2 * k)});
  return result;
}

void add_table(DemoPage& page, const Calibration& calibration, const std::vector<Shot>& images) {
  const geometry::Camera& c = calibration.camera;
  const planar::calibration::Deviations& d = calibration.deviations;
  const auto row = [](const char* what, double value, double deviation, int digits) {
    return std::vector<std::string>{what, fmt::format("{:.{}f}", value, digits),
                                    fmt::format("{:.{}f}", deviation, digits)};
  };
  page.table(
      {"number", "value", "standard deviation"},
      {row("fx, px", c.fx, d.fx, 2), row("fy, px", c.fy, d.fy, 2), row("cx, px", c.cx, d.cx, 2),
       row("cy, px", c.cy, d.cy, 2), row("k1", c.distortion[0], d.distortion[0], 4),
       row("k2", c.distortion[1], d.distortion[1], 4),
       row("p1", c.distortion[2], d.distortion[2], 5),
       row("p2", c.distortion[3], d.distortion[3], 5),
       row("k3", c.distortion[4], d.distortion[4], 4)},
      fmt::format(
          "The camera, estimated from {} of {} images. The reprojection error is {:.2f} px (RMS).",
          calibration.used, images.size(), c.rms));
}

}  // namespace

void demo_calibrate(Context& context, DemoPage& page) {
  const planar::calibration::BoardSpec spec = planar::calibration::parse_board("chess:9x6", 0.025);
  const std::vector<Shot> images = shots(spec);
  context.progress->begin("calibrate", static_cast<std::int64_t>(images.size()), "images");
  page.begin_area("Camera calibration",
                  "Images of a printed board determine the focal length, the principal point and "
                  "the lens distortion of a camera.");
  planar::CalibratorOptions options;
  options.board = spec;
  const auto calibrator = planar::Calibrator::load(options);
  planar::CalibratorState state;
  for (const Shot& shot : images) {
    throw_if_stopped(context.stop);
    Frame frame;
    frame.image = shot.image;
    frame.name = shot.name;
    frame.still = true;
    calibrator.process(frame, state);
    context.progress->advance();
  }
  const planar::CalibrationResult result = calibrator.calibrate(state, {}, context.stop);
  const Calibration& calibration = result.calibration;
  if (!calibration.ok()) {
    page.note(calibration.refusal);
    context.progress->end();
    return;
  }
  const geometry::Camera straight = geometry::undistorted_camera(calibration.camera);
  // The view with the largest tilt shows the distortion well.
  std::size_t max_tilt_index = 0;
  double tilt = -1;
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (!result.images[i].reason.empty()) continue;
    const double tilt_deg = calibration.views[result.images[i].view].tilt_deg;
    if (tilt_deg <= tilt) continue;
    tilt = tilt_deg;
    max_tilt_index = i;
  }
  const std::size_t view = result.images[max_tilt_index].view;
  const cv::Mat& image = images[max_tilt_index].image;
  page.compare(
      page.image("calibrate-bent", image, "original image"),
      page.image("calibrate-straight",
                 geometry::undistort_image(image, calibration.camera, straight), "undistorted"));
  page.command(
      "tarsier calibrate images/ --board chess:9x6 --square 25mm -o camera.yaml "
      "--undistorted straight");
  cv::Mat corners = image.clone();
  draw_view(corners, result.views[view], spec);
  draw_errors(corners, result.views[view], spec, calibration.camera,
              calibration.views[view].camera_from_board, 20);
  page.heading("Detected corners",
               "Corners are located to a tenth of a pixel. Red lines are the reprojection errors, "
               "enlarged 20 times. The map shows which parts of the image the board covered. The "
               "calibration reports which views are missing.");
  page.grid(
      {page.image("calibrate-corners", corners, images[max_tilt_index].name),
       page.drawing("calibrate-coverage", coverage_image(result.used_views(), result.coverage, 640),
                    "coverage of the image by the board")});
  add_table(page, calibration, images);
  page.heading("Board to print", "The board is true to scale, as PDF, SVG or PNG.");
  const auto charuco = planar::calibration::parse_board("charuco:5x7:6x6_250", 0.035);
  page.grid(
      {page.drawing("calibrate-sheet",
                    planar::sheets::raster_of(planar::sheets::board_page(charuco, {}), 60),
                    "a board with markers: a visible part of it is sufficient"),
       page.drawing(
           "calibrate-markers",
           planar::sheets::raster_of(
               planar::sheets::marker_pages("6x6_250", {0, 1, 2, 3, 4, 5}, 50, {}).front(), 60),
           "markers")});
  page.command("tarsier ar marker-sheet --board charuco:5x7:6x6_250 --square 35mm -o board.pdf");
  context.progress->end();
}

}  // namespace tarsier::cli
