// SPDX-License-Identifier: MIT
#include "tarsier/core/rounding.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/pipelines/calibrator.h"

#include <nlohmann/json.hpp>
#include <span>

namespace tarsier::planar {
namespace {

using Json = nlohmann::ordered_json;

Json list_of(std::span<const double> numbers) {
  Json list = Json::array();
  for (const double number : numbers) list.push_back(number);
  return list;
}

}  // namespace

nlohmann::ordered_json to_json(const CalibrationResult& result, const CalibrationImage& image) {
  Json line;
  if (image.still) {
    line["image"] = image.name;
  } else {
    line["frame"] = image.index;
    line["time"] = rounded_to_steps(image.time, 1e3);
  }
  line["found"] = image.found;
  line["used"] = image.reason.empty() && result.ok();
  if (!image.reason.empty()) line["reason"] = image.reason;
  if (image.found) {
    line["points"] = result.views[image.view].points.size();
    const calibration::ViewReport& report = result.calibration.views[image.view];
    if (report.state != calibration::ViewState::kNoPose && result.ok()) {
      line["dropped"] = report.dropped;
      line["rms"] = rounded_to_steps(report.rms, 1e4);
      line["tilt"] = rounded_to_steps(report.tilt_deg, 10);
      const Eigen::Vector3d rotation = geometry::rotation_vector(report.camera_from_board.rotation);
      const Eigen::Vector3d& t = report.camera_from_board.translation;
      line["rvec"] = {rotation[0], rotation[1], rotation[2]};
      line["tvec"] = {t[0], t[1], t[2]};
    }
  }
  line["ms"] = rounded_to_steps(image.ms, 100);
  return line;
}

nlohmann::ordered_json to_json(const CalibrationResult& result) {
  const calibration::Coverage& coverage = result.coverage;
  if (!result.ok()) {
    return {{"board", result.board.text()},
            {"refusal", result.calibration.refusal},
            {"images", result.images.size()},
            {"coverage", rounded_to_steps(coverage.share(), 1e3)},
            {"missing", coverage.missing()}};
  }
  const geometry::Camera& camera = result.calibration.camera;
  const calibration::Deviations& d = result.calibration.deviations;
  return {{"model", name_of(camera.lens)},
          {"board", result.board.text()},
          {"width", camera.width},
          {"height", camera.height},
          {"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"distortion", list_of(camera.coefficients())},
          {"rms", rounded_to_steps(camera.rms, 1e6)},
          {"deviations",
           {{"fx", d.fx},
            {"fy", d.fy},
            {"cx", d.cx},
            {"cy", d.cy},
            {"distortion", list_of({d.distortion.data(), camera.coefficients().size()})}}},
          {"images", result.images.size()},
          {"used", result.calibration.used},
          {"coverage", rounded_to_steps(coverage.share(), 1e3)},
          {"missing", coverage.missing()},
          {"warnings", result.calibration.warnings}};
}

}  // namespace tarsier::planar
