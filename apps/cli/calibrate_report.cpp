// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/undistort.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/planar/calibration/draw_board.h"

#include <fmt/format.h>

#include "cmd_calibrate.h"
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using geometry::Camera;
using planar::calibration::Calibration;
using planar::calibration::ViewReport;
using planar::calibration::ViewState;
using Json = nlohmann::ordered_json;

cv::Vec3d rotation_vector(const cv::Matx33d& rotation) {
  const cv::Vec4d q = geometry::quaternion_of(rotation);
  const cv::Vec3d axis(q[1], q[2], q[3]);
  const double sine = cv::norm(axis);
  return sine > 1e-12 ? axis * (2 * std::atan2(sine, q[0]) / sine) : 2 * axis;
}

// Why a picture does not count; empty: it does.
std::string reason_of(const CalibrationPicture& picture, const Calibration& calibration) {
  if (!picture.reason.empty() || !calibration.ok()) return picture.reason;
  switch (calibration.views[picture.view].state) {
    case ViewState::kUsed:
      return "";
    case ViewState::kNoPose:
      return "the board has no pose";
    case ViewState::kOutlier:
      break;
  }
  return "does not fit the other views";
}

Json picture_json(const CalibrationPicture& picture, const CalibrationJob& job,
                  const Calibration& calibration) {
  Json line;
  if (picture.still) {
    line["image"] = picture.name;
  } else {
    line["frame"] = picture.index;
    line["time"] = rounded(picture.time, 3);
  }
  line["found"] = picture.found;
  const std::string reason = reason_of(picture, calibration);
  line["used"] = reason.empty() && calibration.ok();
  if (!reason.empty()) line["reason"] = reason;
  if (picture.found) {
    const ViewReport& report = calibration.views[picture.view];
    line["points"] = job.views[picture.view].points.size();
    if (report.state != ViewState::kNoPose && calibration.ok()) {
      line["dropped"] = report.dropped;
      line["rms"] = rounded(report.rms, 4);
      line["tilt"] = rounded(report.tilt_deg, 1);
      const cv::Vec3d turn = rotation_vector(report.camera_from_board.rotation);
      const cv::Vec3d& t = report.camera_from_board.translation;
      line["rvec"] = {turn[0], turn[1], turn[2]};
      line["tvec"] = {t[0], t[1], t[2]};
    }
  }
  line["ms"] = rounded(picture.ms, 2);
  return line;
}

Json list_of(std::span<const double> numbers) {
  Json list = Json::array();
  for (const double number : numbers) list.push_back(number);
  return list;
}

Json summary_json(const CalibrateFlags& flags, const CalibrationJob& job,
                  const Calibration& calibration, const planar::calibration::Coverage& coverage) {
  const Camera& camera = calibration.camera;
  const planar::calibration::Deviations& d = calibration.deviations;
  const std::size_t numbers = camera.coefficients().size();
  Json line{{"camera", flags.output.empty() ? Json(nullptr) : Json(flags.output)},
            {"model", name_of(camera.lens)},
            {"board", job.spec.text()},
            {"width", camera.width},
            {"height", camera.height},
            {"fx", camera.fx},
            {"fy", camera.fy},
            {"cx", camera.cx},
            {"cy", camera.cy},
            {"distortion", list_of(camera.coefficients())},
            {"rms", rounded(camera.rms, 6)},
            {"deviations",
             {{"fx", d.fx},
              {"fy", d.fy},
              {"cx", d.cx},
              {"cy", d.cy},
              {"distortion", list_of({d.distortion.data(), numbers})}}},
            {"pictures", job.pictures.size()},
            {"used", calibration.used},
            {"coverage", rounded(coverage.share(), 3)},
            {"missing", coverage.missing()},
            {"warnings", calibration.warnings}};
  return line;
}

