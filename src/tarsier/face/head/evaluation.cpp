// SPDX-License-Identifier: MIT
#include "tarsier/face/head/evaluation.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/words.h"
#include "tarsier/face/head/point_file.h"
#include "tarsier/face/head/train_head.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>
#include <string_view>

namespace tarsier::face::head {
namespace {

// R = Rz(roll) Rx(pitch) Ry(yaw), degrees: pitch, yaw, roll.
Eigen::Vector3d biwi_of(const Eigen::Matrix3d& r) {
  const HeadAngles angles = angles_of_rotation(r);
  return {-angles.pitch_deg, angles.yaw_deg, angles.roll_deg};
}

double wrapped(double degrees) { return std::remainder(degrees, 360.0); }

double angle_between(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return geometry::angle_of(a * b.transpose()) / kRadiansPerDegree;
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return quantile(values, 0.5);
}

template <std::size_t N>
std::array<double, N> numbers(const nlohmann::json& value, const std::string& where) {
  std::array<double, N> result{};
  if (!value.is_array() || value.size() != N) {
    throw InputError(where, fmt::format("expected a list of {} numbers", N));
  }
  for (std::size_t k = 0; k < N; ++k) {
    if (!value[k].is_number() || !std::isfinite(value[k].get<double>())) {
      throw InputError(where, "a number is missing or not finite");
    }
    result[k] = value[k].get<double>();
  }
  return result;
}

double number_of(const nlohmann::json& object, const char* name, const std::string& where) {
  if (!object.contains(name)) return 0;
  return numbers<1>(nlohmann::json::array({object[name]}), where)[0];
}

std::optional<Eigen::Vector3d> sigma_in(const nlohmann::json& face, const std::string& where) {
  const char* names[] = {"yaw_sigma_deg", "pitch_sigma_deg", "roll_sigma_deg"};
  Eigen::Vector3d sigma;
  for (int k = 0; k < 3; ++k) {
    if (!face.contains(names[k]) || face[names[k]].is_null()) return std::nullopt;
    sigma[k] = number_of(face, names[k], where);
    if (sigma[k] < 0) throw InputError(where, fmt::format("\"{}\" is below 0", names[k]));
  }
  return sigma;
}

std::optional<Eigen::Matrix3d> rotation_in(const nlohmann::json& face, const std::string& where) {
  for (const char* name : {"rotation", "R"}) {
    if (!face.contains(name) || face[name].is_null()) continue;
    const std::array<double, 9> values = numbers<9>(face[name], where);
    const Eigen::Matrix3d r = geometry::from_row_major(values);
    if (!geometry::is_rotation(r, 1e-3)) {
      throw InputError(where, fmt::format("\"{}\" is not a rotation matrix", name));
    }
    return r;
  }
  if (face.contains("yaw") && face.contains("pitch")) {
    return rotation_of_angles({number_of(face, "yaw", where), number_of(face, "pitch", where),
                               number_of(face, "roll", where)});
  }
  if (face.contains("euler")) {
    const std::array<double, 3> euler = numbers<3>(face["euler"], where);
    return rotation_of_angles({euler[1], -euler[0], euler[2]});
  }
  return std::nullopt;
}

PoseLine line_of(const nlohmann::json& value, const std::string& where) {
  if (!value.is_object() || !value.contains("image") || !value["image"].is_string()) {
    throw InputError(where, "no object with \"image\"");
  }
  PoseLine line;
  line.image = value["image"].get<std::string>();
  const nlohmann::json* face = &value;
  if (value.contains("faces")) {
    if (!value["faces"].is_array()) throw InputError(where, "\"faces\": expected a list");
    if (value["faces"].empty()) return line;
    face = &value["faces"][0];
    if (!face->is_object()) throw InputError(where, "a face is not a JSON object");
  }
  line.rotation = rotation_in(*face, where);
  line.sigma_deg = sigma_in(*face, where);
  if (line.sigma_deg && face->contains("sigma_floor_deg")) {
    const std::array<double, 3> floor = numbers<3>((*face)["sigma_floor_deg"], where);
    line.sigma_floor_deg = Eigen::Vector3d(floor[0], floor[1], floor[2]);
  }
  for (const char* name : {"translation", "t"}) {
    if (!face->contains(name) || (*face)[name].is_null() || line.translation) continue;
    const std::array<double, 3> t = numbers<3>((*face)[name], where);
    line.translation = Eigen::Vector3d(t[0], t[1], t[2]);
  }
  return line;
}

}  // namespace

void SigmaCoverage::add(double error_deg, double sigma_deg) {
  ++count;
  within += std::abs(error_deg) <= sigma_deg ? 1 : 0;
  within2 += std::abs(error_deg) <= 2 * sigma_deg ? 1 : 0;
}

PoseScore score_poses(const std::vector<PosePair>& pairs, int truths) {
  PoseScore score;
  score.truths = truths;
  score.with_pose = static_cast<int>(pairs.size());
  std::vector<double> angles;
  std::vector<double> pitch;
  std::vector<double> yaw;
  std::vector<double> roll;
  std::vector<double> translation_errors;
  std::vector<double> share;
  for (const PosePair& pair : pairs) {
    const Eigen::Vector3d difference = biwi_of(pair.rotation) - biwi_of(pair.truth);
    pitch.push_back(std::abs(wrapped(difference[0])));
    yaw.push_back(std::abs(wrapped(difference[1])));
    roll.push_back(std::abs(wrapped(difference[2])));
    angles.push_back(angle_between(pair.rotation, pair.truth));
    if (pair.sigma_deg) {
      score.coverage.yaw.add(yaw.back(), (*pair.sigma_deg)[0]);
      score.coverage.pitch.add(pitch.back(), (*pair.sigma_deg)[1]);
      score.coverage.roll.add(roll.back(), (*pair.sigma_deg)[2]);
    }
    if (pair.sigma_deg && pair.sigma_floor_deg) {
      const Eigen::Array3d sigma =
          (pair.sigma_deg->array().square() - pair.sigma_floor_deg->array().square()).max(0).sqrt();
      score.image_coverage.yaw.add(yaw.back(), sigma[0]);
      score.image_coverage.pitch.add(pitch.back(), sigma[1]);
      score.image_coverage.roll.add(roll.back(), sigma[2]);
    }
    if (!pair.translation || !pair.true_translation) continue;
    translation_errors.push_back((*pair.translation - *pair.true_translation).norm());
    const double distance = (*pair.true_translation).norm();
    if (distance > 0) share.push_back(100 * translation_errors.back() / distance);
  }
  if (angles.empty()) return score;
  score.pitch_mae_deg = mean(pitch);
  score.yaw_mae_deg = mean(yaw);
  score.roll_mae_deg = mean(roll);
  score.mean_deg = mean(angles);
  score.over_10_deg = static_cast<double>(std::count_if(angles.begin(), angles.end(),
                                                        [](double a) { return a > 10; })) /
                      static_cast<double>(angles.size());
  std::sort(angles.begin(), angles.end());
  score.median_deg = quantile(angles, 0.5);
  score.p95_deg = quantile(angles, 0.95);
  score.with_translation = static_cast<int>(translation_errors.size());
  score.translation_mean_mm = mean(translation_errors);
  score.translation_median_mm = median(translation_errors);
  score.translation_percent = mean(share);
  return score;
}

std::vector<PoseLine> read_pose_lines(const std::string& path) {
  std::istringstream text(read_file(path, 256'000'000));
  std::vector<PoseLine> lines;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = fmt::format("{}: line {}", path, number);
    lines.push_back(line_of(parse_json(line, where), where));
  }
  if (lines.empty()) throw InputError(path, "has no lines");
  return lines;
}

