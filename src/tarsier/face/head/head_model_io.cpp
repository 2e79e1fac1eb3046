// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/shape/packed_matrix.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>
#include <stdexcept>

namespace tarsier::face::head {
namespace {

using nlohmann::json;
using shape::packed;
using shape::unpacked;

constexpr const char* kType = "head-model";
constexpr int kVersion = 1;
constexpr int kMaxPoints = 10'000;

std::vector<int> indices(const json& list, const std::string& path, const std::string& name,
                         std::size_t count) {
  if (!list.is_array() || list.size() != count)
    throw ModelError(path, fmt::format("'{}' is no list of {} numbers", name, count));
  std::vector<int> result;
  for (const json& item : list) {
    const bool fits = item.is_number_integer() && item >= -1 && item <= 1'000'000;
    if (!fits) throw ModelError(path, fmt::format("'{}' has what is no index", name));
    result.push_back(item.get<int>());
  }
  return result;
}

std::vector<int> numbers(const json& object, const std::string& path, const std::string& name,
                         std::size_t count) {
  return indices(member(object, name, path), path, name, count);
}

}  // namespace

json to_json(const HeadModel& model) {
  model.check();
  json value;
  value["mean"] = packed(model.mean);
  value["modes"] =
      packed(model.mode_count() > 0 ? model.modes : Eigen::MatrixXd(3 * model.points(), 0));
  value["deviation"] = packed(model.deviation);
  value["noise"] = packed(model.noise);
  value["mirror"] = model.mirror;
  value["outer_eyes"] = model.outer_eyes;
  value["landmark"] = model.landmark;
  value["connections"] = model.connections;
  value["outline"] = model.outline;
  value["trained_on"] = model.trained_on;
  return value;
}

HeadModel head_model_from_json(const json& value, const std::string& path) {
  HeadModel model;
  const Eigen::MatrixXd mean = unpacked(value, path, "mean", 3, -1);
  if (mean.cols() < 4 || mean.cols() > kMaxPoints)
    throw ModelError(path, fmt::format("'mean' has {} points", mean.cols()));
  model.mean = mean;
  const auto points = static_cast<std::size_t>(mean.cols());
  model.modes = unpacked(value, path, "modes", mean.size(), -1);
  if (model.modes.cols() > mean.size())
    throw ModelError(path, fmt::format("'modes' has {} columns", model.modes.cols()));
  model.deviation = unpacked(value, path, "deviation", model.modes.cols(), 1);
  model.noise = unpacked(value, path, "noise", mean.cols(), 1);
  const json& mirror = member(value, "mirror", path);
  const bool has_mirror = !(mirror.is_array() && mirror.empty());
  model.mirror = numbers(value, path, "mirror", has_mirror ? points : 0);
  const std::vector<int> eyes = numbers(value, path, "outer_eyes", 2);
  model.outer_eyes = {eyes[0], eyes[1]};
  model.landmark = numbers(value, path, "landmark", points);
  const json& connections = member(value, "connections", path);
  if (!connections.is_array()) throw ModelError(path, "'connections' is no list");
  for (const json& pair : connections) {
    const std::vector<int> ends = indices(pair, path, "connections", 2);
    model.connections.push_back({ends[0], ends[1]});
  }
  const json& outline = member(value, "outline", path);
  model.outline = indices(outline, path, "outline", std::min(outline.size(), points));
  model.trained_on = static_cast<int>(
      integer_member(value, "trained_on", path, 0, std::numeric_limits<int>::max()));
  try {
    model.check();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, std::string("no head model: ") + error.what());
  }
  return model;
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
