// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/linalg/model_fields.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face::appearance {
namespace {

using Eigen::Index;
using nlohmann::json;

constexpr const char* kType = "appearance-model";
constexpr int kVersion = 1;
constexpr double kMaxFrame = 2000;  // px, of a frame's side

void list_texture(linalg::ModelFields& file, Texture& texture) {
  const auto size =
      static_cast<std::int64_t>(texture.warp.pixels().size()) * channel_count(texture.channels);
  file.named("channels", texture.channels, parse_channels, 32);
  file.number("px_per_unit", texture.px_per_unit, 1e-3, 1e5);
  file.list<float>("mean", texture.mean, size);
  // Mode by mode; signed 8-bit numbers are stored as bytes 0..255 with an offset of 128.
  PackedArray<std::uint8_t> modes{{texture.packed_modes.cols(), texture.packed_modes.rows()}, {}};
  modes.values.reserve(static_cast<std::size_t>(texture.packed_modes.size()));
  for (Index k = 0; k < texture.packed_modes.size(); ++k)
    modes.values.push_back(static_cast<std::uint8_t>(texture.packed_modes.data()[k] + 128));
  file.array("modes", modes, {-1, size});
  const std::int64_t count = modes.shape[0];
  file.require(count <= 1000, "{} texture modes", count);
  if (file.reads()) {
    texture.packed_modes.resize(size, count);
    for (std::size_t k = 0; k < modes.values.size(); ++k)
      texture.packed_modes.data()[k] = static_cast<std::int8_t>(int{modes.values[k]} - 128);
  }
  file.list<float>("steps", texture.steps, count);
  file.list<double>("deviation", texture.deviation, count);
  file.number("variance_kept", texture.variance_kept, 0, 1);
  file.number("noise", texture.noise, 0, 1e6);
  file.number("usual_offset", texture.mean_offset, -1e6, 1e6);
  file.number("usual_gain", texture.mean_gain, 0, 1e6);
}

Texture texture_from_json(const AppearanceModel& model, const json& value,
                          const std::string& path) {
  linalg::ModelFields file(value, path);
  Channels channels{};
  double px_per_unit = 0;
  file.named("channels", channels, parse_channels, 32);
  file.number("px_per_unit", px_per_unit, 1e-3, 1e5);
  const Eigen::Matrix2Xd all = model.extended(model.shape.mean);
  const Eigen::Vector2d extent = all.rowwise().maxCoeff() - all.rowwise().minCoeff();
  file.require(px_per_unit * extent.maxCoeff() <= kMaxFrame,
               "px_per_unit {}: frames of at most {} px are possible", px_per_unit, kMaxFrame);
  Texture texture = empty_texture(model, channels, px_per_unit);
  list_texture(file, texture);
  return texture;
}

void require_points(const linalg::ModelFields& file, const char* name,
                    const std::vector<std::int32_t>& indices, int points) {
  for (const std::int32_t index : indices)
    file.require(index >= 0 && index < points, "{}: point {} of {}", name, index, points);
}

// Lists all fields except the textures.
void list_shape(linalg::ModelFields& file, AppearanceModel& model) {
  file.item("shape", model.shape, shape::shape_model_from_json);
  const int n = model.points();
  file.number("margin", model.margin, 0, 1);
  file.list<std::int32_t>("outer", model.outer, -1);
  require_points(file, "outer", model.outer, n);
  file.require(model.outer.size() <= static_cast<std::size_t>(n), "outer: {} of {} points",
               model.outer.size(), n);
  PackedArray<std::int32_t> mesh{{static_cast<std::int64_t>(model.mesh.size()), 3}, {}};
  for (const auto& triangle : model.mesh)
    mesh.values.insert(mesh.values.end(), triangle.begin(), triangle.end());
  file.array("mesh", mesh, {-1, 3});
  const std::vector<std::int32_t>& corners = mesh.values;
  require_points(file, "mesh", corners, n + static_cast<int>(model.outer.size()));
  file.require(corners.size() <= 30U * (static_cast<unsigned>(n) + model.outer.size()),
               "mesh: {} triangles", corners.size() / 3);
  if (file.reads())
    for (std::size_t k = 0; k + 2 < corners.size(); k += 3)
      model.mesh.push_back({corners[k], corners[k + 1], corners[k + 2]});
  file.number("lost_error", model.lost_error, 0, 1e6);
  file.part("place", model.shape_in_box, [](linalg::ModelFields& part, ShapeInBox& shape_in_box) {
    part.number("dx", shape_in_box.dx, -10, 10);
    part.number("dy", shape_in_box.dy, -10, 10);
    part.number("size", shape_in_box.size, 1e-3, 10);
    part.whole("seen", shape_in_box.boxes, 0, 1'000'000'000);
  });
}

}  // namespace

json to_json(const AppearanceModel& model) {
  model.check();
  json value = linalg::written(model, list_shape);
  for (const Texture& level : model.levels)
    value["levels"].push_back(linalg::written(level, list_texture));
  if (model.colour) value["colour"] = linalg::written(*model.colour, list_texture);
  return value;
}

AppearanceModel appearance_model_from_json(const json& value, const std::string& path) {
  const auto fields = [&](linalg::ModelFields& file, AppearanceModel& model) {
    list_shape(file, model);
    for (const json& level : file.list_of("levels", 1, 5))
      model.levels.push_back(texture_from_json(model, level, path));
    if (value.contains("colour")) model.colour = texture_from_json(model, value["colour"], path);
  };
  return linalg::read_checked<AppearanceModel>(value, path, fields, "no appearance model: ");
}

void write_appearance_model(const std::string& path, const AppearanceModel& model,
                            const json& provenance) {
  write_archive(path, {kType, kVersion, provenance, to_json(model)});
}

AppearanceModel read_appearance_model(const std::string& path) {
  return appearance_model_from_json(read_archive(path, kType, kVersion).payload, path);
}

}  // namespace tarsier::face::appearance
