// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/geometry/undistort.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/calibration/draw_board.h"

#include <fmt/format.h>

#include "verbs/calibrate/calibrate.h"
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using geometry::Camera;
using planar::CalibrationImage;
using planar::CalibrationResult;
using planar::calibration::ViewReport;
using planar::calibration::ViewState;
using Json = nlohmann::ordered_json;

std::string join(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

std::string shown_name(const CalibrationImage& entry) {
  return entry.still ? printable(entry.name)
                     : fmt::format("frame {} ({:.2f} s)", entry.index, entry.time);
}

void print_table(const CalibrationResult& result) {
  std::string text;
  int dull = 0;  // frames of videos that gave no view
  for (const CalibrationImage& entry : result.images) {
    if (!entry.found) {
      if (entry.still) {
        text += fmt::format("{}: {}\n", shown_name(entry), entry.reason);
      } else {
        ++dull;
      }
      continue;
    }
    const ViewReport& report = result.calibration.views[entry.view];
    text +=
        fmt::format("{}: {} points, {:.3f} px, tilted by {:.0f} degrees{}{}\n", shown_name(entry),
                    result.views[entry.view].points.size(), report.rms, report.tilt_deg,
                    report.dropped > 0 ? fmt::format(", {} left out", report.dropped) : "",
                    entry.reason.empty() ? "" : ": LEFT OUT, it " + entry.reason);
  }
  if (dull > 0) text += fmt::format("{} more frames added no new views\n", dull);
  const Camera& c = result.calibration.camera;
  const planar::calibration::Deviations& d = result.calibration.deviations;
  text += fmt::format(
      "\n{} lens, {}x{} px, from {} views: rms {:.3f} px\n"
      "  fx {:.2f} +- {:.2f}   fy {:.2f} +- {:.2f} px\n"
      "  cx {:.2f} +- {:.2f}   cy {:.2f} +- {:.2f} px\n",
      name_of(c.lens), c.width, c.height, result.calibration.used, c.rms, c.fx, d.fx, c.fy, d.fy,
      c.cx, d.cx, c.cy, d.cy);
  static const std::map<geometry::Lens, std::vector<const char*>> kNames{
      {geometry::Lens::kPinhole, {"k1", "k2", "p1", "p2", "k3"}},
      {geometry::Lens::kRational, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}},
      {geometry::Lens::kFisheye, {"k1", "k2", "k3", "k4"}}};
  std::size_t k = 0;
  for (const char* name : kNames.at(c.lens)) {
    text += fmt::format("  {} {:.5f} +- {:.5f}", name, c.distortion[k], d.distortion[k]);
    ++k;
    if (k == c.coefficients().size() || k % 3 == 0) text += '\n';
  }
  text += fmt::format("{:.0f} % of the image is covered", 100 * result.coverage.share());
  const auto missing = result.coverage.missing();
  text += missing.empty() ? "\n" : fmt::format("; better with: {}\n", join(missing, ", "));
  print_text(text);
}

void write_csv(const std::string& path, const CalibrationResult& result) {
  std::string text = "image,time,found,used,points,dropped,rms_px,tilt_deg,reason\n";
  for (const CalibrationImage& entry : result.images) {
    const ViewReport none;
    const ViewReport& report = entry.found ? result.calibration.views[entry.view] : none;
    text += fmt::format("{},{:.3f},{:d},{:d},{},{},{:.4f},{:.1f},{}\n",
                        csv_field(entry.still ? entry.name : std::to_string(entry.index)),
                        entry.time, entry.found, entry.reason.empty(),
                        entry.found ? result.views[entry.view].points.size() : std::size_t{0},
                        report.dropped, report.rms, report.tilt_deg, csv_field(entry.reason));
  }
  write_file_atomically(path, text);
}

// Output images in one folder, with unique names.
class Folder {
 public:
  explicit Folder(std::string path) : path_(std::move(path)) { make_folder(path_); }
  std::string file(const CalibrationImage& entry, const char* ending) {
    const std::string stem = entry.still ? fs::path(entry.name).stem().string().substr(0, 150)
                                         : fmt::format("frame-{:06}", entry.index);
    std::string name = stem;
    for (int k = 2; !names_.insert(name).second; ++k) name = fmt::format("{}-{}", stem, k);
    return (fs::path(path_) / (name + ending)).string();
  }
  [[nodiscard]] std::string plain(const char* name) const {
    return (fs::path(path_) / name).string();
  }

 private:
  std::string path_;
  std::set<std::string> names_;
};

cv::Mat image_of(const CalibrationImage& entry) {
  return entry.still ? read_image(entry.name) : entry.image.clone();
}

void draw_images(const std::string& path, const CalibrationResult& result, Context& context) {
  constexpr double kErrorScale = 20;
  Folder folder(path);
  for (const CalibrationImage& entry : result.images) {
    throw_if_stopped(context.stop);
    if (!entry.found || result.views[entry.view].empty()) continue;
    cv::Mat image = image_of(entry);
    const planar::calibration::BoardView& view = result.views[entry.view];
    draw_view(image, view, result.board);
    const ViewReport& report = result.calibration.views[entry.view];
    if (report.state != ViewState::kNoPose) {
      draw_errors(image, view, result.board, result.calibration.camera, report.camera_from_board,
                  kErrorScale);
    }
    write_image(folder.file(entry, ".png"), image);
  }
  write_image(folder.plain("coverage.png"),
              coverage_image(result.used_views(), result.coverage, 960));
}

void straighten_images(const std::string& path, const CalibrationResult& result, Context& context) {
  const Camera& camera = result.calibration.camera;
  const Camera straight = geometry::undistorted_camera(camera);
  const geometry::Undistorter undistorter(camera, straight);
  Folder folder(path);
  for (const CalibrationImage& entry : result.images) {
    throw_if_stopped(context.stop);
    if (entry.still ? !entry.found : entry.image.empty()) continue;
    const cv::Mat image = image_of(entry);
    if (image.size() != result.size) continue;
    write_image(folder.file(entry, ".png"), undistorter(image));
  }
  geometry::write_camera_file(folder.plain("camera.yaml"), straight);
}

}  // namespace

void print_images(const CalibrationResult& result) {
  for (const CalibrationImage& entry : result.images) print_json(to_json(result, entry));
}

ExitStatus finish_calibration(const CalibrateFlags& flags, const CalibrationResult& result,
                              Context& context) {
  if (context.json) print_images(result);
  if (!result.ok()) {
    const std::vector<std::string>& inputs = flags.run.inputs;
    throw InputError(
        inputs.size() == 1 ? inputs.front() : fmt::format("these {} inputs", inputs.size()),
        result.calibration.refusal);
  }
  if (!flags.output.empty()) {
    const auto format = flags.format == "opencv"   ? geometry::CameraFormat::kOpencv
                        : flags.format == "colmap" ? geometry::CameraFormat::kColmap
                                                   : geometry::CameraFormat::kTarsier;
    geometry::write_camera_file(flags.output, result.calibration.camera, format);
  }
  if (!flags.csv.empty()) write_csv(flags.csv, result);
  if (!flags.draw.empty()) draw_images(flags.draw, result, context);
  for (const std::string& warning : result.calibration.warnings) log_warning("{}", warning);
  if (context.json) {
    Json line{{"camera", flags.output.empty() ? Json(nullptr) : Json(flags.output)}};
    line.update(to_json(result));
    print_json(line);
  } else if (!context.quiet) {
    print_table(result);
  }
  // Last, because a lens whose distortion cannot be inverted at the border only affects these
  // images.
  if (!flags.undistorted.empty()) straighten_images(flags.undistorted, result, context);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
