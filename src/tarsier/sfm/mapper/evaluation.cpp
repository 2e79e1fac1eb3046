// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/evaluation.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMaxTruthBytes = 100'000'000;
constexpr ArchiveLimits kLineLimits{1'000'000, 16, 100'000};
constexpr double kThresholds[] = {0.5, 1, 3, 5};

std::vector<double> numbers(const nlohmann::json& line, const char* key, std::size_t count) {
  if (!line.contains(key) || !line[key].is_array() || line[key].size() != count) return {};
  std::vector<double> result;
  for (const auto& value : line[key]) {
    if (!value.is_number() || !std::isfinite(value.get<double>())) return {};
    result.push_back(value.get<double>());
  }
  return result;
}

double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

// The larger one of the errors of rotation and translation direction between two images, degrees.
double pair_error(const geometry::Rigid3& a, const geometry::Rigid3& b,
                  const geometry::Rigid3& true_a, const geometry::Rigid3& true_b) {
  const geometry::Rigid3 relative = b * a.inverse();
  const geometry::Rigid3 expected = true_b * true_a.inverse();
  const double rotation = geometry::angle_of(relative.rotation * expected.rotation.transpose());
  const double direction = angle_between(relative.translation, expected.translation);
  return std::max(rotation, direction) * kDegreesPerRadian;
}

// Area under recall(error) from 0 to the threshold, in percent of the threshold.
double area(std::vector<double> errors, double threshold) {
  if (errors.empty()) return 0;
  std::sort(errors.begin(), errors.end());
  const auto count = static_cast<double>(errors.size());
  double sum = 0;
  double last_error = 0;
  double last_recall = 0;
  for (std::size_t i = 0; i < errors.size() && errors[i] <= threshold; ++i) {
    const double recall = static_cast<double>(i + 1) / count;
    sum += (errors[i] - last_error) * (last_recall + recall) / 2;
    last_error = errors[i];
    last_recall = recall;
  }
  sum += (threshold - last_error) * last_recall;
  return 100 * sum / threshold;
}

}  // namespace

PoseTruth read_pose_truth(const std::string& path) {
  PoseTruth truth;
  if (std::filesystem::is_directory(path)) {
    for (const Image& image : read_colmap_poses(path).images)
      if (image.registered) truth[image.name] = image.pose;
    return truth;
  }
  std::istringstream file(read_file(path, kMaxTruthBytes));
  std::string text;
  for (int number = 1; std::getline(file, text); ++number) {
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    const auto fail = [&](const char* what) {
      throw InputError(path, fmt::format("line {}: {}", number, what));
    };
    nlohmann::json line;
    try {
      line = parse_json(text, path, kLineLimits);
    } catch (const InputError&) {
      fail("is not JSON");
    }
    if (!line.is_object() || !line.contains("name") || !line["name"].is_string())
      fail("expected {\"name\", \"R\", \"C\"}");
    const std::vector<double> r = numbers(line, "R", 9);
    const std::vector<double> c = numbers(line, "C", 3);
    const std::vector<double> t = numbers(line, "t", 3);
    if (r.empty() || (c.empty() && t.empty())) fail("\"R\" has 9 numbers, \"C\" or \"t\" 3");
    geometry::Rigid3 pose;
    pose.rotation = geometry::from_row_major(std::span(r).first<9>());
    if (std::abs(pose.rotation.determinant() - 1) > 0.01) fail("\"R\" is not a rotation matrix");
    pose.translation = Eigen::Vector3d((c.empty() ? t : c).data());
    if (!c.empty()) pose.translation = -(pose.rotation * pose.translation);
    truth[line["name"].get<std::string>()] = pose;
  }
  if (truth.empty()) throw InputError(path, "contains no poses");
  return truth;
}