std::vector<PosePair> match_poses(const std::vector<PoseLine>& found,
                                  const std::vector<PoseLine>& truth) {
  std::map<std::string, const PoseLine*> of_image;
  for (const PoseLine& line : found) of_image[line.image] = &line;
  std::vector<PosePair> pairs;
  for (const PoseLine& line : truth) {
    const auto at = of_image.find(line.image);
    if (!line.rotation || at == of_image.end() || !at->second->rotation) continue;
    pairs.push_back({line.image, *at->second->rotation, *line.rotation, at->second->translation,
                     line.translation, at->second->sigma_deg, at->second->sigma_floor_deg});
  }
  return pairs;
}

std::optional<PointingName> parse_pointing_name(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  std::string_view rest = stem;
  // Each number with its min and max count of digits; the last two have a sign.
  const auto number = [&](std::size_t min_digits, std::size_t max_digits, bool is_signed) {
    const std::size_t begin = is_signed && (rest.starts_with('+') || rest.starts_with('-')) ? 1 : 0;
    std::size_t end = begin;
    while (end < rest.size() && end < begin + max_digits && rest[end] >= '0' && rest[end] <= '9')
      ++end;
    const std::string_view word = rest.substr(0, end);
    rest.remove_prefix(end);
    return end >= begin + min_digits && (begin == 1) == is_signed ? to_number(word) : std::nullopt;
  };
  for (const std::string_view name : {"personne", "personn", "persone", "person"}) {
    if (!rest.starts_with(name)) continue;
    rest.remove_prefix(name.size());
    const auto person = number(2, 2, false);
    const auto series = number(1, 1, false);
    const auto image = number(2, 2, false);
    const auto tilt = number(1, 2, true);
    const auto pan = number(1, 2, true);
    if (!person || !series || !image || !tilt || !pan || !rest.empty()) return std::nullopt;
    return PointingName{static_cast<int>(*person), *tilt, *pan};
  }
  return std::nullopt;
}

