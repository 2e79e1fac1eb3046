// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/linalg/model_fields.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>

namespace tarsier::face::head {
namespace {

using nlohmann::json;

constexpr const char* kType = "head-model";
constexpr int kVersion = 1;
constexpr int kMaxModelPoints = 10'000;

std::vector<int> indices(const json& list, const std::string& path, const std::string& name,
                         std::size_t count) {
  if (!list.is_array() || list.size() != count)
    throw ModelError(path, fmt::format("'{}': expected a list of {} numbers", name, count));
  std::vector<int> result;
  for (const json& item : list) {
    const bool fits = item.is_number_integer() && item >= -1 && item <= 1'000'000;
    if (!fits) throw ModelError(path, fmt::format("'{}': expected a list of indices", name));
    result.push_back(item.get<int>());
  }
  return result;
}

std::vector<int> numbers(const json& object, const std::string& path, const std::string& name,
                         std::size_t count) {
  return indices(member(object, name, path), path, name, count);
}

void list_head_model(linalg::ModelFields& file, HeadModel& model) {
  file.matrix("mean", model.mean, 3, -1);
  file.require(model.points() >= 4 && model.points() <= kMaxModelPoints, "'mean' has {} points",
               model.points());
  const auto points = static_cast<std::size_t>(model.points());
  file.matrix("modes", model.modes, model.mean.size(), -1);
  file.require(model.modes.cols() <= model.mean.size(), "'modes' has {} columns",
               model.modes.cols());
  file.matrix("deviation", model.deviation, model.modes.cols(), 1);
  file.matrix("noise", model.noise, model.points(), 1);
  file.other("mirror", model.mirror, [&](const json& object, const std::string& path) {
    const json& mirror = member(object, "mirror", path);
    return numbers(object, path, "mirror", mirror.is_array() && mirror.empty() ? 0 : points);
  });
  file.other("outer_eyes", model.outer_eyes, [](const json& object, const std::string& path) {
    const std::vector<int> eyes = numbers(object, path, "outer_eyes", 2);
    return std::array{eyes[0], eyes[1]};
  });
  file.other("landmark", model.landmark, [&](const json& object, const std::string& path) {
    return numbers(object, path, "landmark", points);
  });
  file.other("connections", model.connections, [](const json& object, const std::string& path) {
    const json& connections = member(object, "connections", path);
    if (!connections.is_array()) throw ModelError(path, "'connections': expected a list");
    std::vector<std::array<int, 2>> result;
    for (const json& pair : connections) {
      const std::vector<int> ends = indices(pair, path, "connections", 2);
      result.push_back({ends[0], ends[1]});
    }
    return result;
  });
  file.other("outline", model.outline, [&](const json& object, const std::string& path) {
    const json& outline = member(object, "outline", path);
    return indices(outline, path, "outline", std::min(outline.size(), points));
  });
  file.whole("trained_on", model.trained_on, 0);
}

}  // namespace

json to_json(const HeadModel& model) {
  model.check();
  return linalg::written(model, list_head_model);
}

HeadModel head_model_from_json(const json& value, const std::string& path) {
  return linalg::read_checked<HeadModel>(value, path, list_head_model, "no head model: ");
}

void write_head_model(const std::string& path, const HeadModel& model, const json& provenance) {
  write_archive(path, {kType, kVersion, provenance, to_json(model)});
}

HeadModel read_head_model(const std::string& path) {
  return head_model_from_json(read_archive(path, kType, kVersion).payload, path);
}

LandmarkMapping own_mapping(const HeadModel& model) {
  LandmarkMapping mapping;
  mapping.landmarks = model.landmark;
  mapping.model_points.resize(model.landmark.size());
  std::iota(mapping.model_points.begin(), mapping.model_points.end(), 0);
  return mapping;
}

LandmarkMapping read_landmark_mapping(const std::string& path, int model_points, int landmarks) {
  TARSIER_REQUIRE(model_points >= 1 && landmarks >= 1, "{} model points, {} landmarks",
                  model_points, landmarks);
  std::istringstream file(read_file(path, 1'000'000));
  LandmarkMapping mapping;
  std::vector<char> point_seen(static_cast<std::size_t>(model_points), 0);
  std::vector<char> landmark_seen(static_cast<std::size_t>(landmarks), 0);
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const auto fail = [&](const std::string& reason) {
      throw InputError(path, fmt::format("line {}: {}", number, reason));
    };
    line.resize(std::min(line.size(), line.find('#')));
    std::istringstream words(line);
    std::string word;
    if (!(words >> word)) continue;
    std::istringstream pair(line);
    long long point = -1;
    long long landmark = -1;
    if (!(pair >> point >> landmark) || (pair >> word))
      fail("expected two whole numbers, the model's point and the landmark");
    if (point < 0 || point >= model_points)
      fail(fmt::format("model point {} of {}", point, model_points));
    if (landmark < 0 || landmark >= landmarks)
      fail(fmt::format("landmark {} of {}", landmark, landmarks));
    if (point_seen[static_cast<std::size_t>(point)]++ != 0)
      fail(fmt::format("model point {} for the second time", point));
    if (landmark_seen[static_cast<std::size_t>(landmark)]++ != 0)
      fail(fmt::format("landmark {} for the second time", landmark));
    mapping.model_points.push_back(static_cast<int>(point));
    mapping.landmarks.push_back(static_cast<int>(landmark));
  }
  if (mapping.model_points.size() < 4)
    throw InputError(path, fmt::format("{} pairs of points, at least 4 are needed",
                                       mapping.model_points.size()));
  return mapping;
}

}  // namespace tarsier::face::head