PoseScores evaluate_poses(const Model& model, const PoseTruth& truth, const std::string& name) {
  PoseScores scores;
  scores.total = static_cast<int>(truth.size());
  std::map<std::string, geometry::Rigid3> found;
  for (const Image& image : model.images)
    if (image.registered && truth.contains(image.name)) found[image.name] = image.pose;
  scores.registered = static_cast<int>(found.size());
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  std::vector<std::string> names;
  for (const auto& [image, pose] : found) {
    from.push_back(pose.center());
    to.push_back(truth.at(image).center());
    names.push_back(image);
  }
  const auto similarity =
      geometry::similarity_between(geometry::columns_of(from), geometry::columns_of(to));
  if (!similarity) {
    throw InputError(name, fmt::format("the model and the ground truth have {} images in common; "
                                       "three whose positions are not collinear are needed",
                                       found.size()));
  }
  std::vector<double> errors;
  // The rotation between the two worlds that fits all orientations best. The rotation from the
  // centres is inaccurate where these are nearly collinear.
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const std::string& image : names)
    sum += truth.at(image).rotation.transpose() * found.at(image).rotation;
  const Eigen::Matrix3d true_from_found = geometry::nearest_rotation(sum);
  double rotations = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    errors.push_back((*similarity * from[i] - to[i]).norm());
    if (errors.back() > scores.center_max) {
      scores.center_max = errors.back();
      scores.center_worst = names[i];
    }
    const Eigen::Matrix3d rotation = found.at(names[i]).rotation * true_from_found.transpose();
    rotations +=
        geometry::angle_of(rotation * truth.at(names[i]).rotation.transpose()) * kDegreesPerRadian;
  }
  const auto count = static_cast<double>(errors.size());
  scores.center_mean = std::accumulate(errors.begin(), errors.end(), 0.0) / count;
  scores.rotation_mean_deg = rotations / count;
  std::sort(errors.begin(), errors.end());
  scores.center_median = (errors[(errors.size() - 1) / 2] + errors[errors.size() / 2]) / 2;

  Eigen::Vector3d low(1e300, 1e300, 1e300);
  Eigen::Vector3d high = -low;
  std::vector<double> pairs;
  for (auto a = truth.begin(); a != truth.end(); ++a) {
    const Eigen::Vector3d center = a->second.center();
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
    for (auto b = std::next(a); b != truth.end(); ++b) {
      const auto x = found.find(a->first);
      const auto y = found.find(b->first);
      pairs.push_back(x == found.end() || y == found.end()
                          ? 1e9
                          : pair_error(x->second, y->second, a->second, b->second));
    }
  }
  scores.extent = (high - low).norm();
  for (const double threshold : kThresholds) scores.auc[threshold] = area(pairs, threshold);
  return scores;
}

nlohmann::ordered_json scores_json(const PoseScores& scores, const Model& model) {
  const auto rounded = [](double value, double steps) { return std::round(value * steps) / steps; };
  const ModelStatistics statistics = statistics_of(model);
  nlohmann::ordered_json json{
      {"total", scores.total},
      {"registered", scores.registered},
      {"center_mean", rounded(scores.center_mean, 1e6)},
      {"center_median", rounded(scores.center_median, 1e6)},
      {"center_max", rounded(scores.center_max, 1e6)},
      {"center_worst", scores.center_worst},
      {"extent", rounded(scores.extent, 1e4)},
      {"center_mean_percent",
       rounded(100 * scores.center_mean / std::max(scores.extent, 1e-12), 1e5)},
      {"rotation_mean_deg", rounded(scores.rotation_mean_deg, 1e5)}};
  for (const auto& [threshold, value] : scores.auc)
    json[fmt::format("auc@{}", threshold)] = rounded(value, 1e2);
  json["points"] = model.points.size();
  json["mean_track"] = rounded(statistics.mean_track, 1e3);
  json["reprojection_px"] = rounded(statistics.reprojection_px, 1e4);
  return json;
}

}  // namespace tarsier::sfm
