// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/statistics.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::planar::markers {
namespace {

using nlohmann::json;

constexpr std::int64_t kMaxBytes = 256'000'000;
constexpr ArchiveLimits kLineLimits{10'000'000, 16, 1'000'000};

// The fault of a line; read_lines() adds its number.
struct BadLine {
  std::string reason;
};

std::vector<double> numbers_of(const json& value, std::size_t min_count, std::size_t max_count,
                               std::string_view name) {
  if (!value.is_array() || value.size() < min_count || value.size() > max_count)
    throw BadLine{fmt::format("\"{}\" needs {} numbers", name, min_count)};
  std::vector<double> numbers;
  for (const json& number : value) {
    if (!number.is_number() || !std::isfinite(number.get<double>()))
      throw BadLine{fmt::format("\"{}\": expected only numbers", name)};
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

const json& member(const json& object, const char* name) {
  const auto it = object.find(name);
  if (it == object.end()) throw BadLine{fmt::format("no \"{}\"", name)};
  return *it;
}

std::string text_of(const json& object, const char* name, bool is_required) {
  const auto it = object.find(name);
  if (it == object.end() && !is_required) return "";
  if (it == object.end() || !it->is_string())
    throw BadLine{fmt::format("\"{}\": expected a text", name)};
  return it->get<std::string>();
}

double number_of(const json& object, const char* name, double default_value) {
  const auto it = object.find(name);
  if (it == object.end() || it->is_null()) return default_value;
  if (!it->is_number() || !std::isfinite(it->get<double>()))
    throw BadLine{fmt::format("\"{}\": expected a number", name)};
  return it->get<double>();
}

MarkerRecord marker_of(const json& object) {
  if (!object.is_object()) throw BadLine{"a marker is not a JSON object"};
  MarkerRecord marker;
  const double id = number_of(object, "id", -1);
  if (id < 0 || id > 1e6 || id != std::floor(id)) throw BadLine{"a marker's \"id\" is none"};
  marker.id = static_cast<int>(id);
  const json& corners = member(object, "corners");
  if (!corners.is_array() || corners.size() != 4) throw BadLine{"a marker needs four \"corners\""};
  for (std::size_t k = 0; k < 4; ++k) {
    const auto xy = numbers_of(corners[k], 2, 2, "corners");
    marker.corners[k] = {xy[0], xy[1]};
  }
  marker.side_px = number_of(object, "side_px", 50);
  const auto rvec = object.find("rvec");
  const auto tvec = object.find("tvec");
  if (rvec != object.end() && tvec != object.end() && !rvec->is_null() && !tvec->is_null()) {
    const auto r = numbers_of(*rvec, 3, 3, "rvec");
    const auto t = numbers_of(*tvec, 3, 3, "tvec");
    marker.pose = geometry::Rigid3{geometry::rotation_by({r[0], r[1], r[2]}), {t[0], t[1], t[2]}};
  }
  return marker;
}

std::vector<MarkerRecord> markers_of(const json& line) {
  const json& list = member(line, "markers");
  if (!list.is_array() || list.size() > 10000) throw BadLine{"\"markers\": expected a list"};
  std::vector<MarkerRecord> markers;
  for (const json& marker : list) markers.push_back(marker_of(marker));
  return markers;
}

MarkerTruth truth_of(const json& line) {
  MarkerTruth truth;
  truth.image = text_of(line, "image", true);
  truth.family = text_of(line, "family", false);
  truth.target = text_of(line, "target", false);
  if (truth.family.empty() && truth.target.empty())
    throw BadLine{"neither \"family\" nor \"target\""};
  truth.level = text_of(line, "level", false);
  truth.size = number_of(line, "size", 0);
  if (truth.size < 0) throw BadLine{"\"size\" is negative"};
  const auto k = numbers_of(member(line, "K"), 9, 9, "K");
  if (!(k[0] > 0 && k[4] > 0)) throw BadLine{"\"K\" has no focal length"};
  truth.camera.fx = k[0];
  truth.camera.fy = k[4];
  truth.camera.cx = k[2];
  truth.camera.cy = k[5];
  if (const auto dist = line.find("dist"); dist != line.end()) {
    const auto numbers = numbers_of(*dist, 0, 8, "dist");
    std::copy(numbers.begin(), numbers.end(), truth.camera.distortion.begin());
    if (numbers.size() > 5) truth.camera.lens = geometry::Lens::kRational;
  }
  truth.markers = markers_of(line);
  return truth;
}

void read_lines(const std::string& path, const std::function<void(const json&)>& take) {
  std::istringstream file(read_file(path, kMaxBytes));
  std::string text;
  for (int number = 1; std::getline(file, text); ++number) {
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    try {
      const json line = parse_json(text, path, kLineLimits);
      if (!line.is_object()) throw BadLine{"no JSON object"};
      take(line);
    } catch (const InputError&) {
      throw InputError(path, fmt::format("line {} is not valid JSON", number));
    } catch (const BadLine& bad) {
      throw InputError(path, fmt::format("line {}: {}", number, bad.reason));
    }
  }
}

// NaN for an empty list.
double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  return quantile(values, share);
}

double mean_distance(const MarkerRecord& found, const MarkerRecord& truth, std::size_t turn) {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k)
    sum += cv::norm(found.corners[(k + turn) % 4] - truth.corners[k]);
  return sum / 4;
}

double degrees_between(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return geometry::angle_of(a * b.transpose()) * 180 / CV_PI;
}

}  // namespace

