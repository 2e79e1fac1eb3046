// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace tarsier::face::appearance {
namespace {

using Eigen::Index;
using nlohmann::json;

constexpr const char* kType = "appearance-model";
constexpr int kVersion = 1;
constexpr double kMaxFrame = 2000;  // px, of a frame's side

template <typename T, typename Vector>
json pack_vector(const Vector& vector) {
  return pack(PackedArray<T>{{vector.size()}, {vector.data(), vector.data() + vector.size()}});
}

json texture_to_json(const Texture& texture) {
  // Mode by mode; 8 bit numbers with sign as the bytes 0..255 of theirs + 128.
  PackedArray<std::uint8_t> modes;
  modes.shape = {texture.packed_modes.cols(), texture.packed_modes.rows()};
  modes.values.reserve(static_cast<std::size_t>(texture.packed_modes.size()));
  for (Index k = 0; k < texture.packed_modes.size(); ++k)
    modes.values.push_back(static_cast<std::uint8_t>(texture.packed_modes.data()[k] + 128));
  return {{"channels", name_of(texture.channels)},
          {"px_per_unit", texture.px_per_unit},
          {"mean", pack_vector<float>(texture.mean)},
          {"modes", pack(modes)},
          {"steps", pack_vector<float>(texture.steps)},
          {"deviation", pack_vector<double>(texture.deviation)},
          {"variance_kept", texture.variance_kept},
          {"noise", texture.noise},
          {"usual_offset", texture.usual_offset},
          {"usual_gain", texture.usual_gain}};
}

Texture texture_from_json(const AppearanceModel& model, const json& value,
                          const std::string& path) {
  Channels channels{};
  const std::string name = text_member(value, "channels", path, 32);
  try {
    channels = parse_channels(name);
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  const double px_per_unit = number_member(value, "px_per_unit", path, 1e-3, 1e5);
  const Eigen::Matrix2Xd all = model.extended(model.shape.mean);
  const Eigen::Vector2d extent = all.rowwise().maxCoeff() - all.rowwise().minCoeff();
  if (!(px_per_unit * extent.maxCoeff() <= kMaxFrame))
    throw ModelError(path, fmt::format("px_per_unit {}: frames of at most {} px are possible",
                                       px_per_unit, kMaxFrame));
  Texture texture = empty_texture(model, channels, px_per_unit);
  const auto size =
      static_cast<std::int64_t>(texture.warp.pixels().size()) * channel_count(channels);
  const auto mean = unpack<float>(member(value, "mean", path), path, "mean", {size});
  texture.mean = Eigen::Map<const Eigen::VectorXf>(mean.values.data(), size);
  const auto modes = unpack<std::uint8_t>(member(value, "modes", path), path, "modes", {-1, size});
  const std::int64_t count = modes.shape[0];
  if (count > 1000) throw ModelError(path, fmt::format("{} texture modes", count));
  texture.packed_modes.resize(size, count);
  for (std::size_t k = 0; k < modes.values.size(); ++k)
    texture.packed_modes.data()[k] = static_cast<std::int8_t>(int{modes.values[k]} - 128);
  const auto steps = unpack<float>(member(value, "steps", path), path, "steps", {count});
  texture.steps = Eigen::Map<const Eigen::VectorXf>(steps.values.data(), count);
  const auto deviation =
      unpack<double>(member(value, "deviation", path), path, "deviation", {count});
  texture.deviation = Eigen::Map<const Eigen::VectorXd>(deviation.values.data(), count);
  texture.variance_kept = number_member(value, "variance_kept", path, 0, 1);
  texture.noise = number_member(value, "noise", path, 0, 1e6);
  texture.usual_offset = number_member(value, "usual_offset", path, -1e6, 1e6);
  texture.usual_gain = number_member(value, "usual_gain", path, 0, 1e6);
  return texture;
}

std::vector<int> indices(const json& value, const std::string& path, const char* name,
                         std::int64_t columns, int points) {
  const auto array =
      columns == 1 ? unpack<std::int32_t>(member(value, name, path), path, name, {-1})
                   : unpack<std::int32_t>(member(value, name, path), path, name, {-1, columns});
  for (const std::int32_t index : array.values) {
    if (index < 0 || index >= points)
      throw ModelError(path, fmt::format("{}: point {} of {}", name, index, points));
  }
  return {array.values.begin(), array.values.end()};
}

}  // namespace

json to_json(const AppearanceModel& model) {
  model.check();
  PackedArray<std::int32_t> mesh;
  mesh.shape = {static_cast<std::int64_t>(model.mesh.size()), 3};
  for (const auto& triangle : model.mesh)
    mesh.values.insert(mesh.values.end(), triangle.begin(), triangle.end());
  json levels = json::array();
  for (const Texture& level : model.levels) levels.push_back(texture_to_json(level));
  json value = {
      {"shape", shape::to_json(model.shape)},
      {"margin", model.margin},
      {"outer", pack(PackedArray<std::int32_t>{{static_cast<std::int64_t>(model.outer.size())},
                                               {model.outer.begin(), model.outer.end()}})},
      {"mesh", pack(mesh)},
      {"levels", std::move(levels)},
      {"lost_error", model.lost_error},
      {"place",
       {{"dx", model.place.dx},
        {"dy", model.place.dy},
        {"size", model.place.size},
        {"seen", model.place.seen}}}};
  if (model.colour) value["colour"] = texture_to_json(*model.colour);
  return value;
}

AppearanceModel appearance_model_from_json(const json& value, const std::string& path) {
  AppearanceModel model;
  model.shape = shape::shape_model_from_json(member(value, "shape", path), path);
  const int n = model.shape.points();
  model.margin = number_member(value, "margin", path, 0, 1);
  model.outer = indices(value, path, "outer", 1, n);
  if (model.outer.size() > static_cast<std::size_t>(n))
    throw ModelError(path, fmt::format("outer: {} of {} points", model.outer.size(), n));
  const std::vector<int> corners =
      indices(value, path, "mesh", 3, n + static_cast<int>(model.outer.size()));
  if (corners.size() > 30U * (static_cast<unsigned>(n) + model.outer.size()))
    throw ModelError(path, fmt::format("mesh: {} triangles", corners.size() / 3));
  for (std::size_t k = 0; k + 2 < corners.size(); k += 3)
    model.mesh.push_back({corners[k], corners[k + 1], corners[k + 2]});
  model.lost_error = number_member(value, "lost_error", path, 0, 1e6);
  const json& place = member(value, "place", path);
  model.place.dx = number_member(place, "dx", path, -10, 10);
  model.place.dy = number_member(place, "dy", path, -10, 10);
  model.place.size = number_member(place, "size", path, 1e-3, 10);
  model.place.seen = static_cast<int>(integer_member(place, "seen", path, 0, 1'000'000'000));
  const json& levels = member(value, "levels", path);
  if (!levels.is_array() || levels.empty() || levels.size() > 5)
    throw ModelError(path, "levels: a list of 1 to 5 is expected");
  try {
    for (const json& level : levels) model.levels.push_back(texture_from_json(model, level, path));
    if (value.contains("colour")) model.colour = texture_from_json(model, value["colour"], path);
    model.check();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, std::string("no appearance model: ") + error.what());
  }
  return model;
}

void write_appearance_model(const std::string& path, const AppearanceModel& model,
                            const json& provenance) {
  write_archive(path, {kType, kVersion, provenance, to_json(model)});
}

AppearanceModel read_appearance_model(const std::string& path) {
  return appearance_model_from_json(read_archive(path, kType, kVersion).payload, path);
}

}  // namespace tarsier::face::appearance