std::string join(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

std::string shown_name(const CalibrationPicture& picture) {
  return picture.still ? printable(picture.name)
                       : fmt::format("frame {} ({:.2f} s)", picture.index, picture.time);
}

void print_table(const CalibrationJob& job, const Calibration& calibration,
                 const planar::calibration::Coverage& coverage) {
  std::string text;
  int dull = 0;  // frames of videos that brought nothing
  for (const CalibrationPicture& picture : job.pictures) {
    const std::string reason = reason_of(picture, calibration);
    if (!picture.found) {
      if (picture.still) {
        text += fmt::format("{}: {}\n", shown_name(picture), reason);
      } else {
        ++dull;
      }
      continue;
    }
    const ViewReport& report = calibration.views[picture.view];
    text +=
        fmt::format("{}: {} points, {:.3f} px, tilted by {:.0f} degrees{}{}\n", shown_name(picture),
                    job.views[picture.view].points.size(), report.rms, report.tilt_deg,
                    report.dropped > 0 ? fmt::format(", {} left out", report.dropped) : "",
                    reason.empty() ? "" : ": LEFT OUT, it " + reason);
  }
  if (dull > 0) text += fmt::format("{} more frames brought nothing new\n", dull);
  const Camera& c = calibration.camera;
  const planar::calibration::Deviations& d = calibration.deviations;
  text += fmt::format(
      "\n{} lens, {}x{} px, from {} views: rms {:.3f} px\n"
      "  fx {:.2f} +- {:.2f}   fy {:.2f} +- {:.2f} px\n"
      "  cx {:.2f} +- {:.2f}   cy {:.2f} +- {:.2f} px\n",
      name_of(c.lens), c.width, c.height, calibration.used, c.rms, c.fx, d.fx, c.fy, d.fy, c.cx,
      d.cx, c.cy, d.cy);
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
  text += fmt::format("{:.0f} % of the picture is covered", 100 * coverage.share());
  const auto missing = coverage.missing();
  text += missing.empty() ? "\n" : fmt::format("; better with: {}\n", join(missing, ", "));
  print_text(text);
}

void write_csv(const std::string& path, const CalibrationJob& job, const Calibration& calibration) {
  std::string text = "picture,time,found,used,points,dropped,rms_px,tilt_deg,reason\n";
  const auto quoted = [](const std::string& word) {
    if (word.find_first_of(",\"\n\r") == std::string::npos) return word;
    std::string result = "\"";
    for (const char c : word) result += c == '"' ? std::string("\"\"") : std::string(1, c);
    return result + '"';
  };
  for (const CalibrationPicture& picture : job.pictures) {
    const std::string reason = reason_of(picture, calibration);
    const ViewReport none;
    const ViewReport& report = picture.found ? calibration.views[picture.view] : none;
    text += fmt::format("{},{:.3f},{:d},{:d},{},{},{:.4f},{:.1f},{}\n",
                        quoted(picture.still ? picture.name : std::to_string(picture.index)),
                        picture.time, picture.found, reason.empty(),
                        picture.found ? job.views[picture.view].points.size() : std::size_t{0},
                        report.dropped, report.rms, report.tilt_deg, quoted(reason));
  }
  write_file_atomically(path, text);
}

// Pictures of one folder of output: no two of the same name.
class Folder {
 public:
  explicit Folder(std::string path) : path_(std::move(path)) { make_folder(path_); }
  std::string file(const CalibrationPicture& picture, const char* ending) {
    const std::string stem = picture.still ? fs::path(picture.name).stem().string().substr(0, 150)
                                           : fmt::format("frame-{:06}", picture.index);
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

cv::Mat image_of(const CalibrationPicture& picture) {
  return picture.still ? read_image(picture.name) : picture.image.clone();
}

void draw_pictures(const CalibrateFlags& flags, const CalibrationJob& job,
                   const Calibration& calibration, const planar::calibration::Coverage& coverage,
                   Context& context) {
  constexpr double kErrorScale = 20;
  Folder folder(flags.draw);
  for (const CalibrationPicture& picture : job.pictures) {
    throw_if_stopped(context.stop);
    if (!picture.found || job.views[picture.view].empty()) continue;
    cv::Mat image = image_of(picture);
    const planar::calibration::BoardView& view = job.views[picture.view];
    draw_view(image, view, job.spec);
    const ViewReport& report = calibration.views[picture.view];
    if (report.state != ViewState::kNoPose && calibration.ok()) {
      draw_errors(image, view, job.spec, calibration.camera, report.camera_from_board, kErrorScale);
    }
    write_image(folder.file(picture, ".png"), image);
  }
  std::vector<planar::calibration::BoardView> used;
  for (std::size_t i = 0; i < job.views.size(); ++i)
    if (calibration.views[i].state == ViewState::kUsed) used.push_back(job.views[i]);
  write_image(folder.plain("coverage.png"), coverage_picture(used, coverage, 960));
}

void straighten_pictures(const CalibrateFlags& flags, const CalibrationJob& job,
                         const Calibration& calibration, Context& context) {
  const Camera straight = geometry::undistorted_camera(calibration.camera);
  const geometry::Straightener straighten(calibration.camera, straight);
  Folder folder(flags.undistorted);
  for (const CalibrationPicture& picture : job.pictures) {
    throw_if_stopped(context.stop);
    if (picture.still ? !picture.found : picture.image.empty()) continue;
    const cv::Mat image = image_of(picture);
    if (image.size() != job.size) continue;
    write_image(folder.file(picture, ".png"), straighten(image));
  }
  geometry::write_camera_file(folder.plain("camera.yaml"), straight);
}

planar::calibration::Coverage coverage_of_used(const CalibrationJob& job,
                                               const Calibration& calibration) {
  std::vector<planar::calibration::BoardView> used;
  for (std::size_t i = 0; i < job.views.size(); ++i)
    if (calibration.views[i].state == ViewState::kUsed) used.push_back(job.views[i]);
  return coverage_of(used, job.spec, job.size);
}

}  // namespace

ExitStatus finish_calibration(const CalibrateFlags& flags, const CalibrationJob& job,
                              Context& context) {
  if (job.size.empty()) {  // no board anywhere
    for (const CalibrationPicture& picture : job.pictures)
      print_json(picture_json(picture, job, {}));
    return ExitStatus::kNothingFound;
  }
  const Calibration calibration =
      calibrate(job.views, job.spec, job.size, flags.options, context.stop);
  if (context.json) {
    for (const CalibrationPicture& picture : job.pictures)
      print_json(picture_json(picture, job, calibration));
  }
  if (!calibration.ok()) throw InputError(flags.run.inputs.front(), calibration.refusal);
  const planar::calibration::Coverage coverage = coverage_of_used(job, calibration);
  if (!flags.output.empty()) {
    const auto format = flags.format == "opencv"   ? geometry::CameraFormat::kOpencv
                        : flags.format == "colmap" ? geometry::CameraFormat::kColmap
                                                   : geometry::CameraFormat::kTarsier;
    geometry::write_camera_file(flags.output, calibration.camera, format);
  }
  if (!flags.csv.empty()) write_csv(flags.csv, job, calibration);
  if (!flags.draw.empty()) draw_pictures(flags, job, calibration, coverage, context);
  for (const std::string& warning : calibration.warnings) log_warning("{}", warning);
  if (context.json) {
    print_json(summary_json(flags, job, calibration, coverage));
  } else if (!context.quiet) {
    print_table(job, calibration, coverage);
  }
  // Last: a lens that cannot be undone at the border is an error, of the pictures alone.
  if (!flags.undistorted.empty()) straighten_pictures(flags, job, calibration, context);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