Gaze gaze_of_rotation(const Eigen::Matrix3d& r) {
  return {std::atan2(r(0, 2), r(2, 2)) / kRadiansPerDegree,
          std::asin(std::clamp(r(1, 2), -1.0, 1.0)) / kRadiansPerDegree};
}

Eigen::Vector3d forward_of_gaze(const Gaze& gaze) {
  const double across = std::cos(gaze.elevation_deg * kRadiansPerDegree);
  return {-std::sin(gaze.azimuth_deg * kRadiansPerDegree) * across,
          -std::sin(gaze.elevation_deg * kRadiansPerDegree),
          -std::cos(gaze.azimuth_deg * kRadiansPerDegree) * across};
}

HeadAngles angles_towards(const Eigen::Vector3d& forward, double roll_deg) {
  const double c = std::cos(roll_deg * kRadiansPerDegree);
  const double s = std::sin(roll_deg * kRadiansPerDegree);
  const double x = c * forward[0] + s * forward[1];
  const double y = -s * forward[0] + c * forward[1];
  return {std::asin(std::clamp(-x, -1.0, 1.0)) / kRadiansPerDegree,
          std::atan2(-y, -forward[2]) / kRadiansPerDegree, roll_deg};
}

PointingScore score_pointing(const std::vector<PointingOutcome>& outcomes) {
  PointingScore score;
  std::vector<double> yaw;
  std::vector<double> pitch;
  std::vector<double> azimuth;
  std::vector<double> elevation;
  std::map<double, std::vector<double>> of_pan;
  std::map<double, std::vector<double>> of_tilt;
  for (const PointingOutcome& outcome : outcomes) {
    if (std::abs(outcome.truth.pan_deg) > 45 || std::abs(outcome.truth.tilt_deg) > 30) continue;
    ++score.images;
    score.detected += outcome.face_detected ? 1 : 0;
    if (!outcome.rotation) continue;
    const HeadAngles angles = angles_of_rotation(*outcome.rotation);
    const Gaze gaze = gaze_of_rotation(*outcome.rotation);
    azimuth.push_back(gaze.azimuth_deg - outcome.truth.pan_deg);
    elevation.push_back(gaze.elevation_deg - outcome.truth.tilt_deg);
    ++score.with_pose;
    score.detected_with_pose += outcome.face_detected ? 1 : 0;
    yaw.push_back(angles.yaw_deg - outcome.truth.pan_deg);
    pitch.push_back(angles.pitch_deg - outcome.truth.tilt_deg);
    if (outcome.sigma_deg) {
      const HeadAngles named = angles_towards(
          forward_of_gaze({outcome.truth.pan_deg, outcome.truth.tilt_deg}), angles.roll_deg);
      score.coverage.yaw.add(angles.yaw_deg - named.yaw_deg, (*outcome.sigma_deg)[0]);
      score.coverage.pitch.add(angles.pitch_deg - named.pitch_deg, (*outcome.sigma_deg)[1]);
    }
    of_pan[outcome.truth.pan_deg].push_back(angles.yaw_deg);
    of_tilt[outcome.truth.tilt_deg].push_back(angles.pitch_deg);
  }
  const auto mae = [](const std::vector<double>& errors, double offset) {
    double sum = 0;
    for (const double e : errors) sum += std::abs(e - offset);
    return errors.empty() ? 0 : sum / static_cast<double>(errors.size());
  };
  score.yaw_offset_deg = median(yaw);
  score.pitch_offset_deg = median(pitch);
  score.yaw_mae_deg = mae(yaw, score.yaw_offset_deg);
  score.pitch_mae_deg = mae(pitch, score.pitch_offset_deg);
  score.azimuth_mae_deg = mae(azimuth, median(azimuth));
  score.elevation_mae_deg = mae(elevation, median(elevation));
  score.yaw_mae_raw_deg = mae(yaw, 0);
  score.pitch_mae_raw_deg = mae(pitch, 0);
  for (const auto& [pan, values] : of_pan) score.yaw_of_pan[pan] = mean(values);
  for (const auto& [tilt, values] : of_tilt) score.pitch_of_tilt[tilt] = mean(values);
  score.yaw_rises = score.yaw_of_pan.size() > 1;
  double last = -1e9;
  for (const auto& [pan, value] : score.yaw_of_pan) {
    score.yaw_rises = score.yaw_rises && value > last;
    last = value;
  }
  return score;
}

