// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"

#include <fmt/format.h>

#include "verbs/pose/engine.h"
#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

// Scores of poses, for `pose eval` and `pose train-view`.
namespace tarsier::cli {
namespace {

std::string text_of(const face::head::PointingScore& score) {
  std::string text = fmt::format(
      "{} images with |pan| <= 45 and |tilt| <= 30: pose found in {}; of the {} where the strict "
      "detector sees a face, in {:.1f} %\n"
      "yaw   MAE {:.2f} degrees after the offset of {:+.2f}; {:.2f} without\n"
      "pitch MAE {:.2f} degrees after the offset of {:+.2f}; {:.2f} without\n"
      "direction: elevation MAE {:.2f}, azimuth {:.2f} degrees after their offsets\n"
      "mean yaw {} with pan:",
      score.images, score.with_pose, score.detected,
      100.0 * score.detected_with_pose / std::max(1, score.detected), score.yaw_mae_deg,
      score.yaw_offset_deg, score.yaw_mae_raw_deg, score.pitch_mae_deg, score.pitch_offset_deg,
      score.pitch_mae_raw_deg, score.elevation_mae_deg, score.azimuth_mae_deg,
      score.yaw_rises ? "rises strictly" : "does NOT rise strictly");
  for (const auto& [pan, yaw] : score.yaw_of_pan) text += fmt::format("  {:+g}: {:+.1f}", pan, yaw);
  text += "\nmean pitch by tilt:";
  for (const auto& [tilt, pitch] : score.pitch_of_tilt) {
    text += fmt::format("  {:+g}: {:+.1f}", tilt, pitch);
  }
  return text + "\n" + coverage_text(score.coverage);
}

nlohmann::ordered_json json_of(const face::head::PointingScore& score) {
  nlohmann::ordered_json line;
  line["set"] = "pointing04";
  line["images"] = score.images;
  line["seen"] = score.detected;
  line["seen_found"] = score.detected_with_pose;
  line["found"] = score.with_pose;
  line["yaw_mae"] = rounded(score.yaw_mae_deg, 3);
  line["pitch_mae"] = rounded(score.pitch_mae_deg, 3);
  line["yaw_offset"] = rounded(score.yaw_offset_deg, 3);
  line["pitch_offset"] = rounded(score.pitch_offset_deg, 3);
  line["yaw_mae_raw"] = rounded(score.yaw_mae_raw_deg, 3);
  line["pitch_mae_raw"] = rounded(score.pitch_mae_raw_deg, 3);
  line["elevation_mae"] = rounded(score.elevation_mae_deg, 3);
  line["azimuth_mae"] = rounded(score.azimuth_mae_deg, 3);
  line["yaw_rises"] = score.yaw_rises;
  for (const auto& [pan, yaw] : score.yaw_of_pan) {
    line["yaw_of_pan"][fmt::format("{:+g}", pan)] = rounded(yaw, 3);
  }
  for (const auto& [tilt, pitch] : score.pitch_of_tilt) {
    line["pitch_of_tilt"][fmt::format("{:+g}", tilt)] = rounded(pitch, 3);
  }
  add_coverage(score.coverage, line);
  return line;
}

}  // namespace

std::string coverage_text(const face::head::AngleCoverage& coverage, const std::string& of) {
  const auto share = [](int within, int count) {
    const Interval interval = wilson_interval(within, count);
    return fmt::format("{:.1f} % ({} of {}; {:.0f}-{:.0f})", 100.0 * within / count, within, count,
                       100 * interval.low, 100 * interval.high);
  };
  std::string text;
  for (const auto& [name, axis] :
       {std::pair("yaw", coverage.yaw), std::pair("pitch", coverage.pitch),
        std::pair("roll", coverage.roll)}) {
    if (axis.count == 0) continue;
    text += fmt::format("{:<5} within 1 sigma{} {}, within 2 {}\n", name, of,
                        share(axis.within, axis.count), share(axis.within2, axis.count));
  }
  return text;
}

void add_coverage(const face::head::AngleCoverage& coverage, nlohmann::ordered_json& line,
                  const std::string& of) {
  for (const auto& [name, axis] :
       {std::pair("yaw", coverage.yaw), std::pair("pitch", coverage.pitch),
        std::pair("roll", coverage.roll)}) {
    if (axis.count == 0) continue;
    if (of.empty()) line["with_sigma"] = axis.count;
    line[fmt::format("{}{}_within_sigma", name, of)] = rounded(1.0 * axis.within / axis.count, 4);
    line[fmt::format("{}{}_within_2sigma", name, of)] = rounded(1.0 * axis.within2 / axis.count, 4);
  }
}

void print_pointing(const face::head::PointingScore& score, const Context& context,
                    const std::string& title) {
  if (!context.json) {
    print_text((title.empty() ? "" : title + ": ") + text_of(score));
    return;
  }
  nlohmann::ordered_json line = json_of(score);
  if (!title.empty()) line["what"] = title;
  print_json(line);
}

}  // namespace tarsier::cli