MarkerRecord record_of(const Marker& marker, const std::optional<MarkerPose>& pose) {
  MarkerRecord result;
  result.id = marker.id;
  for (std::size_t k = 0; k < 4; ++k)
    result.corners[k] = {marker.corners[k].x(), marker.corners[k].y()};
  if (pose) result.pose = pose->camera_from_marker;
  return result;
}

std::vector<MarkerTruth> read_marker_truth(const std::string& path) {
  std::vector<MarkerTruth> truth;
  read_lines(path, [&](const json& line) { truth.push_back(truth_of(line)); });
  if (truth.empty()) throw InputError(path, "has no lines");
  return truth;
}

std::map<std::string, ImageDetections> read_detected_markers(const std::string& path) {
  std::map<std::string, ImageDetections> found;
  read_lines(path, [&](const json& line) {
    ImageDetections& entry = found[text_of(line, "image", true)];
    entry.markers = markers_of(line);
    if (line.contains("ms")) entry.ms = number_of(line, "ms", 0);
  });
  return found;
}

void MarkerEvaluator::add(const MarkerTruth& truth, std::span<const MarkerRecord> found,
                          std::optional<double> ms) {
  ++counts_.images;
  if (ms) ms_.push_back(*ms);
  auto& level = counts_.levels[truth.level];
  counts_.truth += static_cast<int>(truth.markers.size());
  level.second += static_cast<int>(truth.markers.size());
  std::vector<bool> is_matched(truth.markers.size(), false);
  for (const MarkerRecord& marker : found) {
    const MarkerRecord* right = nullptr;
    bool is_rotated = false;
    for (std::size_t i = 0; i < truth.markers.size() && right == nullptr; ++i) {
      const MarkerRecord& there = truth.markers[i];
      if (is_matched[i] || there.id != marker.id) continue;
      const double limit = std::max(3.0, tolerance_ * there.side_px);
      if (mean_distance(marker, there, 0) < limit) {
        is_matched[i] = true;
        right = &there;
      }
      for (std::size_t turn = 1; turn < 4 && right == nullptr; ++turn)
        is_rotated = is_rotated || mean_distance(marker, there, turn) < limit;
    }
    if (right == nullptr) {
      ++counts_.false_positives;
      counts_.rotated += is_rotated ? 1 : 0;
      continue;
    }
    ++counts_.true_positives;
    ++level.first;
    double squares = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const cv::Point2d d = marker.corners[k] - right->corners[k];
      squares += d.dot(d);
    }
    corner_px_.push_back(std::sqrt(squares / 4));
    if (marker.pose && right->pose) {
      rotation_deg_.push_back(degrees_between(marker.pose->rotation, right->pose->rotation));
      distance_percent_.push_back(100 *
                                  (marker.pose->translation - right->pose->translation).norm() /
                                  std::max(1e-12, right->pose->translation.norm()));
    }
  }
}

MarkerScore MarkerEvaluator::score() const {
  constexpr double kFlip = 15;  // degrees
  MarkerScore score = counts_;
  score.corner_px = quantile_of(corner_px_, 0.5);
  score.corner_px_p95 = quantile_of(corner_px_, 0.95);
  score.rotation_deg = quantile_of(rotation_deg_, 0.5);
  score.rotation_deg_p95 = quantile_of(rotation_deg_, 0.95);
  score.distance_percent = quantile_of(distance_percent_, 0.5);
  score.ms = quantile_of(ms_, 0.5);
  if (!rotation_deg_.empty()) {
    const auto flips = std::count_if(rotation_deg_.begin(), rotation_deg_.end(),
                                     [](double angle) { return angle > kFlip; });
    score.flips_percent =
        100 * static_cast<double>(flips) / static_cast<double>(rotation_deg_.size());
  }
  return score;
}

}  // namespace tarsier::planar::markers