std::optional<cv::Rect2d> pointing_box(const std::string& image) {
  const std::string path = std::filesystem::path(image).replace_extension(".txt").string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  std::istringstream text(read_file(path, 100'000));
  std::string word;
  std::vector<double> values;
  while (text >> word && values.size() < 4) {
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (end != word.c_str() && *end == '\0' && std::isfinite(value)) values.push_back(value);
  }
  if (values.size() != 4 || !(values[2] > 0) || !(values[3] > 0)) {
    throw InputError(path, "no face as centre x, centre y, width, height");
  }
  return cv::Rect2d(values[0] - values[2] / 2, values[1] - values[3] / 2, values[2], values[3]);
}

HeadComparison compare_head(const HeadModel& head, const std::string& path) {
  const Eigen::Matrix3Xd truth = read_landmarks3d(path);
  if (truth.cols() != head.points()) {
    throw InputError(path, fmt::format("has {} points, the head {}", truth.cols(), head.points()));
  }
  // In the head's mm: the ground truth may be in cm.
  HeadComparison comparison;
  comparison.all_mm = aligned_error(truth, head.mean);
  if (head.points() == 68) {
    std::vector<int> inner(51);
    std::iota(inner.begin(), inner.end(), 17);
    comparison.inner_mm = aligned_error(truth, head.mean, inner);
  }
  return comparison;
}

}  // namespace tarsier::face::head
