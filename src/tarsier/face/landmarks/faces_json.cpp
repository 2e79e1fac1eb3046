// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/faces_json.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

namespace tarsier::face::landmarks {

namespace {

double hundredth(double value) { return std::round(value * 100) / 100; }
double thousandth(double value) { return std::round(value * 1000) / 1000; }

nlohmann::ordered_json points_json(const Eigen::Matrix2Xd& points) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (Eigen::Index p = 0; p < points.cols(); ++p) {
    list.push_back({hundredth(points(0, p)), hundredth(points(1, p))});
  }
  return list;
}

nlohmann::ordered_json numbers_json(const Eigen::VectorXd& numbers) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const double number : numbers) list.push_back(hundredth(number));
  return list;
}

nlohmann::ordered_json box_json(const cv::Rect2d& box) {
  return {hundredth(box.x), hundredth(box.y), hundredth(box.width), hundredth(box.height)};
}

std::string canonical(const std::string& path) {
  std::error_code error;
  const std::filesystem::path result = std::filesystem::weakly_canonical(path, error);
  return error ? path : result.string();
}

std::optional<Eigen::Matrix2Xd> points_of(const nlohmann::json& value, const std::string& where) {
  if (!value.is_array() || value.size() > 10000) throw InputError(where, "points must be a list");
  if (value.empty()) return std::nullopt;
  Eigen::Matrix2Xd points(2, static_cast<Eigen::Index>(value.size()));
  for (std::size_t p = 0; p < value.size(); ++p) {
    const nlohmann::json& point = value[p];
    if (!point.is_array() || point.size() < 2 || !point[0].is_number() || !point[1].is_number()) {
      throw InputError(where, fmt::format("point {} is not [x, y]", p));
    }
    points.col(static_cast<Eigen::Index>(p)) << point[0].get<double>(), point[1].get<double>();
  }
  if (!points.allFinite()) throw InputError(where, "a point is not finite");
  return points;
}

std::optional<Eigen::Matrix2Xd> widest(const nlohmann::json& faces, const std::string& where) {
  if (!faces.is_array()) throw InputError(where, "faces must be a list");
  std::optional<Eigen::Matrix2Xd> best;
  double width = -1;
  for (const nlohmann::json& face : faces) {
    if (!face.is_object() || !face.contains("points")) {
      throw InputError(where, "a face has no points");
    }
    double own = 0;
    if (face.contains("box") && face["box"].is_array() && face["box"].size() == 4 &&
        face["box"][2].is_number()) {
      own = face["box"][2].get<double>();
    }
    if (own <= width) continue;
    width = own;
    best = points_of(face["points"], where);
  }
  return best;
}

}  // namespace

nlohmann::ordered_json faces_json(const std::vector<TrackedFace>& faces, bool with_ids) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const TrackedFace& face : faces) {
    nlohmann::ordered_json item;
    if (with_ids) item["id"] = face.id;
    item["box"] = box_json(face.box);
    item["points"] = points_json(face.points);
    if (face.visibility.visible.size() > 0) {
      item["visible"] = numbers_json(face.visibility.visible);
      item["sigma_px"] = numbers_json(face.visibility.sigma_px);
    }
    item["score"] = thousandth(face.score);
    if (!with_ids) item["detection"] = thousandth(face.detection);
    list.push_back(std::move(item));
  }
  return list;
}

std::optional<Eigen::Matrix2Xd> FaceLines::find(const std::string& image, int count) const {
  const auto found = points.find(canonical(image));
  if (found == points.end() || !found->second) return std::nullopt;
  if (found->second->cols() != count) {
    throw InputError(
        path, fmt::format("{}: {} points, the truth has {}", image, found->second->cols(), count));
  }
  return found->second;
}

FaceLines read_face_lines(const std::string& path) {
  FaceLines lines;
  lines.path = path;
  std::istringstream text(read_file(path, 1'000'000'000));
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = fmt::format("{}:{}", path, number);
    const nlohmann::json value = parse_json(line, where);
    if (!value.is_object() || !value.contains("image") || !value["image"].is_string()) {
      throw InputError(where, "expected an object with \"image\"");
    }
    std::optional<Eigen::Matrix2Xd> points;
    if (value.contains("points") && !value["points"].is_null()) {
      points = points_of(value["points"], where);
    } else if (value.contains("faces")) {
      points = widest(value["faces"], where);
    }
    lines.points[canonical(value["image"].get<std::string>())] = std::move(points);
  }
  return lines;
}

}  // namespace tarsier::face::landmarks
